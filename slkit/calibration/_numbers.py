"""Whether the numbers of calibration.toml are those of the boards in the pictures: corners and marks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import Singles, grey, homography
from slkit.data import Finding, Image
from slkit.geometry import Floats, transformed

_REACH = 2
"""How many corners too few or too many are searched for."""
_CONTINUES = 0.6
_RING = 0.3
_OFF = 0.06
"""A mark whose cells differ from what the marks' distances say by a larger share is not the one described."""


def count_corners(pictures: Sequence[npt.NDArray[np.uint8]], told: tuple[int, int]) -> tuple[int, int] | None:
    """Return the number of inner corners near `told` of a board that all pictures (8 bits) show, or None.

    The largest number comes first: OpenCV often finds a part of a board, but never more than there is.
    """
    steps = range(-_REACH, _REACH + 1)
    counts = {(told[0] + dx, told[1] + dy) for dx in steps for dy in steps}
    for count in sorted(counts, key=lambda c: (-c[0] * c[1], c)):
        if min(count) >= 3 and all(_holds(picture, count) for picture in pictures):
            return count
    return None


def _holds(picture: npt.NDArray[np.uint8], count: tuple[int, int]) -> bool:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    return bool(cv2.findChessboardCorners(picture, count, flags=flags)[0])


def continues(picture: Image, camera_xy: Floats, grid_xy: Floats) -> bool:
    """Tell whether a checkerboard goes on beyond the corners that were found.

    camera_xy (n, 2) px; grid_xy (n, 2): which corner each is, in steps of one.
    """
    if len(camera_xy) < 9:
        return False
    levels: Any = cv2.GaussianBlur(grey(picture), (0, 0), 0.7)
    matrix = homography(grid_xy, camera_xy)
    if np.isnan(matrix).any():
        return False
    low, high = grid_xy.min(axis=0), grid_xy.max(axis=0)
    for axis in (0, 1):
        along = np.arange(low[1 - axis], high[1 - axis] + 1)
        for outside, step in ((low[axis] - 1, -1.0), (high[axis] + 1, 1.0)):
            line = np.full((len(along), 2), outside)
            line[:, 1 - axis] = along
            if np.mean([_is_corner(levels, matrix, place, axis, step) for place in line]) > _CONTINUES:
                return True
    return False


def _is_corner(levels: Singles, matrix: Floats, place: Floats, axis: int, step: float) -> bool:
    """Tell whether grey levels around a corner (column, row) of the grid alternate twice from bright to dark."""
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False) + np.pi / 16
    ring = place + _RING * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    values = _sampled(levels, matrix, ring)
    if (values < 0).any():
        return False
    inner = place.copy()
    inner[axis] -= step
    known = _sampled(levels, matrix, inner + _RING * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    signs = values > (values.min() + values.max()) / 2
    return bool((signs != np.roll(signs, 1)).sum() == 4 and np.ptp(values) > 0.5 * np.ptp(known))


def _sampled(levels: Singles, matrix: Floats, places: Floats) -> Singles:
    """Return the grey levels at places (n, 2) of a plane that a homography carries to pixels, -1 outside."""
    at = transformed(matrix, places).astype(np.float32)
    values: Any = cv2.remap(levels, at[:, :1], at[:, 1:], cv2.INTER_LINEAR, borderValue=(-1.0,))
    return values.ravel()


def corners_finding(there: tuple[int, int] | None, told: tuple[int, int], key: str) -> list[Finding]:
    """Return that a checkerboard has not the number of corners that calibration.toml says.

    there: what `count_corners` says; key: the table of calibration.toml.
    """
    if there is None or there in (told, told[::-1]):
        return []
    fault = f"the checkerboard has {there[0]} x {there[1]} inner corners, not {told[0]} x {told[1]}"
    remedy = f"count the inner corners again and correct corners under [{key}] in calibration.toml"
    return [Finding(fault, "", remedy, "wrong-corners")]


def cell_ratio(white: Image, marks: Floats, xy_mm: Floats, cell_mm: float) -> float:
    """Return how many times larger the cells of the marks are than their told size at the told distances, or NaN.

    marks (n, 2) px: where the marks at xy_mm (n, 2) are in a picture under white light; the median over all marks.
    """
    matrix = homography(xy_mm, marks)
    if np.isnan(matrix).any():
        return np.nan
    levels = grey(white)
    sizes = [_half_width(levels, matrix, center, cell_mm, turn) for center in xy_mm for turn in (False, True)]
    known = np.array([s for s in sizes if np.isfinite(s)])
    return float(np.median(known)) if len(known) >= len(xy_mm) else np.nan


def _half_width(levels: Singles, matrix: Floats, center: Floats, cell_mm: float, turn: bool) -> float:
    """Return half the width of a mark in cells: where rays through its two black cells leave them."""
    reach = np.arange(0.2, 3.2, 0.05)
    ends: list[float] = []
    for sign in (-1.0, 1.0):
        ray = sign * np.stack([reach, 0.5 * reach], axis=-1)[:, :: -1 if turn else 1]
        values = _sampled(levels, matrix, center + cell_mm * ray)
        # Beyond the paper it may be darker still.
        dark = int(np.argmin(np.where(values < 0, np.inf, values)[: len(values) // 4]))
        middle = (values[dark] + _plateau(values[dark:])) / 2
        above = np.flatnonzero(values[dark:] > middle)
        if not len(above) or above[0] == 0:
            return np.nan
        i = dark + int(above[0])
        ends.append(float(reach[i] - 0.05 * (values[i] - middle) / (values[i] - values[i - 1])))
    return float(np.mean(ends))


def _plateau(values: Singles) -> float:
    """Return the level that a ray first rises to from the dark: behind the mark's own paper it may be lit as well."""
    ahead = values[4:] < 1.08 * values[:-4]
    risen = (values[:-4] > 1.6 * values[0]) & (values[:-4] > values[0] + 5)
    level = np.flatnonzero(ahead & risen)
    return float(values[level[0] : level[0] + 9].max() if len(level) else values.max())


def marks_finding(ratios: Sequence[float]) -> list[Finding]:
    """Return that xy_mm and cell_mm contradict each other, from the `cell_ratio` of the views."""
    known = [r for r in ratios if np.isfinite(r)]
    ratio = float(np.median(known)) if known else 1.0
    if abs(np.log(ratio)) <= np.log(1 + _OFF):
        return []
    fault = (
        f"the cells of the marks are {ratio:.2f} times as large, beside the marks' distances, as calibration.toml says"
    )
    remedy = "measure the board and correct xy_mm or cell_mm under [marks] in calibration.toml"
    return [Finding(fault, "", remedy, "wrong-marks")]
