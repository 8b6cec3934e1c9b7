import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._edges import _SCALE, refined
from slkit.codecs._footprint import VARIANCE, displacement
from slkit.codecs._line_scales import SMALLEST_SCALE
from slkit.codecs._line_view import Coarse, View
from slkit.codecs._masks import Light
from slkit.codecs._noise import NoiseCurve
from slkit.codecs._peaks import Peaks, agreeing, fill_between

from ..bench_pictures import lines_by_kernels
from ..numpy_twins import centres


def gaussians(centers: np.ndarray, sigma: float, width: int = 60) -> np.ndarray:
    return np.exp(-((np.arange(width) - centers[:, None]) ** 2) / (2 * sigma**2)).astype(np.float32)


def peaks_of(picture: np.ndarray, noise: float = 0.01, scale: float = 0.9, spacing: float = 8.0) -> Peaks:
    """The lines that one kernel finds, all of them."""
    return Peaks(*lines_by_kernels(picture, np.full_like(picture, noise**2), scale, spacing))


def some_peaks(row: list[int], col: list[float], value: list[float]) -> Peaks:
    blank = np.zeros(len(row))
    return Peaks(np.array(row, dtype=np.int64), np.array(col), blank, blank, blank, np.array(value))


@settings(max_examples=40, deadline=None)
@given(sigma=st.floats(0.85, 2.5), scale=st.floats(0.9, 2.0), start=st.floats(25, 35))
def test_a_sampled_line_is_placed_to_a_hundredth_of_a_pixel(sigma: float, scale: float, start: float) -> None:
    centers = start + np.linspace(0, 1, 11)
    found = peaks_of(gaussians(centers, sigma), scale=scale, spacing=24)
    found = found.select(found.contrast > 0.5)
    np.testing.assert_array_equal(found.row, np.arange(11))
    assert np.abs(found.col - centers).max() < 0.01


def test_sigma_is_the_scatter_under_noise(rng: np.random.Generator) -> None:
    centers = 25 + 10 * rng.random(4000)
    picture = gaussians(centers, 1.0) + rng.normal(0, 0.02, (4000, 60)).astype(np.float32)
    found = peaks_of(picture, noise=0.02)
    found = found.select(found.contrast > 0.5)
    assert len(found) == 4000
    ratio = (found.col - centers[found.row]) / found.sigma_col
    assert 0.95 < ratio.std() < 1.1
    # The Cramer-Rao bound for a Gaussian profile: 1.06 sqrt(sigma) noise / height.
    assert np.median(found.sigma_col) < 1.1 * 1.06 * 0.02


def test_only_peaks_that_go_on_smoothly_agree() -> None:
    col = [2.0, 4.0, 6.0, 8.0, 10.0, 3.0, 30.0]
    value = [1.0, 2.0, 9.0, 4.0, 5.0, 1.0, 2.0]
    peaks = some_peaks([0, 0, 0, 0, 0, 1, 1], col, value)
    agree = agreeing(peaks, np.full(7, 0.5), 3.0)
    assert agree.tolist() == [True, True, False, True, True, False, False]
    assert not agreeing(peaks, np.full(7, -0.5), 3.0).any()
    assert len(agreeing(some_peaks([], [], []), np.empty(0), 3.0)) == 0


def test_between_two_lines_the_value_is_interpolated() -> None:
    peaks = some_peaks([1, 1, 1, 2], [2.5, 6.5, 20.0, 3.0], [10.0, 11.0, 19.0, 12.0])
    value, sigma = fill_between(peaks.row, peaks.col, peaks.value, np.full(4, 0.1), (4, 30), 3.0)
    np.testing.assert_allclose(value[1, 3:7], [10.125, 10.375, 10.625, 10.875])
    assert np.isfinite(value).sum() == np.isfinite(sigma).sum() == 4
    assert (sigma[1, 3:7] < 0.1).all()


def seen_by_pixels(light: np.ndarray, fine: int, variance: float) -> np.ndarray:
    """Return samples `fine` px apart of light that is blurred by a Gaussian of `variance` px."""
    reach = 5 * fine
    at = np.arange(-reach, reach + 1) / fine
    kernel = np.exp(-(at**2) / (2 * variance))
    return np.convolve(light, kernel / kernel.sum(), "same")[::fine]


