"""The compiled loops of lines, each beside the NumPy that says what it computes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._line_scales import FLATTEST, LineRule, scales_of
from slkit.codecs._line_view import AxisPeaks, Coarse, View
from slkit.codecs._lines import find_lines
from slkit.codecs._masks import Light
from slkit.codecs._noise import NoiseCurve
from slkit.codecs._peaks import Peaks, slope_along_rows
from slkit.codecs._slope_kernels import NO_KERNEL, log_rows, run_rows

from .. import numpy_twins

SEED = st.integers(0, 2**32 - 1)
NOISE = NoiseCurve(dark=3.0, least=2.0, gain=0.05)
MIN_CONTRAST, MIN_SNR = 0.05, 5.0


def scale_map(slope: np.ndarray, width: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The nearest kernel's sigma for lines on a slope, NaN where they lie too close, and their spacing, in px."""
    stretch = 1 / np.maximum(np.abs(slope), FLATTEST)
    spacing = period * stretch
    looks = np.minimum(np.sqrt((width * stretch) ** 2 / 12 + 0.4), 0.25 * spacing)
    level = np.maximum(np.rint(np.log(np.maximum(looks, 0.9) / 0.9) / np.log(1.4)), 0)
    scale = np.where(np.abs(slope) <= np.float32(period / 2.5), 0.9 * 1.4**level, np.nan)
    return scale, spacing


