"""The lines of all shifts of a pattern, found a few rows of the pictures at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._line_scales import FLATTEST, LineRule, Room, Scales
from slkit.codecs._line_view import AxisPeaks, View
from slkit.codecs._masks import Levels
from slkit.codecs._results import Rows, grey_of
from slkit.codecs._rows import over_large_blocks, over_rows
from slkit.data import Correspondences, Float32s, Image

Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]
Part = tuple[Doubles, Float32s]


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of one projector axis, in parts of a few picture rows, in order; see `join_rows` for their columns."""

    view: View
    parts: list[Part]

    def peaks(self) -> AxisPeaks:
        """Return the lines as arrays."""
        col, told = (np.concatenate(arrays) for arrays in zip(*self.parts, strict=True))
        row, value, sigma, confidence = told.T
        return AxisPeaks(
            row.astype(np.intp), col, value.astype(np.float64), sigma, confidence, self.view.turned, self.view.jump / 2
        )

    def correspondences(self, axis: int, white: Image) -> Correspondences:
        """Return the lines as correspondences that know one axis of the projector, 0 for x; white: their colours."""
        from slkit.codecs._line_join_kernels import write_lines

        ends = np.cumsum([0, *(len(col) for col, _ in self.parts)]).tolist()
        rows, light, (_, brightest) = Rows.room_for(ends[-1]), self.view.light.white, grey_of(white)
        fields = rows.camera_xy, rows.projector_xy, rows.sigma, rows.confidence, rows.grey

        def work(first: int, last: int) -> None:
            for k in range(first, last):
                part = slice(ends[k], ends[k + 1])
                out = (field[part] for field in fields)
                write_lines(*self.parts[k], self.view.turned, axis, light, brightest, *out)

        over_rows(work, len(self.parts))
        return rows.correspondences(white, ends[-1])


@dataclass(frozen=True, eq=False)
class Scratch:
    """Memory for a block of rows (r, w) of `shifts` pictures, used again for the next one.

    lines (shifts, n, 5), ends (shifts, r + 1): what is found in each picture; slope (r, w), light (r + 2, w): of the
    scene; kernels (r, w), runs (m, 3), starts (r + 1,): where which kernel serves; col (k,), told (k, 4): what is kept.
    """

    lines: Doubles
    ends: Wholes
    slope: Float32s
    light: Float32s
    kernels: npt.NDArray[np.uint8]
    runs: Wholes
    starts: Wholes
    col: Doubles
    told: Float32s
    room: Room

    @classmethod
    def of(cls, rows: int, width: int, shifts: int, scales: Scales) -> Scratch:
        """Return memory for the most that a block may show."""
        most = rows * (width // 2 + 1)
        slope, light = np.empty((rows, width), np.float32), np.empty((rows + 2, width), np.float32)
        lines, ends = np.empty((shifts, most, 5)), np.empty((shifts, rows + 1), np.int32)
        kernels, runs = np.empty((rows, width), np.uint8), np.empty((rows * width, 3), np.int32)
        starts = np.empty(rows + 1, np.int32)
        kept = shifts * most
        col, told = np.empty(kept), np.empty((kept, 4), np.float32)
        return cls(lines, ends, slope, light, kernels, runs, starts, col, told, Room.of(width, scales))


def find_lines(view: View, pictures: Sequence[Levels], scales: Scales, rules: Sequence[LineRule]) -> Lines:
    """Return the lines of pictures (h, w) that fit their neighbours; rules: which lines each picture shows."""
    found: dict[int, Part] = {}
    shape = pictures[0].shape

    def work(rows: slice, scratch: Scratch) -> None:
        found[rows.start] = _find_in(view, pictures, scales, rules, rows, scratch)

    over_large_blocks(lambda rows: Scratch.of(rows, shape[1], len(pictures), scales), work, shape)
    return Lines(view, [found[start] for start in sorted(found)])


def _find_in(
    view: View, pictures: Sequence[Levels], scales: Scales, rules: Sequence[LineRule], rows: slice, scratch: Scratch
) -> Part:
    from slkit.codecs._line_join_kernels import join_rows
    from slkit.codecs._line_kernels import line_rows
    from slkit.codecs._slope_kernels import log_rows, run_rows, slope_rows

    light, coarse, count = view.light, view.coarse, rows.stop - rows.start
    slope, logs, ends = scratch.slope[:count], scratch.light[: count + 2], scratch.ends[:, : count + 1]
    slope_rows(coarse.value, coarse.known, view.jump, view.radius, rows.start, slope)
    where = scratch.kernels[:count], scratch.runs, scratch.starts
    run_rows(slope, scales, *where)
    scene = light.white[rows], light.black[rows], light.mask[rows], coarse.known[rows], coarse.value[rows], slope
    for picture, rule, lines, end in zip(pictures, rules, scratch.lines, ends, strict=True):
        line_rows(picture[rows], *scene, light.curve.numbers, *where, scales, rule, scratch.room, lines, end)
    log_rows(light.white, light.black, rows.start - 1, logs)
    told = slope, logs, coarse.square[rows], rules[0].period, FLATTEST
    kept = join_rows(rows.start, scratch.lines.reshape(-1, 5), ends, *told, scratch.col, scratch.told)
    return scratch.col[:kept].copy(), scratch.told[:kept].copy()
