"""Numbered tags: a grid of them for side A, or a few in place of corner marks for side B."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import as_floats, as_size
from slkit.targets._dictionaries import check_dictionary, markers, modules
from slkit.targets._drawing import INK, PAPER, Cells, Ink, check_length, grid

DEFAULT_TAGS = "apriltag_36h11"
_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


@dataclass(frozen=True)
class TagMarks:
    """A numbered tag at each given place of a white plane: number 0 at the first, 1 at the second, ...

    xy_mm: centres in the board frame; tag_mm: side of a tag's black border; dictionary: of the tags. The points are
    the corners of the tags; order and orientation come from the numbers, and not all tags need be seen.
    Errors: InputError for tags that overlap or cannot be.
    """

    kind: Literal["tags"] = field(default="tags", kw_only=True)
    xy_mm: tuple[tuple[float, float], ...]
    tag_mm: float
    dictionary: str = DEFAULT_TAGS

    def __post_init__(self) -> None:
        centers = as_floats(self.xy_mm, (None, 2), "xy_mm")
        check_length(self.tag_mm, "tag_mm")
        if not len(centers):
            raise InputError("xy_mm must hold the centre of one tag or more")
        check_dictionary(self.dictionary, len(centers))
        room = self.tag_mm * (1 + 1 / modules(self.dictionary)) * (1 - 1e-9)
        apart = np.abs(centers[:, None] - centers).max(axis=2)
        if (apart[np.triu_indices(len(centers), 1)] < room).any():
            raise InputError(f"tags of {self.tag_mm} mm stand too close: leave at least one cell of white between them")

    def centers(self) -> npt.NDArray[np.float64]:
        """Return the centres (n, 2) in mm, by number."""
        return np.array(self.xy_mm, dtype=np.float64)

    def points(self) -> npt.NDArray[np.float64]:
        """Return the corners (4 n, 2) in mm: TL TR BR BL of tag 0, then of tag 1, ..."""
        return (self.centers()[:, None] + _CORNERS * self.tag_mm).reshape(-1, 2)

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a white margin of a quarter of a tag: x min, y min, x max, y max in mm."""
        centers, margin = self.centers(), 0.75 * self.tag_mm
        (x0, y0), (x1, y1) = centers.min(axis=0) - margin, centers.max(axis=0) + margin
        return float(x0), float(y0), float(x1), float(y1)

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm."""
        return PAPER + (INK - PAPER) * self.cells.mean(xy, footprint_mm)

    def ink(self) -> Ink:
        """Return the black cells of the tags."""
        return Ink.of_boxes(self.cells.boxes())

    @cached_property
    def cells(self) -> Cells:
        """All tags on one net of lines, in mm."""
        bits = markers(self.dictionary, len(self.xy_mm))
        count = bits.shape[1]
        inner = (np.arange(count + 1) / count - 0.5) * self.tag_mm
        # Rounding makes one line of those that tags in a row share.
        x, y = (np.unique(np.round(c[:, None] + inner, 9)) for c in self.centers().T)
        ink = np.zeros((len(y) - 1, len(x) - 1))
        for tag, center in zip(bits, self.centers(), strict=True):
            col, row = ((np.convolve(v, [0.5, 0.5], "valid") - c) for v, c in zip((x, y), center, strict=True))
            col, row = (np.floor((v / self.tag_mm + 0.5) * count).astype(np.intp) for v in (col, row))
            mine = np.ix_((row >= 0) & (row < count), (col >= 0) & (col < count))
            ink[mine] += tag[np.ix_(row[(row >= 0) & (row < count)], col[(col >= 0) & (col < count)])]
        return Cells(x, y, ink)


@dataclass(frozen=True)
class AprilTags:
    """A printed grid of numbered tags; a view of a part of it counts.

    tags: in x and y, numbered from 0 row by row; tag_mm: side of a tag's black border; gap_mm: white between tags;
    dictionary: of the tags. The top left corner of tag 0 is the origin. Errors: InputError for a board that cannot be.
    """

    kind: Literal["april-tags"] = field(default="april-tags", kw_only=True)
    tags: tuple[int, int]
    tag_mm: float
    gap_mm: float
    dictionary: str = DEFAULT_TAGS

    def __post_init__(self) -> None:
        as_size(self.tags, "tags")
        check_length(self.gap_mm, "gap_mm")
        check_length(self.tag_mm, "tag_mm")
        _ = self.marks

    def centers(self) -> npt.NDArray[np.float64]:
        """Return the centres (n, 2) in mm, by number."""
        return self.marks.centers()

    def points(self) -> npt.NDArray[np.float64]:
        """Return the corners (4 n, 2) in mm: TL TR BR BL of tag 0, then of tag 1, ..."""
        return self.marks.points()

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet with a white margin of a quarter of a tag: x min, y min, x max, y max in mm."""
        return self.marks.extent()

    def reflectance(self, xy: npt.ArrayLike, footprint_mm: float) -> npt.NDArray[np.float64]:
        """Return the reflectance (...), 0 to 1, at board points (..., 2) mm."""
        return self.marks.reflectance(xy, footprint_mm)

    def ink(self) -> Ink:
        """Return the black cells of the tags."""
        return self.marks.ink()

    @cached_property
    def marks(self) -> TagMarks:
        """The same tags, one by one."""
        centers = grid(self.tags) * (self.tag_mm + self.gap_mm) + self.tag_mm / 2
        return TagMarks(tuple((float(x), float(y)) for x, y in centers), self.tag_mm, self.dictionary)
