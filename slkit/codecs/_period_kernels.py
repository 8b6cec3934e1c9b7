"""The periods that coarser fringes choose, in compiled loops over rows of pixels."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
# Beyond such an exponent 1 + exp(-x) is 1 in float32.
_CERTAIN = np.float32(17.0)


@_compiled
def place_on_axis(cycle: Singles, cycle_sigma: Singles, pitch: float, center: float, position: Singles, sigma: Singles):
    """Write position and sigma in px (r, w) on one period as long as the axis, whose middle is `center`.

    Taken around the middle, so that noise wraps at both ends alike. cycle, cycle_sigma (r, w) in periods.
    """
    wide, middle, share = np.float32(pitch), np.float32(center), np.float32(center / pitch)
    half = np.float32(0.5)
    for row in range(cycle.shape[0]):
        for col in range(cycle.shape[1]):
            off = cycle[row, col] - share + half
            position[row, col] = middle + (off - np.floor(off) - half) * wide
        for col in range(cycle.shape[1]):
            sigma[row, col] = cycle_sigma[row, col] * wide


@_compiled
def distances(
    position: Singles, cycle: Singles, pitch: float, center: float, extent: float, longest: float, out: Singles
) -> None:
    """Write how far, in periods, a coarse position in px is from the nearest whole period, (r, w) each.

    center, extent: of the axis in px; longest: the coarsest period in px, after which a position wraps, or infinite.
    """
    order = np.empty(position.shape[1], dtype=np.float32)
    for row in range(position.shape[0]):
        _nearest(position[row], cycle[row], pitch, order, out[row])
        _mend_ends(position[row], cycle[row], pitch, center, extent, longest, order, out[row])


@_compiled
def refine_rows(
    cycle: Singles,
    cycle_sigma: Singles,
    pitch: float,
    center: float,
    extent: float,
    longest: float,
    beyond: float,
    reach: float,
    log_odds: float,
    position: Singles,
    sigma: Singles,
    confidence: Singles,
    mask: Mask,
) -> None:
    """Turn a coarse position and sigma in px (r, w) into those of the chosen period; take doubtful pixels out of mask.

    cycle, cycle_sigma in periods; beyond: variance in periods squared that the picture shows above what both sigmas
    predict. A distance counts up to `reach` periods, and up to where the odds are exp(log_odds). confidence is
    multiplied by odds / (1 + odds) where mask says. Else as `distances`.
    """
    order, distance = np.empty(cycle.shape[1], dtype=np.float32), np.empty(cycle.shape[1], dtype=np.float32)
    per_px, wide, more = np.float32(1 / pitch), np.float32(pitch), np.float32(beyond)
    for row in range(cycle.shape[0]):
        here, own, far = cycle[row], cycle_sigma[row], sigma[row]
        _nearest(position[row], here, pitch, order, distance)
        _mend_ends(position[row], here, pitch, center, extent, longest, order, distance)
        for k in range(len(far)):
            coarse = far[k] * per_px
            far[k] = coarse * coarse + own[k] * own[k] + more
        _choose(distance, far, reach, log_odds, confidence[row], mask[row])
        for k in range(len(far)):
            far[k] = own[k] * wide
        to = position[row]
        for k in range(len(far)):
            to[k] = (here[k] + order[k]) * wide


@_compiled
def _nearest(position: Singles, cycle: Singles, pitch: float, order: Singles, distance: Singles) -> None:
    """Write the whole periods (w,) that bring cycle nearest to position / pitch, and what is left, in periods."""
    per_px = np.float32(1 / pitch)
    for k in range(len(position)):
        raw = position[k] * per_px - cycle[k]
        whole = np.rint(raw)
        order[k] = whole
        distance[k] = raw - whole


@_compiled
def _mend_ends(
    position: Singles,
    cycle: Singles,
    pitch: float,
    center: float,
    extent: float,
    longest: float,
    order: Singles,
    distance: Singles,
) -> None:
    """Move pixels (w,) at one end of an axis to its other end, in place, where that fits image and phase better."""
    if longest == np.inf:
        return
    per_px, middle, half = np.float32(1 / pitch), np.float32(center / pitch), np.float32(extent / 2 / pitch)
    core, rim, turn, zero = np.float32(center), np.float32(extent / 2 - pitch), np.float32(longest), np.float32(0)
    for k in range(len(position)):
        off, place = position[k] - core, cycle[k]
        raw = (position[k] - (turn if off > zero else -turn)) * per_px - place
        other = np.rint(raw)
        there = abs(raw - other) + max(abs(place + other - middle) - half, zero)
        here = abs(distance[k]) + max(abs(place + order[k] - middle) - half, zero)
        better = (abs(off) > rim) & (there < here)
        order[k] = other if better else order[k]
        distance[k] = raw - other if better else distance[k]


@_compiled
def _choose(
    distance: Singles, variance: Singles, reach: float, log_odds: float, confidence: Singles, mask: Mask
) -> None:
    """Judge distances (w,) of a variance (w,) in periods squared: see `refine_rows`. Overwrites variance."""
    surely, most, least, half, one = (
        np.float32(log_odds),
        np.float32(reach),
        np.float32(1e-6),
        np.float32(0.5),
        np.float32(1),
    )
    for k in range(len(mask)):
        mask[k] &= abs(distance[k]) < min(most, half - surely * variance[k])
    for k in range(len(mask)):
        variance[k] = (half - abs(distance[k])) / max(variance[k], least)
    odds, doubtful = variance, 0
    for k in range(len(mask)):
        doubtful += mask[k] & (odds[k] < _CERTAIN)
    if doubtful:
        for k in range(len(mask)):
            if mask[k] & (odds[k] < _CERTAIN):
                confidence[k] /= one + np.exp(-odds[k])


@_compiled
def keep_inside(
    position: Singles, sigma: Singles, center: float, rim: float, end: float, sigmas: float, mask: Mask
) -> None:
    """Take out of mask (r, w) what lies more than rim, or more than end - sigmas sigma, from the middle of an axis.

    position, sigma (r, w), center, rim and end in px; end: infinite where nothing can wrap.
    """
    middle, most, wrap, wide = np.float32(center), np.float32(rim), np.float32(end), np.float32(sigmas)
    for row in range(mask.shape[0]):
        for col in range(mask.shape[1]):
            mask[row, col] &= abs(position[row, col] - middle) <= min(most, wrap - wide * sigma[row, col])


@_compiled
def blank_outside(mask: Mask, position: Singles) -> None:
    """Write NaN to position where mask does not hold, (r, w) each."""
    nothing = np.float32(np.nan)
    for row in range(mask.shape[0]):
        for col in range(mask.shape[1]):
            position[row, col] = position[row, col] if mask[row, col] else nothing
