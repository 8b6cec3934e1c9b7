"""Phases of shifted sinusoids, and the periods that coarser ones choose, in compiled loops over rows of pixels."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
# Beyond such an exponent 1 + exp(-x) is 1 in float32.
_CERTAIN = np.float32(17.0)
_TERMS = 8


@cache
def arctangent() -> Singles:
    """Return the coefficients (8,) of a polynomial p with |atan(x) - x p(x^2)| < 1e-7 for x up to 1; do not write."""
    chebyshev = np.polynomial.chebyshev.Chebyshev.interpolate(_atan_over_x, _TERMS - 1, [0, 1])
    return chebyshev.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef.astype(np.float32)


def _atan_over_x(square: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x = np.sqrt(np.maximum(square, 1e-18))
    return np.arctan(x) / x


@_compiled
def add_step(frame: Levels, cosine_of: float, sine_of: float, cosine: Singles, sine: Singles, total: Singles) -> None:
    """Add one shifted frame (r, w) to the sums over a set, weighted by cosine and sine of its shift, and plainly."""
    c, s = np.float32(cosine_of), np.float32(sine_of)
    for row in range(frame.shape[0]):
        here, to_c, to_s, to_t = frame[row], cosine[row], sine[row], total[row]
        for col in range(len(here)):
            level = np.float32(here[col])
            to_c[col] += c * level
            to_s[col] += s * level
            to_t[col] += level


@_compiled
def finish_wave(
    cosine: Singles, sine: Singles, total: Singles, steps: int, offset: float, p: Singles, cycle: Singles
) -> None:
    """Write the phase in periods, 0 to 1, less offset in radians; turn cosine into the modulation, total into the mean.

    All (r, w); p (8,): `arctangent`.
    """
    p0, p1, p2, p3, p4, p5, p6, p7 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    turn, start = np.float32(1 / (2 * np.pi)), np.float32(offset / (2 * np.pi))
    share, mean = np.float32(2 / steps), np.float32(1 / steps)
    for row in range(cosine.shape[0]):
        here, up, out, level = cosine[row], sine[row], cycle[row], total[row]
        for col in range(len(here)):
            x, y = here[col], up[col]
            a, b = abs(x), abs(y)
            low, high = min(a, b), max(a, b)
            ratio = low / high if high > 0 else np.float32(0)
            t = ratio * ratio
            angle = ratio * (p0 + t * (p1 + t * (p2 + t * (p3 + t * (p4 + t * (p5 + t * (p6 + t * p7)))))))
            angle = np.float32(np.pi / 2) - angle if b > a else angle
            angle = np.float32(np.pi) - angle if x < 0 else angle
            angle = -angle if y < 0 else angle
            place = angle * turn - start
            place -= np.floor(place)
            out[col] = np.float32(0) if place >= 1 else place
        for col in range(len(here)):
            here[col] = np.sqrt(here[col] * here[col] + up[col] * up[col]) * share
        for col in range(len(level)):
            level[col] *= mean


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
    middle, half, rim = center / pitch, extent / 2 / pitch, extent / 2 - pitch
    for row in range(position.shape[0]):
        for col in range(position.shape[1]):
            off = position[row, col] - center
            if abs(off) <= rim:
                continue
            place = cycle[row, col]
            raw = (position[row, col] - (longest if off > 0 else -longest)) / pitch - place
            other = np.rint(raw)
            there = abs(raw - other) + max(abs(place + other - middle) - half, 0.0)
            here = abs(distance[row, col]) + max(abs(place + order[row, col] - middle) - half, 0.0)
            if there < here:
                order[row, col], distance[row, col] = other, raw - other


@_compiled
def choose_period(
    order: Singles,
    distance: Singles,
    cycle: Singles,
    cycle_sigma: Singles,
    coarse_sigma: Singles,
    pitch: float,
    beyond: float,
    reach: float,
    log_odds: float,
    position: Singles,
    sigma: Singles,
    confidence: Singles,
    mask: Mask,
) -> None:
    """Write position and sigma in px (r, w) of the chosen period; take doubtful pixels out of mask.

    cycle_sigma in periods, coarse_sigma in px; beyond: variance in periods squared that the picture shows above what
    these predict. A distance counts up to `reach` periods, and up to where the odds are exp(log_odds). confidence is
    multiplied by odds / (1 + odds).
    """
    per_px, wide, surely = np.float32(1 / pitch), np.float32(pitch), np.float32(log_odds)
    more, most = np.float32(beyond), np.float32(reach)
    for row in range(order.shape[0]):
        for col in range(order.shape[1]):
            coarse, own = coarse_sigma[row, col] * per_px, cycle_sigma[row, col]
            variance = coarse * coarse + own * own + more
            away = abs(distance[row, col])
            odds = (1 - 2 * away) / (2 * max(variance, np.float32(1e-6)))
            if odds < _CERTAIN:
                confidence[row, col] /= 1 + np.exp(-odds)
            mask[row, col] &= away < min(most, np.float32(0.5) - surely * variance)
            position[row, col] = (cycle[row, col] + order[row, col]) * wide
            sigma[row, col] = own * wide


@_compiled
def write_maps(
    mask: Mask,
    position: Singles,
    sigma: Singles,
    axis: int,
    alone: bool,
    starts: Longs,
    projector_xy: Singles,
    spread: Singles,
) -> None:
    """Write position and sigma of one axis (r, w) of the kept pixels to the rows of a result from starts (r,) on."""
    for row in range(mask.shape[0]):
        at = starts[row]
        for col in range(mask.shape[1]):
            if mask[row, col]:
                projector_xy[at, axis], spread[at, axis] = position[row, col], sigma[row, col]
                if alone:
                    projector_xy[at, 1 - axis], spread[at, 1 - axis] = np.nan, np.nan
                at += 1


@_compiled
def write_seen(
    row0: int,
    mask: Mask,
    confidence: Singles,
    light: Levels,
    brightest: float,
    starts: Longs,
    camera_xy: Singles,
    chance: Singles,
    color: Singles,
) -> None:
    """Write place, confidence and grey as colour of the kept pixels of rows row0 on (r, w); see `write_maps`."""
    scale = np.float32(1 / brightest)
    for row in range(mask.shape[0]):
        at = starts[row]
        for col in range(mask.shape[1]):
            if mask[row, col]:
                camera_xy[at, 0], camera_xy[at, 1], chance[at] = col, row0 + row, confidence[row, col]
                level = np.float32(light[row, col]) * scale
                color[at, 0], color[at, 1], color[at, 2] = level, level, level
                at += 1
