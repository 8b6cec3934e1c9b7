import json

import numpy as np
import pytest

from slkit.calibration.photometry import estimate_photometry
from slkit.data import Frames, Image
from slkit.errors import CalibrationError, InputError
from slkit.geometry import Rig
from slkit.simulation import Optics, SimulatedScanner, plane, working_volume

COLORS = {
    "white": (255, 255, 255),
    "black": (0, 0, 0),
    "red": (255, 0, 0),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
}
LEVELS = {f"{name}_{n:03d}": tuple(n * v // 255 for v in COLORS[name]) for name in list(COLORS)[2:] for n in (64, 150)}
NEUTRAL = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])


def random_mixing(rng: np.random.Generator) -> np.ndarray:
    """Crosstalk of 0 to 0.25, each its own, times the camera's white balance; the mean of white is 1."""
    mixing = rng.uniform(0, 0.25, (3, 3))
    np.fill_diagonal(mixing, 0)
    mixing += np.diag(1 - mixing.sum(axis=1))
    mixing *= rng.uniform(0.5, 1.5, (3, 1))
    return 3 * mixing / mixing.sum()


def vignetted(height: int, width: int) -> np.ndarray:
    """A gain that falls to a third of 1 in the corners."""
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return 1 / (1 + x**2 + y**2)


def taken(
    mixing: np.ndarray = NEUTRAL,
    gain: np.ndarray | float = 0.5,
    ambient: float = 0.08,
    gamma: float = 1.0,
    noise: float = 0.0,
    bits: int = 8,
    albedo: np.ndarray | float = 1.0,
    camera_gamma: float = 1.0,
    colors: dict[str, tuple[int, ...]] = COLORS,
    seed: int = 0,
) -> dict[str, Image]:
    """Pictures by the model itself. noise: 1 sigma in levels of 8 bits; albedo: (h, w, 3) of what is lit."""
    rng, full = np.random.default_rng(seed), 2**bits - 1
    gain = (vignetted(60, 80) * gain)[..., None]
    pictures: dict[str, Image] = {}
    for name, levels in colors.items():
        light = gain * albedo * (np.array(levels) / 255) ** gamma
        seen = (ambient + light @ mixing.T) ** camera_gamma + noise / 255 * rng.standard_normal(gain.shape[:2] + (3,))
        pictures[name] = np.clip(np.rint(full * seen), 0, full).astype(np.uint8 if bits == 8 else np.uint16)
    return pictures


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_model_is_found_again(seed: int, noise: float, bits: int):
    rng = np.random.default_rng(seed)
    mixing, ambient, gamma = random_mixing(rng), rng.uniform(0.05, 0.15), rng.uniform(1, 2.4)
    gain = (0.93 - ambient) / mixing.sum(axis=1).max()
    found = estimate_photometry(taken(mixing, gain, ambient, gamma, noise, bits, colors=COLORS | LEVELS, seed=seed))
    evidence, mean = found["evidence"], gain * vignetted(60, 80).mean()
    assert evidence["pixels"] == 4800 and evidence["neutral"] == 1 and not found["warnings"]
    # Noise of a level or more dithers rounding away; without, each mean may be off by half a level.
    rounding = 0.5 / (2**bits - 1) if noise == 0 else 0.0
    sigma = np.array(evidence["mixing_sigma"])
    assert (np.abs(found["mixing"] - mixing) <= 5 * sigma + 4 * rounding / mean).all()
    deviation = noise / 255 / np.sqrt(4800)
    assert np.abs(np.array(found["ambient"]) - ambient).max() <= 5 * deviation + rounding
    # Light s of a level u: ds = s log(u) dgamma; a color is unmixed by a row of the inverse.
    row = np.abs(np.linalg.inv(mixing)).sum(axis=1).max()
    u = np.array([64, 150]) / 255
    slope = np.sqrt((u ** (2 * gamma) * np.log(u) ** 2).sum())
    assert np.abs(np.array(found["response"]) - gamma).max() <= (10 * deviation + 4 * rounding) * row / mean / slope
    # White and the three colors are independent pictures: each misfit has the noise of eight.
    assert np.abs(evidence["additivity"]).max() <= (5 * 8 * deviation + 8 * rounding) / (
        mean * mixing.sum(axis=1).min()
    )


def test_the_sigma_of_the_mixing_is_the_spread_over_repetitions():
    mixing = random_mixing(np.random.default_rng(1))
    found = [estimate_photometry(taken(mixing, noise=2.0, seed=seed)) for seed in range(40)]
    pulls = [(np.array(f["mixing"]) - mixing) / f["evidence"]["mixing_sigma"] for f in found]
    # 40 repetitions of at least 5 independent numbers: the spread of their rms is 1 / sqrt(2 * 200) = 0.05.
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1, abs=0.2)
    assert np.abs(np.mean(pulls, axis=0)).max() < 5 / np.sqrt(40)


