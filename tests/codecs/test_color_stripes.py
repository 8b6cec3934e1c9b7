"""The codec on pictures whose every pixel is known: what it finds, what it leaves out, what it refuses."""

import json
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d, shift

from slkit.codecs._color_pattern import HUES, PALETTE
from slkit.codecs.color_stripes import ColorStripes
from slkit.data import Frames
from slkit.errors import DecodeError, InputError
from slkit.registry import create
from slkit.simulation import Optics, SimulatedScanner, one_to_one_rig, scene

from .stripe_truth import score

SIZE = (240, 60)
PERIOD = 12
RNG_SEED = 4


def seen(codec: ColorStripes, change: Any = None, noise: float = 1.0) -> Frames:
    """What a camera sees pixel for pixel, 20 to 220 levels with a blur of 0.8 px; change: of the light, 0 to 1."""
    rng = np.random.default_rng(RNG_SEED)
    pictures = []
    for pattern in codec.encode():
        light = gaussian_filter1d(gaussian_filter1d(pattern / 255, 0.8, axis=0), 0.8, axis=1)
        light = light if change is None else change(light)
        level = 20 + 200 * light + rng.normal(0, noise, light.shape)
        pictures.append(np.clip(np.rint(level), 0, 255).astype(np.uint8))
    return Frames.of(pictures, codec.encode().names)


