"""Find the corner marks of a white board without a click: saddle points that fit the board's drawing."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._fit import Drawing, fit_drawing, softened
from slkit.geometry import transformed
from slkit.targets import BorderMarks, CornerMarks

Points = npt.NDArray[np.float64]

_SCALES = (1.5, 3.0, 6.0)
_CANDIDATES = 22
_SPARE = 8
"""Candidates beyond the marks themselves."""
_WEAKEST = 0.3
_DARK = 8.0
"""Grey level of the stretched picture below which darkness is not told apart."""
_MIN_CONTRAST = 0.3
"""Smallest difference between a mark's white and black cells, as a share of the white."""
# Places of a mark in cells. They reach near the outline, so that a mark stretched by a wrong homography fails.
_BLACK = np.array([[s * x, s * y] for s in (-1, 1) for x, y in ((0.5, 0.5), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75))])
_WHITE = _BLACK * [1, -1]
_BENT = 2.0
"""How far in cells a mark may lie from where the homography of the first four puts it."""
_DRAWING = Drawing(np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0]), np.eye(2), reach=1.35)
"""A mark in cells, and a rim of white."""
_AROUND = np.array([[s * x, t * y] for s in (-1, 1) for t in (-1, 1) for x, y in ((1.4, 0.5), (0.5, 1.4))])


def find_marks(image: npt.NDArray[np.uint8], target: CornerMarks | BorderMarks) -> Points | None:
    """Return the centres (n, 2) px of the marks in the order of `target.points()`, or None where they are not all seen.

    image: 8-bit grey (h, w). Saddle points of the grey levels are candidates; every four of them propose a homography
    of the board, and the one under which all marks have their black cells in place, white around them, is taken. Each
    mark's drawing is then fitted to its picture. A board whose marks look alike when turned by 180 degrees is taken
    upright: its plane is the same.
    """
    smooth = np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0), dtype=np.float32)
    points = target.points()
    candidates = _saddles(image, max(_CANDIDATES, len(points) + _SPARE))
    quads = _quads(candidates)
    if not len(quads):
        return None
    proposals = _homographies(quads, points[:4])
    score = _scores(smooth, proposals, points[:4], target.cell_mm, 0.0)
    proposals = proposals[score > _MIN_CONTRAST]
    if not len(proposals):
        return None
    shifts = _shifts(candidates, proposals, points, target.cell_mm)
    score = _scores(smooth, proposals, points, target.cell_mm, shifts)
    # A small bonus for the upright order decides between two that fit equally well.
    best = int(np.argmax(score * (1 + 1e-3 * _uprightness(proposals, points[:4]))))
    if score[best] <= _MIN_CONTRAST:
        return None
    return _refined(image, proposals[best], points, target.cell_mm, shifts[best])


def _saddles(image: npt.NDArray[np.uint8], most: int) -> Points:
    """Return the `most` strongest saddle points (k, 2) px over several scales, each once, strongest first."""
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
        order = np.argsort(-strength)[: 4 * most]
        found += [(float(strength[i]), float(cols[i]), float(rows[i])) for i in order]
    kept: list[tuple[float, float, float]] = []
    for strength, x, y in sorted(found, reverse=True):
        # Four marks of one board look much alike: what is far weaker than the fourth strongest is noise.
        if len(kept) == most or (len(kept) >= 4 and strength < _WEAKEST * kept[3][0]):
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