def test_one_inverse_undoes_crosstalk_and_white_balance():
    mixing = random_mixing(np.random.default_rng(2))
    mauve = {"mauve": (200, 60, 120)}
    pictures = taken(mixing, bits=16, colors=COLORS | mauve)
    color = pictures.pop("mauve") / 65535
    found = estimate_photometry(pictures)
    assert np.mean(np.sum(found["mixing"], axis=1)) == pytest.approx(1)
    light = (color - found["ambient"]) @ np.linalg.inv(found["mixing"]).T
    np.testing.assert_allclose(light / light[..., :1], np.broadcast_to([1, 0.3, 0.6], light.shape), atol=1e-3)


@pytest.mark.parametrize(("crosstalk", "gamma", "bits"), [(0.0, 1.0, 8), (0.15, 2.2, 8), (0.25, 1.8, 16)])
def test_the_simulator_is_found_again(small_rig: Rig, crosstalk: float, gamma: float, bits: int):
    center, radius = working_volume(small_rig)
    optics = Optics(crosstalk=crosstalk, projector_gamma=gamma, bits=bits, color=True, samples=3)
    wall = plane(center[2], (10.0, 0.0), (4 * radius, 3 * radius), (center[0], center[1]))
    colors, (width, height) = COLORS | LEVELS, small_rig.projector.size
    fields = [np.full((height, width, 3), color, np.uint8) for color in colors.values()]
    seen = SimulatedScanner(wall, small_rig, optics, seed=4).capture(Frames.of(fields, list(colors)))
    found = estimate_photometry(dict(zip(colors, seen, strict=True)))
    # The rim of the field, a pixel wide, is blurred alike in every picture.
    np.testing.assert_allclose(found["mixing"], optics.mixing(), atol=5 * np.max(found["evidence"]["mixing_sigma"]))
    np.testing.assert_allclose(found["response"], [gamma] * 3, atol=0.01)
    np.testing.assert_allclose(found["ambient"], [0.015 + 0.12 * 0.8] * 3, atol=1e-3)


def test_objects_and_prints_in_the_field_do_not_count():
    mixing = random_mixing(np.random.default_rng(3))
    clean = np.array(estimate_photometry(taken(mixing, noise=1.0))["mixing"])
    albedo = np.ones((60, 80, 3))
    albedo[::7, ::3] = 0.2
    printed = estimate_photometry(taken(mixing, noise=1.0, albedo=albedo))
    np.testing.assert_allclose(printed["mixing"], mixing, atol=6 * np.max(printed["evidence"]["mixing_sigma"]))
    assert printed["evidence"]["neutral"] > 0.99
    albedo[10:50, 20:55] = (0.9, 0.5, 0.3)
    albedo[:10, :10] = (0.3, 0.9, 0.9)
    found = estimate_photometry(taken(mixing, noise=1.0, albedo=albedo))
    np.testing.assert_allclose(found["mixing"], clean, atol=6 * np.max(found["evidence"]["mixing_sigma"]))
    colored = (40 * 35 + 10 * 10) / 4800
    assert found["evidence"]["neutral"] == pytest.approx(1 - colored, abs=0.02)
    albedo[:, :27], albedo[:, 27:54], albedo[:, 54:] = (1, 0.5, 0.5), (0.5, 1, 0.5), (0.5, 0.5, 1)
    with pytest.raises(CalibrationError, match="% of the lit field agree on one color mixing: .* plain white"):
        estimate_photometry(taken(mixing, noise=1.0, albedo=albedo))


def test_saturated_and_unlit_places_do_not_count():
    pictures = taken(gain=1.2, noise=1.0)
    found = estimate_photometry(pictures)
    saturated = np.mean(pictures["white"].max(axis=2) >= 250)
    assert 0.2 < saturated < 0.5
    assert found["evidence"]["saturated"] == pytest.approx(saturated)
    np.testing.assert_allclose(found["mixing"], NEUTRAL, atol=6 * np.max(found["evidence"]["mixing_sigma"]) + 1e-3)
    albedo = np.ones((60, 80, 3))
    albedo[:, :50] = 0
    dark = estimate_photometry(taken(noise=1.0, albedo=albedo))
    assert dark["evidence"]["pixels"] == 60 * 30
    # A sensor of 12 bits in 16-bit pictures is full at 4095.
    low = {name: np.minimum(p.astype(np.uint16) * 20, 4095) for name, p in taken(gain=0.9).items()}
    assert estimate_photometry(low)["evidence"]["saturated"] > 0.1


