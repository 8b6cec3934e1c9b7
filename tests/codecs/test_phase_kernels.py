"""The compiled loops of phase shift, each beside the NumPy that says what it computes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._footprint import around, displacement
from slkit.codecs._lit_kernels import add_tiles, lit_rows
from slkit.codecs._masks import saturation, without_rim
from slkit.codecs._noise import NoiseCurve
from slkit.codecs._patch_kernels import write_doubted
from slkit.codecs._period_kernels import blank_outside, distances, keep_inside, place_on_axis, refine_rows
from slkit.codecs._phase import FringeSet, mean_of, modulated, set_of
from slkit.codecs._results import row_counts
from slkit.codecs._rows import over_large_blocks
from slkit.codecs._tiles import Tiles
from slkit.codecs._unwrap import sample
from slkit.codecs._wave_kernels import CHUNK, arctangent, sums_for, wave_rows
from slkit.errors import DecodeError

SEED = st.integers(0, 2**32 - 1)
NOISE = NoiseCurve(dark=20.0, least=2.0, gain=0.05)


def shape_of(rng: np.random.Generator) -> tuple[int, int]:
    return int(rng.integers(1, 40)), int(rng.integers(1, 40))


def waves(
    seed: int, steps: int, sign: int, kind: type = np.uint8, shape: tuple[int, int] | None = None
) -> tuple[FringeSet, np.ndarray]:
    """A set of pictures of noise, and the complex sum over them."""
    rng = np.random.default_rng(seed)
    top, shape = 256 if kind is np.uint8 else 4096, shape or shape_of(rng)
    pictures = [rng.integers(0, top, shape).astype(kind) for _ in range(steps)]
    fringes = set_of(pictures, sign, float(rng.uniform(-7, 7)), 16.0)
    shift = np.exp(1j * sign * 2 * np.pi * np.arange(steps) / steps)
    return fringes, np.tensordot(shift, np.stack(pictures).astype(float), 1)


def run(fringes: FringeSet, mask: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `wave_rows` makes of a set: cycle, sigma, light and confidence."""
    out = np.ones((4, *mask.shape), dtype=np.float32)
    sums = sums_for(fringes.steps, *mask.shape)
    for four in fringes.fours():
        wave_rows(*four, sums, fringes.steps, NOISE.numbers, fringes.offset, arctangent(), mask, *out)
    return tuple(out)


@settings(max_examples=40, deadline=None)
@given(
    seed=SEED,
    steps=st.integers(3, 9),
    sign=st.sampled_from([1, -1]),
    kind=st.sampled_from([np.uint8, np.uint16]),
    wide=st.booleans(),
)
def test_phase_and_its_noise_are_those_of_numpy(seed: int, steps: int, sign: int, kind: type, wide: bool) -> None:
    fringes, total = waves(seed, steps, sign, kind, (2, 2 * CHUNK + 7) if wide else None)
    cycle, sigma, light, confidence = run(fringes, np.ones(total.shape, dtype=bool))
    away = (cycle - (np.angle(total) - fringes.offset) / (2 * np.pi) + 0.5) % 1 - 0.5
    assert (cycle >= 0).all() and (cycle < 1).all()
    modulation, level = np.abs(total) * 2 / steps, np.mean(fringes.frames, axis=0)
    clear = modulation > 0.01 * level.max()
    np.testing.assert_allclose(away[clear], 0, atol=2e-5)
    np.testing.assert_allclose(light, np.maximum(modulation, 1), rtol=1e-5, atol=1e-5 * level.max())
    snr = np.maximum(modulation / NOISE.at(level.astype(np.float32)), 1e-3)
    np.testing.assert_allclose(sigma[clear], (np.sqrt(2 / steps) / (2 * np.pi) / snr)[clear], rtol=1e-4)
    # Sums round in proportion to their size, which tells where the modulation is below the noise of 12 bits.
    rounding = 1e-5 * max(level.max() / 256, 1)
    np.testing.assert_allclose(confidence, -np.expm1(-steps / 4 * snr**2), atol=rounding)


