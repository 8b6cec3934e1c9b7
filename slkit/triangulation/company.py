"""Which points of a cloud have company: others as near to them as those have to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.triangulation._run import in_parts

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

# So many points share a cell on average: where neighbours are searched for, and at most where they are counted.
_SEARCHED, _COUNTED = 3.0, 100.0
# So many points tell how far apart neighbours are: such shares of them have less than the least and the most.
_SAMPLE, _LEAST, _MOST = 20_000, 0.001, 0.98
# As a part of that least: what is counted there shall be rare.
_BELOW = 0.9
_WIDEST = 0.1  # of z
_TURNS = 8


def in_company(xyz: Singles, isolated_factor: float, remote_factor: float) -> Mask:
    """Return which points (n, 3) mm, seen by a camera at the origin along z, have company; all of ten or fewer.

    The distance to the tenth neighbour is at most isolated_factor times the median of the same distance among those ten
    neighbours, and, as an angle seen from the camera, at most remote_factor times the cloud's median, which 20 000
    points stand for.
    """
    from slkit.triangulation._company_kernels import NEIGHBORS

    count = len(xyz)
    if count <= NEIGHBORS:
        return np.ones(count, dtype=np.bool_)
    ahead = xyz[:, 2] > 0
    if not ahead.all():
        # Nothing there was seen by a camera that looks along z.
        ahead[ahead] = in_company(xyz[ahead], isolated_factor, remote_factor)
        return ahead
    grid = _sorted(xyz, _SEARCHED)
    some = np.arange(0, count, -(-count // _SAMPLE), dtype=np.int32)
    reach, _ = grid.reaches(some)
    farthest = remote_factor * float(np.median(grid.angles(some, reach)))
    least, most = np.quantile(reach / grid.xyz[some, 2], [_LEAST, _MOST]).tolist()
    # Sorted a second time rather than held meanwhile: two grids at once are much of the memory of a scan.
    del grid
    keep, clear, limit = _counted(xyz, _BELOW * least, min(most, farthest, _WIDEST), isolated_factor)
    grid = _sorted(xyz, _SEARCHED)
    doubted = np.flatnonzero(~keep[grid.order]).astype(np.int32)
    reach, neighbors = grid.reaches(doubted)
    among_equals = clear[grid.order[doubted]] & (reach <= limit * grid.xyz[doubted, 2])
    rest = np.flatnonzero(~among_equals)
    among_equals[rest] = _compared(grid, doubted[rest], reach[rest], neighbors[rest], isolated_factor)
    keep[grid.order[doubted]] = among_equals & (grid.angles(doubted, reach) <= farthest)
    return keep


@dataclass(frozen=True, eq=False)
class _Grid:
    """Points (n, 3) in an order (n,) by cell; starts (cells + 1,): where each cell begins; step: see `reaches`."""

    order: Wholes
    xyz: Singles
    starts: Wholes
    columns: int
    step: float

    @property
    def rows(self) -> int:
        return (len(self.starts) - 1) // self.columns

    def reaches(self, which: Wholes) -> tuple[Singles, Wholes]:
        """Return the distance to the tenth neighbour of points (k,), which rise, and the ten (k, 10)."""
        from slkit.triangulation._company_kernels import NEIGHBORS, reaches

        told = self.xyz, self.starts, self.columns, self.step
        reach, neighbors = np.empty(len(which), np.float32), np.empty((len(which), NEIGHBORS), np.int32)
        in_parts(lambda a, b: reaches(*told, which[a:b], reach[a:b], neighbors[a:b]), len(which), turns=_TURNS)
        return reach, neighbors

    def angles(self, which: Wholes, reach: Singles) -> Singles:
        """Return the angle (k,) under which the camera sees a distance from each of some points."""
        return reach / np.linalg.norm(self.xyz[which], axis=1)


def _counted(xyz: Singles, narrow: float, wide: float, factor: float) -> tuple[Mask, Mask, float]:
    """Return which points (n,) pass without a search, which have no crowded place around, and a limit.

    A place is crowded where a point has ten others within narrow z. Where there is none around, a point whose tenth
    neighbour is at most limit z away has no neighbour whose own is `factor` times as near; one that has ten others
    within wide z, or less where that is above the limit, passes.
    """
    from slkit.triangulation._company_kernels import clear_of, crowd

    # A neighbour may be nearer to the camera than the point itself.
    limit = factor * narrow / (1 + factor * narrow)
    wide = min(wide, limit)
    grid = _sorted(xyz, _COUNTED, wide)
    # Where few points fill a large picture the cells are larger than asked for.
    wide = min(wide, grid.step)
    near, clear = np.empty(len(xyz), dtype=np.bool_), np.empty(len(xyz), dtype=np.bool_)
    dense = np.zeros(len(grid.starts) - 1, dtype=np.bool_)

    def count(first: int, last: int) -> None:
        for row in range(first, last):
            crowd(grid.xyz, grid.starts, grid.columns, wide, narrow, row, near, dense)

    in_parts(count, grid.rows, 16, _TURNS)
    for row in range(grid.rows):
        clear_of(grid.starts, grid.columns, row, dense, clear)
    near &= clear
    back = np.empty_like(near), np.empty_like(near)
    back[0][grid.order], back[1][grid.order] = near, clear
    return *back, min(limit, 2 * grid.step)


def _compared(grid: _Grid, which: Wholes, reach: Singles, neighbors: Wholes, factor: float) -> Mask:
    """Return which of some points (k,) reach at most `factor` times as far as their neighbours (k, 10), by search."""
    from slkit.triangulation._company_kernels import among_equals

    every = np.full(len(grid.xyz), np.nan, dtype=np.float32)
    others = np.zeros(len(every), dtype=np.bool_)
    others[neighbors] = True
    others[which] = False
    every[which] = reach
    more = np.flatnonzero(others).astype(np.int32)
    every[more] = grid.reaches(more)[0]
    keep = np.empty(len(which), dtype=np.bool_)
    among_equals(reach, neighbors, every, factor, keep)
    return keep


def _sorted(xyz: Singles, points: float, step: float = np.inf) -> _Grid:
    """Return the points by cell, which holds so many on average, or fewer where its step would be larger than given."""
    from slkit.triangulation._company_kernels import cells_of, count_cells, extent_of, places_of, sort_by_cell

    corners = np.empty(4, np.float32)
    extent_of(xyz, corners)
    low, high = corners[:2], corners[2:]
    extent = np.maximum(high - low, 1e-6).astype(np.float64)
    corner = np.maximum(np.abs(low), np.abs(high)).astype(np.float64)
    longest = float(np.sqrt(1 + corner @ corner))
    size = min(float(np.sqrt(points * extent[0] * extent[1] / len(xyz))), step * longest)
    # A cloud along a line, or one far apart, would have a grid of very many cells.
    size = max(size, float(extent.max()) / len(xyz), float(np.sqrt(extent[0] * extent[1] / len(xyz))))
    columns, rows = (int(e / size) + 2 for e in extent)
    cell, order, placed = np.empty(len(xyz), np.int32), np.empty(len(xyz), np.int32), np.empty_like(xyz)
    counts: dict[int, Wholes] = {}

    def count(a: int, b: int) -> None:
        cells_of(xyz[a:b], low, size, columns, cell[a:b])
        counts[a] = np.empty(rows * columns, np.int32)
        count_cells(cell[a:b], counts[a])

    in_parts(count, len(xyz))
    starts, every = np.empty(rows * columns + 1, np.int32), np.stack([counts[a] for a in sorted(counts)])
    places_of(every, starts)
    places = dict(zip(sorted(counts), every, strict=True))
    in_parts(lambda a, b: sort_by_cell(xyz, cell[a:b], a, places[a], order, placed), len(xyz))
    return _Grid(order, placed, starts, columns, size / longest)
