"""Sums and phases of shifted sinusoids, in compiled loops over rows of pixels."""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
# Beyond such an exponent 1 + exp(-x) is 1 in float32.
_CERTAIN = np.float32(17.0)
_TERMS = 8
_LEAST_SNR = 1e-3

FRAMES = 4
"""So many frames are taken at a time."""
CHUNK = 2048
"""Pixels whose sums lie side by side: cosine, sine and total of so many, then those of the next.

A fixed distance between the three tells the compiler that they do not overlap, which it needs for parallel lanes.
"""
SINE, TOTAL = CHUNK, 2 * CHUNK


@cache
def arctangent() -> Singles:
    """Return the coefficients (8,) of a polynomial p with |atan(x) - x p(x^2)| < 1e-7 for x up to 1; do not write."""
    chebyshev = np.polynomial.chebyshev.Chebyshev.interpolate(_atan_over_x, _TERMS - 1, [0, 1])
    return chebyshev.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef.astype(np.float32)


def _atan_over_x(square: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x = np.sqrt(np.maximum(square, 1e-18))
    return np.arctan(x) / x


def sums_for(steps: int, rows: int, width: int) -> Singles:
    """Return memory for the sums over sets of at most so many frames, (r, c, 3 CHUNK) or, used again, (1, 1, 3 CHUNK).

    More than four frames are added by several calls, so that each chunk of pixels needs sums of its own.
    """
    shape = (rows, -(-width // CHUNK)) if steps > FRAMES else (1, 1)
    return np.empty((*shape, 3 * CHUNK), dtype=np.float32)


@_compiled
def wave_rows(
    one: Levels,
    two: Levels,
    three: Levels,
    four: Levels,
    weights: Singles,
    most: Levels,
    first: bool,
    last: bool,
    sums: Singles,
    steps: int,
    noise: Singles,
    offset: float,
    p: Singles,
    mask: Mask,
    cycle: Singles,
    sigma: Singles,
    light: Singles,
    confidence: Singles,
) -> None:
    """Take four frames of a set (r, w) into its sums; with the last, write what these tell, (r, w) each.

    weights (4, 3): cosine and sine of each frame's shift, and 1; or 0, 0, 0: it does not count. first, last: of `steps`
    frames. sums: `sums_for`. noise (3,), most (4,): as `lit_rows`. p (8,): `arctangent`. cycle: phase in periods, 0 to
    1, less offset in radians; sigma: its 1 sigma, sqrt(2 / steps) / (2 pi) noise / modulation; light: the modulation
    in grey levels, at least 1. Where mask says, confidence is multiplied by the chance that noise alone modulates less,
    1 - exp(-steps snr^2 / 4) after Rayleigh. Where mask leaves out a whole chunk, light is 1, cycle and sigma are 0.
    """
    for row in range(cycle.shape[0]):
        for start in range(0, cycle.shape[1], CHUNK):
            cut, to = slice(start, start + CHUNK), sums[row % sums.shape[0], start // CHUNK % sums.shape[1]]
            if not _any(mask[row, cut]):
                light[row, cut] = 1
                cycle[row, cut] = sigma[row, cut] = 0
                continue
            add_four(one[row, cut], two[row, cut], three[row, cut], four[row, cut], weights, first, to)
            if last:
                _phase(to, offset, p, cycle[row, cut])
                _amplitude(to, steps, noise, light[row, cut], sigma[row, cut])
                _chance(sigma[row, cut], mask[row, cut], confidence[row, cut])


@_compiled
def _any(mask: Mask) -> bool:
    count = 0
    for k in range(len(mask)):
        count += mask[k]
    return count > 0


@_compiled
def add_four(
    one: Levels, two: Levels, three: Levels, four: Levels, weights: Singles, afresh: bool, sums: Singles
) -> None:
    c0, c1, c2, c3 = weights[0, 0], weights[1, 0], weights[2, 0], weights[3, 0]
    s0, s1, s2, s3 = weights[0, 1], weights[1, 1], weights[2, 1], weights[3, 1]
    t0, t1, t2, t3 = weights[0, 2], weights[1, 2], weights[2, 2], weights[3, 2]
    if afresh:
        sums[:] = 0
    for k in range(len(one)):
        a, b, c, d = np.float32(one[k]), np.float32(two[k]), np.float32(three[k]), np.float32(four[k])
        sums[k] = sums[k] + c0 * a + c1 * b + c2 * c + c3 * d
        sums[SINE + k] = sums[SINE + k] + s0 * a + s1 * b + s2 * c + s3 * d
        sums[TOTAL + k] = sums[TOTAL + k] + t0 * a + t1 * b + t2 * c + t3 * d


@_compiled
def _phase(here: Singles, offset: float, p: Singles, cycle: Singles) -> None:
    p0, p1, p2, p3, p4, p5, p6, p7 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    turn, start = np.float32(1 / (2 * np.pi)), np.float32(offset / (2 * np.pi))
    zero, one, quarter, half = np.float32(0), np.float32(1), np.float32(np.pi / 2), np.float32(np.pi)
    for k in range(len(cycle)):
        x, y = here[k], here[SINE + k]
        a, b = abs(x), abs(y)
        low, high = min(a, b), max(a, b)
        ratio = low / high if high > zero else zero
        t = ratio * ratio
        angle = ratio * (p0 + t * (p1 + t * (p2 + t * (p3 + t * (p4 + t * (p5 + t * (p6 + t * p7)))))))
        angle = quarter - angle if b > a else angle
        angle = half - angle if x < zero else angle
        angle = -angle if y < zero else angle
        place = angle * turn - start
        place -= np.floor(place)
        cycle[k] = zero if place >= one else place


@_compiled
def _amplitude(here: Singles, steps: int, noise: Singles, light: Singles, sigma: Singles) -> None:
    share, mean = np.float32(2 / steps), np.float32(1 / steps)
    least, gain, dark, zero = noise[0], noise[1], noise[2], np.float32(0)
    scale, lowest, one = np.float32(np.sqrt(2 / steps) / (2 * np.pi)), np.float32(_LEAST_SNR), np.float32(1)
    for k in range(len(sigma)):
        x, y = here[k], here[SINE + k]
        size = np.sqrt(x * x + y * y) * share
        variance = least + gain * max(here[TOTAL + k] * mean - dark, zero)
        light[k] = max(size, one)
        sigma[k] = scale / max(size / np.sqrt(variance), lowest)


@_compiled
def _chance(sigma: Singles, mask: Mask, confidence: Singles) -> None:
    # The exponent is steps / 4 snr^2 = 1 / (8 pi^2 sigma^2).
    scale = np.float32(1 / (8 * np.pi**2))
    least = np.sqrt(scale / _CERTAIN)
    doubtful = 0
    for k in range(len(sigma)):
        doubtful += mask[k] & (sigma[k] > least)
    if doubtful:
        for k in range(len(sigma)):
            if mask[k] & (sigma[k] > least):
                confidence[k] *= -np.expm1(-scale / (sigma[k] * sigma[k]))