def test_pixels_out_of_the_mask_keep_their_confidence_and_whole_chunks_are_passed_over() -> None:
    fringes, total = waves(1, 5, 1, shape=(3, 2 * CHUNK))
    mask = np.random.default_rng(2).random(total.shape) < 0.5
    mask[:, CHUNK:] = False
    every, some = run(fringes, np.ones_like(mask)), run(fringes, mask)
    for one, other in zip(every, some, strict=True):
        assert np.array_equal(one[mask], other[mask])
    assert (some[3][~mask] == 1).all() and (some[2][:, CHUNK:] == 1).all()


@settings(max_examples=30, deadline=None)
@given(seed=SEED, steps=st.integers(3, 9), snr=st.floats(1, 30), kind=st.sampled_from([np.uint8, np.uint16]))
def test_lit_and_saturated_pixels_are_those_of_numpy(seed: int, steps: int, snr: float, kind: type) -> None:
    fringes, total = waves(seed, steps, 1, kind)
    lit, saturated = np.ones(total.shape, dtype=bool), np.zeros(total.shape, dtype=bool)
    sums, mean = sums_for(steps, *total.shape), np.empty(total.shape, dtype=kind)
    for four in fringes.fours():
        lit_rows(*four, sums, steps, NOISE.numbers, snr, lit, saturated, mean)
    assert np.array_equal(mean, mean_of(fringes.frames))
    ratio = np.abs(total) * 2 / steps / NOISE.at(np.mean(fringes.frames, axis=0).astype(np.float32))
    sure = np.abs(ratio - snr) > 1e-3
    assert np.array_equal(lit[sure], (ratio > snr)[sure])
    assert np.array_equal(saturated, np.logical_or.reduce([saturation(frame) for frame in fringes.frames]))


