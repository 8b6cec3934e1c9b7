"""Gray code: every projector cell has a binary number, shown bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import reduce
from typing import cast

import numpy as np

from slkit.codecs._cell_bits import BitRule, read_cells
from slkit.codecs._cell_places import gather, place, possible
from slkit.codecs._edges import BitRecord, borders
from slkit.codecs._gray_code import (
    Axes,
    Axis,
    CellCode,
    Ints,
    Profile,
    check_thresholds,
    coded_axes,
    constant,
    patterns,
)
from slkit.codecs._line_view import AxisPeaks, Coarse
from slkit.codecs._masks import Levels, Reader, levels, measure_light
from slkit.codecs._results import colors_at
from slkit.data import Correspondences, Float32s, Frames, Image
from slkit.errors import InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds


@dataclass(frozen=True)
class Gray:
    """Reflected binary Gray code of the cells floor(position / step), bit 1 lit.

    projector (width, height) px. axes: "x" numbers columns, "y" rows. inverse: each pattern is followed by its
    inverse; otherwise it is compared with (white + black) / 2. step: projector px a cell. references: white and black
    pictures first; without them each pattern needs its inverse. robust: decide bits by direct and global light.
    subpixel: instead of pixels, give the sub-pixel borders between cells, where the projector position is exact.

    Thresholds, all relative. min_snr: white - black in units of its noise, below it a pixel is unlit. bit_snr: the
    difference that decides a bit, in units of its noise, and min_contrast: the same as a share of white - black; below
    either the bit is unknown. max_cells: unknown bits leave an interval of neighbouring cells; a longer one is dropped.
    The value is the interval's middle, sigma follows from its length (see `gather`). confidence: the probability under
    Gaussian noise that the weakest known bit is right.

    Errors: InputError where a parameter is out of range.
    Source: Inokuchi, Sato and Matsuda, Range imaging system for 3-D object recognition (1984).
    """

    projector: tuple[int, int]
    axes: Axes = "x"
    inverse: bool = True
    step: int = 1
    references: bool = True
    robust: bool = False
    subpixel: bool = False
    min_snr: float = 5.0
    bit_snr: float = 3.0
    min_contrast: float = 0.05
    max_cells: int = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "projector", as_size(self.projector, "projector"))
        axes = coded_axes(self.axes)
        if not 1 <= self.step <= min(self.projector[a == "y"] for a in axes):
            raise InputError(f"step must be between 1 and the projector's size, not {self.step}")
        if not (self.references or self.inverse):
            raise InputError("references can only be left out when every pattern has its inverse: set inverse = true")
        check_thresholds(self.min_snr, self.bit_snr, self.min_contrast)
        if self.max_cells < 1:
            raise InputError(f"max_cells must be at least 1, not {self.max_cells}")

    def encode(self) -> Frames:
        """Return the patterns in display order: white, black, then for each axis its bits, highest first."""
        profiles: dict[str, Profile] = {"white": constant(255), "black": constant(0)} if self.references else {}
        for code in self._codes():
            profiles |= code.profiles()
        return patterns(profiles, self.projector)

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return the cell that each camera pixel sees, at the pixel's centre.

        bounds (h, w, 4): cells outside by more than one cell are ruled out.
        Errors: InputError where frames do not fit the patterns, DecodeError where nothing is lit.
        """
        names = self._names()
        reader = Reader(frames, names)
        shown = self._first_frames(reader)
        white, black = self._references(shown)

        def read(name: str) -> Levels:
            index = names.index(name)
            return levels(shown[index]) if index < len(shown) else reader.levels(index)

        light = measure_light(white, black, self.min_snr)
        rule = BitRule(self.bit_snr, self.min_contrast, self.robust)
        squares: list[Float32s] = []
        intervals: list[tuple[CellCode, tuple[Ints, Ints]]] = []
        edges: dict[Axis, AxisPeaks] = {}
        for code in self._codes():
            record = BitRecord(light)
            cells = read_cells(code, read, light, rule, record.add if self.subpixel else None)
            interval = possible(cells, code, bounds)
            intervals.append((code, interval))
            squares.append(cells.square)
            if self.subpixel:
                coarse = Coarse(*place(interval, code, self.max_cells, light.mask), cells.square)
                edges[code.axis] = borders(code, cells, coarse, interval, record)
        found = gather(intervals, reduce(np.minimum, squares), light.mask, self.max_cells, white)
        return self._at_edges(edges, found, white) if self.subpixel else found

    def _at_edges(self, edges: Mapping[Axis, AxisPeaks], found: Correspondences, white: Image) -> Correspondences:
        """Return the cell borders of all axes; the coordinate that a border does not fix is that of its pixel."""
        parts: list[Correspondences] = []
        at, spreads = found.as_map(white.shape[:2]), replace(found, projector_xy=found.sigma).as_map(white.shape[:2])
        for axis, border in edges.items():
            camera_xy, i = border.camera_xy.astype(np.float32), int(axis == "y")
            cols, rows = np.rint(camera_xy).astype(np.intp).T
            value, spread = at[rows, cols], spreads[rows, cols]
            value[:, i], spread[:, i] = border.value, border.sigma
            both = Correspondences(camera_xy, value, spread, border.confidence, colors_at(white, camera_xy))
            parts.append(both.select(np.isfinite(value).sum(axis=1) == len(edges)))
        return Correspondences(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Correspondences)))

    def lit(self, frames: Frames) -> Image:
        """Return the fully lit picture (h, w): white, or the brighter of a pattern and its inverse."""
        return self._references(self._first_frames(Reader(frames, self._names())))[0]

    def _codes(self) -> list[CellCode]:
        return [CellCode(axis, self.projector[axis == "y"], self.step, self.inverse) for axis in coded_axes(self.axes)]

    def _names(self) -> list[str]:
        return (["white", "black"] if self.references else []) + [n for code in self._codes() for n in code.names()]

    def _first_frames(self, reader: Reader) -> list[Image]:
        """Return the frames that show what is lit: white and black, or the two coarsest bits.

        The borders of those two never coincide, so that one of them is clear-cut at every pixel.
        """
        count = 2 if self.references else 2 * min(2, self._codes()[0].bits)
        return [reader.color(i) for i in range(count)]

    def _references(self, shown: list[Image]) -> tuple[Image, Image]:
        if self.references:
            return shown[0], shown[1]
        return cast(Image, np.max(shown, axis=0)), cast(Image, np.min(shown, axis=0))
