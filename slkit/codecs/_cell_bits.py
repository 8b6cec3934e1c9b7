"""Reading a Gray code back: which cells each pixel may show, and how sure its bits are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slkit.codecs._gray_code import CellCode, Ints
from slkit.codecs._masks import Levels, Light
from slkit.codecs._rows import over_rows
from slkit.codecs._separation import SEPARATION_BITS, Pair, robust_bit, separate
from slkit.data import Float32s
from slkit.device import on_cuda

# Bits that a loop takes at a time: more of their pictures are not held in memory.
_AT_ONCE = 6
# Cells of so many bits are held as short numbers.
_SHORT_BITS = 15


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
    """What the code says, (h, w) each: cells lo to hi exist and are possible.

    square: of the smallest |difference| of a known bit in sigmas. guess: what the bits say taken at face value, where
    every bit was asked for, else lo.
    """

    lo: Ints
    hi: Ints
    square: Float32s
    guess: Ints

    @classmethod
    def of(cls, code: CellCode, shape: tuple[int, ...]) -> Cells:
        """Return room for the cells (h, w) that a code's pictures show."""
        kind = np.int16 if code.bits <= _SHORT_BITS else np.int32
        lo, hi = (np.empty(shape, kind) for _ in range(2))
        return cls(lo, hi, np.empty(shape, np.float32), lo)


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
    cells = Cells.of(code, light.mask.shape)
    for first in range(0, code.bits, _AT_ONCE):
        bits = range(first, min(first + _AT_ONCE, code.bits))
        # In display order: a video can only be read forwards.
        shown = {name: read(name) for bit in reversed(bits) for name in code.names_of(bit)}
        add_bits(code, bits, [shown[name] for bit in bits for name in code.names_of(bit)], light, rule, cells)
    return cells


def add_bits(
    code: CellCode, bits: range, pictures: Sequence[Levels], light: Light, rule: BitRule, cells: Cells
) -> None:
    """Take at most `_AT_ONCE` bits into cells that hold all lower ones; see `read_cells`.

    pictures: the grey levels (h, w) of each bit, the lowest first, and of its inverse, all of one type.
    """
    limits = np.array([rule.snr, rule.contrast], dtype=np.float32)
    last = code.count - 1 if bits.stop == code.bits else (1 << bits.stop) - 1
    told = light.curve.numbers, limits, bits.start
    if on_cuda():
        from slkit.codecs._cuda_kernels import add_bits as on_device

        step = 2 if code.inverse else 1
        lit, inverse = np.stack(pictures[::step]), np.stack(pictures[1::step]) if code.inverse else None
        on_device(lit, inverse, (light.white, light.black), *told, last, cells.lo, cells.hi, cells.square)
        return
    from slkit.codecs._bit_kernels import add_rows

    # A compiled loop knows pictures of one type and layout only, and so many; none is changed.
    same = [_read_only(picture) for picture in pictures]
    same += same[-1:] * (_AT_ONCE * (2 if code.inverse else 1) - len(same))

    def work(first: int, stop: int) -> None:
        rows = slice(first, stop)
        state = cells.lo[rows], cells.hi[rows], cells.square[rows]
        part = tuple(picture[rows] for picture in same)
        add_rows(part, code.inverse, light.white[rows], light.black[rows], *told, len(bits), last, *state)

    over_rows(work, len(light.mask))


def _read_only(picture: Levels) -> Levels:
    view = np.ascontiguousarray(picture).view()
    view.flags.writeable = False
    return view


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
    hi, guess, square = lo, lo, np.full(lo.shape, np.inf, dtype=np.float32)
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
    return Cells(lo, np.minimum(hi, code.count - 1), square, guess)


def _read_pair(code: CellCode, bit: int, read: Callable[[str], Levels], light: Light) -> Pair:
    lit = read(f"{code.axis}_bit{bit}").astype(np.float32)
    if code.inverse:
        inverse = read(f"{code.axis}_bit{bit}_inverse").astype(np.float32)
        return Pair(lit, inverse, np.hypot(light.noise(lit), light.noise(inverse)))
    # Without an inverse the references stand in for it: white + black - pattern.
    references = np.hypot(light.noise(light.high), light.noise(light.low))
    return Pair(lit, light.high + light.low - lit, np.hypot(2 * light.noise(lit), references))