def scene(steepness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return brightness, line centres and line pictures of a row whose brightness changes by `steepness` per px."""
    fine = 20
    u = np.arange(80 * fine) / fine
    brightness = 40 * np.exp(steepness * (u - 40))
    centers = np.arange(20, 60, 3.3)
    lines = np.exp(-((u - centers[:, None]) ** 2) / (2 * 0.6**2))
    pictures = np.stack([seen_by_pixels(brightness * line, fine, VARIANCE) for line in lines])
    return seen_by_pixels(brightness, fine, VARIANCE), centers, pictures


@pytest.mark.parametrize("steepness", [-0.06, 0.06])
def test_lines_on_a_scene_of_changing_brightness_are_moved_back(steepness: float) -> None:
    white, centers, pictures = scene(steepness)
    high = np.tile(white.astype(np.float32), (len(centers), 1))
    share = (pictures / high).astype(np.float32)
    known = np.ones(share.shape, dtype=bool)
    value = np.tile(np.arange(80, dtype=np.float32), (len(centers), 1))
    light = Light(np.zeros_like(high), high, NoiseCurve(0.0, 0.01, 0.0), known)
    view = View.across(Coarse(value, known, np.full_like(high, 9)), light, 6, 1)
    found = peaks_of(share, noise=0.001)
    found = found.select(found.contrast > 0.1)
    moved = view.centered(found, 6)
    before, after = found.col - centers[found.row], moved.col - centers[moved.row]
    assert len(found) == len(centers)
    assert np.abs(np.median(before)) > 0.02
    assert np.abs(after).max() < 0.006
    assert (moved.sigma_col > found.sigma_col).all()


def test_displacement_is_that_of_a_patch_of_the_scene() -> None:
    fine = 20
    u = np.arange(60 * fine) / fine
    brightness = 50 * np.exp(0.05 * (u - 30))
    value = 0.9 * u + 0.01 * (u - 30) ** 2
    seen = seen_by_pixels(brightness * value, fine, 1.0) / seen_by_pixels(brightness, fine, 1.0)
    rows = np.tile(seen.astype(np.float32), (9, 1))
    span = np.tile(seen_by_pixels(brightness, fine, 1.0).astype(np.float32), (9, 1))
    shift = displacement(rows, np.ones(rows.shape, dtype=bool), span, 3.0)
    inner = np.s_[2:-2, 10:50]
    np.testing.assert_allclose((rows - value[::fine])[inner], shift[inner], atol=2e-3)
    assert (np.abs(shift[inner]) > 0.01).all()
    assert not shift[:2].any() and not displacement(rows, np.zeros(rows.shape, dtype=bool), span, 3.0).any()


def test_the_narrowest_kernel_ends_well_before_the_next_line() -> None:
    centers = 25 + np.linspace(0, 1, 21)
    picture = sum(gaussians(centers + 3.4 * k, 0.85) for k in range(-9, 10))
    found = peaks_of(np.asarray(picture, np.float32), scale=SMALLEST_SCALE, spacing=3.4)
    near = found.select(np.abs(found.col - centers[found.row]) < 1)
    assert len(near) == 21
    assert np.abs(near.col - centers[near.row]).max() < 0.01


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_compiled_places_of_edges_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.uniform(0, 1, (6, 60)).astype(np.float32)
    noise = rng.uniform(0.01, 0.1, picture.shape).astype(np.float32)
    row, start = rng.integers(0, 6, 40), rng.uniform(-0.4, 59.4, 40)
    col, sigma = centres(picture, noise, row, start, _SCALE, rising=True)
    found, spread = refined(picture, noise, row, start)
    # A pace that is nearly zero may have either sign in another order of summing.
    usual = ~(np.abs(sigma) > 1e3)
    np.testing.assert_allclose(found[usual], col[usual], atol=1e-4)
    np.testing.assert_allclose(spread[usual], sigma[usual], rtol=1e-3)
