"""From the cells of a Gray code to the rows of a result, in compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._cell_kernels import TILE
from slkit.codecs._noise_kernels import write_chances
from slkit.codecs._run_kernels import next_run, write_axis

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.signedinteger[Any]]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def write_margins(mask: Mask, square: Singles, starts: Longs, confidence: Singles) -> None:
    """Write the confidence of the kept pixels to the rows of a result from starts (r,) on; square (r, w): of sigmas."""
    for row in range(mask.shape[0]):
        to = starts[row]
        first, end = next_run(mask[row], 0)
        while first < end:
            write_chances(square[row, first:end], confidence[to : to + end - first])
            to += end - first
            first, end = next_run(mask[row], end)


@_compiled
def write_places(
    row0: int,
    mask: Mask,
    lo: Wholes,
    hi: Wholes,
    shares: Singles,
    scale: Singles,
    axis: int,
    alone: bool,
    starts: Longs,
    projector_xy: Singles,
    sigma: Singles,
) -> None:
    """Write value and sigma in px of one axis for the kept pixels of rows row0 on; see `write_seen`.

    shares (t, s, 2): of pixels near by that are between two cells, at borders of the lowest bit and at others; scale
    (4,): px a cell, px of the middle of cell 0, narrowest width of a place in cells, and px of sigma a cell of width;
    alone: no other axis is coded.
    """
    widths, found, tiles = np.empty((3, mask.shape[1]), np.float32), np.empty((3, mask.shape[1]), np.float32), -1
    found[2] = np.nan
    for row in range(mask.shape[0]):
        if (row0 + row) // TILE != tiles:
            tiles = (row0 + row) // TILE
            _spread(shares[tiles], scale[2], widths)
        to = starts[row]
        first, end = next_run(mask[row], 0)
        while first < end:
            part, out = slice(first, end), slice(to, to + end - first)
            given = lo[row, part], hi[row, part], widths[0, part], widths[1, part], widths[2, part]
            value, spread, nothing = found[0, : end - first], found[1, : end - first], found[2, : end - first]
            _place(*given, scale, value, spread)
            write_axis(value, spread, nothing, axis, alone, projector_xy[out], sigma[out])
            to += end - first
            first, end = next_run(mask[row], end)


@_compiled
def _spread(shares: Singles, narrowest: np.float32, widths: Singles) -> None:
    """Write how wide a place is, in cells, at each column (3, w): in one cell, between two at either kind of border."""
    one, two = np.float32(1), np.float32(2)
    for col in range(widths.shape[1]):
        lowest, other = shares[col // TILE, 0], shares[col // TILE, 1]
        widths[0, col] = max(one - lowest - other, narrowest)
        widths[1, col], widths[2, col] = max(two * lowest, narrowest), max(two * other, narrowest)


@_compiled
def _place(
    lo: Wholes,
    hi: Wholes,
    single: Singles,
    lowest: Singles,
    other: Singles,
    scale: Singles,
    value: Singles,
    spread: Singles,
) -> None:
    half, middle, share = np.float32(0.5) * scale[0], scale[1], scale[3]
    for i in range(len(lo)):
        value[i] = np.float32(np.int32(lo[i]) + np.int32(hi[i])) * half + middle
    for i in range(len(lo)):
        first, cells = np.int32(lo[i]), np.int32(hi[i]) - np.int32(lo[i]) + np.int32(1)
        alone, low, high = single[i], lowest[i], other[i]
        between = high if first & np.int32(1) else low
        width = between if cells == np.int32(2) else np.float32(cells)
        spread[i] = (alone if cells == np.int32(1) else width) * share
