"""Whether the two pictures of one pose belong together: exchanged, stale, or with the board moved in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import Singles, grey
from slkit.data import Finding, Image
from slkit.geometry import Floats

_LIT = 0.25
"""What is brighter than this share of the brightest counts as lit."""
_DIFFERENT = 1.4
"""By this factor two pictures of one place differ where the pattern is black in one of them."""
_NOWHERE = 0.01
_SHALLOW = 0.75
"""A pattern whose squares differ by less than this share of what is usual is mixed with something else."""
_REACH = 0.06
"""How far a mark is searched for, as a share of the picture's width."""
_ALIKE = 0.6
_MOVED_PX = 0.6


@dataclass(frozen=True)
class Pair:
    """What two pictures of one pose say: shares of the lit pixels that the pattern darkens and brightens, and depth.

    depth: the share by which black squares are darker than white ones.
    """

    view: str
    darker: float
    brighter: float
    depth: float


def compare(view: str, white: Image, pattern: Image) -> Pair:
    """Return how the picture under the pattern differs from that under white light."""
    one, other = (cv2.GaussianBlur(grey(p), (0, 0), 1.0) for p in (white, pattern))
    brightest = np.maximum(one, other)
    lit = brightest > _LIT * float(np.percentile(brightest, 99.5))
    ratio: Any = (other[lit] + 1) / (one[lit] + 1)
    low, high = np.percentile(ratio, (10, 90))
    darker, brighter = float((ratio < 1 / _DIFFERENT).mean()), float((ratio > _DIFFERENT).mean())
    return Pair(view, darker, brighter, float(1 - low / high))


def exchange_findings(pairs: Sequence[Pair]) -> list[Finding]:
    """Return the poses whose pictures are exchanged, or whose pattern was not, or not fully, shown."""
    found: list[Finding] = []
    usual = float(np.median([p.depth for p in pairs])) if len(pairs) > 2 else 0.0
    again = "wait longer after a change of the pattern, and take both pictures again"
    for pair in pairs:
        if pair.darker < _NOWHERE and pair.brighter < _NOWHERE:
            fault = "both pictures show the same light"
            found.append(Finding(fault, pair.view, again, "stale-frame"))
        elif pair.brighter > max(3 * pair.darker, 0.05):
            fault = "the picture under white light and the one under the pattern are exchanged"
            found.append(Finding(fault, pair.view, "exchange the two pictures", "swapped-pictures"))
        elif pair.depth < _SHALLOW * usual:
            fault = (
                f"the pattern is mixed with other light: its squares differ by {100 * pair.depth:.0f} %, "
                f"{100 * usual:.0f} % in other views"
            )
            found.append(Finding(fault, pair.view, again, "stale-frame"))
    return found


def motion_finding(view: str, white: Image, pattern: Image, marks: Floats, cell_px: float) -> list[Finding]:
    """Return that the board moved between two pictures, where marks (n, 2) px of the first are elsewhere in the second.

    cell_px: side of a mark's cell.
    """
    shifts = mark_shifts(grey(white), grey(pattern), marks, cell_px)
    if len(shifts) < 3:
        return []
    moved = float(np.median(np.linalg.norm(shifts, axis=1)))
    if moved <= _MOVED_PX:
        return []
    fault = f"the board moved by {moved:.1f} px between the two pictures"
    return [Finding(fault, view, "fix the board before you take both pictures, or leave this pose out", "moved-board")]


def mark_shifts(white: Singles, pattern: Singles, marks: Floats, cell_px: float) -> Floats:
    """Return by how many px (k, 2) the marks that both pictures show have moved from the first to the second."""
    half = max(round(1.8 * cell_px), 4)
    reach = max(round(_REACH * white.shape[1]), 6)
    shifts = [_shift(white, pattern, at, half, reach) for at in marks]
    return np.array([s for s in shifts if s is not None]).reshape(-1, 2)


def _shift(white: Singles, pattern: Singles, at: Floats, half: int, reach: int) -> Floats | None:
    x, y = (int(v) for v in np.rint(at))
    height, width = white.shape
    if min(x, y) < half or x + half >= width or y + half >= height:
        return None
    left, top = max(x - half - reach, 0), max(y - half - reach, 0)
    template = white[y - half : y + half + 1, x - half : x + half + 1]
    around = pattern[top : y + half + reach + 1, left : x + half + reach + 1]
    likeness: Any = cv2.matchTemplate(
        np.ascontiguousarray(around), np.ascontiguousarray(template), cv2.TM_CCOEFF_NORMED
    )
    row, col = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    if likeness[row, col] < _ALIKE:
        return None
    fine = np.array([_vertex(likeness[row, :], int(col)), _vertex(likeness[:, col], int(row))])
    return fine + [left + half - x, top + half - y]


def _vertex(values: npt.NDArray[Any], peak: int) -> float:
    """Return the place of a maximum to a fraction of a sample, by a parabola through its neighbours."""
    if not 0 < peak < len(values) - 1:
        return float(peak)
    before, top, after = (float(v) for v in values[peak - 1 : peak + 2])
    bend = before - 2 * top + after
    return peak + (0.5 * (before - after) / bend if bend < 0 else 0.0)
