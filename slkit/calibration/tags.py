"""Find ChArUco boards and numbered tags in pictures, to a few hundredths of a pixel, whole or in part."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._fit import Drawing, fit_drawing, softened
from slkit.calibration.detect import Corners, fit_corners
from slkit.targets import AprilTags, Charuco, ProjectedCharuco, TagMarks, dictionary, markers

Array = npt.NDArray[np.float64]

_FEWEST_CORNERS = 6
_RIM = 0.8
"""White around a tag that is fitted too, in cells of the tag."""
_OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def find_charuco(image: npt.NDArray[np.uint8], target: Charuco | ProjectedCharuco) -> Corners | None:
    """Return the inner corners (ny, nx, 2) px of a ChArUco board in the board's order, or None below six.

    image: 8-bit grey (h, w). NaN for a corner that was not seen; the markers next to a corner say which one it is.
    """
    square, marker = _sides(target)
    board = cv2.aruco.CharucoBoard(target.squares, 1.0, marker / square, dictionary(target.dictionary))
    # OpenCV gives None where it finds nothing, which its stubs do not say.
    found: Any
    ids: Any
    found, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    if found is None or len(found) < _FEWEST_CORNERS:
        return None
    nx, ny = target.corners
    corners = np.full((nx * ny, 2), np.nan)
    corners[np.ravel(ids)] = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    # The neighbourhood of a corner must not reach the markers in the white squares.
    reach = 0.9 * (square - marker) / (2 * square)
    return fit_corners(image, corners.reshape(ny, nx, 2), reach)


def find_tags(image: npt.NDArray[np.uint8], target: AprilTags | TagMarks) -> Array | None:
    """Return the corners (4 n, 2) px of numbered tags in the order of `target.points()`, or None where none is seen.

    image: 8-bit grey (h, w). NaN for the corners of a tag that was not seen, or of a number that was seen twice. The
    drawing of each tag is fitted to its picture.
    """
    ids: Any
    quads, ids, _ = cv2.aruco.ArucoDetector(dictionary(target.dictionary)).detectMarkers(image)
    count = len(target.centers())
    bits = markers(target.dictionary, count)
    corners = np.full((count, 4, 2), np.nan)
    soft = softened(image)
    numbers: list[int] = [] if ids is None else np.ravel(ids).tolist()
    for number, quad in zip(numbers, quads, strict=True):
        if number < count and numbers.count(number) == 1:
            corners[number] = _fitted(soft, np.asarray(quad, dtype=np.float32).reshape(4, 2), bits[number])
    return corners.reshape(-1, 2) if np.isfinite(corners).any() else None


def _fitted(soft: npt.NDArray[np.float32], quad: npt.NDArray[np.float32], bits: Array) -> Array:
    """Return the corners (4, 2) px of a tag, NaN where its drawing does not fit. bits (n, n): 1 is black."""
    count = len(bits)
    lines = np.linspace(-0.5, 0.5, count + 1)
    drawing = Drawing(lines, lines, bits, reach=0.5 + _RIM / count, perspective=True)
    start = np.asarray(cv2.getPerspectiveTransform(_OUTLINE.astype(np.float32), quad), dtype=np.float64)
    found = fit_drawing(soft, drawing, start)
    return np.full((4, 2), np.nan) if found is None else cv2.perspectiveTransform(_OUTLINE[None], found)[0]


def _sides(target: Charuco | ProjectedCharuco) -> tuple[float, float]:
    if isinstance(target, Charuco):
        return target.square_mm, target.marker_mm
    return target.step_px, target.marker_px