def _quads(candidates: Points) -> Points:
    """Return every four points (m, 4, 2) px that are convex, clockwise as seen in the picture, from each start."""
    count = len(candidates)
    fours = np.array(list(combinations(range(count), 4)), dtype=np.intp).reshape(-1, 4)
    quads = candidates[fours]
    away = quads - quads.mean(axis=1, keepdims=True)
    around = np.argsort(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    quads = np.take_along_axis(quads, around[..., None], axis=1)
    sides = np.roll(quads, -1, axis=1) - quads
    after = np.roll(sides, -1, axis=1)
    turns = sides[..., 0] * after[..., 1] - sides[..., 1] * after[..., 0]
    lengths = np.linalg.norm(sides, axis=2)
    convex = (turns > 0.05 * lengths * np.roll(lengths, -1, axis=1)).all(axis=1)
    return np.concatenate([np.roll(quads[convex], turn, axis=1) for turn in range(4)])


def _homographies(quads: Points, corners: Points) -> Points:
    """Return the homographies (m, 3, 3) that take board points (4, 2) mm to quads (m, 4, 2) px."""
    # Lengths of the order of 1 keep the equations well conditioned.
    scale = np.abs(corners).max()
    x, y = corners.T / scale
    zero, one = np.zeros(4), np.ones(4)
    u, v = quads[..., 0], quads[..., 1]
    rows = np.zeros((len(quads), 8, 8))
    rows[:, :4, :6] = np.stack([x, y, one, zero, zero, zero], axis=1)
    rows[:, 4:, :6] = np.stack([zero, zero, zero, x, y, one], axis=1)
    rows[:, :4, 6], rows[:, :4, 7] = -u * x, -u * y
    rows[:, 4:, 6], rows[:, 4:, 7] = -v * x, -v * y
    found = np.linalg.solve(rows, np.concatenate([u, v], axis=1)[..., None])[..., 0]
    matrix = np.concatenate([found, np.ones((len(quads), 1))], axis=1).reshape(-1, 3, 3)
    return np.asarray(matrix @ np.diag([1 / scale, 1 / scale, 1.0]), dtype=np.float64)


def _shifts(candidates: Points, homographies: Points, centers: Points, cell_mm: float) -> Points:
    """Return how far (m, n, 2) in px each mark lies from where a homography of the first four puts it.

    A lens bends the rows between them; the nearest candidate tells, if one lies within reach. NaN where none does.
    """
    predicted = transformed(homographies, centers)
    beside = transformed(homographies, centers + [cell_mm, 0.0])
    reach = _BENT * np.linalg.norm(beside - predicted, axis=2)
    away = candidates - predicted[:, :, None]
    distance = np.linalg.norm(away, axis=3)
    nearest = distance.argmin(axis=2)[..., None]
    shifts = np.take_along_axis(away, nearest[..., None], axis=2)[:, :, 0]
    shifts[np.take_along_axis(distance, nearest, axis=2)[..., 0] > reach] = np.nan
    return shifts


def _scores(
    smooth: npt.NDArray[np.float32], homographies: Points, centers: Points, cell_mm: float, shifts: Points | float
) -> Points:
    """Return for each proposed homography (m,) the smallest contrast of a mark; 0 where one is not as drawn.

    shifts (m, n, 2): from where the homography puts each mark to where it is looked for, in px.
    """
    places = centers[:, None] + np.concatenate([_BLACK, _WHITE, _AROUND])[None] * cell_mm
    seen = transformed(homographies, places.reshape(-1, 2)).reshape(len(homographies), *places.shape)
    values = _sample(smooth, seen + np.expand_dims(shifts, 2) if np.ndim(shifts) else seen)
    dark, bright, around = np.split(values, [len(_BLACK), len(_BLACK) + len(_WHITE)], axis=2)
    # White paper must surround a mark; where the picture ends there it cannot be asked for.
    paper = np.minimum(bright.min(axis=2), np.where(np.isnan(around), np.inf, around).min(axis=2))
    score = ((paper - dark.max(axis=2)) / np.maximum(bright.max(axis=2), 1)).min(axis=1)
    return np.nan_to_num(score.astype(np.float64), nan=0.0)


def _sample(smooth: npt.NDArray[np.float32], points: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Return grey levels at points (..., 2) px, NaN outside the picture."""
    height, width = smooth.shape
    x, y = points[..., 0], points[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    cols = np.rint(np.where(inside, x, 0)).astype(np.intp)
    rows = np.rint(np.where(inside, y, 0)).astype(np.intp)
    return np.where(inside, smooth[rows, cols], np.float32(np.nan)).astype(np.float32)


def _uprightness(homographies: Points, corners: Points) -> Points:
    points = transformed(homographies, corners)
    right, down = points[:, 1] - points[:, 0], points[:, 3] - points[:, 0]
    return right[:, 0] / np.linalg.norm(right, axis=1) + down[:, 1] / np.linalg.norm(down, axis=1)


def _refined(
    image: npt.NDArray[np.uint8], homography: Points, centers: Points, cell_mm: float, shifts: Points
) -> Points | None:
    """Return the marks (n, 2) px where their drawing fits their picture best, or None where one does not fit."""
    soft = softened(image)
    places: list[Points] = []
    for (x, y), (dx, dy) in zip(centers, shifts, strict=True):
        start = homography @ np.array([[cell_mm, 0, x], [0, cell_mm, y], [0, 0, 1]])
        found = fit_drawing(soft, _DRAWING, np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]]) @ start)
        if found is None:
            return None
        places.append(found[:2, 2] / found[2, 2])
    return np.array(places)
