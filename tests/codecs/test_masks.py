import numpy as np
import pytest

from slkit.codecs._masks import Reader, grey, levels, measure_light, saturation, without_rim
from slkit.codecs._noise import Evidence, noise_curve
from slkit.codecs._results import collect, colors_at
from slkit.data import Frames
from slkit.errors import DecodeError, InputError


def noisy(rng: np.random.Generator, level: np.ndarray, read: float, gain: float) -> np.ndarray:
    return (level + rng.normal(0, np.sqrt(read**2 + gain * level))).astype(np.float32)


@pytest.mark.parametrize(("read", "gain"), [(2.0, 0.0), (1.0, 0.05), (0.0, 0.0)])
def test_the_noise_curve_is_that_of_the_sensor(rng: np.random.Generator, read: float, gain: float) -> None:
    level = np.tile(np.linspace(5, 230, 400), (300, 1))
    picture = np.rint(noisy(rng, level, read, gain))
    curve = noise_curve(
        [Evidence(picture.astype(np.float32), picture.astype(np.float32), np.ones(picture.shape, dtype=bool))]
    )
    at = np.array([20, 100, 200], dtype=np.float32)
    np.testing.assert_allclose(curve.at(at), np.sqrt(read**2 + gain * at + 1 / 12), rtol=0.12)


def test_relief_and_print_do_not_count_as_noise(rng: np.random.Generator) -> None:
    level = np.tile(np.linspace(10, 200, 400), (300, 1))
    v, u = np.mgrid[:300, :400]
    # The darker third carries a fine print; what the rest shows still bounds the noise there.
    print_ = np.where((u < 130) & (u > 40), 8 * np.sin(1.7 * u) * np.sin(1.3 * v), 0)
    picture = noisy(rng, level + print_, 1.0, 0.04)
    curve = noise_curve([Evidence(picture, picture, np.ones(picture.shape, dtype=bool))])
    at = np.array([50, 150], dtype=np.float32)
    np.testing.assert_allclose(curve.at(at), np.sqrt(1 + 0.04 * at), rtol=0.15)


def test_tiny_pictures_have_the_noise_of_rounding() -> None:
    picture = np.full((2, 2), 9, np.float32)
    assert noise_curve([Evidence(picture, picture, np.ones((2, 2), dtype=bool))]).at(picture)[0, 0] == pytest.approx(
        12**-0.5
    )


def test_light_masks_what_is_dark_or_saturated(rng: np.random.Generator) -> None:
    white = np.clip(noisy(rng, np.full((60, 80), 120.0), 2.0, 0.0), 0, 254).astype(np.uint8)
    black = np.clip(noisy(rng, np.full((60, 80), 20.0), 2.0, 0.0), 0, 254).astype(np.uint8)
    white[:, :20] = black[:, :20]
    white[10:20, 40:50] = 255
    light = measure_light(white, black, 5.0)
    expected = np.ones((60, 80), dtype=bool)
    expected[:, :20] = expected[10:20, 40:50] = False
    np.testing.assert_array_equal(light.mask, without_rim(expected))
    assert light.noise(light.high)[30, 60] == pytest.approx(2.0, rel=0.15)
    assert light.span.min() >= 1


def test_a_rim_is_one_pixel_wide_and_single_holes_stay_single() -> None:
    mask = np.zeros((20, 30), dtype=bool)
    mask[4:16, 5:] = True
    mask[10, 20] = False
    inner = np.zeros_like(mask)
    inner[5:15, 6:] = True
    inner[10, 20] = False
    np.testing.assert_array_equal(without_rim(mask), inner)


def test_darkness_and_saturation_are_told_apart() -> None:
    dark, full = np.full((20, 20), 7, np.uint8), np.full((20, 20), 255, np.uint8)
    with pytest.raises(DecodeError, match="no pixel is lit"):
        measure_light(dark, dark, 5.0)
    with pytest.raises(DecodeError, match="saturated"):
        measure_light(full, dark, 5.0)


def test_saturation_knows_sensors_of_fewer_bits() -> None:
    picture = np.array([[4095, 100], [4094, 65]], np.uint16)
    assert saturation(picture).tolist() == [[True, False], [False, False]]
    assert not saturation(picture - np.uint16(60)).any()
    color = np.zeros((2, 2, 3), np.uint8)
    color[0, 1, 2] = 255
    assert saturation(color).tolist() == [[False, True], [False, False]]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("turned", [False, True])
def test_grey_is_the_mean_of_the_channels(rng: np.random.Generator, kind: type, turned: bool) -> None:
    picture = rng.integers(0, np.iinfo(kind).max, (37, 53, 3), kind, endpoint=True)
    picture[0, 0], picture[0, 1] = 0, np.iinfo(kind).max
    picture = picture[::-1, :, ::-1] if turned else picture
    found = grey(picture)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, picture.mean(axis=2, dtype=np.float32))
    np.testing.assert_array_equal(levels(picture), found)
    np.testing.assert_array_equal(grey(picture[..., 0]), picture[..., 0])


def test_the_reader_refuses_what_does_not_fit() -> None:
    a, b = np.zeros((4, 5), np.uint8), np.zeros((4, 6), np.uint8)
    with pytest.raises(InputError, match=r"2 frames are needed \(p to q\), but there is 1"):
        Reader(Frames.of([a]), ["p", "q"])
    reader = Reader(Frames.of([a, b], ["first", "second"]), ["p", "q"])
    reader.grey(0)
    with pytest.raises(InputError, match="second is 6 x 4 px"):
        reader.grey(1)


def test_colours_are_shares_of_the_brightest_level() -> None:
    lit = np.zeros((3, 4, 3), np.uint16)
    lit[1, 2] = [1000, 500, 250]
    assert grey(lit)[1, 2] == pytest.approx(1750 / 3)
    colors = colors_at(lit, np.array([[2.3, 0.8], [-0.4, 5.0]], np.float32))
    np.testing.assert_allclose(colors, [[1, 0.5, 0.25], [0, 0, 0]])
    mask = np.zeros((3, 4), dtype=bool)
    mask[1, 2] = True
    value = np.full((3, 4, 2), 8, np.float32)
    found = collect(mask, {i: (value[..., i], value[..., i]) for i in (0, 1)}, value[..., 0] / 8, lit)
    assert found.camera_xy.tolist() == [[2, 1]] and found.color.shape == (1, 3)


def test_noise_is_measured_wherever_an_object_lies() -> None:
    """A bright object of a tenth of a large picture, in which noise grows with light: 6.2 levels at 200."""
    rng = np.random.default_rng(0)
    for top in (40, 400, 777):
        white = np.full((1500, 2000), 20.0)
        white[top : top + 150, 300:1300] = np.linspace(60, 220, 1000)
        noisy = white + rng.normal(0, 1, white.shape) * np.sqrt(1 + 0.19 * np.maximum(white - 20, 0))
        black = 20 + rng.normal(0, 1, white.shape)
        pictures = [np.clip(np.rint(p), 0, 255).astype(np.uint8) for p in (noisy, black)]
        light = measure_light(*pictures, 5.0)
        assert float(light.noise(np.array([200], np.float32))[0]) == pytest.approx(np.sqrt(1 + 0.19 * 180), rel=0.12)
