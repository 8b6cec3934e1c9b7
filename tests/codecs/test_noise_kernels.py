"""The noise that pictures show, beside the NumPy that says how it is measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._masks import without_rim
from slkit.codecs._noise import Evidence, noise_curve
from slkit.codecs._tiles import Tiles, sampled


def by_numpy(evidence: list[Evidence]) -> tuple[float, float, float]:
    """The dark level, the variance there and its gain of the line below no step of the grey level."""
    sizes, levels = [], []
    for e in evidence:
        rows = np.diff(e.picture.astype(float), 2, axis=0)
        both = np.abs(np.diff(rows, 2, axis=1)) / (6 * np.sqrt(e.share))
        windows = np.lib.stride_tricks.sliding_window_view(e.level.astype(float), (3, 3))
        inner = e.usable[1:-1, 1:-1]
        sizes.append(both[inner])
        levels.append(windows.mean(axis=(2, 3))[inner])
    size, level = np.concatenate(sizes), np.concatenate(levels)
    low, high = level.min(), level.max()
    step = np.minimum(((level - low) * 8 / max(high - low, 1e-6)).astype(int), 7)
    groups = [size[step == i] for i in range(8) if np.sum(step == i) >= 100]
    centers = [level[step == i].mean() for i in range(8) if np.sum(step == i) >= 100]
    if not groups:
        groups, centers = [size], [level.mean()]
    variances = []
    for group in groups:
        spread = 1.4826 * np.median(group)
        kept = np.minimum(group, 3 * spread) if spread > 0 else group
        variances.append(max(np.mean(kept**2), 1 / 12))
    gains = [(v - variances[0]) / (c - centers[0]) for v, c in zip(variances[1:], centers[1:], strict=True)]
    return centers[0], variances[0], max(min(gains, default=0), 0)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    height=st.integers(3, 60),
    width=st.integers(3, 60),
    share=st.floats(0.1, 2),
    whole=st.booleans(),
)
def test_the_curve_is_that_of_numpy(seed: int, height: int, width: int, share: float, whole: bool) -> None:
    rng = np.random.default_rng(seed)
    evidence: list[Evidence] = []
    for scale in rng.uniform(1, 200, int(rng.integers(1, 3))):
        level = (scale * rng.random((height, 1)) + rng.normal(0, 3, (height, width))).astype(np.float32)
        picture = (level + rng.normal(0, 2, level.shape)).astype(np.float32)
        usable = rng.random(level.shape) < 0.8
        usable[height // 2, width // 2] = True
        evidence.append(Evidence(np.rint(picture) if whole else picture, level, usable, share))
    if not any(e.usable[1:-1, 1:-1].any() for e in evidence):
        return
    curve = noise_curve(evidence)
    dark, least, gain = by_numpy(evidence)
    # A level on the border of two steps may fall to either side.
    np.testing.assert_allclose([curve.dark, curve.least], [dark, least], rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(curve.gain * 100, gain * 100, rtol=0.05, atol=0.05)


def test_nothing_usable_is_no_noise_but_rounding() -> None:
    picture = np.arange(50, dtype=np.float32).reshape(5, 10)
    for evidence in (
        Evidence(picture, picture, np.zeros((5, 10), bool)),
        Evidence(*[picture[:2]] * 2, np.ones((2, 10), bool)),
    ):
        curve = noise_curve([evidence])
        assert (curve.least, curve.gain) == (pytest.approx(1 / 12), 0)


@pytest.mark.parametrize("shape", [(20, 30), (400, 900), (1500, 2000)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_tiles_are_cut_out_of_a_picture(shape: tuple[int, int], kind: type) -> None:
    rng = np.random.default_rng(1)
    picture, saturated = rng.integers(0, 250, shape).astype(kind), rng.random(shape) < 0.3
    tiles, found = Tiles.of(shape), sampled(picture, saturated)
    np.testing.assert_array_equal(found.level, tiles.cut(picture))
    np.testing.assert_array_equal(found.usable, ~tiles.cut(saturated) & tiles.inner)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), height=st.integers(1, 20), width=st.integers(1, 20))
def test_a_mask_loses_what_has_more_than_two_neighbours_outside(seed: int, height: int, width: int) -> None:
    mask = np.random.default_rng(seed).random((height, width)) < 0.8
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(mask, 1, mode="edge"), (3, 3))
    np.testing.assert_array_equal(without_rim(mask), mask & (windows.sum(axis=(2, 3)) >= 7))
