"""Distances to the nearest other points of a cloud that one camera saw: near in space is near in the picture.

Points are sorted into square cells by their viewing direction x / z, y / z. A cell s away from a point's own holds
nothing nearer to it than z s / q, where q is the length of the longest direction (x, y, 1): rings of cells are searched
until that rules out the rest, so that the result is exact.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Bytes = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

NEIGHBORS = 10
"""So many neighbours are looked for."""

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def cells_of(xyz: Singles, origin: Singles, size: float, columns: int, out: Wholes) -> None:
    """Write the cell of each point (n,), row by row; origin (2,): the corner of the first; size: side of a cell."""
    for i in range(len(xyz)):
        col = int((xyz[i, 0] / xyz[i, 2] - origin[0]) / size)
        row = int((xyz[i, 1] / xyz[i, 2] - origin[1]) / size)
        out[i] = row * columns + col


@_compiled
def _ring(
    xyz: Singles,
    starts: Longs,
    columns: int,
    i: int,
    row: int,
    col: int,
    ring: int,
    square: Singles,
    who: Wholes,
) -> None:
    """Take the points of the cells at the distance `ring` from (row, col) among the nearest of point i."""
    rows = (len(starts) - 1) // columns
    for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
        whole = abs(r - row) == ring
        for c in range(max(col - ring, 0), min(col + ring + 1, columns)):
            if not (whole or abs(c - col) == ring):
                continue
            for j in range(starts[r * columns + c], starts[r * columns + c + 1]):
                x, y, z = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
                away = x * x + y * y + z * z
                if away >= square[NEIGHBORS - 1] or j == i:
                    continue
                k = NEIGHBORS - 1
                while k > 0 and square[k - 1] > away:
                    square[k], who[k] = square[k - 1], who[k - 1]
                    k -= 1
                square[k], who[k] = away, j


@_compiled
def _nearest(
    xyz: Singles,
    cell: Wholes,
    starts: Longs,
    columns: int,
    step: float,
    cap: float,
    i: int,
    square: Singles,
    who: Wholes,
) -> int:
    """Write the squared distances and numbers of the nearest points of point i; return how many rings that took."""
    square[:] = np.inf
    row, col = divmod(cell[i], columns)
    limit = cap * np.sqrt(xyz[i, 0] ** 2 + xyz[i, 1] ** 2 + xyz[i, 2] ** 2)
    farthest = max(columns, (len(starts) - 1) // columns)
    ring = 0
    while ring <= farthest:
        _ring(xyz, starts, columns, i, row, col, ring, square, who)
        sure = xyz[i, 2] * step * ring
        if square[NEIGHBORS - 1] <= sure * sure or sure > limit:
            break
        ring += 1
    return ring


@_compiled
def reaches(
    xyz: Singles,
    cell: Wholes,
    starts: Longs,
    columns: int,
    step: float,
    cap: float,
    first: int,
    every: int,
    reach: Singles,
    rings: Bytes,
) -> None:
    """Write the distance (k,) to the tenth neighbour, and how many rings of cells hold all ten, at most 255.

    Of the points first, first + every ... of xyz (n, 3), which is sorted by cell (n,); starts (cells + 1,): where each
    cell begins; step: its side over the length of the longest direction; cap: what is farther away than so many radians
    may be called infinitely far.
    """
    square, who = np.empty(NEIGHBORS, dtype=np.float32), np.empty(NEIGHBORS, dtype=np.int32)
    for k in range(len(reach)):
        rings[k] = min(_nearest(xyz, cell, starts, columns, step, cap, first + k * every, square, who), 255)
        reach[k] = np.sqrt(square[NEIGHBORS - 1])


@_compiled
def least_of(cell: Wholes, reach: Singles, out: Singles) -> None:
    """Write the smallest reach of each cell (c,), which is infinite where it is empty."""
    out[:] = np.inf
    for i in range(len(cell)):
        out[cell[i]] = min(out[cell[i]], reach[i])


@_compiled
def among_equals(
    xyz: Singles,
    cell: Wholes,
    starts: Longs,
    columns: int,
    step: float,
    cap: float,
    reach: Singles,
    rings: Bytes,
    least: Singles,
    factor: float,
    first: int,
    last: int,
    keep: Mask,
) -> None:
    """Tell of points first to last whether their reach is at most `factor` times the median of their neighbours'.

    Most pass by the smallest reach of all that the rings hold; only for the others neighbours are looked for again.
    """
    rows = (len(starts) - 1) // columns
    square, who = np.empty(NEIGHBORS, dtype=np.float32), np.empty(NEIGHBORS, dtype=np.int32)
    theirs = np.empty(NEIGHBORS, dtype=np.float32)
    for i in range(first, last):
        row, col = divmod(cell[i], columns)
        lowest, ring = np.float32(np.inf), int(rings[i])
        for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
            for c in range(max(col - ring, 0), min(col + ring + 1, columns)):
                lowest = min(lowest, least[r * columns + c])
        if ring < 255 and reach[i] <= factor * lowest:
            keep[i] = True
            continue
        _nearest(xyz, cell, starts, columns, step, cap, i, square, who)
        for k in range(NEIGHBORS):
            theirs[k] = reach[who[k]] if square[k] < np.inf else np.inf
        theirs.sort()
        middle = (theirs[NEIGHBORS // 2 - 1] + theirs[NEIGHBORS // 2]) / 2
        keep[i] = reach[i] <= factor * middle