def test_the_response_is_told_only_where_it_is_measured():
    assert "response" not in estimate_photometry(taken(gamma=2.0))
    found = estimate_photometry(taken(gamma=2.0, colors=COLORS | {"red_128": (128, 0, 0)}))
    assert "response" not in found
    assert found["warnings"] == ["the response is not measured: there is no intermediate level of green and blue"]
    whites = {f"white_{n}": (n, n, n) for n in (50, 100, 200)}
    found = estimate_photometry(
        taken(random_mixing(np.random.default_rng(5)), gamma=2.0, bits=16, colors=COLORS | whites)
    )
    np.testing.assert_allclose(found["response"], [2, 2, 2], atol=1e-3)
    pictures = taken(colors=COLORS | {"white_064": (190, 190, 190), "white_190": (200, 200, 200)})
    (warning,) = estimate_photometry(pictures)["warnings"]
    assert "no power of the level" in warning and "picture modes" in warning


def test_a_camera_or_projector_that_is_not_linear_is_told():
    (warning,) = estimate_photometry(taken(camera_gamma=1 / 2.2, noise=1.0, gain=0.7))["warnings"]
    assert "brighter than white: the camera is not linear" in warning
    boosted = COLORS | {name: tuple(v * 7 // 10 for v in COLORS[name]) for name in ("red", "green", "blue")}
    (warning,) = estimate_photometry(taken(colors=boosted))["warnings"]
    assert "white is 4" in warning and "adds white of its own" in warning


def swapped(pictures: dict[str, Image], *names: str) -> dict[str, Image]:
    return pictures | {name: pictures[other] for name, other in zip(names, (*names[1:], names[0]), strict=True)}


def test_pictures_that_are_not_what_they_should_be_are_refused():
    good = taken(random_mixing(np.random.default_rng(6)), noise=1.0)
    for name in COLORS:
        with pytest.raises(InputError, match=f"needs the picture {name}: project"):
            estimate_photometry({k: v for k, v in good.items() if k != name})
    for change, message in (
        ({"green": good["green"][..., 0]}, "picture green is grey"),
        ({"blue": good["blue"][:-1]}, "picture blue is 80 x 59 px colour 8-bit, but white is 80 x 60"),
        ({"blue": good["blue"].astype(np.uint16)}, "picture blue is .* 16-bit, but white is .* 8-bit"),
        ({"pink": good["red"]}, "'pink' names no picture"),
        ({"red_255": good["red"]}, "'red_255' names no picture"),
    ):
        with pytest.raises(InputError, match=message):
            estimate_photometry(good | change)


def test_pictures_that_contradict_their_names_are_refused():
    good = taken(random_mixing(np.random.default_rng(6)), noise=1.0, colors=COLORS | LEVELS)
    for names, message in (
        (("white", "black"), "black is brighter than white"),
        (("red", "white"), "red is brighter than white"),
        (("red", "blue"), "red and blue look exchanged"),
        (("green", "blue"), "green and blue look exchanged"),
        (("red", "green", "blue"), "red, green and blue look exchanged"),
        (("red", "red_150"), "red_150 is not darker than red"),
    ):
        with pytest.raises(CalibrationError, match=message):
            estimate_photometry(swapped(good, *names))
    with pytest.raises(CalibrationError, match="red and blue look exchanged: .* order red green blue"):
        estimate_photometry({name: picture[..., ::-1] for name, picture in good.items()})
    grey = {name: np.repeat(p.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8) for name, p in good.items()}
    with pytest.raises(CalibrationError, match="look nearly alike"):
        estimate_photometry(grey)
    with pytest.raises(CalibrationError, match="blue is hardly brighter than black"):
        estimate_photometry(good | {"blue": good["black"]})
    with pytest.raises(CalibrationError, match="white is hardly brighter than black"):
        estimate_photometry(taken(gain=0.01))
    with pytest.raises(CalibrationError, match="% of the lit field are saturated: shorten"):
        estimate_photometry(taken(gain=3.0))
    with pytest.raises(CalibrationError, match="only 48 pixels are lit"):
        estimate_photometry({name: picture[20:26, 30:38] for name, picture in good.items()})


def test_large_pictures_are_taken_in_blocks():
    small = taken(noise=1.0, gain=0.6)
    large = {name: picture.repeat(6, axis=0).repeat(6, axis=1) for name, picture in small.items()}
    a, b = estimate_photometry(small), estimate_photometry(large)
    # 360 x 480 px make blocks of 2 px.
    assert b["evidence"]["pixels"] == 360 * 480
    np.testing.assert_allclose(a["mixing"], b["mixing"], atol=1e-12)


def test_the_result_is_json():
    found = estimate_photometry(taken(colors=COLORS | LEVELS))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert set(found) == {"mixing", "ambient", "response", "evidence", "warnings"}
