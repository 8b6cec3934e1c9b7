"""The dense one-shot codec: on pictures whose every pixel is known, and on the simulator's free-form object."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from slkit.codecs._color_pattern import HUES, PALETTE
from slkit.codecs._fringe_kernels import _CUT, _WINDOW, _fit
from slkit.codecs.color_fringe import ColorFringe
from slkit.data import Correspondences, Frames
from slkit.errors import DecodeError, InputError
from slkit.geometry import Rig
from slkit.registry import create
from slkit.report.measure import label_error

SIZE = (240, 60)
PERIOD = 12
DARK, BRIGHT = 20.0, 200.0


def seen(codec: ColorFringe, change: Any = None, noise: float = 1.0) -> Frames:
    """What a camera sees pixel for pixel, 20 to 220 levels with a blur of 0.8 px; change: of the light, 0 to 1."""
    rng = np.random.default_rng(4)
    pictures = []
    for pattern in codec.encode():
        light = gaussian_filter1d(gaussian_filter1d(pattern / 255, 0.8, axis=0), 0.8, axis=1)
        light = light if change is None else change(light)
        level = DARK + BRIGHT * light + rng.normal(0, noise, light.shape)
        pictures.append(np.clip(np.rint(level), 0, 255).astype(np.uint8))
    return Frames.of(pictures, codec.encode().names)


def errors(found: Correspondences, axis: int = 0) -> np.ndarray:
    return found.projector_xy[:, axis] - found.camera_xy[:, axis]


def test_default_is_one_picture_of_fringes_that_cover_the_projector() -> None:
    codec = ColorFringe((1024, 768))
    patterns = codec.encode()
    assert patterns.names == ("x_fringes",) and patterns[0].shape == (768, 1024, 3)
    assert (len(codec.layout.stripes), codec.layout.period) == (64, 16)
    assert ColorFringe((4096, 64)).layout.period == 27  # 152 fringes are the longest sequence.
    assert ColorFringe((96, 96), references=True, axes="y").encode().names == ("white", "black", "y_fringes")


@settings(max_examples=30, deadline=None)
@given(period=st.integers(4, 40), extent=st.integers(200, 400), axis=st.sampled_from(["x", "y"]))
def test_the_brightest_channel_is_one_sinusoid_whose_color_tells_the_fringe(
    period: int, extent: int, axis: Any
) -> None:
    codec = ColorFringe((extent, extent), axes=axis, period=period)
    picture = codec.encode()[0]
    line = picture[0] if axis == "x" else picture[:, 0]
    at = np.arange(min(extent, period * len(codec.layout.stripes)))
    wave = 127.5 * (1 - np.cos(2 * np.pi * (at + 0.5) / period))
    assert np.abs(line[at].max(axis=1) - wave).max() <= 0.5 + 1e-9
    hue = np.array([PALETTE[codec.colors[codec.layout.stripes[i // period]]] for i in at])
    assert (line[at] == line[at].max(axis=1, keepdims=True) * hue).all()


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("references", [False, True])
def test_every_pixel_of_a_plane_is_read(axis: Any, references: bool) -> None:
    size = SIZE if axis == "x" else SIZE[::-1]
    codec = ColorFringe(size, axes=axis, period=PERIOD, references=references)
    found = codec.decode(seen(codec))
    k = int(axis == "y")
    assert np.isnan(found.projector_xy[:, 1 - k]).all() and (found.camera_xy == np.rint(found.camera_xy)).all()
    assert len(found) > 0.93 * SIZE[0] * SIZE[1]  # All but the rims of the light.
    inside = np.abs(found.camera_xy[:, k] - SIZE[0] / 2) < SIZE[0] / 2 - PERIOD
    error = errors(found, k)[inside]
    # Colours that meet at the darkest place move it a little; the bound of noise alone is 0.03 px.
    assert np.sqrt(np.mean(error**2)) < 0.12 and abs(np.mean(error)) < 0.03
    assert np.mean(np.abs(error) < 3 * found.sigma[inside, k]) > 0.95
    assert found.confidence.min() > 0.1 and np.median(found.confidence) > 0.9


def test_a_mirrored_picture_and_one_along_the_other_side_mean_the_same() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)
    frames = seen(codec)
    straight = codec.decode(frames).as_map(SIZE[::-1])[..., 0]
    mirrored = codec.decode(Frames.of([frames[0][:, ::-1].copy()], frames.names)).as_map(SIZE[::-1])[:, ::-1, 0]
    turned = codec.decode(Frames.of([frames[0].transpose(1, 0, 2).copy()], frames.names)).as_map(SIZE)[..., 0].T
    for other in (mirrored, turned):
        both = np.isfinite(straight) & np.isfinite(other)
        assert both.sum() > 0.98 * np.isfinite(straight).sum()
        inside = np.abs(straight - other)[:, PERIOD:-PERIOD]
        # A pixel between two fringes may be named after either, and takes that one's colour.
        assert np.nanmax(inside) < 0.25 and np.nanmedian(inside) < 0.02


def test_noise_is_what_sigma_says_at_least() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)
    clean, noisy = (codec.decode(seen(codec, noise=n)).as_map(SIZE[::-1])[..., 0] for n in (0.0, 6.0))
    found = codec.decode(seen(codec, noise=6.0))
    spread = np.nanstd((noisy - clean)[:, PERIOD:-PERIOD])
    assert 0.02 < spread < 1.5 * np.median(found.sigma[:, 0])


def test_the_window_finds_the_phase_of_a_sinusoid_exactly_and_its_noise_factor_is_that_of_least_squares() -> None:
    period, at = 9.3, 60
    x = np.arange(121, dtype=np.float32)
    carrier = 2 * np.pi * x / period
    cosine, sine = np.cos(carrier).astype(np.float32), np.sin(carrier).astype(np.float32)
    out = np.empty(9, np.float32)
    value = (0.7 + 0.4 * np.cos(carrier + 0.3)).astype(np.float32)
    assert _fit(at, np.zeros(121, np.int64), period, value, cosine, sine, out)
    np.testing.assert_allclose(out[[0, 2, 3]], [0.3 / (2 * np.pi), 0.4, 0.7], atol=1e-4)
    assert out[4] < 2e-3 and abs(out[5]) < 1e-4
    reach = int(np.ceil(_CUT * _WINDOW * period))
    near = slice(at - reach, at + reach + 1)
    weight = np.exp(-((x[near] - at) ** 2) / (2 * (_WINDOW * period) ** 2))
    base = np.stack([np.ones(2 * reach + 1), cosine[near], sine[near]], axis=1)
    solve = np.linalg.solve(base.T @ (weight[:, None] * base), base.T * weight)
    assert 0.8 < out[6] / np.linalg.norm(solve[2]) < 1.6  # It neglects that weights are not the noise's.


def test_pixels_beyond_an_edge_of_light_are_not_read() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)

    def cut(light: np.ndarray) -> np.ndarray:
        light = light.copy()
        light[:, 105:150] = 0
        return light

    found = codec.decode(seen(codec, cut))
    dark = (found.camera_xy[:, 0] > 105 + PERIOD / 3) & (found.camera_xy[:, 0] < 149 - PERIOD / 3)
    assert not dark.any() and np.abs(errors(found)).max() < PERIOD / 2


def test_bounds_rule_out_and_let_through() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)
    frames = seen(codec)
    x, y = np.meshgrid(np.arange(SIZE[0], dtype=np.float32), np.arange(SIZE[1], dtype=np.float32))
    true = np.stack([x - 3, x + 3, y - 3, y + 3], axis=-1)
    free = codec.decode(frames)
    assert len(codec.decode(frames, true)) > 0.99 * len(free)
    half = true.copy()
    half[:, : SIZE[0] // 2] = np.nan
    assert codec.decode(frames, half).camera_xy[:, 0].min() >= SIZE[0] // 2
    assert len(codec.decode(frames, true + 60)) == 0


def test_photometry_undoes_what_the_camera_mixes() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)
    mixing = np.array([[0.75, 0.25, 0.02], [0.15, 0.6, 0.15], [0.02, 0.25, 0.8]])
    frames = seen(codec, lambda light: 0.9 * light @ mixing.T)
    told = replace(codec, photometry={"mixing": mixing}).decode(frames)
    assert len(told) > 0.9 * SIZE[0] * SIZE[1] and np.abs(np.median(errors(told))) < 0.05
    assert np.mean(np.abs(errors(told)) < PERIOD / 2) > 0.999


def test_a_table_of_parameters_makes_the_codec() -> None:
    table = {"projector": [240, 60], "period": 12, "colors": list(HUES), "references": True, "photometry": None}
    assert create(ColorFringe, json.loads(json.dumps(table)), "test") == ColorFringe(
        SIZE, period=PERIOD, references=True
    )


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"colors": ("red", "white", "blue")}, "colors must be three or more"),
        ({"colors": ("red", "green")}, "colors must be three or more"),
        ({"window": 1}, "window must be at least 2"),
        ({"sequence": (0, 9)}, "sequence must name places"),
        ({"sequence": (0, 1, 2, 3, 0, 1, 2, 3)}, "the 3 fringes from 0 and from 4 on"),
        ({"period": 3}, "period must be at least 4"),
        ({"period": 80}, "only 3 fringes of 80 px"),
        ({"min_snr": 0.0}, "min_snr must be positive"),
        ({"min_contrast": 1.0}, "min_contrast between 0 and 1"),
    ],
)
def test_parameters_that_make_no_pattern_are_refused(parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        ColorFringe(SIZE, **parameters)


def test_pictures_that_are_none_of_it_are_refused() -> None:
    codec = ColorFringe(SIZE, period=PERIOD)
    name = codec.encode().names
    with pytest.raises(InputError, match="frame x_fringes is grey, but colour fringes need colour pictures"):
        codec.decode(Frames.of([np.zeros(SIZE[::-1], np.uint8)], name))
    with pytest.raises(DecodeError, match="there are no coloured fringes"):
        codec.decode(Frames.of([np.zeros((*SIZE[::-1], 3), np.uint8)], name))
    lit = codec.lit(seen(codec))
    assert lit.shape == SIZE[::-1] and lit.min() > DARK + BRIGHT / 4 and np.median(lit) > DARK + BRIGHT / 2


@dataclass(frozen=True)
class Figures:
    """share: of the lit pixels; wrong: order; rms_px of the right ones; limit_px of noise alone; sure: wrong of those
    with a confidence above 0.75."""

    share: float
    wrong: float
    rms_px: float
    limit_px: float
    sure: float


def figures(rig: Rig, scene: str) -> Figures:
    from slkit.simulation import Optics, SimulatedScanner, build

    scanner = SimulatedScanner(build(scene, rig), rig, Optics(color=True, read_noise=2, shot_noise=0))
    codec, truth = ColorFringe(rig.projector.size), scanner.truth()
    true = np.full((*truth.lit.shape, 2), np.nan)
    true[truth.lit] = truth.projector_xy
    taken = scanner.capture(codec.encode())
    found = codec.decode(Frames.of([taken[0]], taken.names))
    col, row = np.rint(found.camera_xy).astype(int).T
    all_of_it = label_error(found, true[row, col], codec.layout.period)
    sure = found.confidence > 0.75
    best = label_error(found.select(sure), true[row, col][sure], codec.layout.period)
    # Noise of 2 levels on a modulation of 0.65 * 255 / 2 at best: two thirds of a fringe of `_WINDOW` count.
    steep = np.nanmedian(np.abs(np.diff(true[..., 0], axis=1)))
    samples = 2 * np.sqrt(np.pi) * _WINDOW * codec.layout.period / steep
    limit = codec.layout.period / (2 * np.pi) * np.sqrt(2 / samples) * 2 / (0.65 * 255 / 2)
    share = all_of_it.points / int(truth.lit.sum())
    return Figures(share, all_of_it.wrong, all_of_it.rms_px, float(limit), best.wrong)


@pytest.mark.parametrize(
    ("rig", "scene", "share", "wrong"),
    [
        ("paper", "free-form", 0.82, 0.02),
        ("sharper", "free-form", 0.84, 0.02),
        ("random 1", "free-form", 0.92, 0.005),
        ("random 2", "free-form", 0.88, 0.01),
        ("paper", "color-free-form", 0.76, 0.03),
    ],
)
def test_free_form_object_from_one_picture(
    rig: str, scene: str, share: float, wrong: float, scaled: Callable[[Rig, float], Rig]
) -> None:
    from slkit.simulation import paper_rig, random_rig

    rigs = {"paper": paper_rig(), "sharper": replace(paper_rig(), camera=scaled(paper_rig(), 1280 / 768).camera)}
    chosen = rigs[rig] if rig in rigs else random_rig(np.random.default_rng(int(rig.split()[1])))
    got = figures(chosen, scene)
    print(f"\n{rig}, {scene}: {got}")
    assert got.share > share and got.wrong < wrong and got.sure < max(wrong, 0.01)
    assert got.limit_px < got.rms_px < 1.3