def errors(codec: ColorStripes, frames: Frames, bounds: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Errors in px, and the places (m, 2) px, of what is found: the camera sees the projector pixel for pixel."""
    found = codec.decode(frames, bounds)
    axis = int(codec.axes == "y")
    return found.projector_xy[:, axis] - found.camera_xy[:, axis], found.camera_xy


def share(codec: ColorStripes, xy: np.ndarray) -> float:
    """The share of slit crossings found."""
    return len(xy) / (len(codec.layout.stripes) * codec.projector[codec.axes == "x"])


def test_default_is_one_picture_of_slits_four_wide_and_eight_apart() -> None:
    codec = ColorStripes((1024, 768))
    patterns = codec.encode()
    assert patterns.names == ("x_stripes",) and patterns[0].shape == (768, 1024, 3)
    assert (codec.layout.width, codec.layout.gap) == (4, 8)
    assert ColorStripes((1920, 1080)).layout.gap == 9  # 148 of 152 slits cover it.
    assert codec.validate().windows == len(codec.layout.stripes) - 2 and codec.validate().distance == 1


@settings(max_examples=30, deadline=None)
@given(
    width=st.integers(1, 6),
    gap=st.integers(1, 9),
    first=st.integers(0, 20),
    axes=st.sampled_from(["x", "y"]),
    switch=st.booleans(),
)
def test_every_slit_lies_where_the_parameters_say(width: int, gap: int, first: int, axes: Any, switch: bool) -> None:
    transitions = "switch" if switch else "any"
    codec = ColorStripes((150, 130), axes=axes, width=width, gap=gap, first=first, transitions=transitions)
    picture = codec.encode()[0]
    line = picture[0] if axes == "x" else picture[:, 0]
    assert (picture == (line[None] if axes == "x" else line[:, None])).all()
    expected = np.zeros_like(line)
    for place, color in enumerate(codec.layout.stripes):
        start = first + place * (width + gap)
        expected[start : start + width] = 255 * np.array(PALETTE[codec.colors[color]])
    assert (line == expected).all()
    assert first + len(codec.layout.stripes) * (width + gap) - gap <= len(line)
    changes = np.diff([PALETTE[codec.colors[c]] for c in codec.layout.stripes], axis=0)
    assert changes.any(axis=1).all()
    if switch:
        assert ((changes > 0).any(axis=1) & (changes < 0).any(axis=1)).all()


def test_edges_are_the_125_stripes_of_zhang_curless_and_seitz() -> None:
    codec = ColorStripes((1024, 768), style="edges")
    shown = np.array([PALETTE[codec.colors[s]] for s in codec.layout.stripes])
    assert len(shown) <= 125 and codec.layout.gap == 0
    flips = np.abs(np.diff(shown, axis=0))
    assert flips.any(axis=1).all() and not flips.all(axis=1).any()
    whole = ColorStripes((1125, 768), style="edges", width=9)
    assert len(whole.layout.stripes) == 125 and whole.validate().windows == 122


@pytest.mark.parametrize("axes", ["x", "y"])
@pytest.mark.parametrize("references", [False, True])
def test_on_a_flat_wall_every_slit_is_found_to_a_hundredth(axes: Any, references: bool) -> None:
    codec = ColorStripes((124, 114), axes=axes, references=references, first=6)
    off, xy = errors(codec, seen(codec))
    # 200 levels, noise 1, blur 0.8 px: the bound is 0.004 px (methods 1.4, scaled); sampling leaves as much again.
    assert np.sqrt(np.mean(off**2)) < 0.01 and np.abs(off).max() < 0.05
    assert share(codec, xy) > 0.95


def test_edges_are_found_as_slits_are() -> None:
    codec = ColorStripes((240, 60), style="edges", width=5)
    off, xy = errors(codec, seen(codec))
    assert np.abs(off).max() < 0.15 and share(codec, xy) > 0.9


def test_sigma_is_honest(spread: Any) -> None:
    codec = ColorStripes(SIZE)
    frames = seen(codec, lambda light: 0.25 * light, noise=2.0)
    found = codec.decode(frames)
    ratio = (found.projector_xy[:, 0] - found.camera_xy[:, 0]) / found.sigma[:, 0]
    assert 0.6 < spread(ratio) < 1.4
    assert (found.confidence > 0.9).mean() > 0.95


@pytest.mark.parametrize("shift_px", [0.0, 0.2, 0.4, 0.6, 0.8])
def test_centers_follow_a_shift_between_the_pixels(shift_px: float) -> None:
    codec = ColorStripes(SIZE)
    off, _ = errors(codec, seen(codec, lambda light: shift(light, (0, shift_px, 0), order=3), noise=0.5))
    assert np.median(off) == pytest.approx(-shift_px, abs=0.02)


def test_colored_patches_may_hide_slits_but_give_no_wrong_label() -> None:
    """A wall of red, green, blue and yellow squares 40 px wide that reflect the other channels a quarter as well."""
    paint = np.array([[1, 0.25, 0.25], [0.25, 1, 0.25], [0.25, 0.25, 1], [1, 1, 0.25]])
    rows, cols = np.indices(SIZE[::-1]) // 40
    albedo = paint[(rows + cols) % 4]
    for codec, least in ((ColorStripes(SIZE), 0.55), (ColorStripes(SIZE, references=True), 0.9)):
        off, xy = errors(codec, seen(codec, lambda light: light * albedo))
        assert (np.abs(off) > PERIOD / 2).mean() <= 0.005
        assert share(codec, xy) > least


def test_a_missing_slit_does_not_shift_the_others() -> None:
    codec = ColorStripes(SIZE)

    def without(light: np.ndarray) -> np.ndarray:
        light = light.copy()
        light[:, 8 * PERIOD - 4 : 9 * PERIOD - 4] = 0
        return light

    off, xy = errors(codec, seen(codec, without))
    assert np.abs(off).max() < 0.1
    assert share(codec, xy) > 0.9 * 19 / 20


def test_an_extra_slit_that_nobody_projected_is_left_out() -> None:
    codec = ColorStripes(SIZE)

    def with_extra(light: np.ndarray) -> np.ndarray:
        light = light.copy()
        light[:, 8 * PERIOD + 7 : 8 * PERIOD + 10] = [0.8, 0.3, 0.1]
        return light

    off, xy = errors(codec, seen(codec, with_extra))
    assert (np.abs(off) > 1).mean() <= 0.01 and share(codec, xy) > 0.85


def test_order_reversal_in_front_of_a_wall_is_recovered() -> None:
    """Rows 15 to 44 of a strip before the wall show slits of eight places on, which the wall lacks: a shadow."""
    codec = ColorStripes((360, 60))
    jump, place = 8 * PERIOD, slice(10 * PERIOD, 15 * PERIOD)

    def thin(light: np.ndarray) -> np.ndarray:
        result = light.copy()
        taken = slice(place.start + jump, place.stop + jump)
        result[15:45, taken] = 0
        result[15:45, place] = light[15:45, taken]
        return result

    off, xy = errors(codec, seen(codec, thin))
    inside = (xy[:, 1] >= 17) & (xy[:, 1] <= 42) & (xy[:, 0] > place.start + 2) & (xy[:, 0] < place.stop - 2)
    assert np.abs(off[inside] - jump).max() < 0.1 and inside.sum() > 0.9 * 4 * 26
    others = (xy[:, 0] > place.stop + 2) | (xy[:, 0] < place.start - 2)
    assert np.abs(off[others]).max() < 0.3  # Rows are averaged with their neighbours, also at its ends.
    assert others.sum() > 0.9 * (25 * 60 - 5 * 30)


def test_saturated_slits_keep_their_labels() -> None:
    codec = ColorStripes(SIZE)
    off, xy = errors(codec, seen(codec, lambda light: 1.6 * light))
    assert np.abs(off).max() < 0.3 and share(codec, xy) > 0.9


def test_a_fifth_of_hue_noise_costs_slits_and_no_labels() -> None:
    """Each slit's colour in each row is mixed with another one by a random share, 20 % on average."""
    codec = ColorStripes(SIZE)
    rng = np.random.default_rng(RNG_SEED)
    amount = np.abs(rng.normal(0, 0.25, (SIZE[1], SIZE[0] // PERIOD, 1))).clip(0, 1)
    other = np.array([PALETTE[c] for c in HUES])[rng.integers(0, 6, amount.shape[:2])]

    def stained(light: np.ndarray) -> np.ndarray:
        part = np.repeat(amount, PERIOD, axis=1), np.repeat(other, PERIOD, axis=1)
        return (1 - part[0]) * light + part[0] * part[1] * light.max(axis=2, keepdims=True)

    off, xy = errors(codec, seen(codec, stained))
    assert (np.abs(off) > PERIOD / 2).mean() <= 0.005 and share(codec, xy) > 0.8


def test_dark_and_bright_parts_are_found_alike() -> None:
    codec = ColorStripes(SIZE)
    ramp = np.linspace(0.15, 1, SIZE[0])[:, None]
    off, xy = errors(codec, seen(codec, lambda light: light * ramp))
    assert np.abs(off).max() < 0.2 and share(codec, xy) > 0.9


def test_mirrored_turned_and_upside_down_pictures_mean_the_same() -> None:
    codec = ColorStripes(SIZE)
    frames = seen(codec)
    width, height = SIZE
    back = {
        np.fliplr: lambda xy: np.stack([width - 1 - xy[:, 0], xy[:, 1]], axis=1),
        np.flipud: lambda xy: np.stack([xy[:, 0], height - 1 - xy[:, 1]], axis=1),
        np.rot90: lambda xy: np.stack([width - 1 - xy[:, 1], xy[:, 0]], axis=1),
    }
    count = len(codec.decode(frames))
    for turn, to_first in back.items():
        found = codec.decode(Frames.of([np.ascontiguousarray(turn(frames[0]))]))
        assert np.abs(found.projector_xy[:, 0] - to_first(found.camera_xy)[:, 0]).max() < 0.1
        assert len(found) > 0.97 * count


@pytest.mark.parametrize("offset", [0.3, -0.3])
def test_colors_bent_apart_are_brought_together(offset: float) -> None:
    """Red and blue moved against green: no centre may depend on its colour by more than 0.1 px; it is 0.3 unaided."""
    codec = ColorStripes(SIZE)

    def bent(light: np.ndarray) -> np.ndarray:
        moved = [shift(light[..., c], (0, by), order=3) for c, by in ((0, offset), (1, 0), (2, -offset))]
        return np.stack(moved, axis=-1)

    off, xy = errors(codec, seen(codec, bent))
    color = np.asarray(codec.layout.stripes)[np.rint((xy[:, 0] - 1.5) / PERIOD).astype(int)]
    biases = [np.median(off[color == c]) for c in range(6)]
    assert np.abs(biases).max() < 0.03
    assert share(codec, xy) > 0.9


def test_a_sensor_with_one_color_a_pixel_biases_no_color() -> None:
    codec = ColorStripes(SIZE)
    picture = seen(codec)[0]
    mosaic = picture[..., 1].copy()
    mosaic[::2, ::2], mosaic[1::2, 1::2] = picture[::2, ::2, 0], picture[1::2, 1::2, 2]
    again = cv2.cvtColor(mosaic, cv2.COLOR_BayerBG2RGB)
    off, xy = errors(codec, Frames.of([again]))
    color = np.asarray(codec.layout.stripes)[np.rint((xy[:, 0] - 1.5) / PERIOD).astype(int)]
    assert np.abs([np.median(off[color == c]) for c in range(6)]).max() < 0.1
    assert share(codec, xy) > 0.85 and np.abs(off).max() < 1


def test_what_a_rig_knows_of_its_colors_undoes_crosstalk() -> None:
    """Strong, uneven mixing, undone by the photometry of the rig: as good as without mixing."""
    mixing = np.array([[0.6, 0.35, 0.0], [0.3, 0.6, 0.3], [0.0, 0.35, 0.6]])
    plain = ColorStripes(SIZE)
    frames = seen(plain, lambda light: light @ mixing.T)
    off, xy = errors(replace(plain, photometry={"mixing": mixing.tolist()}), frames)
    assert np.abs(off).max() < 0.2 and share(plain, xy) > 0.9


def test_bounds_rule_labels_out() -> None:
    codec = ColorStripes(SIZE)
    frames = seen(codec)
    cols = np.broadcast_to(np.arange(SIZE[0], dtype=np.float32), SIZE[::-1])
    every = np.stack([cols - 5, cols + 5, cols * 0, cols * 0], axis=-1)
    assert len(codec.decode(frames, every)) >= 0.99 * len(codec.decode(frames))
    half = every.copy()
    half[:, 120:] = np.nan
    _, xy = errors(codec, frames, half)
    assert xy[:, 0].max() < 120 and len(xy) > 0.4 * len(codec.decode(frames))
    assert len(codec.decode(frames, every + np.float32(60))) < 0.03 * len(codec.decode(frames))


def test_sixteen_bits_mean_what_eight_do() -> None:
    codec = ColorStripes(SIZE)
    frames = seen(codec)
    low, high = codec.decode(frames), codec.decode(Frames.of([frames[0].astype(np.uint16) * 257], frames.names))
    np.testing.assert_allclose(low.camera_xy, high.camera_xy, atol=1e-3)
    np.testing.assert_array_equal(low.projector_xy, high.projector_xy)


def test_lit_is_as_bright_between_the_slits_as_on_them() -> None:
    codec = ColorStripes(SIZE)
    lit = codec.lit(seen(codec))
    assert lit.shape == SIZE[::-1] and np.percentile(lit, 1) > 180


def test_a_foreign_sequence_is_decoded_by_its_own_numbers() -> None:
    sequence = (0, 1, 2, 0, 2, 1, 3, 0, 3, 1, 2, 3, 2)
    codec = ColorStripes((120, 60), first=5, width=3, gap=6, sequence=sequence, colors=HUES[:4])
    off, xy = errors(codec, seen(codec))
    assert np.abs(off).max() < 0.1 and share(codec, xy) > 0.85


def test_parameters_survive_a_recipe() -> None:
    codec = ColorStripes((1024, 768), axes="y", gap=9, transitions="switch", references=True)
    table = json.loads(json.dumps({"projector": [1024, 768], "axes": "y", "gap": 9, "transitions": "switch"}))
    assert create(ColorStripes, table | {"references": True}, "here") == codec


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"colors": ("red", "orange", "blue")}, "three or more different ones of black, blue"),
        ({"colors": ("red", "red", "blue")}, "three or more different"),
        ({"colors": ("red", "blue")}, "three or more different"),
        ({"colors": ("red", "black", "blue")}, "black slits cannot be seen"),
        ({"window": 1}, "at least 2"),
        ({"sequence": (0, 1, 2, 3, 0, 1, 2, 4, 5)}, "stripes from 0 and from 4 on have the same colours"),
        ({"sequence": (0, 1, 7)}, "places in colors, 0 to 5"),
        ({"width": 0}, "at least 1 px"),
        ({"gap": 0}, "at least 1 px"),
        ({"style": "edges", "gap": 2}, "no gap"),
        ({"style": "edges", "colors": HUES}, "usual order"),
        ({"style": "edges", "sequence": (0, 1, 1, 2, 3, 4)}, "neighbours in sequence must differ"),
        ({"first": 300}, "0 to 239"),
        ({"min_snr": 0.0}, "positive"),
        ({"min_contrast": 1.0}, "between 0 and 1"),
        ({"projector": (40, 60)}, "only 4 stripes of 4 \\+ 8 px fit"),
        ({"transitions": "switch", "colors": ("red", "yellow", "white")}, "no sequence of 3 colours"),
        ({"photometry": {"mixing": [[1, 1, 1]] * 3}}, "invertible"),
        ({"photometry": {}}, "invertible"),
    ],
)
def test_parameters_out_of_range_are_refused(parameters: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        ColorStripes(**({"projector": SIZE} | parameters))


def test_frames_that_do_not_fit_are_refused() -> None:
    codec = ColorStripes(SIZE)
    picture = seen(codec)[0]
    with pytest.raises(InputError, match="x_stripes.*there are 2"):
        codec.decode(Frames.of([picture, picture]))
    for grey in (picture.max(axis=2), np.repeat(picture.max(axis=2)[:, :, None], 3, axis=2)):
        with pytest.raises(InputError, match="frame 000 is grey"):
            codec.decode(Frames.of([grey]))
    with pytest.raises(InputError, match="only 240 x 1 px"):
        codec.decode(Frames.of([picture[:1]]))
    with pytest.raises(InputError, match="bounds must"):
        codec.decode(Frames.of([picture]), np.zeros((5, 5, 4), np.float32))
    for blank in (0, 255):
        with pytest.raises(DecodeError, match="no coloured slits"):
            codec.decode(Frames.of([np.full_like(picture, blank)]))


def test_other_patterns_than_projected_are_named() -> None:
    """Red and blue exchanged, as by a camera that is read in the wrong order, or another sequence of these colours."""
    codec = ColorStripes((360, 90))
    frames = seen(codec)
    assert len(codec.decode(frames)) > 0.9 * 30 * 90
    swapped = Frames.of([np.ascontiguousarray(frames[0][:, :, ::-1])])
    other = replace(codec, sequence=tuple((5 - np.array(codec.sequence)).tolist()))
    for pattern, pictures in ((codec, swapped), (other, frames)):
        for bounds in (None, np.tile(np.array([0, 359, 0, 89], np.float32), (90, 360, 1))):
            with pytest.raises(DecodeError, match="not in the order of this pattern"):
                pattern.decode(pictures, bounds)


def test_colors_that_nobody_projected_get_next_to_no_labels() -> None:
    """Half a picture is coloured texture: labels there are wrong, and the pattern beside it must not suffer."""
    codec, wrong, count = ColorStripes((480, 240)), 0, 0
    for seed, size in ((1, 2), (1, 5), (2, 2), (2, 5)):
        noise = np.random.default_rng(seed).normal(0, 1, (240, 480, 3))
        texture = np.clip(0.4 + size * cv2.GaussianBlur(noise, (0, 0), size), 0, 1)[:, :240]
        off, _ = errors(codec, seen(codec, partial(_beside, texture)))
        wrong, count = wrong + int((np.abs(off) > PERIOD / 2).sum()), count + len(off)
    assert wrong <= 0.01 * count and count > 0.9 * 4 * 20 * 240


def _beside(texture: np.ndarray, light: np.ndarray) -> np.ndarray:
    return np.concatenate([texture, 0.8 * light[:, texture.shape[1] :]], axis=1)


@pytest.mark.parametrize("albedo", [(1.0, 0.8, 0.02), (0.02, 1.0, 1.0), (1.0, 0.02, 0.9)])
def test_paint_that_hides_a_channel_gives_no_wrong_labels(albedo: tuple[float, float, float]) -> None:
    """A white picture tells which channels come back; what is not seen must not become another colour."""
    rig = one_to_one_rig()
    paint = scene.plane(1100.0, (8.0, -6.0), (700.0, 500.0), albedo=albedo)
    codec = ColorStripes(rig.projector.size, references=True)
    scanner = SimulatedScanner(paint, rig, Optics(color=True, read_noise=2.0, shot_noise=0.0), 1)
    found = codec.decode(scanner.capture(codec.encode()))
    seen = scanner.truth()
    truth = np.full((*seen.lit.shape, 2), np.nan)
    truth[seen.lit] = seen.projector_xy
    result = score(codec, found, truth)
    assert result.error.wrong <= 0.005
    assert result.visible > 0.3
