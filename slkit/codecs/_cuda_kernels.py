"""The bits of a Gray code on a CUDA device, one thread a pixel; `_bit_kernels` does the same on the processor.

Importing this module imports numba's CUDA: do it inside functions only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda as _typed
from numba import float32, int32

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.signedinteger[Any]]

# numba's own types of it are not complete.
cuda: Any = _typed

_THREADS = 128


@cuda.jit(device=True)
def _larger(a: float, b: float) -> float:
    # numba 0.68 cannot compile max() for CUDA.
    return b if b > a else a


def _pixel(
    lit: Levels,
    inverse: Levels,
    white: Levels,
    black: Levels,
    noise: Singles,
    rule: Singles,
    first: int,
    last: int,
    lo: Wholes,
    hi: Wholes,
    square: Singles,
) -> None:
    """Take the bits from `first` on, lit (bits, n), of the thread's pixel into its cells lo to hi, (n,) each.

    inverse (bits, n), or (0, n) where white + black - pattern stands in for it; noise (3,): variance in dark, its gain
    a level, the dark level; rule (2,): what makes a bit known in sigmas, and as a share of white - black; last: number
    of the last cell after these bits.
    """
    i = cuda.grid(1)
    if i >= lo.shape[0]:
        return
    high, low, base = float32(white[i]), float32(black[i]), noise[2]
    references = _larger(high - base, float32(0)) + _larger(low - base, float32(0))
    least = rule[1] * _larger(high - low, float32(1))
    begin, end, weakest = int32(0), int32(0), float32(np.inf)
    if first > 0:
        begin, end, weakest = int32(lo[i]), int32(hi[i]), square[i]
    for k in range(lit.shape[0]):
        one = float32(lit[k, i])
        light = _larger(one - base, float32(0))
        if inverse.shape[0] > 0:
            other = float32(inverse[k, i])
            difference = one - other
            variance = float32(2) * noise[0] + noise[1] * (light + _larger(other - base, float32(0)))
        else:
            difference = float32(2) * one - (high + low)
            variance = float32(6) * noise[0] + noise[1] * (float32(4) * light + references)
        size = difference * difference
        ratio = size / variance
        known = ratio > rule[0] * rule[0] and size > least * least
        top = int32((1 << (first + k + 1)) - 1)
        before = begin
        if known and difference > 0:
            begin, end = top - end, top - before
        elif not known:
            end = top - before
        if known and ratio < weakest:
            weakest = ratio
    lo[i], hi[i], square[i] = begin, end if end < last else int32(last), weakest


_pixels = cuda.jit(_pixel)


def add_bits(
    lit: Levels,
    inverse: Levels | None,
    references: tuple[Levels, Levels],
    noise: Singles,
    rule: Singles,
    first: int,
    last: int,
    lo: Wholes,
    hi: Wholes,
    square: Singles,
) -> None:
    """Take the bits from `first` on into cells, as `_cell_bits.add_bits` does; lit, inverse: (bits, h, w)."""
    count = lo.size
    pictures = [a.reshape(len(a), count) for a in (lit, lit[:0] if inverse is None else inverse)]
    light = [r.ravel() for r in references]
    given = [cuda.to_device(np.ascontiguousarray(a)) for a in (*pictures, *light, noise, rule)]
    state = [cuda.to_device(a.ravel()) for a in (lo, hi, square)]
    _pixels[-(-count // _THREADS), _THREADS](*given, first, last, *state)
    for array, result in zip((lo, hi, square), state, strict=True):
        array[...] = result.copy_to_host().reshape(array.shape)
