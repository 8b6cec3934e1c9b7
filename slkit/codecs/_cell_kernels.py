"""Where pictures are lit, and where the cells of a Gray code are known, in compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.signedinteger[Any]]
Counts = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

TILE = 16
"""Side in px of the tiles over which doubtful pixels are counted."""

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def light_rows(high: Levels, low: Levels, saturated: Mask, noise: Singles, snr: float, lit: Mask) -> None:
    """Write where rows (r, w) of the white picture stand out of the black one by snr times the noise and are whole.

    noise (3,): variance in dark, its gain a level, the dark level.
    """
    least, gain, dark, square = noise[0], noise[1], noise[2], np.float32(snr * snr)
    for row in range(high.shape[0]):
        for col in range(high.shape[1]):
            a, b = np.float32(high[row, col]), np.float32(low[row, col])
            rise = max(a - b, np.float32(0))
            variance = 2 * least + gain * (max(a - dark, np.float32(0)) + max(b - dark, np.float32(0)))
            lit[row, col] = (rise * rise > square * variance) & ~saturated[row, col]


@_compiled
def keep_inner(mask: Mask, least: int, first: int, kept: Mask) -> None:
    """Write which pixels of a mask (h, w), from row `first` on, have `least` of eight neighbours inside, (r, w).

    Beyond the picture's border its own row and column go on.
    """
    end, right = mask.shape[0] - 1, mask.shape[1] - 1
    count, one, none = np.empty(right + 3, np.uint8), np.uint8(1), np.uint8(0)
    for row in range(len(kept)):
        at, sums = first + row, count[1:]
        above, here, below = mask[max(at - 1, 0)], mask[at], mask[min(at + 1, end)]
        for col in range(right + 1):
            sums[col] = (one if above[col] else none) + (one if here[col] else none) + (one if below[col] else none)
        count[0], count[right + 2] = sums[0], sums[right]
        to = kept[row]
        for col in range(right + 1):
            to[col] = here[col] & (count[col] + count[col + 1] + count[col + 2] > least)


@_compiled
def count_doubts(lo: Wholes, hi: Wholes, most: int, mask: Mask, counts: Counts, kept: Longs) -> None:
    """Take the pixels that cannot be placed out of mask (r, w), and count the others.

    A pixel is placed where 1 to `most` cells, lo to hi (r, w), are possible. counts (t, s, 3): in each tile the placed
    pixels, those between two cells at a border of the lowest bit, and at any other; kept (r,): what is left of mask.
    """
    width = lo.shape[1]
    low, other, none, one, two = np.uint8(1), np.uint8(16), np.uint8(0), np.int32(1), np.int32(2)
    kind = np.empty(width, dtype=np.uint8)
    for row in range(lo.shape[0]):
        begin, end, inside, tiles = lo[row], hi[row], mask[row], counts[row // TILE]
        for col in range(width):
            cells = np.int32(end[col]) - np.int32(begin[col]) + one
            inside[col] &= (cells >= one) & (cells <= most)
        for col in range(width):
            between = inside[col] & (np.int32(end[col]) - np.int32(begin[col]) + one == two)
            border = other if begin[col] & 1 else low
            kind[col] = border if between else none
        placed = 0
        for tile in range(len(tiles)):
            total, lowest, others = 0, 0, 0
            for col in range(tile * TILE, min((tile + 1) * TILE, width)):
                total += inside[col]
                lowest += kind[col] & 1
                others += kind[col] >> 4
            placed += total
            tiles[tile, 0] += total
            tiles[tile, 1] += lowest
            tiles[tile, 2] += others
        kept[row] = placed


@_compiled
def place_rows(lo: Wholes, hi: Wholes, mask: Mask, most: int, step: float, value: Singles, known: Mask) -> None:
    """Write the middle in px of the possible cells lo to hi (r, w), and whether it is known; see `place`.

    most: of cells in a known position; step: px a cell.
    """
    half, middle = np.float32(step / 2), np.float32((step - 1) / 2)
    for row in range(lo.shape[0]):
        begin, end, lit, to, sure = lo[row], hi[row], mask[row], value[row], known[row]
        for col in range(len(to)):
            to[col] = np.float32(begin[col] + end[col]) * half + middle
        for col in range(len(to)):
            count = end[col] - begin[col] + np.int32(1)
            sure[col] = lit[col] & (count >= 1) & (count <= most)
