"""Sums and phases of shifted sinusoids, in compiled loops over rows of pixels, and the rows of a result."""

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
_LEAST_SNR = 1e-3

CHUNK = 512
"""Pixels whose sums lie side by side: cosine, sine and total of so many, then those of the next.

A fixed distance between the three tells the compiler that they do not overlap, which it needs for parallel lanes.
"""
_SINE, _TOTAL = CHUNK, 2 * CHUNK


@cache
def arctangent() -> Singles:
    """Return the coefficients (8,) of a polynomial p with |atan(x) - x p(x^2)| < 1e-7 for x up to 1; do not write."""
    chebyshev = np.polynomial.chebyshev.Chebyshev.interpolate(_atan_over_x, _TERMS - 1, [0, 1])
    return chebyshev.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef.astype(np.float32)


def _atan_over_x(square: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x = np.sqrt(np.maximum(square, 1e-18))
    return np.arctan(x) / x


@_compiled
def add_steps(
    one: Levels, two: Levels, three: Levels, four: Levels, weights: Singles, afresh: bool, sums: Singles
) -> None:
    """Add four shifted frames (r, w) to the sums over a set (r, chunks, 3 CHUNK), or begin these afresh: see `CHUNK`.

    weights (4, 3): the cosine and sine of each frame's shift, and 1; 0, 0, 0 for a frame that is not to count.
    """
    c0, c1, c2, c3 = weights[0, 0], weights[1, 0], weights[2, 0], weights[3, 0]
    s0, s1, s2, s3 = weights[0, 1], weights[1, 1], weights[2, 1], weights[3, 1]
    t0, t1, t2, t3 = weights[0, 2], weights[1, 2], weights[2, 2], weights[3, 2]
    for row in range(one.shape[0]):
        for chunk in range(sums.shape[1]):
            to, cut = sums[row, chunk], slice(chunk * CHUNK, (chunk + 1) * CHUNK)
            p, q, r, s = one[row, cut], two[row, cut], three[row, cut], four[row, cut]
            if afresh:
                to[:] = 0
            for k in range(len(p)):
                a, b, c, d = np.float32(p[k]), np.float32(q[k]), np.float32(r[k]), np.float32(s[k])
                to[k] = to[k] + c0 * a + c1 * b + c2 * c + c3 * d
                to[_SINE + k] = to[_SINE + k] + s0 * a + s1 * b + s2 * c + s3 * d
                to[_TOTAL + k] = to[_TOTAL + k] + t0 * a + t1 * b + t2 * c + t3 * d


@_compiled
def mark_saturated(one: Levels, two: Levels, three: Levels, four: Levels, most: Levels, saturated: Mask) -> None:
    """Mark where one of four frames (r, w) exceeds its highest level that is not saturated: most (4,)."""
    m0, m1, m2, m3 = most[0], most[1], most[2], most[3]
    for row in range(saturated.shape[0]):
        p, q, r, s, out = one[row], two[row], three[row], four[row], saturated[row]
        for k in range(len(out)):
            out[k] |= (p[k] > m0) | (q[k] > m1) | (r[k] > m2) | (s[k] > m3)


@_compiled
def keep_lit(sums: Singles, steps: int, noise: Singles, snr: float, lit: Mask) -> None:
    """Take out of lit (r, w) where the modulation is not above snr times the noise of one frame.

    noise (3,): variance in dark, its gain a level, the dark level.
    """
    square, mean = np.float32((steps * snr / 2) ** 2), np.float32(1 / steps)
    least, gain, dark, zero = noise[0], noise[1], noise[2], np.float32(0)
    for row in range(lit.shape[0]):
        for chunk in range(sums.shape[1]):
            here, out = sums[row, chunk], lit[row, chunk * CHUNK : (chunk + 1) * CHUNK]
            for k in range(len(out)):
                x, y = here[k], here[_SINE + k]
                variance = least + gain * max(here[_TOTAL + k] * mean - dark, zero)
                out[k] &= x * x + y * y > square * variance


@_compiled
def wave_rows(
    sums: Singles,
    steps: int,
    offset: float,
    noise: Singles,
    p: Singles,
    mask: Mask,
    cycle: Singles,
    sigma: Singles,
    modulation: Singles,
    confidence: Singles,
) -> None:
    """Write what the sums over a set of `steps` frames tell, (r, w) each; noise (3,): as `keep_lit`.

    cycle: the phase in periods, 0 to 1, less offset in radians; sigma: 1 sigma of it, sqrt(2 / steps) / (2 pi) noise /
    modulation; modulation in grey levels. Where mask says, confidence is multiplied by the chance that noise alone
    would modulate less, 1 - exp(-steps snr^2 / 4) after Rayleigh. p (8,): `arctangent`.
    """
    for row in range(cycle.shape[0]):
        for chunk in range(sums.shape[1]):
            here, cut = sums[row, chunk], slice(chunk * CHUNK, (chunk + 1) * CHUNK)
            _phase(here, offset, p, cycle[row, cut])
            _amplitude(here, steps, noise, modulation[row, cut], sigma[row, cut])
            _chance(sigma[row, cut], mask[row, cut], confidence[row, cut])


@_compiled
def _phase(here: Singles, offset: float, p: Singles, cycle: Singles) -> None:
    p0, p1, p2, p3, p4, p5, p6, p7 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    turn, start = np.float32(1 / (2 * np.pi)), np.float32(offset / (2 * np.pi))
    zero, one, quarter, half = np.float32(0), np.float32(1), np.float32(np.pi / 2), np.float32(np.pi)
    for k in range(len(cycle)):
        x, y = here[k], here[_SINE + k]
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
def _amplitude(here: Singles, steps: int, noise: Singles, modulation: Singles, sigma: Singles) -> None:
    share, mean = np.float32(2 / steps), np.float32(1 / steps)
    least, gain, dark, zero = noise[0], noise[1], noise[2], np.float32(0)
    scale, lowest = np.float32(np.sqrt(2 / steps) / (2 * np.pi)), np.float32(_LEAST_SNR)
    for k in range(len(sigma)):
        x, y = here[k], here[_SINE + k]
        size = np.sqrt(x * x + y * y) * share
        variance = least + gain * max(here[_TOTAL + k] * mean - dark, zero)
        modulation[k] = size
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


@_compiled
def add_tiles(frame: Levels, most: int, rows: Longs, cols: Longs, total: Singles, usable: Mask) -> None:
    """Add tiles of a frame (h, w) to total (r, c), and take what is above the level `most` out of usable (r, c).

    rows, cols (r,): where in the frame each row of a tile begins.
    """
    for row in range(len(rows)):
        here, to, good = frame[rows[row], cols[row] :], total[row], usable[row]
        for k in range(len(to)):
            to[k] += np.float32(here[k])
        for k in range(len(good)):
            good[k] &= here[k] <= most


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
