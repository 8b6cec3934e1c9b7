"""Find grids of discs in pictures: centres of gravity, freed from the bias of perspective."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import Corners, homography, symmetries, unmirrored, uprightness
from slkit.geometry import transformed
from slkit.targets import CircleGrid

Array = npt.NDArray[np.float64]

_SMALLEST_PX2 = 20.0
_WIDEST_RING = 1.5
"""Radius in disc radii up to which paper around a disc is looked at, unless the next disc is nearer."""
_MISFIT = 0.25
"""Largest distance of a centre from the homography of the grid, in radii: lenses bend a grid by much less."""
_ROUNDS = 4


def find_circles(image: npt.NDArray[np.uint8], target: CircleGrid) -> Array | None:
    """Return the centres (n, 2) px of the discs in the order of `target.points()`, or None where they are not all seen.

    image: 8-bit grey (h, w). The picture of a disc is an ellipse whose centre is not the picture of the disc's centre;
    the difference follows from the homography of the whole grid and is taken away. A grid that looks the same when it
    is turned is taken upright.
    """
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID if target.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    detector = _blob_detector(image)
    for more in (0, cv2.CALIB_CB_CLUSTERING):
        found, blobs = cv2.findCirclesGrid(image, target.circles, flags=flags | more, blobDetector=detector)
        nx, ny = target.circles
        ordered = _in_order(np.asarray(blobs, dtype=np.float64).reshape(ny, nx, 2), target) if found else None
        if ordered is not None:
            return _refined(image, ordered, target)
    return None


def ellipse_offset(matrix: Array, centers: Array, radius: float) -> Array:
    """Return by how much (n, 2) px the centre of a disc's picture lies from the picture of its centre.

    matrix (3, 3): homography from mm to px; centers (n, 2), radius: of the discs in mm.
    Source: Heikkila and Silven, A four-step camera calibration procedure (1997), section 3.
    """
    back = np.linalg.inv(matrix)
    x, y = centers.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    conic = np.stack([one, zero, -x, zero, one, -y, -x, -y, x * x + y * y - radius**2], axis=1).reshape(-1, 3, 3)
    seen = back.T @ conic @ back
    middle = np.linalg.solve(seen[:, :2, :2], -seen[:, :2, 2:])[..., 0]
    return middle - transformed(matrix, centers)


def _blob_detector(image: npt.NDArray[np.uint8]) -> Any:
    # OpenCV's own stubs leave this detector out.
    opencv: Any = cv2
    settings = opencv.SimpleBlobDetector_Params()
    settings.minArea, settings.maxArea = _SMALLEST_PX2, image.size / 9
    settings.minDistBetweenBlobs = 3.0
    return opencv.SimpleBlobDetector_create(settings)


def _in_order(found: Corners, target: CircleGrid) -> Array | None:
    """Return centres (n, 2) in the grid's order, or None where no order fits the grid."""
    fitting: list[Corners] = []
    for variant in symmetries(found):
        if variant.shape == found.shape and unmirrored(variant):
            seen = variant.reshape(-1, 2)
            matrix = homography(target.points(), seen)
            away = np.linalg.norm(transformed(matrix, target.points()) - seen, axis=1)
            if (away < _MISFIT * _radius_px(matrix, target)).all():
                fitting.append(variant)
    return max(fitting, key=uprightness).reshape(-1, 2) if fitting else None


def _refined(image: npt.NDArray[np.uint8], seen: Array, target: CircleGrid) -> Array:
    points, radius = target.points(), target.diameter_mm / 2
    apart = target.spacing_mm * (2**0.5 if target.asymmetric else 1)
    reach = min(_WIDEST_RING, apart / target.diameter_mm)
    for _ in range(_ROUNDS):
        matrix = homography(points, seen)
        offset = ellipse_offset(matrix, points, radius)
        shift = seen - transformed(matrix, points)
        middles = [_middle(image, matrix, p, s, radius, reach) for p, s in zip(points, shift, strict=True)]
        seen = np.array(middles) - offset
    return seen


def _middle(
    image: npt.NDArray[np.uint8], matrix: Array, center: Array, shift: Array, radius: float, reach: float
) -> Array:
    """Return the centre of gravity (2,) px of the darkness of one disc against a linear shade of the paper around it.

    shift (2,): how far in px the disc lies from where the homography puts it.
    """
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = transformed(matrix, center + reach * radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)) + shift
    low = np.maximum(np.floor(rim.min(axis=0)), 0).astype(np.intp)
    high = np.minimum(np.ceil(rim.max(axis=0)), np.array(image.shape[::-1]) - 1).astype(np.intp)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    back = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    away = np.linalg.norm(transformed(back, pixels - shift) - center, axis=1) / radius
    pixels, away = pixels[away <= reach], away[away <= reach]
    levels = image[pixels[:, 1].astype(np.intp), pixels[:, 0].astype(np.intp)].astype(np.float64)
    paper = away > (1 + reach) / 2
    middle = pixels.mean(axis=0)
    basis = np.column_stack([np.ones(len(pixels)), pixels - middle])
    shade = basis @ np.linalg.lstsq(basis[paper], levels[paper], rcond=None)[0]
    # As a share of the paper, so that a disc half in shadow keeps its middle.
    dark = 1 - levels / np.maximum(shade, 1)
    return (dark[:, None] * pixels).sum(axis=0) / dark.sum()


def _radius_px(matrix: Array, target: CircleGrid) -> Array:
    """Return the smaller radius (n,) px that each disc has in the picture."""
    points, radius = target.points(), target.diameter_mm / 2
    middle = transformed(matrix, points)
    across = [np.linalg.norm(transformed(matrix, points + np.eye(2)[k] * radius) - middle, axis=1) for k in (0, 1)]
    return np.minimum(*across)
