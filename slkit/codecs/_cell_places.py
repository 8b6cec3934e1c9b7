"""From the cells that a Gray code leaves possible to correspondences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._cell_bits import Cells
from slkit.codecs._gray_code import CellCode, Ints, Mask
from slkit.codecs._results import Rows, grey_of
from slkit.codecs._rows import over_rows
from slkit.data import Correspondences, Float32s, Image
from slkit.errors import InputError
from slkit.protocols import Bounds

Longs = npt.NDArray[np.int64]
Counts = npt.NDArray[np.int32]

# Doubtful pixels are counted in the tile of a pixel and the eight around it, and a place is no narrower than this, in
# cells.
_AROUND = 3
_NARROWEST = 0.5


def possible(cells: Cells, code: CellCode, bounds: Bounds | None) -> tuple[Ints, Ints]:
    """Return the interval lo, hi (h, w) of cells that lie within bounds (h, w, 4), give or take one cell.

    lo > hi where none is left. Errors: InputError where bounds have another size.
    """
    lo, hi = cells.lo, cells.hi
    if bounds is None:
        return lo, hi
    if bounds.shape != (*lo.shape, 4):
        raise InputError(f"bounds must have the shape {(*lo.shape, 4)}, not {bounds.shape}")
    first = 0 if code.axis == "x" else 2
    least, most = bounds[..., first], bounds[..., first + 1]
    allowed = np.isfinite(least) & np.isfinite(most)
    # Far-away bounds would overflow the cast to whole cells; two cells beyond the border nothing is left of them.
    beyond = 2 * code.step
    least, most = (np.clip(np.where(allowed, b, 0), -beyond, code.size + beyond) for b in (least, most))
    lo = np.maximum(lo, np.floor(least / code.step).astype(np.int32) - 1)
    hi = np.where(allowed, np.minimum(hi, np.ceil(most / code.step).astype(np.int32) + 1), -1)
    return lo, hi


def place(interval: tuple[Ints, Ints], code: CellCode, max_cells: int, mask: Mask) -> tuple[Float32s, Mask]:
    """Return the px of the middle of an interval of cells, and whether it is usable, (h, w) each; mask: what is lit."""
    from slkit.codecs._cell_kernels import place_rows

    value, known = np.empty(mask.shape, np.float32), np.empty(mask.shape, np.bool_)

    def work(first: int, last: int) -> None:
        rows = slice(first, last)
        lo, hi = (cells[rows] for cells in interval)
        place_rows(lo, hi, mask[rows], max_cells, float(code.step), value[rows], known[rows])

    over_rows(work, len(mask))
    return value, known


def gather(
    intervals: Sequence[tuple[CellCode, tuple[Ints, Ints]]], square: Float32s, mask: Mask, max_cells: int, white: Image
) -> Correspondences:
    """Return one correspondence for each pixel of mask (h, w) that all codes place within `max_cells` cells.

    intervals: of each axis the cells lo to hi (h, w) that are possible; square (h, w): of the smallest known difference
    in sigmas; white (h, w) or (h, w, 3): where the colours come from.

    A position somewhere in an interval of width w has a sigma of w / sqrt(12). Two cells are left in doubt only close
    to the border between them; how close, the share of such pixels in the neighbourhood tells: all of them where a
    bit is not resolved at all. Borders of the lowest bit and of all others, half of them each, are told apart.
    """
    from slkit.codecs._cell_kernels import TILE, count_doubts

    mask, height, kept = mask.copy(), len(mask), np.empty(len(mask), np.int64)
    tiles = -(-height // TILE), -(-mask.shape[1] // TILE), 3
    shares: list[Float32s] = []
    for _, (lo, hi) in intervals:
        counts = np.zeros(tiles, np.int32)

        def count(first: int, last: int, lo: Ints = lo, hi: Ints = hi, counts: Counts = counts) -> None:
            part = slice(first, last)
            count_doubts(lo[part], hi[part], max_cells, mask[part], counts[first // TILE :], kept[part])

        over_rows(count, height, TILE)
        shares.append(_shares(counts))
    starts, total = np.cumsum(kept) - kept, int(kept.sum())
    out = Rows.room_for(total)
    _pixels(mask, square, white, starts, out)
    for (code, interval), near in zip(intervals, shares, strict=True):
        _write_axis(code, interval, near, mask, starts, out, len(intervals) == 1)
    return out.correspondences(white, total)


def _write_axis(
    code: CellCode,
    interval: tuple[Ints, Ints],
    shares: Float32s,
    mask: Mask,
    starts: Longs,
    out: Rows,
    alone: bool,
) -> None:
    """Write position and sigma of one axis; alone: there is no other, which is then NaN."""
    from slkit.codecs._result_kernels import write_places

    (lo, hi), axis = interval, int(code.axis == "y")
    middle = (code.step - 1) / 2
    scale = np.array([code.step, middle, _NARROWEST, code.step / np.sqrt(12)], dtype=np.float32)

    def work(first: int, last: int) -> None:
        part, told = slice(first, last), (shares, scale, axis, alone)
        write_places(first, mask[part], lo[part], hi[part], *told, starts[part], out.projector_xy, out.sigma)

    over_rows(work, len(mask))


def _shares(counts: Counts) -> Float32s:
    """Return the shares (t, s, 2) of doubtful pixels in a tile and around it, of counts (t, s, 3)."""
    import cv2

    # One channel at a time: what lies beyond the picture counts for nothing.
    parts = [np.ascontiguousarray(counts[..., i], dtype=np.float32) for i in range(3)]
    window = (_AROUND, _AROUND)
    sums: list[Any] = [cv2.boxFilter(p, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT) for p in parts]
    return np.stack([part / np.maximum(sums[0], 1) for part in sums[1:]], axis=-1).astype(np.float32)


def _pixels(mask: Mask, square: Float32s, white: Image, starts: Longs, out: Rows) -> None:
    """Write place, grey and confidence of the pixels of mask (h, w); starts (h,): where each row's begin."""
    from slkit.codecs._result_kernels import write_margins
    from slkit.codecs._run_kernels import write_seen

    grey, brightest = grey_of(white)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        write_seen(first, mask[part], grey[part], brightest, starts[part], out.camera_xy, out.grey)
        write_margins(mask[part], square[part], starts[part], out.confidence)

    over_rows(work, len(mask))
