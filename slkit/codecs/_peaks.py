"""Sub-pixel centres of lines in pictures, and what neighbouring centres say about each other.

Everything here works along picture rows; for lines seen the other way round the caller turns the pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._rows import over_rows
from slkit.data import Float32s

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Peaks:
    """Line centres, one a row of each array (m,).

    row: picture row; col: sub-pixel column; sigma_col: its 1 sigma in px; contrast: height above the two valleys beside
    it; noise: 1 sigma of the picture there; value: the label, a projector position in px.
    """

    row: npt.NDArray[np.intp]
    col: Floats
    sigma_col: Floats
    contrast: Floats
    noise: Floats
    value: Floats

    def __len__(self) -> int:
        return len(self.row)

    def select(self, keep: npt.NDArray[Any]) -> Peaks:
        """Return the peaks named by a mask (m,) or by indices."""
        return Peaks(*(getattr(self, f.name)[keep] for f in fields(self)))

    @property
    def nearest(self) -> npt.NDArray[np.intp]:
        """The column of the pixel nearest to each centre, (m,)."""
        return np.rint(self.col).astype(np.intp)

    @staticmethod
    def join(parts: list[Peaks]) -> Peaks:
        """Return all peaks of several sets, ordered by row, then column."""
        one = Peaks(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Peaks)))
        # The parts are in order: a stable sort of one key only merges them.
        width = np.ceil(one.col.max(initial=0)) + 2
        return one.select(np.argsort(one.row * width + one.col, kind="stable"))


def slope_along_rows(value: Float32s, mask: Mask, jump: float, radius: int) -> Float32s:
    """Return how fast a map (h, w) changes from column to column, averaged over a window; NaN where nothing is known.

    mask (h, w): where value is known. jump: a larger difference between neighbours is an edge of the scene and left
    out. radius: half the width of the window in px.
    """
    from slkit.codecs._slope_kernels import slope_rows

    slope = np.empty(value.shape, dtype=np.float32)
    over_rows(lambda first, last: slope_rows(value, mask, jump, radius, first, slope[first:last]), len(value))
    return slope


def mean_changes(value: Float32s, mask: Mask, jump: float) -> tuple[float, float]:
    """Return how much a map (h, w) changes from column to column and from row to row, on average; see above.

    0 where nothing is known.
    """
    from slkit.codecs._slope_kernels import change_rows

    sums: list[Floats] = []

    def work(first: int, last: int) -> None:
        part = np.zeros(4)
        change_rows(value, mask, jump, first, last, part)
        sums.append(part)

    over_rows(work, len(value))
    along, steps, down, steps_down = np.sum(sums, axis=0).tolist()
    return along / max(steps, 1), down / max(steps_down, 1)


def sample_row(picture: Float32s, row: npt.NDArray[np.intp], col: Floats) -> Floats:
    """Return the values (m,) of a picture (h, w) at whole rows and fractional columns, by linear interpolation."""
    last = picture.shape[1] - 1
    col = np.clip(col, 0, last)
    left = np.minimum(col.astype(np.intp), max(last - 1, 0))
    share = col - left
    return (1 - share) * picture[row, left] + share * picture[row, np.minimum(left + 1, last)]


def agreeing(peaks: Peaks, slope: Floats, limit: float) -> Mask:
    """Tell which peaks (m,), ordered by row and column, go on smoothly to a neighbour in their row.

    slope (m,): expected change of value per px; limit: see `joined`.
    """
    fits = joined(peaks, slope, limit)
    agree = np.zeros(len(peaks), dtype=bool)
    agree[:-1] |= fits
    agree[1:] |= fits
    return agree


def joined(peaks: Peaks, slope: Floats, limit: float) -> Mask:
    """Tell which of the m - 1 pairs of neighbours in a list of m peaks belong to one smooth piece of a row.

    Their values are at most `limit` px apart and change between half and twice as fast as expected, in the expected
    direction: monotone, unique and evenly spaced.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.diff(peaks.value) / np.diff(peaks.col) / (slope[:-1] + slope[1:]) * 2
    return (np.diff(peaks.row) == 0) & (np.abs(np.diff(peaks.value)) <= limit) & (ratio > 0.5) & (ratio < 2)


def pace(peaks: Peaks, slope: Floats, limit: float) -> Floats:
    """Return the change of value per px (m,) between the neighbours of each peak; `slope` (m,) where one is missing."""
    result = slope.copy()
    fits = joined(peaks, slope, limit)
    inner = np.flatnonzero(fits[:-1] & fits[1:]) + 1
    rise = peaks.value[inner + 1] - peaks.value[inner - 1]
    result[inner] = rise / (peaks.col[inner + 1] - peaks.col[inner - 1])
    return result


def fill_between(
    rows: npt.NDArray[np.intp],
    cols: Floats,
    values: Floats,
    sigma: npt.NDArray[np.floating[Any]],
    shape: tuple[int, int],
    limit: float,
) -> tuple[Float32s, Float32s]:
    """Return maps (h, w) of value and sigma, interpolated along rows between neighbouring lines; NaN elsewhere.

    rows, cols, values, sigma (m,): where lines are, by row and column, their px and its 1 sigma. limit: px of value;
    lines further apart are not neighbours.
    """
    value_map, sigma_map = np.full(shape, np.nan, dtype=np.float32), np.full(shape, np.nan, dtype=np.float32)
    rise = np.abs(np.diff(values))
    pair = np.flatnonzero((np.diff(rows) == 0) & (rise <= limit) & (rise > 0))
    first = np.ceil(cols[pair]).astype(np.intp)
    counts = np.maximum(np.floor(cols[pair + 1]).astype(np.intp) - first + 1, 0)
    pair, first = np.repeat(pair, counts), np.repeat(first, counts)
    col = first + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (col - cols[pair]) / (cols[pair + 1] - cols[pair])
    row = rows[pair]
    value_map[row, col] = (1 - share) * values[pair] + share * values[pair + 1]
    sigma_map[row, col] = np.hypot((1 - share) * sigma[pair], share * sigma[pair + 1])
    return value_map, sigma_map
