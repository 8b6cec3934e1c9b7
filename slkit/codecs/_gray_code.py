"""The reflected binary Gray code of one projector axis: drawing it, and reading it back with its doubts.

Shared by the codecs that number projector cells with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.codecs._masks import Levels, Light
from slkit.codecs._rows import over_blocks, over_rows
from slkit.codecs._separation import SEPARATION_BITS, Pair, robust_bit, separate
from slkit.data import Float32s, Frames
from slkit.device import on_cuda
from slkit.errors import InputError
from slkit.protocols import Bounds

Axis = Literal["x", "y"]
Axes = Literal["x", "y", "both"]
Ints = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]
Profile = npt.NDArray[np.uint8]

# More pictures of a code are not held in memory than those of so many bits.
_AT_ONCE = 6
# Beyond so many sigmas noise turns nothing over, as far as float32 can tell.
_MOST_SIGMAS = 6


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

    def center(self, cell: npt.NDArray[Any]) -> Float32s:
        """Return the projector position in px of the middle of a cell (...), whole or fractional."""
        return (cell * self.step + (self.step - 1) / 2).astype(np.float32)


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


@dataclass(frozen=True)
class BitRule:
    """When a bit counts as known: |difference| > `snr` times its noise, and > `contrast` times white - black.

    robust: also ask whether direct or global light explains the difference (see `_separation`).
    """

    snr: float
    contrast: float
    robust: bool


@dataclass(frozen=True, eq=False)
class Cells:
    """What the code says, (h, w) each: cells lo to hi are possible.

    square: of the smallest |difference| of a known bit in sigmas. guess: what the bits say taken at face value, where
    every bit was asked for, else lo.
    """

    lo: Ints
    hi: Ints
    square: Float32s
    guess: Ints

    @property
    def margin(self) -> Float32s:
        """The smallest |difference| of a known bit in sigmas (h, w)."""
        return np.sqrt(self.square)


def read_cells(
    code: CellCode,
    read: Callable[[str], Levels],
    light: Light,
    rule: BitRule,
    on_bit: Callable[[int, Float32s, Float32s], None] | None = None,
) -> Cells:
    """Return the cells that pictures of the code show.

    read: gives the grey levels (h, w) of a name, called once each. on_bit(bit, difference, noise): called for every
    bit, both in grey levels (h, w).

    From the lowest bit up, an interval [lo, hi] of cells within a block of 2^k becomes, in a block twice as large,
    itself where the next bit is 0, its mirror image where it is 1, and the hull of both where the bit is unknown:
    narrow at the border that the bit marks, where both are neighbours, and wide anywhere else.
    """
    if rule.robust or on_bit is not None:
        return _read_with_care(code, read, light, rule, on_bit)
    lo, hi = (np.zeros(light.mask.shape, dtype=np.int32) for _ in range(2))
    cells = Cells(lo, hi, np.full(lo.shape, np.inf, dtype=np.float32), lo)
    for first in range(0, code.bits, _AT_ONCE):
        bits = range(first, min(first + _AT_ONCE, code.bits))
        # In display order: a video can only be read forwards.
        shown = {name: read(name) for bit in reversed(bits) for name in code.names_of(bit)}
        add_bits(code, bits, shown, light, rule, cells)
    return cells


def add_bits(
    code: CellCode, bits: range, shown: Mapping[str, Levels], light: Light, rule: BitRule, cells: Cells
) -> None:
    """Take bits into cells that hold all lower ones; see `read_cells`.

    shown: the grey levels (h, w) of each name, all of one type. A few rows pass through all of the bits at a time.
    """
    if on_cuda():
        _add_bits_on_cuda(code, bits, shown, light, rule, cells)
        return
    from slkit.codecs._cell_kernels import add_pair, add_single, least_squares

    noise = light.curve.numbers

    def block(rows: slice) -> None:
        least = np.empty(light.mask[rows].shape, dtype=np.float32)
        least_squares(light.white[rows], light.black[rows], rule.contrast, least)
        lo, hi = cells.lo[rows].astype(np.float32), cells.hi[rows].astype(np.float32)
        state = lo, hi, cells.square[rows]
        for bit in bits:
            lit = shown[f"{code.axis}_bit{bit}"][rows]
            if code.inverse:
                add_pair(lit, shown[f"{code.axis}_bit{bit}_inverse"][rows], least, noise, rule.snr, bit, *state)
            else:
                add_single(lit, light.white[rows], light.black[rows], least, noise, rule.snr, bit, *state)
        cells.lo[rows], cells.hi[rows] = lo, hi

    over_blocks(block, light.mask.shape)


def _add_bits_on_cuda(
    code: CellCode, bits: range, shown: Mapping[str, Levels], light: Light, rule: BitRule, cells: Cells
) -> None:
    from slkit.codecs._cuda_kernels import add_bits as on_device

    lit = np.stack([shown[f"{code.axis}_bit{bit}"] for bit in bits])
    inverse = np.stack([shown[f"{code.axis}_bit{bit}_inverse"] for bit in bits]) if code.inverse else lit[:0]
    limits = np.array([rule.snr, rule.contrast], dtype=np.float32)
    state = cells.lo, cells.hi, cells.square
    on_device(lit, inverse, (light.white, light.black), light.curve.numbers, limits, bits.start, *state)


def _read_with_care(
    code: CellCode,
    read: Callable[[str], Levels],
    light: Light,
    rule: BitRule,
    on_bit: Callable[[int, Float32s, Float32s], None] | None,
) -> Cells:
    """Return the cells where direct and global light decide bits, or each bit is asked for; see `read_cells`."""
    held = {bit: _read_pair(code, bit, read, light) for bit in SEPARATION_BITS if rule.robust and bit < code.bits}
    separation = separate(list(held.values()), light.low) if held else None
    lo = np.zeros(light.low.shape, dtype=np.int32)
    hi, guess = lo.copy(), lo.copy()
    square = np.full(lo.shape, np.inf, dtype=np.float32)
    for bit in range(code.bits):
        pair = held.pop(bit) if bit in held else _read_pair(code, bit, read, light)
        difference = pair.lit - pair.inverse
        one = difference > 0
        known = np.abs(difference) > np.maximum(rule.snr * pair.noise, rule.contrast * light.span)
        if separation is not None:
            robust_one, robust_known = robust_bit(pair, separation, light.low, rule.snr)
            one, known = np.where(robust_known, robust_one, one), known & robust_known
        top = 2 ** (bit + 1) - 1
        lo, hi = np.where(one & known, top - hi, lo), np.where(known, np.where(one, top - lo, hi), top - lo)
        guess = np.where(one, top - guess, guess)
        square = np.where(known, np.minimum(square, (difference / pair.noise) ** 2), square)
        if on_bit is not None:
            on_bit(bit, difference, pair.noise)
    return Cells(lo, hi, square, guess)


def possible(cells: Cells, code: CellCode, bounds: Bounds | None) -> tuple[Ints, Ints]:
    """Return the interval lo, hi (h, w) of cells that exist and lie within bounds (h, w, 4), give or take one cell.

    lo > hi where none is left. Errors: InputError where bounds have another size.
    """
    lo, hi = cells.lo, np.minimum(cells.hi, code.count - 1)
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


def check_thresholds(min_snr: float, bit_snr: float, min_contrast: float) -> None:
    """Refuse thresholds out of range. Errors: InputError."""
    for name, value in (("min_snr", min_snr), ("bit_snr", bit_snr)):
        if not 0 < value < np.inf:
            raise InputError(f"{name} must be a positive number, not {value}")
    if not 0 <= min_contrast < 1:
        raise InputError(f"min_contrast must be a share between 0 and 1, not {min_contrast}")


def probability(margin: Float32s) -> Float32s:
    """Return the probability (...) that noise does not turn over a difference of `margin` sigmas."""
    from slkit.codecs._cell_kernels import PER_SIGMA

    table = chances()
    return np.interp(margin * np.float32(PER_SIGMA), np.arange(len(table)), table).astype(np.float32)


@cache
def chances() -> Float32s:
    """Return the standard normal distribution at 0, 1 / 256, 2 / 256 ... sigmas (n,), as far as it differs from 1.

    A table, for a function of every pixel. Do not write to it.
    """
    from slkit.codecs._cell_kernels import PER_SIGMA

    sigmas = [k / PER_SIGMA for k in range(_MOST_SIGMAS * PER_SIGMA + 1)]
    return np.array([(1 + math.erf(s / math.sqrt(2))) / 2 for s in sigmas], dtype=np.float32)


def _read_pair(code: CellCode, bit: int, read: Callable[[str], Levels], light: Light) -> Pair:
    lit = read(f"{code.axis}_bit{bit}").astype(np.float32)
    if code.inverse:
        inverse = read(f"{code.axis}_bit{bit}_inverse").astype(np.float32)
        return Pair(lit, inverse, np.hypot(light.noise(lit), light.noise(inverse)))
    # Without an inverse the references stand in for it: white + black - pattern.
    references = np.hypot(light.noise(light.high), light.noise(light.low))
    return Pair(lit, light.high + light.low - lit, np.hypot(2 * light.noise(lit), references))