@pytest.mark.parametrize(("kind", "top"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65535), (np.uint16, 3000)])
@pytest.mark.parametrize("colour", [False, True])
def test_modulated_pixels_are_not_saturated_and_not_at_a_rim(kind: type, top: int, colour: bool) -> None:
    """As in whole pictures, though worked out in parts; a colour is saturated where one of its channels is."""
    rng = np.random.default_rng(3)
    bright = np.where(rng.random((301, 90)) < 0.9, 0.3, 0.52)
    bright[:, :20] = 0
    shown = [(0.9 * bright * top * (1 + np.cos(2 * np.pi * step / 4))).clip(0, top).astype(kind) for step in range(4)]
    shown[2][100:104, 40:60] = top
    pictures = [np.stack([picture // 2, picture, picture // 3], axis=2) for picture in shown] if colour else shown
    fringes = set_of(pictures, 1, 0.0, 16.0)
    burnt = np.logical_or.reduce([saturation(picture) for picture in pictures])
    assert burnt[100:104, 40:60].all() == (top != 3000)
    total = np.abs(np.tensordot(1j ** np.arange(4), np.stack(fringes.frames).astype(float), 1)) / 2
    lit = total > 4 * NOISE.at(np.mean(fringes.frames, axis=0).astype(np.float32))
    within = rng.random(lit.shape) < 0.99
    expected = without_rim(without_rim(lit & ~burnt & within))
    mask, mean = modulated([fringes, fringes], NOISE, within, 4.0)
    assert np.array_equal(mask, expected)
    np.testing.assert_allclose(mean, np.mean(fringes.frames, axis=0), atol=0.501)
    assert colour or np.array_equal(mean, mean_of(shown))
    with pytest.raises(DecodeError, match="no pixel is lit"):
        modulated([set_of([0 * picture for picture in pictures], 1, 0.0, 16.0)], NOISE, None, 4.0)


def whole_periods(position: np.ndarray, cycle: np.ndarray, pitch: float, extent: float, longest: float) -> Any:
    """The whole periods nearest to a coarse position, at the end of the axis that fits better, and what is left."""
    center, half = (extent - 1) / 2, extent / 2 / pitch

    def fit(shifted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        raw = shifted / pitch - cycle
        order = np.rint(raw)
        return order, raw - order, np.abs(raw - order) + np.maximum(np.abs(cycle + order - center / pitch) - half, 0)

    order, distance, here = fit(position)
    if np.isinf(longest):
        return order, distance, np.full_like(here, np.inf)
    other, far, there = fit(position - np.where(position > center, longest, -longest))
    better = (np.abs(position - center) > extent / 2 - pitch) & (there < here)
    return np.where(better, other, order), np.where(better, far, distance), np.abs(there - here)


@settings(max_examples=40, deadline=None)
@given(seed=SEED, pitch=st.floats(8, 200), beyond=st.floats(0, 0.01), reach=st.floats(0.1, 0.45), wraps=st.booleans())
def test_the_chosen_period_is_that_of_numpy(seed: int, pitch: float, beyond: float, reach: float, wraps: bool) -> None:
    rng = np.random.default_rng(seed)
    shape, extent, longest = shape_of(rng), 512.0, 512.0 if wraps else np.inf
    position = rng.uniform(-1, 512, shape).astype(np.float32)
    cycle, own = rng.random(shape, dtype=np.float32), rng.uniform(1e-3, 0.05, shape).astype(np.float32)
    sigma = rng.uniform(0.01, 0.2 * pitch, shape).astype(np.float32)
    confidence, mask = rng.random(shape, dtype=np.float32), rng.random(shape) < 0.8
    order, distance, margin = whole_periods(position.astype(float), cycle.astype(float), pitch, extent, longest)
    variance = (sigma / pitch) ** 2 + own**2 + beyond
    limit = np.minimum(reach, 0.5 - np.log(99) * variance)
    odds = (1 - 2 * np.abs(distance)) / (2 * np.maximum(variance, 1e-6))
    # Rounding decides where two ends or two periods fit alike, and at the limit.
    sure = (margin > 1e-3) & (np.abs(distance) < 0.499) & (np.abs(np.abs(distance) - limit) > 1e-3)
    axis = pitch, (extent - 1) / 2, extent, longest
    found = np.empty_like(position)
    distances(position, cycle, *axis, found)
    np.testing.assert_allclose(found[sure], distance[sure], atol=1e-4)
    kept, chance = mask & (np.abs(distance) < limit), confidence / (1 + np.exp(-odds))
    out = position.copy(), sigma.copy(), confidence.copy(), mask.copy()
    refine_rows(cycle, own, *axis, beyond, reach, float(np.log(99)), *out)
    np.testing.assert_allclose(out[0][sure], ((cycle + order) * pitch)[sure], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(out[1], own * pitch, rtol=1e-5)
    assert np.array_equal(out[3][sure], kept[sure])
    np.testing.assert_allclose(out[2][sure & kept], chance[sure & kept], rtol=1e-3)


@settings(max_examples=20, deadline=None)
@given(seed=SEED, pitch=st.floats(512, 700))
def test_places_on_one_period_and_the_axis_they_lie_on_are_those_of_numpy(seed: int, pitch: float) -> None:
    rng = np.random.default_rng(seed)
    cycle, own = rng.random((2, *shape_of(rng)), dtype=np.float32)
    position, sigma = np.empty_like(cycle), np.empty_like(cycle)
    place_on_axis(cycle, own, pitch, 255.5, position, sigma)
    away = (cycle.astype(float) - 255.5 / pitch + 0.5) % 1 - 0.5
    clear = np.abs(away) < 0.499
    np.testing.assert_allclose(position[clear], (255.5 + away * pitch)[clear], atol=1e-3)
    np.testing.assert_allclose(sigma, own * pitch, rtol=1e-6)
    for end in (pitch / 2, np.inf):
        mask = rng.random(cycle.shape) < 0.7
        expected = mask & (np.abs(position - 255.5) <= np.minimum(256.5, np.float32(end) - 3 * sigma))
        keep_inside(position, sigma, 255.5, 256.5, end, 3.0, mask)
        assert np.array_equal(mask, expected)
    expected = np.where(mask, position, np.nan)
    blank_outside(mask, position)
    assert np.array_equal(position, expected, equal_nan=True)


@settings(max_examples=30, deadline=None)
@given(seed=SEED, parts=st.integers(1, 3), both=st.booleans())
def test_the_doubt_of_a_patch_is_that_of_numpy(seed: int, parts: int, both: bool) -> None:
    rng = np.random.default_rng(seed)
    shape = shape_of(rng)
    bends = rng.normal(0, 0.3, shape) + 0.02 * np.arange(shape[1]) ** 2
    bends[:, shape[1] // 2 :] += 20
    position, light = bends.astype(np.float32), rng.uniform(1, 200, shape).astype(np.float32)
    known, sigma = rng.random(shape) < 0.95, rng.random(shape, dtype=np.float32)
    shift = 0.4 * displacement(position, known, light, 4.0)
    expected = np.hypot(sigma, around(shift))
    keep = known & (rng.random(shape) < 0.8)
    starts, total = row_counts(keep)
    assert total == np.count_nonzero(keep)
    place, spread = (np.full((total, 2), -7, dtype=np.float32) for _ in range(2))
    position[~known] = np.nan
    cuts = np.linspace(0, shape[0], parts + 1).astype(int)
    for first, last in zip(cuts[:-1], cuts[1:], strict=True):
        told = keep, position, sigma, np.log(light), 4.0, 0.4
        write_doubted(first, last, *told, 1, not both, starts[first:last], place, spread)
    np.testing.assert_allclose(spread[:, 1], expected[keep], rtol=1e-4, atol=1e-5)
    assert np.array_equal(place[:, 1], position[keep])
    assert (place[:, 0] == -7).all() if both else np.isnan(place[:, 0]).all() and np.isnan(spread[:, 0]).all()


@settings(max_examples=30, deadline=None)
@given(seed=SEED, share=st.floats(0, 1), most=st.integers(1, 3000))
def test_a_sample_is_every_nth_pixel_of_a_mask(seed: int, share: float, most: int) -> None:
    rng = np.random.default_rng(seed)
    mask = rng.random((int(rng.integers(1, 30)), int(rng.integers(1, 300)))) < share
    pixels = np.flatnonzero(mask)
    expected = pixels[:: max(-(-len(pixels) // most), 1)]
    found = sample(mask, most)(np.arange(mask.size).reshape(mask.shape))
    assert found.shape == (1, len(expected)) and np.array_equal(found[0], expected)


@pytest.mark.parametrize("shape", [(40, 50), (600, 700)])
def test_tiles_are_added_up_where_they_lie(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    frames, tiles = [rng.integers(0, 256, shape).astype(np.uint8) for _ in range(3)], Tiles.of(shape)
    total, usable = np.zeros(tiles.shape, np.float32), np.ones(tiles.shape, dtype=bool)
    for frame in frames:
        add_tiles(frame, 250, tiles.rows, tiles.cols, total, usable)
    assert np.array_equal(total, np.sum([tiles.cut(frame).astype(float) for frame in frames], axis=0))
    assert np.array_equal(usable, np.all([tiles.cut(frame) <= 250 for frame in frames], axis=0))


def test_the_mean_of_pictures_is_rounded_to_their_depth() -> None:
    pictures = [np.full((2, 3, 3), level, np.uint16) for level in (1000, 1001, 1003)]
    mean = mean_of(pictures)
    assert mean.dtype == np.uint16 and (mean == 1001).all()


def test_large_blocks_cover_all_rows_once_with_memory_of_their_thread() -> None:
    seen = np.zeros(1000, dtype=int)

    def work(rows: slice, aside: list[int]) -> None:
        assert 0 < rows.stop - rows.start <= aside[0]
        seen[rows] += 1

    over_large_blocks(lambda most: [most], work, (1000, 4096))
    assert (seen == 1).all()
