"""Find projected patterns in pictures, corner by corner in the pattern's own order."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import Corners, find_checkerboard, grey, symmetries, to_8bit, unmirrored, uprightness
from slkit.calibration.tags import find_charuco
from slkit.data import Image
from slkit.targets import ORIGIN_MARK_RADIUS, ProjectedCharuco, ProjectedCheckerboard, grid

_REACH = 0.3
"""How much of each square is fitted, as a share of its side: origin marks stay outside."""
_MIRRORED = "the projected pattern is mirrored: switch off the projector's rear-projection setting"


def find_projected(
    pattern: Image, white: Image, target: ProjectedCheckerboard | ProjectedCharuco
) -> tuple[Corners, tuple[str, ...]] | str:
    """Return the projected corners (ny, nx, 2) px in the pattern's own order and notes, or why they were not found.

    pattern, white: pictures of one board pose under the pattern and under white light; their ratio is free of print and
    vignetting. NaN for a corner that was not found. Origin marks decide between the symmetries of a checkerboard; one
    without them is taken to be upright. Of a ChArUco pattern a part suffices.
    """
    ratio = _light_ratio(pattern, white)
    if isinstance(target, ProjectedCharuco):
        return _find_charuco(ratio, to_8bit(pattern), target)
    found = find_checkerboard(ratio, target.corners, _REACH)
    if found is None:
        found = find_checkerboard(to_8bit(pattern), target.corners, _REACH)
    if found is None:
        return "the projected checkerboard was not found: all of it must lie on the board, in focus, and be seen"
    return _order(ratio, found, target)


def _find_charuco(
    ratio: npt.NDArray[np.uint8], pattern: npt.NDArray[np.uint8], target: ProjectedCharuco
) -> tuple[Corners, tuple[str, ...]] | str:
    for picture in (ratio, pattern):
        found = find_charuco(picture, target)
        if found is not None:
            return found, ()
    if find_charuco(np.ascontiguousarray(ratio[:, ::-1]), target) is not None:
        return _MIRRORED
    return (
        "the projected ChArUco pattern was not found: six corners or more must lie on the board, in focus, and be seen"
    )


def _light_ratio(pattern: Image, white: Image) -> npt.NDArray[np.uint8]:
    top, seen = grey(white), grey(pattern)
    # Where the white light itself is weak the ratio is noise; a floor lets it fade to black instead.
    floor = 0.1 * float(np.percentile(top, 99))
    ratio = np.where(top > floor, seen / np.maximum(top, floor), seen / floor)
    return np.clip(230 * ratio, 0, 255).astype(np.uint8)


def _order(
    ratio: npt.NDArray[np.uint8], found: Corners, target: ProjectedCheckerboard
) -> tuple[Corners, tuple[str, ...]] | str:
    """Return `found` in the pattern's order: the symmetry whose colours and origin marks are the ones seen."""
    variants = [v for v in symmetries(found) if v.shape[:2] == (target.corners[1], target.corners[0])]
    scored = [(_disagreement(ratio, v, target), i) for i, v in enumerate(variants)]
    best = min(scored)[0]
    fitting = [variants[i] for score, i in scored if score <= best]
    if best > 0:
        return (
            "the origin marks of the projected checkerboard were not read: is this the pattern of calibration.toml?"
            if target.origin_marks
            else "the colours of the projected checkerboard are not those of first_color"
        )
    turns = [v for v in fitting if unmirrored(v)]
    if not turns:
        return _MIRRORED
    return max(turns, key=uprightness), _doubts(len(turns), len(fitting) - len(turns), bool(target.origin_marks))


def _doubts(turns: int, mirrored: int, marked: bool) -> tuple[str, ...]:
    """Return what the pattern leaves open: turns, mirrored: how many of its symmetries fit the picture."""
    doubts = [f"{turns} of its symmetries fit, the upright one was taken"] if turns > 1 else []
    doubts += ["its symmetries would hide a mirrored projection"] if mirrored else []
    what = "the origin marks of the pattern leave doubt" if marked else "the pattern has no origin marks"
    return (f"{what}: {'; '.join(doubts)}",) if doubts else ()


def _disagreement(ratio: npt.NDArray[np.uint8], corners: Corners, target: ProjectedCheckerboard) -> int:
    """Return how many squares between the corners differ in colour, or in carrying a mark, from the pattern."""
    ny, nx = corners.shape[:2]
    squares: list[list[int]] = grid((nx - 1, ny - 1)).astype(int).tolist()
    shades = np.array([_shades(ratio, corners, col, row) for col, row in squares])
    known = np.isfinite(shades).all(axis=1)
    rim, center = shades.T
    expected = np.array([target.square_color(col + 1, row + 1) for col, row in squares])
    marked = np.array([(col + 1, row + 1) in target.origin_marks for col, row in squares])
    middle = 0.5 * (np.median(rim[known & (expected > 0)]) + np.median(rim[known & (expected == 0)]))
    colors_differ = (rim > middle) != (expected > 0)
    # A centre is judged against its own rim, by half of the contrast between the two kinds of squares.
    contrast = np.abs(rim - middle)
    marks_differ = (np.abs(center - rim) > contrast) != marked
    weak_evidence = ~known | (colors_differ & ~marked)
    colors = int((known & colors_differ).sum())
    tolerated = max(len(squares) // 20, 1)
    marks = int((marks_differ & marked).sum()) + max(
        int((marks_differ & ~marked & ~weak_evidence).sum()) - tolerated, 0
    )
    return (marks if target.origin_marks else 0) + max(colors - tolerated, 0)


def _shades(ratio: npt.NDArray[np.uint8], corners: Corners, col: int, row: int) -> tuple[float, float]:
    """Return the median grey of the rim and of the centre of the square right below corner (col, row)."""
    quad = corners[row : row + 2, col : col + 2].reshape(4, 2)
    if np.isnan(quad).any():
        return np.nan, np.nan
    rim_at, center_at = 0.37, ORIGIN_MARK_RADIUS / 2
    ring = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=np.float64)
    places = np.concatenate([0.5 + rim_at * ring, 0.5 + center_at * ring])
    x, y = places.T
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
    points = (weights @ quad).astype(np.float32)
    values = cv2.remap(ratio, points[:, :1], points[:, 1:], cv2.INTER_LINEAR).ravel()
    return float(np.median(values[:8])), float(np.median(values[8:]))
