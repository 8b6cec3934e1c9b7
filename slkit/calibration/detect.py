"""Find printed and projected checkerboards in pictures, to a few hundredths of a pixel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.data import Image, describe_image
from slkit.targets import ORIGIN_MARK_RADIUS, ProjectedCheckerboard, grid

Corners = npt.NDArray[np.float64]
"""Inner corners as they lie on the board, (ny, nx, 2) camera px; NaN for a corner that was not found."""

_MISFIT = 0.15
"""A corner further than this share of the local spacing from where its neighbours put it is not a corner."""
_LOST_SHARE = 0.1
"""A board with a larger share of such corners was not found."""


def to_8bit(image: Image) -> npt.NDArray[np.uint8]:
    """Return a picture (h, w) or (h, w, 3) as 8-bit grey (h, w), its range stretched to full contrast."""
    grey = image.astype(np.float32) if image.ndim == 2 else image.mean(axis=2, dtype=np.float32)
    low, high = np.percentile(grey, (0.5, 99.5))
    return np.clip((grey - low) * (255 / max(float(high - low), 1.0)), 0, 255).astype(np.uint8)


def picture_size(picture: Image) -> tuple[int, int]:
    """Return width and height in px."""
    return picture.shape[1], picture.shape[0]


def wrong_size(picture: Image, size: tuple[int, int]) -> str:
    """Return why a picture cannot go with a first one of size (w, h)."""
    return f"its picture is {describe_image(picture)}, the first is {size[0]} x {size[1]} px"


def find_checkerboard(image: npt.NDArray[np.uint8], corners: tuple[int, int]) -> Corners | None:
    """Return the inner corners (ny, nx, 2) px of a checkerboard in an 8-bit grey picture, or None.

    corners: inner corners, x then y. The order may be turned or mirrored against the board's. Two detectors are
    asked; each corner is then the point to which the grey-level gradients around it are orthogonal.
    """
    for found in _detections(image, corners):
        refined = _refine(image, found.reshape(corners[1], corners[0], 2))
        misfit = _misfit(refined)
        refined[~(misfit < _MISFIT)] = np.nan
        if np.isnan(refined[..., 0]).mean() <= _LOST_SHARE:
            return refined
    return None


def _detections(image: npt.NDArray[np.uint8], corners: tuple[int, int]) -> Iterator[Corners]:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    # A large picture is searched at a reduced size first: adaptive thresholds fail on wide blurred edges.
    for step in (1, 2, 4):
        small = image if step == 1 else cv2.resize(image, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
        if min(small.shape) < 200 and step > 1:
            break
        found, points = cv2.findChessboardCorners(small, corners, flags=flags)
        if found:
            yield (points.reshape(-1, 2).astype(np.float64) + 0.5) * step - 0.5
    found, points = cv2.findChessboardCornersSB(image, corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if found:
        yield points.reshape(-1, 2).astype(np.float64)


def _refine(image: npt.NDArray[np.uint8], found: Corners) -> Corners:
    # The window must not reach the next corner, whatever the tilt: 0.3 of the shortest side of a square.
    half = int(np.clip(0.3 * spacing_of(found).min(), 2, 15))
    return sub_pixel(image, found.reshape(-1, 2), half).reshape(found.shape)


def sub_pixel(image: npt.NDArray[np.uint8], points: npt.NDArray[np.float64], half: int) -> npt.NDArray[np.float64]:
    """Return points (n, 2) px moved to where all grey-level gradients in a window of +- half px are orthogonal to them.

    cv2.cornerSubPix interpolates linearly, which pulls sharp corners towards whole pixels by up to 0.03 px; on a
    picture smoothed in proportion to the window that pull is gone, and so is part of the noise.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), float(np.clip(half / 8, 0.7, 2)))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = points.reshape(-1, 1, 2).astype(np.float32)
    found = cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), criteria)
    return found.reshape(-1, 2).astype(np.float64)


def spacing_of(corners: Corners) -> npt.NDArray[np.float64]:
    """Return for each corner (ny, nx) the distance in px to its nearest neighbour on the board."""
    along_x = np.linalg.norm(np.diff(corners, axis=1), axis=2)
    along_y = np.linalg.norm(np.diff(corners, axis=0), axis=2)
    pad = np.inf
    sides = (
        np.pad(along_x, ((0, 0), (0, 1)), constant_values=pad),
        np.pad(along_x, ((0, 0), (1, 0)), constant_values=pad),
        np.pad(along_y, ((0, 1), (0, 0)), constant_values=pad),
        np.pad(along_y, ((1, 0), (0, 0)), constant_values=pad),
    )
    return np.fmin.reduce(sides)


