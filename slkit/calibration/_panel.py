"""Whether both sides of a board give it the same size: the outline of the panel, measured by what is printed on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._exposure import noise_of
from slkit.calibration.detect import Singles, grey, homography
from slkit.data import BoardView, Finding, Image
from slkit.geometry import Floats, Pinhole, homogeneous

_RAYS, _STEPS = 41, 600
_LOST = 0.3
"""An edge that a larger share of the rays does not find, or finds elsewhere, is no straight edge."""
_STRAIGHT = 0.012
_AGREE = 0.015
"""Sizes from several views that differ by less, as a share, are the panel's own and not the border of the light."""
_OFF = 0.03
_CLEAR = 6.0
"""Paper is brighter than the dark around it by so many times the noise."""
_INK = 0.1
_PAPERS = np.sqrt(2.0)
"""A sheet that is one size larger than the other is no mistake."""

Extent = tuple[float, float, float, float]


def panel_size(picture: Image, camera: Pinhole, view: BoardView, ink: Extent) -> Floats:
    """Return width and height (2,) of the panel in the mm of what is printed on it, NaN where an edge is not seen.

    view: the printed points in the picture; ink: x min, y min, x max, y max in mm of the print.
    """
    known = view.printed
    if known.sum() < 4:
        return np.full(2, np.nan)
    matrix = homography(view.board_xy[known], camera.normalize(view.camera_xy[known]))
    if np.isnan(matrix).any():
        return np.full(2, np.nan)
    low, high = np.array(ink[:2]), np.array(ink[2:])
    levels: Any = grey(picture)
    dark = _CLEAR * noise_of(levels)
    levels = cv2.GaussianBlur(levels, (0, 0), 1.2)
    reach = float((high - low).max())
    out, share = np.linspace(0, reach, _STEPS), np.linspace(0, 1, _RAYS)
    size = high - low
    for axis in (0, 1):
        along = low[1 - axis] + share * size[1 - axis]
        for start, sign in ((low, -1.0), (high, 1.0)):
            places = np.empty((_RAYS, _STEPS, 2))
            places[..., axis] = start[axis] + sign * out
            places[..., 1 - axis] = along[:, None]
            seen = camera.project(homogeneous(places) @ matrix.T)
            x, y = np.moveaxis(seen, -1, 0).astype(np.float32)
            values: Any = cv2.remap(levels, x, y, cv2.INTER_LINEAR, borderValue=(-1.0,))
            size[axis] += _edge(values, out, along, dark)
    return size


def _edge(values: Singles, out: Floats, along: Floats, dark: float) -> float:
    """Return how far out in mm a straight fall from bright to dark lies, NaN where there is none.

    values (rays, steps): grey levels, -1 outside the picture; out (steps,) and along (rays,): their places in mm;
    dark: level below which nothing is seen.
    """
    # Paper may fall from the projector's light into the dark before its own edge.
    first = _falls(values, np.zeros(len(along), dtype=np.intp), dark)
    again = _falls(values, first, dark)
    return next(
        (at for fall in (first, np.where(again > 0, again, first)) if (at := _middle(fall, out, along))), np.nan
    )


def _falls(values: Singles, after: npt.NDArray[np.intp], dark: float) -> npt.NDArray[np.intp]:
    """Return the step (rays,) at which rays fall to half of their brightest, beyond given steps; 0 where none does.

    values (rays, steps): grey levels, -1 outside the picture.
    """
    gap = values.shape[1] // 40
    start = np.where(after > 0, after + gap, 0)
    behind = np.arange(values.shape[1]) >= start[:, None]
    brightest = np.maximum.accumulate(np.where(behind, values, 0), axis=1)
    # Ink is darker than this; paper that only the room lights is not.
    least = max(dark, _INK * float(np.percentile(values[:, :gap], 80)))
    fallen = behind & (values >= 0) & (values < 0.5 * brightest) & (brightest > least)
    return np.where(fallen.any(axis=1), fallen.argmax(axis=1), 0)


def _middle(fall: npt.NDArray[np.intp], out: Floats, along: Floats) -> float:
    """Return the place of a straight edge on the middle ray, 0 where the falls of the rays lie on none."""
    found = fall > 0
    if found.mean() < 1 - _LOST:
        return 0.0
    from scipy.stats import theilslopes

    line: Any = theilslopes(out[fall[found]], along[found])
    slope, start = float(line[0]), float(line[1])
    straight = np.abs(out[fall[found]] - start - slope * along[found]) < _STRAIGHT * out[-1]
    return start + slope * float(along.mean()) if straight.sum() >= (1 - _LOST) * len(along) else 0.0


def panel_finding(side_a: Sequence[Floats], side_b: Sequence[Floats]) -> list[Finding]:
    """Return that square_mm and xy_mm give the panel two sizes, from the `panel_size` of the views of each side."""
    a, b = (np.array([_agreed([s[axis] for s in side]) for axis in (0, 1)]) for side in (side_a, side_b))
    every = np.abs(np.log(a[:, None] / b))
    same = np.log(a / b)[np.isfinite(a / b)]
    # A side of the same length, be it turned, or sides of another shape: the numbers agree, or there are two sheets.
    if not len(same) or np.nanmin(every) < np.log(1 + _OFF) or np.ptp(same) > 2 * _AGREE:
        return []
    off = float(np.exp(same.mean()))
    if abs(abs(same.mean()) - np.log(_PAPERS)) < _AGREE:
        return []
    fault = (
        f"by square_mm the board is {_in_mm(a)} large, by xy_mm of its other side {_in_mm(b)}: "
        f"square_mm is {off:.2f} times what it should be, or the marks' distances are wrong"
    )
    remedy = "measure ten squares, and the marks from centre to centre, and correct square_mm or xy_mm"
    return [Finding(fault, "", remedy, "wrong-square")]


def _in_mm(size: Floats) -> str:
    """Return width and height in words; "?" for one that is not known."""
    return " x ".join(f"{length:.0f}" if np.isfinite(length) else "?" for length in size) + " mm"


def _agreed(values: Sequence[float]) -> float:
    """Return the middle of the largest group of values that agree, the larger one of two; NaN below two."""
    known = np.sort([v for v in values if np.isfinite(v)])
    groups = [known[(known >= v) & (known <= v * (1 + _AGREE))] for v in known]
    best = max(groups, key=lambda g: (len(g), g[0]), default=known)
    return float(np.median(best)) if len(best) > 1 else np.nan
