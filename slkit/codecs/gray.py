"""Gray code: every projector cell has a binary number, shown bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal, cast

import numpy as np

from slkit.codecs._edges import BitRecord, borders
from slkit.codecs._gray_code import (
    Axes,
    Axis,
    BitRule,
    CellCode,
    Profile,
    check_thresholds,
    coded_axes,
    constant,
    patterns,
    place,
    possible,
    probability,
    read_cells,
)
from slkit.codecs._line_view import AxisPeaks, Coarse
from slkit.codecs._masks import Reader, collect, colors_at, grey, measure_light
from slkit.data import Correspondences, Float32s, Frames, Image
from slkit.errors import InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds


@dataclass(frozen=True, eq=False)
class _Found:
    """One axis: value and sigma of every pixel (h, w), px, and the borders between cells if they are asked for."""

    value: Float32s
    sigma: Float32s
    edges: AxisPeaks | None


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
    The value is the interval's middle, sigma follows from its length (see `place`). confidence: the probability under
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

        def read(name: str) -> Float32s:
            index = names.index(name)
            return grey(shown[index]) if index < len(shown) else reader.grey(index)

        light = measure_light(white, black, self.min_snr)
        rule = BitRule(self.bit_snr, self.min_contrast, self.robust)
        keep, margin = light.mask.copy(), np.full(light.mask.shape, np.inf, dtype=np.float32)
        found: dict[Axis, _Found] = {}
        for code in self._codes():
            record = BitRecord(light)
            on_bit = record.add if self.subpixel else None
            cells = read_cells(code, read, light, rule, on_bit)
            interval = possible(cells, code, bounds)
            value, sigma, good = place(interval, code, self.max_cells)
            keep &= good
            margin = np.minimum(margin, cells.margin)
            coarse = Coarse(value, good & light.mask, cells.margin)
            edges = borders(code, cells, coarse, interval, record) if self.subpixel else None
            found[code.axis] = _Found(value, sigma, edges)
        projector_xy, sigma = (_stacked(found, part, keep.shape) for part in ("value", "sigma"))
        if not self.subpixel:
            return collect(keep, projector_xy, sigma, probability(margin), white)
        for pixel_map in (projector_xy, sigma):
            pixel_map[~keep] = np.nan
        return self._at_edges(found, projector_xy, sigma, white)

    def _at_edges(
        self, found: Mapping[Axis, _Found], projector_xy: Float32s, sigma: Float32s, white: Image
    ) -> Correspondences:
        """Return the cell borders of all axes; the coordinate that a border does not fix is that of its pixel."""
        parts: list[Correspondences] = []
        for i, axis in enumerate(("x", "y")):
            edges = found[axis].edges if axis in found else None
            if edges is None:
                continue
            camera_xy = edges.camera_xy.astype(np.float32)
            cols, rows = np.rint(camera_xy).astype(np.intp).T
            value, spread = projector_xy[rows, cols], sigma[rows, cols]
            value[:, i], spread[:, i] = edges.peaks.value, edges.sigma
            both = Correspondences(camera_xy, value, spread, edges.confidence, colors_at(white, camera_xy))
            parts.append(both.select(np.isfinite(value).sum(axis=1) == len(found)))
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


def _stacked(found: Mapping[Axis, _Found], part: Literal["value", "sigma"], shape: tuple[int, ...]) -> Float32s:
    silent = np.full(shape, np.nan, dtype=np.float32)
    both: list[Float32s] = [getattr(found[axis], part) if axis in found else silent for axis in ("x", "y")]
    return np.stack(both, axis=-1)
