"""Find checkerboards in pictures, to a few hundredths of a pixel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._fit import Drawing, fit_drawing, softened
from slkit.data import Image, describe_image
from slkit.targets import grid

Singles = npt.NDArray[np.float32]
Corners = npt.NDArray[np.float64]
"""Inner corners as they lie on the board, (ny, nx, 2) camera px; NaN for a corner that was not found."""

WHOLE_REACH = 0.4
"""How much of plain squares is fitted; their far corners must stay outside."""
_MISFIT = 0.15
"""A corner further than this share of the local spacing from where its neighbours put it is not a corner."""
_NEAR_PX, _NEAR = 1.0, 0.03
"""How far, in px or as a share of the spacing, a fitted corner may lie from where gradients put it."""
_LOST_SHARE = 0.1
"""A board with a larger share of such corners was not found."""


def grey(picture: Image) -> Singles:
    """Return a picture (h, w) or (h, w, 3) as grey levels (h, w), the mean of its colours."""
    return picture.astype(np.float32) if picture.ndim == 2 else picture.mean(axis=2, dtype=np.float32)


def to_8bit(image: Image) -> npt.NDArray[np.uint8]:
    """Return a picture (h, w) or (h, w, 3) as 8-bit grey (h, w), its range stretched to full contrast."""
    levels = grey(image)
    # The ink of four small marks is less than a hundredth of the picture, and must not be cut off.
    low, high = np.percentile(levels, (0.01, 99.9))
    return np.clip((levels - low) * (255 / max(float(high - low), 1.0)), 0, 255).astype(np.uint8)


def picture_size(picture: Image) -> tuple[int, int]:
    """Return width and height in px."""
    return picture.shape[1], picture.shape[0]


def usual_size(pictures: Sequence[Image]) -> tuple[int, int]:
    """Return width and height in px that most pictures have, the first of those that do; (1, 1) without pictures."""
    sizes = Counter(picture_size(p) for p in pictures)
    return sizes.most_common(1)[0][0] if sizes else (1, 1)


def wrong_size(picture: Image, size: tuple[int, int]) -> str:
    """Return why a picture cannot go with others of size (w, h)."""
    return f"its picture is {describe_image(picture)}, most are {size[0]} x {size[1]} px"


def homography(start: npt.ArrayLike, end: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the homography (3, 3) that takes points (n, 2), n >= 4, to others (n, 2) best, NaN where there is none."""
    matrix: Any = cv2.findHomography(np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64))[0]
    return np.full((3, 3), np.nan) if matrix is None else np.asarray(matrix, dtype=np.float64)


def find_checkerboard(
    image: npt.NDArray[np.uint8], corners: tuple[int, int], reach: float = WHOLE_REACH
) -> Corners | None:
    """Return the inner corners (ny, nx, 2) px of a checkerboard in an 8-bit grey picture, or None.

    corners: inner corners, x then y. The order is the board's own, whose first square is black; of a board that looks
    the same when it is turned the upright one. Two detectors are asked; then the drawing of four squares that
    meet is fitted to the picture around each corner. reach: how much of each square is fitted, as a share of its side.
    """
    for found in _detections(image, corners):
        refined = _refine(image, found.reshape(corners[1], corners[0], 2))
        misfit = _misfit(refined)
        refined[~(misfit < _MISFIT)] = np.nan
        if np.isnan(refined[..., 0]).mean() <= _LOST_SHARE:
            return fit_corners(image, _in_order(image, refined, corners), reach)
    return None


def _in_order(image: npt.NDArray[np.uint8], found: Corners, corners: tuple[int, int]) -> Corners:
    """Return corners in the board's order: not mirrored, the square before the first one black, else upright."""
    variants = [v for v in symmetries(found) if v.shape[:2] == corners[::-1] and unmirrored(v)]
    return max(variants, key=lambda v: (_first_is_black(image, v), uprightness(v)), default=found)


def _first_is_black(image: npt.NDArray[np.uint8], found: Corners) -> bool:
    """Tell whether the squares between corners are dark where column + row is even."""
    middle = (found[:-1, :-1] + found[1:, :-1] + found[:-1, 1:] + found[1:, 1:]) / 4
    seen = np.isfinite(middle).all(axis=2)
    cols, rows = np.rint(middle[seen]).astype(np.intp).T
    levels = image[np.clip(rows, 0, image.shape[0] - 1), np.clip(cols, 0, image.shape[1] - 1)].astype(np.float64)
    even = (np.indices(seen.shape).sum(axis=0) % 2 == 0)[seen]
    return bool(levels[even].mean() < levels[~even].mean()) if even.any() and not even.all() else True


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


def fit_corners(image: npt.NDArray[np.uint8], corners: Corners, reach: float) -> Corners:
    """Return corners (ny, nx, 2) px moved to where four blurred squares that meet fit the picture best.

    corners: a start, good to half a pixel, NaN where there is none; kept where nothing fits. reach: how much of each
    square is compared, as a share of its side.
    """
    ny, nx = corners.shape[:2]
    seen = np.isfinite(corners).all(axis=2)
    matrix = homography(grid((nx, ny)).reshape(ny, nx, 2)[seen], corners[seen])
    result = corners.copy()
    if np.isnan(matrix).any():
        return result
    far = np.array([-9.0, 0.0, 9.0])
    drawing = Drawing(far, far, np.eye(2), reach)
    soft, spacing = softened(image), spacing_of(corners)
    for row, col in np.argwhere(seen):
        # The homography of the board tells the shape of the squares; the lens may have moved them together.
        start = matrix @ np.array([[1.0, 0, col], [0, 1.0, row], [0, 0, 1.0]])
        away = corners[row, col] - start[:2, 2] / start[2, 2]
        found = fit_drawing(soft, drawing, np.array([[1, 0, away[0]], [0, 1, away[1]], [0, 0, 1]]) @ start)
        near = max(_NEAR_PX, _NEAR * spacing[row, col])
        if found is not None and np.linalg.norm(found[:2, 2] - corners[row, col]) < near:
            result[row, col] = found[:2, 2]
    return result


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


def symmetries(corners: Corners) -> list[Corners]:
    """Return the eight orders in which a grid of corners can be read."""
    turned = [corners, corners[::-1], corners[:, ::-1], corners[::-1, ::-1]]
    return turned + [v.transpose(1, 0, 2) for v in turned]


def _directions(corners: Corners) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    return np.nanmean(np.diff(corners, axis=1), axis=(0, 1)), np.nanmean(np.diff(corners, axis=0), axis=(0, 1))


def unmirrored(corners: Corners) -> bool:
    """Tell whether rows follow columns clockwise in the picture, as on the board."""
    x, y = _directions(corners)
    return bool(x[0] * y[1] - x[1] * y[0] > 0)


def uprightness(corners: Corners) -> float:
    """Return how well columns point right and rows down, 2 at best."""
    x, y = _directions(corners)
    return float(x[0] / np.linalg.norm(x) + y[1] / np.linalg.norm(y))
