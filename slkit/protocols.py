"""The seams: what a codec, a scanner, a calibrator and the other plug-ins must offer.

A plug-in is a final class that fits one of these protocols; it inherits nothing. Codecs and calibrators are frozen
dataclasses: their fields are their parameters, and the data come as arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slkit.data import BoardView, Calibration, Capture, Correspondences, Frames, Image, PointCloud
from slkit.geometry import Rig

Bounds = npt.NDArray[np.float32]
"""What geometry knows before decoding, (h, w, 4): for every camera pixel the smallest and largest projector column,
then the smallest and largest projector row, in px; NaN where the rig and the depth range allow no point."""


@runtime_checkable
class Codec(Protocol):
    """A way to label projector pixels in pictures; registered as `slkit.codecs`."""

    def encode(self) -> Frames:
        """Return the patterns to project, in display order, named after their role: `white`, `x_bit9`, ..."""
        ...

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return what the pictures of those patterns say; never depends on `encode` having run.

        Errors: DecodeError, or InputError naming the frame, where the set cannot be decoded at all.
        """
        ...

    def lit(self, frames: Frames) -> Image:
        """Return the fully lit picture (h, w) that the frames hold or imply, for finding boards."""
        ...


@runtime_checkable
class Scanner(Protocol):
    """Something that projects patterns and takes a picture of each; registered as `slkit.scanners`."""

    def capture(self, patterns: Frames) -> Frames:
        """Return one picture a pattern, in the same order."""
        ...


@runtime_checkable
class Calibrator(Protocol):
    """A way from captures of boards to a rig; registered as `slkit.calibrators`.

    Attributes that a calibrator may have, and slkit then uses: `model`, a `slkit.calibration.model.Model`, is what
    `--select` compares and what left-out views are judged with; `fewest_views`, how many of each kind of picture it
    needs (default 3); `printed`, `marks` and `projected`, the targets in its pictures, and `projector`, its size in px,
    tell which mistakes to look for.
    """

    def observe(self, captures: Sequence[Capture]) -> Sequence[BoardView]:
        """Return one view a capture; a capture that cannot be used becomes a view that says why."""
        ...

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig that explains the views best. Errors: CalibrationError where the views do not suffice."""
        ...


@runtime_checkable
class Triangulator(Protocol):
    """A function from correspondences to points; registered as `slkit.triangulators`."""

    def __call__(self, correspondences: Correspondences, rig: Rig) -> PointCloud:
        """Return one point a correspondence, NaN where none exists."""
        ...


FileContent = bytes | bytearray | memoryview | Iterator[bytes | memoryview]
"""The content of a file, whole or part by part."""


@runtime_checkable
class Exporter(Protocol):
    """A function from a cloud to a file's bytes; registered as `slkit.exporters` under the file's ending."""

    def __call__(self, cloud: PointCloud) -> FileContent:
        """Return the whole content of the file, or give it part by part."""
        ...


Parameters = dict[str, Any]
"""What a TOML table or `--set` gives for the fields of a plug-in."""