def shares(view: View, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A picture as a share of white less black, 0 where unlit, and the variance of that share."""
    light = view.light
    levels, white, black = (a.astype(np.float32) for a in (picture, light.white, light.black))
    span, (own, of_white, of_black) = light.span, (light.noise(a) ** 2 for a in (levels, white, black))
    share = np.where(light.mask, (levels - black) / span, 0).astype(np.float32)
    variance = (own + (1 - share) ** 2 * of_black + share**2 * of_white) / span**2
    return share, variance.astype(np.float32)


def lines_by_numpy(view: View, pictures: list[np.ndarray], width: int, period: int, size: int) -> AxisPeaks:
    """What `find_lines` finds."""
    scale, spacing = scale_map(view.slope, width, period)
    reach, parts = (width - 1) / 2, list[Peaks]()
    for shift, picture in enumerate(pictures):
        seen = numpy_twins.lines(*shares(view, picture), scale, spacing)
        at = seen["row"], np.rint(seen["col"]).astype(int)
        coarse = view.coarse.value[at].astype(float)
        value = shift + reach + period * np.rint((coarse - shift - reach) / period)
        keep = (np.abs(coarse - value) <= period / 2 - 1) & view.known[at]
        keep &= (value >= reach) & (value <= size - 1 - reach)
        keep &= seen["contrast"] > np.maximum(MIN_CONTRAST, MIN_SNR * seen["noise"])
        told = (seen[name] for name in ("row", "col", "sigma", "contrast", "noise"))
        parts.append(Peaks(*told, value).select(keep))
    return view.consistent(view.centered(Peaks.join(parts), period), period)


def scene(seed: int, width: int, period: int, kind: type, slope: float, shape: tuple[int, int]) -> tuple[Any, ...]:
    """A view and noisy pictures of lines on a surface with a step, a bend, dark patches and unknown positions."""
    rng = np.random.default_rng(seed)
    (h, w), top = shape, 230 if kind is np.uint8 else 40_000
    x, y = np.arange(w), np.arange(h)[:, None]
    bend = rng.uniform(0.5, 4)
    place = abs(slope) * (x + bend * np.sin(x / 17 + y / 9)) + 0.1 * y
    place[h // 2 :, w // 3 :] += rng.uniform(1, 9)
    size = int(place.max()) + period
    place = place if slope > 0 else size - 1 - place
    grain = top / 230
    bright = grain * (90 + 70 * np.sin(x / 11 + y / 5 + rng.uniform(0, 6)))
    dark = np.full(shape, 12 * grain)

    def seen(level: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(level + rng.normal(0, 1.5 * grain, shape)), 0, np.iinfo(kind).max).astype(kind)

    mask = np.ones(shape, bool)
    mask[:, : w // 12] = mask[h // 4 : h // 3, w // 2 : w // 2 + 9] = False
    curve = NoiseCurve(NOISE.dark * grain**2, NOISE.least * grain**2, NOISE.gain * grain)
    light = Light(seen(dark), seen(dark + bright), curve, mask)
    coarse = (2 * np.floor(place / 2) + 0.5).astype(np.float32)
    known = mask & (rng.random(shape) > 0.02)
    square = rng.uniform(0, 90, shape).astype(np.float32)
    view = View.across(Coarse(coarse, known, square), light, period, 2)
    spread = np.sqrt(0.4 + (width / abs(slope)) ** 2 / 12)
    pictures: list[np.ndarray] = []
    for shift in range(period):
        away = (place - shift - (width - 1) / 2 + period / 2) % period - period / 2
        pictures.append(view.turn(seen(dark + bright * 0.9 * np.exp(-((away / slope / spread) ** 2) / 2))))
    return view, pictures, size


def assert_as_numpy(seed: int, width: int, period: int, kind: type, slope: float, shape: tuple[int, int]) -> int:
    """Compare all lines of a scene, and return how many there are."""
    view, pictures, size = scene(seed, width, period, kind, slope, shape)
    reach = (width - 1) / 2
    told = float(period), period / 2 - 1, reach, size - 1 - reach, MIN_CONTRAST, MIN_SNR
    rules = [LineRule(shift + reach, *told) for shift in range(period)]
    found = find_lines(view, pictures, scales_of(width, period), rules).peaks()
    expected = lines_by_numpy(view, pictures, width, period, size)
    np.testing.assert_array_equal(found.row, expected.row)
    np.testing.assert_array_equal(found.value, expected.value)
    np.testing.assert_allclose(found.col, expected.col, atol=2e-4)
    np.testing.assert_allclose(found.sigma, expected.sigma, rtol=1e-3)
    np.testing.assert_allclose(found.confidence, expected.confidence, atol=1e-4)
    return len(found.row)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize(("width", "period"), [(1, 6), (2, 8), (1, 5), (3, 12)])
@pytest.mark.parametrize("slope", [0.21, -0.7, 1.0, 1.8])
def test_lines_are_those_of_numpy(kind: type, width: int, period: int, slope: float) -> None:
    assert assert_as_numpy(7, width, period, kind, slope, (57, 411)) > 1000


@pytest.mark.parametrize("slope", [-0.7, 1.8, 2.2])
@pytest.mark.parametrize("shape", [(9, 40), (1, 30)])
def test_lines_of_the_smallest_pictures_are_those_of_numpy(shape: tuple[int, int], slope: float) -> None:
    assert assert_as_numpy(1, 1, 6, np.uint8, slope, shape) > 0


@pytest.mark.parametrize("slope", [0.05, -0.7, 1.8, 2.2])
@pytest.mark.parametrize("shape", [(40, 9), (3, 12), (2, 2)])
def test_pictures_too_small_for_a_line_have_none(shape: tuple[int, int], slope: float) -> None:
    assert assert_as_numpy(1, 1, 6, np.uint8, slope, shape) == 0


def test_a_line_that_is_moved_off_an_unknown_slope_has_a_sigma() -> None:
    shape, columns = (3, 40), np.arange(40)
    white = np.broadcast_to(np.exp(0.1 * columns), shape).astype(np.float32)
    light = Light(np.zeros(shape, np.float32), 1000 * white, NOISE, np.ones(shape, bool))
    place = np.broadcast_to(columns, shape).astype(np.float32)
    known = np.broadcast_to(columns != 20, shape)
    view = View.across(Coarse(place, known, np.ones(shape, np.float32)), light, 6, 1)
    slope = np.where(known, np.float32(1), np.float32(np.nan))
    vars(view)["slope"] = slope  # windows of several px would leave none unknown
    one = np.ones(1)
    moved = view.centered(Peaks(np.array([1]), 20.49 * one, 0.1 * one, one, one, 20 * one), 6.0)
    assert moved.nearest == 21 and 0.1 < moved.sigma_col < 1


def test_lines_become_correspondences_of_their_axis() -> None:
    view, pictures, size = scene(3, 1, 6, np.uint8, 1.0, (40, 200))
    rules = [LineRule(shift, 6.0, 2.0, 0.0, size - 1.0, MIN_CONTRAST, MIN_SNR) for shift in range(6)]
    lines = find_lines(view, pictures, scales_of(1, 6), rules)
    peaks, white = lines.peaks(), view.light.white
    for axis in (0, 1):
        found = lines.correspondences(axis, white)
        np.testing.assert_array_equal(found.camera_xy, peaks.camera_xy.astype(np.float32))
        np.testing.assert_array_equal(found.projector_xy[:, axis], peaks.value.astype(np.float32))
        np.testing.assert_array_equal(found.sigma[:, axis], peaks.sigma)
        assert np.isnan(found.projector_xy[:, 1 - axis]).all() and np.isnan(found.sigma[:, 1 - axis]).all()
        grey = white[peaks.row, np.rint(peaks.col).astype(int)] / white.max()
        np.testing.assert_allclose(found.color, np.repeat(grey[:, None], 3, axis=1), atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(seed=SEED, jump=st.floats(1, 9), radius=st.integers(1, 12))
def test_slopes_are_those_of_numpy(seed: int, jump: float, radius: int) -> None:
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(1, 14)), int(rng.integers(2, 60))
    value = np.cumsum(rng.uniform(-1, 2, shape), axis=1).astype(np.float32)
    value[:, shape[1] // 2 :] += 50
    mask = rng.random(shape) > 0.2
    step = np.diff(value, axis=1)
    known = mask[:, 1:] & mask[:, :-1] & (np.abs(step) < jump)
    expected = np.full(shape, np.nan)
    for row, col in np.ndindex(shape[0], shape[1] - 1):
        window = np.s_[max(row - 2, 0) : row + 3, max(col - radius, 0) : col + radius + 1]
        if known[window].sum() > radius:
            expected[row, col] = step[window][known[window]].mean()
    expected[:, -1] = expected[:, -2]
    np.testing.assert_allclose(slope_along_rows(value, mask, jump, radius), expected, rtol=1e-4, atol=1e-5)


@settings(max_examples=40, deadline=None)
@given(seed=SEED, width=st.integers(1, 4), period=st.integers(5, 14))
def test_each_pixel_has_the_nearest_of_the_kernels(seed: int, width: int, period: int) -> None:
    rng = np.random.default_rng(seed)
    slope = np.exp(rng.uniform(-9, 3, (3, 80))).astype(np.float32) * rng.choice([-1, 1], (3, 80)).astype(np.float32)
    slope[rng.random(slope.shape) < 0.1] = np.nan
    scales = scales_of(width, period)
    kernels, runs, starts = np.empty(slope.shape, np.uint8), np.empty((slope.size, 3), np.int32), np.empty(4, np.int32)
    run_rows(slope, scales, kernels, runs, starts)
    covered = np.full(slope.shape, NO_KERNEL, np.uint8)
    for row in range(3):
        for first, last, kernel in runs[starts[row] : starts[row + 1]]:
            covered[row, first:last][kernels[row, first:last] == kernel] = kernel
    np.testing.assert_array_equal(covered, kernels)
    used = np.where(kernels == NO_KERNEL, np.nan, np.sqrt(np.append(scales.square, np.zeros(256))[kernels]))
    np.testing.assert_allclose(used, scale_map(slope, width, period)[0], rtol=1e-6)


def test_the_logarithm_of_light_is_that_of_numpy() -> None:
    rng = np.random.default_rng(0)
    high, low = (rng.integers(0, top, (20, 300)).astype(np.uint16) for top in (65535, 900))
    logs = np.empty((22, 300), np.float32)
    log_rows(high, low, -1, logs)
    expected = np.log(np.maximum(high.astype(float) - low, 1))
    np.testing.assert_allclose(logs, expected[np.clip(np.arange(-1, 21), 0, 19)], atol=1e-6)
