"""Find the corner marks of a white board without a click: saddle points that fit the board's drawing."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration.detect import sub_pixel
from slkit.targets import CornerMarks

Points = npt.NDArray[np.float64]

_SCALES = (1.5, 3.0, 6.0)
_CANDIDATES = 22
_WEAKEST = 0.3
_DARK = 8.0
"""Grey level of the stretched picture below which darkness is not told apart."""
_MIN_CONTRAST = 0.3
"""Smallest difference between a mark's white and black cells, as a share of the white."""
# Places of a mark in cells. They reach near the outline, so that a mark stretched by a wrong homography fails.
_BLACK = np.array([[s * x, s * y] for s in (-1, 1) for x, y in ((0.5, 0.5), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75))])
_WHITE = _BLACK * [1, -1]
_AROUND = np.array([[s * x, t * y] for s in (-1, 1) for t in (-1, 1) for x, y in ((1.4, 0.5), (0.5, 1.4))])


def find_marks(image: npt.NDArray[np.uint8], target: CornerMarks) -> Points | None:
    """Return the centres (n, 2) px of the marks in the order of `target.xy_mm`, or None where they are not all seen.

    image: 8-bit grey (h, w). Saddle points of the grey levels are candidates; every four of them propose a homography
    of the board, and the one under which all marks have their black cells in place, white around them, is taken.
    A board whose marks look alike when turned by 180 degrees is taken upright: its plane is the same.
    """
    smooth = np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0), dtype=np.float32)
    candidates = _saddles(image)
    if len(candidates) < 4:
        return None
    best, best_score = None, 0.0
    for four in combinations(range(len(candidates)), 4):
        quad = _clockwise(candidates[list(four)])
        if quad is None:
            continue
        for turn in range(4):
            proposal = _homography(target, np.roll(quad, turn, axis=0))
            score = _score(smooth, proposal, target)
            # A small bonus for the upright order decides between two that fit equally well.
            upright = 1 + 1e-3 * _uprightness(proposal, target)
            if score > _MIN_CONTRAST and score * upright > best_score:
                best, best_score = proposal, score * upright
    return None if best is None else _refine(image, best, target)


def _saddles(image: npt.NDArray[np.uint8]) -> Points:
    """Return the strongest saddle points (k, 2) px over several scales, each once, strongest first."""
    found: list[tuple[float, float, float]] = []
    grey = image.astype(np.float32)
    # Marks may lie beyond the projector's light, where only the room lights them: their ratio counts, not their range.
    ratio = np.log(grey + np.float32(_DARK))
    for scale in _SCALES:
        smooth = cv2.GaussianBlur(ratio, (0, 0), scale)
        xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3) for order in ((2, 0), (0, 2), (1, 1)))
        saddle = np.maximum(xy * xy - xx * yy, 0) * np.float32(scale**4)
        size = 2 * int(2 * scale) + 1
        peaks = (saddle == cv2.dilate(saddle, np.ones((size, size), np.uint8))) & (saddle > 0)
        rows, cols = np.nonzero(peaks)
        strength = np.sqrt(saddle[rows, cols])
        order = np.argsort(-strength)[: 4 * _CANDIDATES]
        found += [(float(strength[i]), float(cols[i]), float(rows[i])) for i in order]
    kept: list[tuple[float, float, float]] = []
    for strength, x, y in sorted(found, reverse=True):
        # Four marks of one board look much alike: what is far weaker than the fourth strongest is noise.
        if len(kept) == _CANDIDATES or (len(kept) >= 4 and strength < _WEAKEST * kept[3][0]):
            break
        apart = all((x - a) ** 2 + (y - b) ** 2 > (2 * _SCALES[-1]) ** 2 for _, a, b in kept)
        if apart and _looks_like_saddle(grey, x, y):
            kept.append((strength, x, y))
    return np.array(kept, dtype=np.float64).reshape(-1, 3)[:, 1:]


