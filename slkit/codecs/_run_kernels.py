"""From maps of a picture to the rows of a result: runs of kept pixels are written side by side, in compiled loops."""

from __future__ import annotations

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
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_inlined
def next_run(mask: Mask, col: int) -> tuple[int, int]:
    """Return the first column and the one past the last of the next run of a mask (w,), from a column on."""
    width = len(mask)
    while col < width and not mask[col]:
        col += 1
    end = col
    while end < width and mask[end]:
        end += 1
    return col, end


@_compiled
def count_rows(mask: Mask, counts: Longs) -> None:
    """Write how many pixels of each row of a mask (r, w) are set: counts (r,)."""
    for row in range(mask.shape[0]):
        found, here = 0, mask[row]
        for col in range(len(here)):
            found += here[col]
        counts[row] = found


@_compiled
def write_seen(
    row0: int, mask: Mask, light: Levels, brightest: float, starts: Longs, camera_xy: Singles, grey: Singles
) -> None:
    """Write place and grey of the kept pixels of rows row0 on (r, w) to the rows of a result, from starts (r,) on.

    light (r, w): the white picture, and its brightest level.
    """
    for row in range(mask.shape[0]):
        to = starts[row]
        first, end = next_run(mask[row], 0)
        while first < end:
            part, out = slice(first, end), slice(to, to + end - first)
            _write_xy(first, row0 + row, camera_xy[out])
            _write_grey(light[row, part], np.float32(brightest), grey[out])
            to += end - first
            first, end = next_run(mask[row], end)


@_compiled
def _write_xy(first: int, row: int, camera_xy: Singles) -> None:
    y = np.float32(row)
    for i in range(len(camera_xy)):
        camera_xy[i, 0], camera_xy[i, 1] = np.float32(np.int32(first + i)), y


@_compiled
def _write_grey(light: Levels, brightest: np.float32, grey: Singles) -> None:
    for i in range(len(light)):
        grey[i] = np.float32(light[i]) / brightest


@_compiled
def write_values(mask: Mask, values: Singles, starts: Longs, found: Singles) -> None:
    """Write values (r, w) of the kept pixels to the rows of a result from starts (r,) on."""
    for row in range(mask.shape[0]):
        to = starts[row]
        first, end = next_run(mask[row], 0)
        while first < end:
            found[to : to + end - first] = values[row, first:end]
            to += end - first
            first, end = next_run(mask[row], end)


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
    """Write position and sigma of one axis (r, w) of the kept pixels to the rows of a result from starts (r,) on.

    alone: no other axis is coded, which is then NaN.
    """
    nothing = np.full(mask.shape[1], np.nan, np.float32)
    for row in range(mask.shape[0]):
        to = starts[row]
        first, end = next_run(mask[row], 0)
        while first < end:
            part, out = slice(first, end), slice(to, to + end - first)
            told = nothing[part], axis, alone
            write_axis(position[row, part], sigma[row, part], *told, projector_xy[out], spread[out])
            to += end - first
            first, end = next_run(mask[row], end)


@_compiled
def write_axis(
    position: Singles,
    sigma: Singles,
    nothing: Singles,
    axis: int,
    alone: bool,
    projector_xy: Singles,
    spread: Singles,
) -> None:
    """Write position and sigma (n,) of one axis into pairs (n, 2); where it is alone, nothing (n,) for the other."""
    if not alone:
        projector_xy[:, axis], spread[:, axis] = position, sigma
    elif axis == 0:
        _join(position, nothing, projector_xy)
        _join(sigma, nothing, spread)
    else:
        _join(nothing, position, projector_xy)
        _join(nothing, sigma, spread)


@_compiled
def _join(x: Singles, y: Singles, both: Singles) -> None:
    for i in range(len(x)):
        both[i, 0], both[i, 1] = x[i], y[i]
