"""The reflected binary Gray code of one projector axis, for the codecs that number projector cells with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.data import Frames
from slkit.errors import InputError

Axis = Literal["x", "y"]
Axes = Literal["x", "y", "both"]
Ints = npt.NDArray[np.signedinteger[Any]]
Mask = npt.NDArray[np.bool_]
Profile = npt.NDArray[np.uint8]


def coded_axes(axes: Axes) -> tuple[Axis, ...]:
    """Return the axes that a setting names, x first. Errors: InputError for another word."""
    table: dict[str, tuple[Axis, ...]] = {"x": ("x",), "y": ("y",), "both": ("x", "y")}
    if axes not in table:
        raise InputError(f"axes must be 'x', 'y' or 'both', not {axes!r}")
    return table[axes]


@dataclass(frozen=True)
class CellCode:
    """The Gray code of the cells floor(position / step) along one axis of a projector.

    size: length of the axis in px; step: px a cell; inverse: every pattern is followed by its inverse.
    Bit 1 = lit. Names go from the most significant bit down: x_bit9, x_bit9_inverse, ...
    """

    axis: Axis
    size: int
    step: int
    inverse: bool

    @property
    def count(self) -> int:
        """The number of cells; the last may be cut by the image's border."""
        return -(-self.size // self.step)

    @property
    def bits(self) -> int:
        """The number of bits that number all cells, at least one."""
        return max((self.count - 1).bit_length(), 1)

    def names(self) -> list[str]:
        """Return the pattern names in display order."""
        return [name for bit in reversed(range(self.bits)) for name in self.names_of(bit)]

    def names_of(self, bit: int) -> list[str]:
        """Return the names of a bit's patterns."""
        tails = ("", "_inverse") if self.inverse else ("",)
        return [f"{self.axis}_bit{bit}{tail}" for tail in tails]

    def profiles(self) -> dict[str, Profile]:
        """Return each pattern as (1, size) or (size, 1), 0 or 255."""
        cells = np.arange(self.size) // self.step
        code = cells ^ (cells >> 1)
        result: dict[str, Profile] = {}
        for bit in reversed(range(self.bits)):
            lit = (code >> bit & 1).astype(bool)
            result[f"{self.axis}_bit{bit}"] = profile_of(lit, self.axis)
            if self.inverse:
                result[f"{self.axis}_bit{bit}_inverse"] = profile_of(~lit, self.axis)
        return result


def profile_of(lit: Mask, axis: Axis) -> Profile:
    """Return what is lit along an axis, (n,), as a picture (1, n) or (n, 1) of 0 and 255."""
    levels = np.where(lit, 255, 0).astype(np.uint8)
    return levels[None, :] if axis == "x" else levels[:, None]


def constant(level: int) -> Profile:
    """Return a picture (1, 1) of one grey level, for `patterns`."""
    return np.full((1, 1), level, dtype=np.uint8)


def patterns(profiles: Mapping[str, Profile], size: tuple[int, int]) -> Frames:
    """Return the pictures (h, w) that profiles of shape (1, w), (h, 1) or (1, 1) stand for, drawn when asked for."""
    names, lines = tuple(profiles), tuple(profiles.values())
    shape = size[1], size[0]
    return Frames(names, lambda i: np.broadcast_to(lines[i], shape).copy())


def check_thresholds(min_snr: float, bit_snr: float, min_contrast: float) -> None:
    """Refuse thresholds out of range. Errors: InputError."""
    for name, value in (("min_snr", min_snr), ("bit_snr", bit_snr)):
        if not 0 < value < np.inf:
            raise InputError(f"{name} must be a positive number, not {value}")
    if not 0 <= min_contrast < 1:
        raise InputError(f"min_contrast must be a share between 0 and 1, not {min_contrast}")
