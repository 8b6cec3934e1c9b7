"""Distances to the nearest other points of a cloud that one camera saw: near in space is near in the picture.

Points are sorted into square cells by their viewing direction x / z, y / z. A cell s away from a point's own holds
nothing nearer to it than z s / q, where q is the length of the longest direction (x, y, 1): rings of cells are searched
until that rules out the rest, so that the result is exact.

Most points need no search: what is within a given distance is counted, which is vector arithmetic.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

NEIGHBORS = 10
"""So many neighbours are looked for."""
_ROOM = 2048  # points around a cell; where there are more a search by rings decides
_LANES = 16
_SECOND = 1 << 16

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def extent_of(xyz: Singles, out: Singles) -> None:
    """Write the smallest and largest x / z and y / z to out (4,): x, y, then x, y."""
    left = top = np.float32(np.inf)
    right = bottom = np.float32(-np.inf)
    for i in range(len(xyz)):
        x, y = xyz[i, 0] / xyz[i, 2], xyz[i, 1] / xyz[i, 2]
        left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    out[0], out[1], out[2], out[3] = left, top, right, bottom


@_compiled
def cells_of(xyz: Singles, origin: Singles, size: float, columns: int, out: Wholes) -> None:
    """Write the cell of each point (n,), row by row; origin (2,): the corner of the first; size: side of a cell."""
    for i in range(len(xyz)):
        col = int((xyz[i, 0] / xyz[i, 2] - origin[0]) / size)
        row = int((xyz[i, 1] / xyz[i, 2] - origin[1]) / size)
        out[i] = row * columns + col


@_compiled
def count_cells(cell: Wholes, out: Wholes) -> None:
    """Write how many points (n,) lie in each cell (c,)."""
    out[:] = 0
    for i in range(len(cell)):
        out[cell[i]] += 1


@_compiled
def places_of(counts: Wholes, starts: Wholes) -> None:
    """Write where each cell begins (c + 1,), and in place of counts (parts, c) where each part's points of it begin.

    Each part continues where the one before leaves off in every cell.
    """
    at = 0
    for cell in range(counts.shape[1]):
        starts[cell] = at
        for part in range(len(counts)):
            count = counts[part, cell]
            counts[part, cell] = at
            at += count
    starts[counts.shape[1]] = at


@_compiled
def sort_by_cell(xyz: Singles, cell: Wholes, first: int, place: Wholes, order: Wholes, out: Singles) -> None:
    """Write the points from `first` on and their numbers to the next free place (c,) of their cells."""
    for i in range(first, first + len(cell)):
        k = place[cell[i - first]]
        place[cell[i - first]] = k + 1
        order[k] = i
        out[k, 0], out[k, 1], out[k, 2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]


@_compiled
def _window(xyz: Singles, starts: Wholes, columns: int, row: int, col: int, out: Singles) -> int:
    """Copy the points of a cell and the eight around it, x y z apart, up to a whole vector; return how many, or 0.

    Zero where there are more than fit.
    """
    rows, count = (len(starts) - 1) // columns, 0
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        first, last = starts[r * columns + max(col - 1, 0)], starts[r * columns + min(col + 2, columns)]
        if count + last - first > _ROOM:
            return 0
        for j in range(first, last):
            out[count], out[_ROOM + count], out[2 * _ROOM + count] = xyz[j, 0], xyz[j, 1], xyz[j, 2]
            count += 1
    while count % _LANES:
        out[count] = np.inf
        count += 1
    return count


@_compiled
def crowd(
    xyz: Singles, starts: Wholes, columns: int, step: float, narrow: float, row: int, near: Mask, dense: Mask
) -> None:
    """Tell which points of a row of cells have ten others within z step, and which cells have points that have ten
    within z narrow, or too many around to be counted.

    All points within z step lie in the cells around.
    """
    window = np.empty(3 * _ROOM, dtype=np.float32)
    for c in range(row * columns, (row + 1) * columns):
        dense[c] = False
        if starts[c] == starts[c + 1]:
            continue
        count = _window(xyz, starts, columns, row, c - row * columns, window)
        for i in range(starts[c], starts[c + 1]):
            x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            far, close = np.float32(z * step), np.float32(z * narrow)
            far, close = far * far, close * close
            both = np.int32(0)
            for k in range(count):
                dx, dy, dz = window[k] - x, window[_ROOM + k] - y, window[2 * _ROOM + k] - z
                away = dx * dx + dy * dy + dz * dz
                # Two counts in one number.
                one = np.int32(1) if away <= far else np.int32(0)
                both = np.int32(both + one + (np.int32(_SECOND) if away <= close else np.int32(0)))
            near[i] = both % _SECOND > NEIGHBORS
            dense[c] |= both // _SECOND > NEIGHBORS or count == 0


@_compiled
def clear_of(starts: Wholes, columns: int, row: int, dense: Mask, clear: Mask) -> None:
    """Tell which points of a row of cells have no dense cell among the 25 around."""
    rows = (len(starts) - 1) // columns
    for col in range(columns):
        found = False
        for r in range(max(row - 2, 0), min(row + 3, rows)):
            for c in range(max(col - 2, 0), min(col + 3, columns)):
                found |= dense[r * columns + c]
        clear[starts[row * columns + col] : starts[row * columns + col + 1]] = not found


@_compiled
def _ring(
    xyz: Singles,
    starts: Wholes,
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
    cell: int,
    starts: Wholes,
    columns: int,
    step: float,
    i: int,
    square: Singles,
    who: Wholes,
) -> None:
    """Write the squared distances and numbers of the nearest points of point i, which lies in a cell."""
    square[:] = np.inf
    row, col = divmod(cell, columns)
    farthest = max(columns, (len(starts) - 1) // columns)
    ring = 0
    while ring <= farthest:
        _ring(xyz, starts, columns, i, row, col, ring, square, who)
        sure = xyz[i, 2] * step * ring
        if square[NEIGHBORS - 1] <= sure * sure:
            break
        ring += 1


@_compiled
def reaches(
    xyz: Singles,
    starts: Wholes,
    columns: int,
    step: float,
    which: Wholes,
    reach: Singles,
    neighbors: Wholes,
) -> None:
    """Write the distance to the tenth neighbour of some points (k,), in rising order, and who the ten are (k, 10).

    xyz (n, 3) is sorted by cell; starts (cells + 1,): where each cell begins; step: its side over the length of the
    longest direction.
    """
    square = np.empty(NEIGHBORS, dtype=np.float32)
    cell = np.searchsorted(starts, which[0], side="right") - 1 if len(which) else 0
    for k in range(len(which)):
        while starts[cell + 1] <= which[k]:
            cell += 1
        _nearest(xyz, cell, starts, columns, step, which[k], square, neighbors[k])
        reach[k] = np.sqrt(square[NEIGHBORS - 1])


@_compiled
def among_equals(reach: Singles, neighbors: Wholes, every: Singles, factor: float, keep: Mask) -> None:
    """Tell whether each reach (k,) is at most `factor` times the median of its neighbours', looked up in every (n,)."""
    theirs = np.empty(NEIGHBORS, dtype=np.float32)
    for k in range(len(reach)):
        for a in range(NEIGHBORS):
            theirs[a] = every[neighbors[k, a]]
        theirs.sort()
        middle = (theirs[NEIGHBORS // 2 - 1] + theirs[NEIGHBORS // 2]) / 2
        keep[k] = reach[k] <= factor * middle