def _looks_like_saddle(grey: npt.NDArray[np.float32], x: float, y: float) -> bool:
    """Tell whether grey levels around a point alternate twice from bright to dark, as around a 2 x 2 mark."""
    angles = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    for radius in (2.5, 4.0, 7.0):
        at = np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)]).astype(np.float32)
        ring = cv2.remap(grey, at[0][None], at[1][None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        low, high = np.percentile(ring, (10, 90))
        signs = ring > (low + high) / 2
        changes = int((signs != np.roll(signs, 1)).sum())
        if changes == 4 and high - low > _MIN_CONTRAST * max(float(high), 1.0):
            return True
    return False


def _clockwise(four: Points) -> Points | None:
    """Return four points in clockwise order as seen in the picture, or None where they are not convex."""
    center = four.mean(axis=0)
    quad = four[np.argsort(np.arctan2(four[:, 1] - center[1], four[:, 0] - center[0]))]
    sides = np.roll(quad, -1, axis=0) - quad
    turns = sides[:, 0] * np.roll(sides, -1, axis=0)[:, 1] - sides[:, 1] * np.roll(sides, -1, axis=0)[:, 0]
    lengths = np.linalg.norm(sides, axis=1)
    convex = (turns > 0.05 * lengths * np.roll(lengths, -1)).all()
    return quad if convex else None


def _homography(target: CornerMarks, quad: Points) -> npt.NDArray[np.float64]:
    matrix = cv2.getPerspectiveTransform(target.points()[:4].astype(np.float32), quad.astype(np.float32))
    return np.asarray(matrix, dtype=np.float64)


def _score(smooth: npt.NDArray[np.float32], homography: npt.NDArray[np.float64], target: CornerMarks) -> float:
    """Return the smallest contrast of a mark under a proposed homography; 0 where a mark is not as drawn."""
    places = target.points()[:, None] + np.concatenate([_BLACK, _WHITE, _AROUND])[None] * target.cell_mm
    values = _sample(smooth, np.asarray(cv2.perspectiveTransform(places, homography)))
    dark, bright, around = np.split(values, [len(_BLACK), len(_BLACK) + len(_WHITE)], axis=1)
    if np.isnan(dark).any() or np.isnan(bright).any():
        return 0.0
    # White paper must surround a mark; where the picture ends there it cannot be asked for.
    paper = np.minimum(bright.min(axis=1), np.where(np.isnan(around), np.inf, around).min(axis=1))
    return float(((paper - dark.max(axis=1)) / np.maximum(bright.max(axis=1), 1)).min())


def _sample(smooth: npt.NDArray[np.float32], points: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Return grey levels at points (..., 2) px, NaN outside the picture."""
    height, width = smooth.shape
    x, y = points[..., 0], points[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    cols = np.clip(np.rint(np.where(inside, x, 0)), 0, width - 1).astype(np.intp)
    rows = np.clip(np.rint(np.where(inside, y, 0)), 0, height - 1).astype(np.intp)
    return np.where(inside, smooth[rows, cols], np.float32(np.nan)).astype(np.float32)


def _uprightness(homography: npt.NDArray[np.float64], target: CornerMarks) -> float:
    points = cv2.perspectiveTransform(target.points()[None, :4], homography)[0]
    right, down = points[1] - points[0], points[3] - points[0]
    return float(right[0] / np.linalg.norm(right) + down[1] / np.linalg.norm(down))


def _refine(image: npt.NDArray[np.uint8], homography: npt.NDArray[np.float64], target: CornerMarks) -> Points:
    """Return the centres of all marks (n, 2) px where the gradients within each mark are orthogonal to the centre."""
    centers = target.points()
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * target.cell_mm
    points = np.empty_like(centers)
    for i, center in enumerate(centers):
        at = cv2.perspectiveTransform(center.reshape(1, 1, 2), homography)[0, 0]
        rim = cv2.perspectiveTransform((center + corners)[None], homography)[0]
        # The window stays inside the mark's own outline, whose edges would pull the result.
        reach = _distance_to_outline(at, rim)
        half = int(np.clip(0.6 * reach, 2, 25))
        points[i] = sub_pixel(image, at[None], half)[0]
    return points


def _distance_to_outline(point: Points, outline: Points) -> float:
    sides = np.roll(outline, -1, axis=0) - outline
    normals = np.stack([-sides[:, 1], sides[:, 0]], axis=1) / np.linalg.norm(sides, axis=1, keepdims=True)
    return float(np.abs(((point - outline) * normals).sum(axis=1)).min())
