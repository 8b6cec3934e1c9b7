"""Which points of a cloud have company: others as near to them as those have to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.triangulation._run import in_parts

Singles = npt.NDArray[np.float32]
Longs = npt.NDArray[np.int64]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

# So many points share a cell on average, and so many points tell how far apart neighbours are.
_POINTS_PER_CELL = 3.0
_SAMPLE = 2000
# The sample's median may be so much smaller than that of all.
_ROOM = 2.0


def in_company(xyz: Singles, isolated_factor: float, remote_factor: float) -> Mask:
    """Return which points (n, 3) mm, seen by a camera at the origin along z, have company; all of ten or fewer.

    The distance to the tenth neighbour is at most isolated_factor times the median of the same distance among those ten
    neighbours, and, as an angle seen from the camera, at most remote_factor times the cloud's median.
    """
    from slkit.triangulation._company_kernels import NEIGHBORS, among_equals, least_of, reaches

    count = len(xyz)
    if count <= NEIGHBORS:
        return np.ones(count, dtype=np.bool_)
    ahead = xyz[:, 2] > 0
    if not ahead.all():
        # Nothing there was seen by a camera that looks along z.
        ahead[ahead] = in_company(xyz[ahead], isolated_factor, remote_factor)
        return ahead
    order, grid = _sorted(xyz)
    told = grid.xyz, grid.cell, grid.starts, grid.columns, grid.step
    length = np.linalg.norm(grid.xyz, axis=1)
    every = -(-count // _SAMPLE)
    some = np.empty(len(length[::every]), np.float32)
    reaches(*told, np.inf, 0, every, some, np.empty(len(some), np.uint8))
    # Beyond this a point is remote whatever its neighbours are.
    cap = _ROOM * remote_factor * float(np.median(some / length[::every]))
    reach, rings = np.empty(count, np.float32), np.empty(count, np.uint8)
    least = np.empty(len(grid.starts) - 1, np.float32)
    keep, result = np.empty(count, dtype=np.bool_), np.empty(count, dtype=np.bool_)

    def measure(a: int, b: int) -> None:
        reaches(*told, cap, a, 1, reach[a:b], rings[a:b])

    def judge(a: int, b: int) -> None:
        among_equals(*told, cap, reach, rings, least, isolated_factor, a, b, keep)

    in_parts(measure, count)
    least_of(grid.cell, reach, least)
    in_parts(judge, count)
    angle = reach / length
    result[order] = keep & (angle <= remote_factor * np.median(angle))
    return result


@dataclass(frozen=True, eq=False)
class _Grid:
    """Points (n, 3) sorted by cell (n,); starts (cells + 1,): where each cell begins; step: see `reaches`."""

    xyz: Singles
    cell: Wholes
    starts: Longs
    columns: int
    step: float


def _sorted(xyz: Singles) -> tuple[Longs, _Grid]:
    """Return the order (n,) of the points by cell, and the grid of cells."""
    from slkit.triangulation._company_kernels import cells_of

    direction = xyz[:, :2] / xyz[:, 2:]
    low, high = direction.min(axis=0), direction.max(axis=0)
    extent = np.maximum(high - low, 1e-6).astype(np.float64)
    size = float(np.sqrt(_POINTS_PER_CELL * extent[0] * extent[1] / len(xyz))) or 1e-6
    # A cloud along a line would have a grid of very many cells.
    size = max(size, float(extent.max()) / len(xyz))
    columns, rows = (int(e / size) + 2 for e in extent)
    cell = np.empty(len(xyz), np.int32)
    cells_of(xyz, low, size, columns, cell)
    order = np.argsort(cell, kind="stable")
    cell = cell[order]
    starts = np.searchsorted(cell, np.arange(rows * columns + 1))
    corner = np.maximum(np.abs(low), np.abs(high)).astype(np.float64)
    longest = float(np.sqrt(1 + corner @ corner))
    return order, _Grid(np.ascontiguousarray(xyz[order]), cell, starts, columns, size / longest)
