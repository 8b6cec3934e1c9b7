"""Sub-pixel borders between Gray code cells, where a bit turns over between neighbouring pixels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from slkit.codecs._cell_bits import Cells
from slkit.codecs._gray_code import CellCode, Ints
from slkit.codecs._line_scales import REACH
from slkit.codecs._line_view import AxisPeaks, Coarse, View
from slkit.codecs._masks import Light
from slkit.codecs._peaks import Peaks
from slkit.codecs._rows import over_rows
from slkit.data import Float32s

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

# Sigma in px of the smoothing before a bit's zero crossing is taken.
_SCALE = 0.9
_NEWTON_STEPS = 3
# The finest bit repeats every four cells: what sampling does to its borders is what it does to lines so far apart.
_PERIOD_CELLS = 4


@dataclass(frozen=True)
class BitRecord:
    """Keeps what every bit of a code showed: the difference and its noise as shares of white - black, (h, w) each."""

    light: Light
    shares: dict[int, tuple[Float32s, Float32s]] = field(default_factory=dict)

    def add(self, bit: int, difference: Float32s, noise: Float32s) -> None:
        """Keep a bit's difference and noise, in grey levels."""
        self.shares[bit] = difference / self.light.span, noise / self.light.span


def borders(code: CellCode, cells: Cells, coarse: Coarse, interval: tuple[Ints, Ints], record: BitRecord) -> AxisPeaks:
    """Return the sub-pixel places where one cell meets the next; the projector position there is exact.

    coarse: the position of the cells in px; interval: the cells possible at each pixel.
    A border counts where the two pixels beside it agree on the two cells that meet, and the bit that turns over
    there is the one that tells these two apart.
    """
    period = float(_PERIOD_CELLS * code.step)
    view = View.across(coarse, record.light, period, code.step)
    lo, hi, guess = (view.turn(a) for a in (*interval, cells.guess))
    lower, upper = np.minimum(guess[:, :-1], guess[:, 1:]), np.maximum(guess[:, :-1], guess[:, 1:])
    known = view.known
    meet = (upper - lower == 1) & known[:, :-1] & known[:, 1:]
    for side in (np.s_[:, :-1], np.s_[:, 1:]):
        meet &= (lo[side] >= lower) & (hi[side] <= upper)
    parts: list[Peaks] = []
    for bit, (share, noise) in record.shares.items():
        share, noise = view.turn(share), view.turn(noise)
        # The number of zeros at the end of the upper cell's number is the bit that differs from the lower cell's.
        turns = meet & ((upper & -upper) == 1 << bit) & ((share[:, :-1] > 0) != (share[:, 1:] > 0))
        row, left = np.nonzero(turns)
        parts.append(_crossings(share, noise, row, left, upper[turns] * code.step - 0.5))
    return view.consistent(view.centered(Peaks.join(parts), period), period)


def _crossings(share: Float32s, noise: Float32s, row: Places, left: Places, value: Floats) -> Peaks:
    before, after = share[row, left].astype(np.float64), share[row, left + 1].astype(np.float64)
    start = left + before / (before - after)
    parts: list[Peaks] = []
    for rising in (True, False):
        mine = (after > before) == rising
        signed = share if rising else -share
        col, sigma = refined(signed, noise, row[mine], start[mine])
        height = np.abs(after - before)[mine]
        local = noise[row[mine], left[mine]].astype(np.float64)
        found = Peaks(row[mine], col, sigma, height, local, value[mine])
        parts.append(found.select(np.isfinite(sigma)))
    return Peaks.join(parts)


def refined(picture: Float32s, noise: Float32s, row: Places, start: Floats) -> tuple[Floats, Floats]:
    """Return where the smoothed pixels around `start` (m,) rise through zero, and its 1 sigma in px.

    NaN where they do not. noise (h, w): 1 sigma of the picture.
    Newton's method with the kernel centred between the pixels: interpolating between sums taken at whole pixels
    instead would pull every place towards the nearer one, by up to 0.04 px.
    """
    from slkit.codecs._edge_kernels import refine

    picture, noise = (np.ascontiguousarray(a, dtype=np.float32) for a in (picture, noise))
    col, sigma = np.empty(len(row)), np.empty(len(row))
    told = _SCALE, int(np.ceil(REACH * _SCALE)), _NEWTON_STEPS

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        refine(picture, noise, row[part], start[part], *told, col[part], sigma[part])

    over_rows(work, len(row))
    return col, sigma
