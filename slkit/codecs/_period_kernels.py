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
def nearest_period(position: Singles, cycle: Singles, pitch: float, order: Singles, distance: Singles) -> None:
    """Write the whole periods (r, w) that bring cycle nearest to position / pitch, and what is left, in periods."""
    per_px = np.float32(1 / pitch)
    for row in range(position.shape[0]):
        for col in range(position.shape[1]):
            raw = position[row, col] * per_px - cycle[row, col]
            whole = np.rint(raw)
            order[row, col] = whole
            distance[row, col] = raw - whole


@_compiled
def mend_ends(
    position: Singles,
    cycle: Singles,
    pitch: float,
    center: float,
    extent: float,
    longest: float,
    order: Singles,
    distance: Singles,
) -> None:
    """Move pixels at one end of an axis to its other end, in place, where that fits image and phase better.

    (r, w) each; center, extent: of the axis in px; longest: the coarsest period in px, after which a position wraps.
    """
    per_px, middle, half = np.float32(1 / pitch), np.float32(center / pitch), np.float32(extent / 2 / pitch)
    core, rim, turn, zero = np.float32(center), np.float32(extent / 2 - pitch), np.float32(longest), np.float32(0)
    for row in range(position.shape[0]):
        for col in range(position.shape[1]):
            off, place = position[row, col] - core, cycle[row, col]
            raw = (position[row, col] - (turn if off > zero else -turn)) * per_px - place
            other = np.rint(raw)
            there = abs(raw - other) + max(abs(place + other - middle) - half, zero)
            here = abs(distance[row, col]) + max(abs(place + order[row, col] - middle) - half, zero)
            better = (abs(off) > rim) & (there < here)
            order[row, col] = other if better else order[row, col]
            distance[row, col] = raw - other if better else distance[row, col]


@_compiled
def choose_period(
    order: Singles,
    distance: Singles,
    cycle: Singles,
    cycle_sigma: Singles,
    pitch: float,
    beyond: float,
    reach: float,
    log_odds: float,
    position: Singles,
    sigma: Singles,
    confidence: Singles,
    mask: Mask,
) -> None:
    """Turn a coarse position and sigma in px (r, w) into those of the chosen period; take doubtful pixels out of mask.

    cycle_sigma in periods; beyond: variance in periods squared that the picture shows above what both sigmas predict.
    A distance counts up to `reach` periods, and up to where the odds are exp(log_odds). confidence is multiplied by
    odds / (1 + odds).
    """
    per_px, wide, surely = np.float32(1 / pitch), np.float32(pitch), np.float32(log_odds)
    more, most, least = np.float32(beyond), np.float32(reach), np.float32(1e-6)
    half, one, two = np.float32(0.5), np.float32(1), np.float32(2)
    odds = np.empty(order.shape[1], dtype=np.float32)
    for row in range(order.shape[0]):
        away, own, far, kept = distance[row], cycle_sigma[row], sigma[row], mask[row]
        for col in range(len(odds)):
            coarse = far[col] * per_px
            far[col] = coarse * coarse + own[col] * own[col] + more
        for col in range(len(odds)):
            kept[col] &= abs(away[col]) < min(most, half - surely * far[col])
        for col in range(len(odds)):
            odds[col] = (one - two * abs(away[col])) / (two * max(far[col], least))
        doubtful = 0
        for col in range(len(odds)):
            doubtful += kept[col] & (odds[col] < _CERTAIN)
        if doubtful:
            for col in range(len(odds)):
                if kept[col] & (odds[col] < _CERTAIN):
                    confidence[row, col] /= one + np.exp(-odds[col])
        for col in range(len(odds)):
            position[row, col] = (cycle[row, col] + order[row, col]) * wide
        for col in range(len(odds)):
            far[col] = own[col] * wide


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
