"""Line shift: thin lines stepped across the scene, told apart by a coarse Gray code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.codecs._cell_bits import BitRule, read_cells
from slkit.codecs._cell_places import place, possible
from slkit.codecs._footprint import NOISE_GAIN, STEEPEST, VARIANCE, VARIANCE_DOUBT, around, displacement
from slkit.codecs._gray_code import (
    Axes,
    Axis,
    CellCode,
    Mask,
    Profile,
    check_thresholds,
    coded_axes,
    constant,
    patterns,
    profile_of,
)
from slkit.codecs._line_scales import LineRule, scales_of
from slkit.codecs._line_view import Coarse, View
from slkit.codecs._lines import Lines, find_lines
from slkit.codecs._masks import Levels, Light, Reader, measure_light
from slkit.codecs._noise import probability
from slkit.codecs._results import collect
from slkit.data import Correspondences, Float32s, Frames, Image
from slkit.errors import InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds

Read = Callable[[str], Levels]
Floats = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class LineShift:
    """A pattern of thin lines, `period` px apart, shown at each of its `period` shifts, after a Gray code of cells.

    projector (width, height) px. axes: "x" finds columns, "y" rows, "both" columns and the row at each of them.
    width: px a line; shift s lights position p where (p - s) mod period < width. cell: projector px a Gray cell, at
    most half a period; inverse: each Gray pattern is followed by its inverse. peaks: "spatial" gives sub-pixel camera
    positions of exact projector lines; "temporal" one value a camera pixel, from its own brightness over the shifts.
    robust: decide bits by direct and global light.

    Thresholds, all relative. min_snr: white - black in units of its noise, below it a pixel is unlit, and the same for
    the contrast of a line; bit_snr: the difference that decides a bit, in units of its noise; min_contrast: a bit's
    difference and a line's contrast as a share of white - black.

    Errors: InputError where a parameter is out of range.
    Source: Guhring, Dense 3-D surface acquisition by structured light using off-the-shelf components (2001).
    """

    projector: tuple[int, int]
    axes: Axes = "x"
    period: int = 6
    width: int = 1
    cell: int = 2
    inverse: bool = True
    peaks: Literal["spatial", "temporal"] = "spatial"
    robust: bool = False
    min_snr: float = 5.0
    bit_snr: float = 3.0
    min_contrast: float = 0.05

    def __post_init__(self) -> None:
        object.__setattr__(self, "projector", as_size(self.projector, "projector"))
        coded_axes(self.axes)
        if self.period < 3:
            raise InputError(f"period must be at least 3 px, not {self.period}")
        if not 1 <= self.width < self.period:
            raise InputError(f"width must be at least 1 and less than period ({self.period}), not {self.width}")
        if not 1 <= self.cell <= self.period / 2:
            raise InputError(f"cell must be at least 1 and at most half of period ({self.period}), not {self.cell}")
        if self.peaks not in ("spatial", "temporal"):
            raise InputError(f"peaks must be 'spatial' or 'temporal', not {self.peaks!r}")
        check_thresholds(self.min_snr, self.bit_snr, self.min_contrast)

    def encode(self) -> Frames:
        """Return the patterns in display order: white, black, then for each axis its Gray code and its lines."""
        profiles: dict[str, Profile] = {"white": constant(255), "black": constant(0)}
        for axis in coded_axes(self.axes):
            profiles |= self._code(axis).profiles()
            position = np.arange(self._size(axis))
            for shift, name in enumerate(self._line_names(axis)):
                profiles[name] = profile_of((position - shift) % self.period < self.width, axis)
        return patterns(profiles, self.projector)

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return the line centres, or one value a camera pixel where peaks is "temporal".

        bounds (h, w, 4): Gray cells outside by more than one cell are ruled out.
        Errors: InputError where frames do not fit the patterns, DecodeError where nothing is lit.
        """
        names = self._names()
        reader = Reader(frames, names)
        white, black = reader.color(0), reader.color(1)
        light = measure_light(white, black, self.min_snr)

        def read(name: str) -> Levels:
            return reader.levels(names.index(name))

        if self.peaks == "temporal":
            return self._decode_pixels(read, light, white, bounds)
        return self._decode_peaks(read, light, white, bounds)

    def lit(self, frames: Frames) -> Image:
        """Return the fully lit picture (h, w): white."""
        return Reader(frames, self._names()).color(0)

    def _size(self, axis: Axis) -> int:
        return self.projector[axis == "y"]

    def _code(self, axis: Axis) -> CellCode:
        return CellCode(axis, self._size(axis), self.cell, self.inverse)

    def _line_names(self, axis: Axis) -> list[str]:
        return [f"{axis}_line{shift}" for shift in range(self.period)]

    def _names(self) -> list[str]:
        names = [n for axis in coded_axes(self.axes) for n in self._code(axis).names() + self._line_names(axis)]
        return ["white", "black", *names]

    def _coarse(self, axis: Axis, read: Read, light: Light, bounds: Bounds | None) -> Coarse:
        """Return what the Gray code of an axis says, known where it leaves one line of a shift to choose."""
        code = self._code(axis)
        cells = read_cells(code, read, light, BitRule(self.bit_snr, self.min_contrast, self.robust))
        # As many unknown cells as leave the next line of the same shift outside, whatever side the true one lies on.
        most = max(self.period // self.cell - 1, 1)
        return Coarse(*place(possible(cells, code, bounds), code, most, light.mask), cells.square)

    def _nearest_line(self, coarse: Floats, offset: Floats) -> tuple[Floats, Mask]:
        """Return the position offset + whole periods nearest to a coarse one, and whether it is near enough to trust.

        Right as long as the coarse position errs by less than half a period.
        """
        value = offset + self.period * np.rint((coarse - offset) / self.period)
        return value, np.abs(coarse - value) <= self.period / 2 - 1

    def _decode_peaks(self, read: Read, light: Light, white: Image, bounds: Bounds | None) -> Correspondences:
        first, *others = coded_axes(self.axes)
        found = self._lines(first, read, light, bounds).correspondences(int(first == "y"), white)
        for axis in others:
            along = self._lines(axis, read, light, bounds).peaks()
            found.projector_xy[:, 1], found.sigma[:, 1] = along.at(found.camera_xy, light.mask.shape)
            found = found.select(np.isfinite(found.projector_xy[:, 1]))
        return found

    def _lines(self, axis: Axis, read: Read, light: Light, bounds: Bounds | None) -> Lines:
        view = View.across(self._coarse(axis, read, light, bounds), light, self.period, self.cell)
        reach, size = (self.width - 1) / 2, self._size(axis)
        # Right as long as the coarse position errs by less than half a period; lines cut by the border are left out.
        told = float(self.period), self.period / 2 - 1, reach, size - 1 - reach, self.min_contrast, self.min_snr
        rules = [LineRule(shift + reach, *told) for shift in range(self.period)]
        pictures = [view.turn(read(name)) for name in self._line_names(axis)]
        return find_lines(view, pictures, scales_of(self.width, self.period), rules)

    def _decode_pixels(self, read: Read, light: Light, white: Image, bounds: Bounds | None) -> Correspondences:
        places: dict[int, tuple[Float32s, Float32s]] = {}
        keep, square = light.mask.copy(), np.full(light.mask.shape, np.inf, dtype=np.float32)
        for axis in coded_axes(self.axes):
            coarse = self._coarse(axis, read, light, bounds)
            phase, snr = self._harmonic(axis, read, light)
            value, near = self._nearest_line(coarse.value, phase)
            good = coarse.known & near & (snr > self.min_snr * np.sqrt(2 / self.period))
            noise = np.sqrt(2 / self.period) * self.period / (2 * np.pi) / np.maximum(snr, 1e-3)
            shift = displacement(value, good, light.span, self.period / 2)
            position = value - VARIANCE * np.clip(shift, -STEEPEST, STEEPEST)
            sigma = np.hypot(NOISE_GAIN * noise, VARIANCE_DOUBT * around(shift))
            places[int(axis == "y")] = position.astype(np.float32), sigma.astype(np.float32)
            keep &= good
            square = np.minimum(square, coarse.square)
        return collect(keep, places, probability(square), white)

    def _harmonic(self, axis: Axis, read: Read, light: Light) -> tuple[Float32s, Float32s]:
        """Return the position in px within a period, and amplitude over noise, of the first harmonic over the shifts.

        (h, w) each. A line's brightness over the shifts is even about its centre, so that the phase is its position.
        """
        total = np.zeros(light.low.shape, dtype=np.complex64)
        level = np.zeros(light.low.shape, dtype=np.float32)
        for shift, name in enumerate(self._line_names(axis)):
            picture = read(name)
            total += picture * np.complex64(np.exp(2j * np.pi * shift / self.period))
            level += picture / self.period
        amplitude = np.abs(total) * (2 / self.period)
        phase = np.angle(total) * (self.period / (2 * np.pi)) + (self.width - 1) / 2
        return phase.astype(np.float32), (amplitude / light.noise(level)).astype(np.float32)