def _misfit(corners: Corners) -> npt.NDArray[np.float64]:
    """Return for each corner (ny, nx) its distance from where its neighbours put it, as a share of the spacing."""
    ny, nx = corners.shape[:2]
    places = grid((nx, ny)).reshape(ny, nx, 2)
    spacing = spacing_of(corners)
    result = np.full((ny, nx), np.inf)
    for row in range(ny):
        for col in range(nx):
            block = (slice(max(row - 2, 0), row + 3), slice(max(col - 2, 0), col + 3))
            around = (places[block] != places[row, col]).any(axis=2)
            matrix: Any
            matrix, _ = cv2.findHomography(places[block][around], corners[block][around], cv2.LMEDS)
            if matrix is not None:
                predicted = cv2.perspectiveTransform(places[row, col].reshape(1, 1, 2), matrix)[0, 0]
                result[row, col] = np.linalg.norm(predicted - corners[row, col]) / spacing[row, col]
    return result


def find_projected(
    pattern: Image, white: Image, target: ProjectedCheckerboard
) -> tuple[Corners, tuple[str, ...]] | str:
    """Return the projected corners (ny, nx, 2) px in the pattern's own order and notes, or why they were not found.

    pattern, white: pictures of one board pose under the checkerboard and under white light; their ratio is free of
    print and vignetting. Origin marks decide between the symmetries; a pattern without them is taken to be upright.
    """
    ratio = _light_ratio(pattern, white)
    found = find_checkerboard(ratio, target.corners)
    if found is None:
        found = find_checkerboard(to_8bit(pattern), target.corners)
    if found is None:
        return "the projected checkerboard was not found: all of it must lie on the board, in focus, and be seen"
    return _order(ratio, found, target)


def _light_ratio(pattern: Image, white: Image) -> npt.NDArray[np.uint8]:
    top = white.astype(np.float32) if white.ndim == 2 else white.mean(axis=2, dtype=np.float32)
    seen = pattern.astype(np.float32) if pattern.ndim == 2 else pattern.mean(axis=2, dtype=np.float32)
    # Where the white light itself is weak the ratio is noise; a floor lets it fade to black instead.
    floor = 0.1 * float(np.percentile(top, 99))
    ratio = np.where(top > floor, seen / np.maximum(top, floor), seen / floor)
    return np.clip(230 * ratio, 0, 255).astype(np.uint8)


def _order(
    ratio: npt.NDArray[np.uint8], found: Corners, target: ProjectedCheckerboard
) -> tuple[Corners, tuple[str, ...]] | str:
    """Return `found` in the pattern's order: the symmetry whose colours and origin marks are the ones seen."""
    variants = [v for v in _symmetries(found) if v.shape[:2] == (target.corners[1], target.corners[0])]
    scored = [(_disagreement(ratio, v, target), i) for i, v in enumerate(variants)]
    best = min(scored)[0]
    fitting = [variants[i] for score, i in scored if score <= best]
    if best > 0:
        return (
            "the origin marks of the projected checkerboard were not read: is this the pattern of calibration.toml?"
            if target.origin_marks
            else "the colours of the projected checkerboard are not those of first_color"
        )
    if len(fitting) == 1 and target.origin_marks:
        if not _unmirrored(fitting[0]):
            return "the projected checkerboard is mirrored: switch off the projector's rear-projection setting"
        return fitting[0], ()
    upright = max((v for v in fitting if _unmirrored(v)), key=_uprightness, default=None)
    if upright is None:
        return "the projected checkerboard is mirrored: switch off the projector's rear-projection setting"
    note = f"the pattern has no origin marks: {len(fitting)} of its symmetries fit, the upright one was taken"
    return upright, (note,) if len(fitting) > 1 else ()


def _symmetries(corners: Corners) -> list[Corners]:
    turned = [corners, corners[::-1], corners[:, ::-1], corners[::-1, ::-1]]
    return turned + [v.transpose(1, 0, 2) for v in turned]


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


def _directions(corners: Corners) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    return np.nanmean(np.diff(corners, axis=1), axis=(0, 1)), np.nanmean(np.diff(corners, axis=0), axis=(0, 1))


def _unmirrored(corners: Corners) -> bool:
    x, y = _directions(corners)
    return bool(x[0] * y[1] - x[1] * y[0] > 0)


def _uprightness(corners: Corners) -> float:
    x, y = _directions(corners)
    return float(x[0] / np.linalg.norm(x) + y[1] / np.linalg.norm(y))
