"""The local-homography method: coded light on a printed checkerboard.

Source: Moreno and Taubin, Simple, accurate, and robust projector-camera calibration (2012): around every printed
corner a homography from camera to projector pixels carries the corner over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration import solve
from slkit.calibration.detect import (
    Corners,
    find_checkerboard,
    picture_size,
    spacing_of,
    to_8bit,
    usual_size,
    wrong_size,
)
from slkit.calibration.estimate import estimate
from slkit.calibration.model import Model
from slkit.data import BoardView, Calibration, Capture, Correspondences
from slkit.errors import CalibrationError, InputError
from slkit.geometry import as_size
from slkit.targets import Checkerboard

_FEWEST_PIXELS = 30
_FEWEST_CORNERS = 12
_OUTLIER_SIGMAS = 4.0


@dataclass(frozen=True)
class LocalHomography:
    """Calibrate from a printed checkerboard under coded light, camera and projector refined together.

    projector: size (w, h) px; printed: the checkerboard; window: half side of the neighbourhood whose decoded pixels
    carry a corner over, in squares of the board; model: what is estimated.
    Errors: InputError for values that cannot be.
    """

    projector: tuple[int, int]
    printed: Checkerboard
    window: float = 0.5
    model: Model = field(default_factory=Model)

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")
        if not 0.1 <= self.window <= 2:
            raise InputError(f"window must lie between 0.1 and 2 squares, not {self.window}")

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed corners with the projector pixels that light them.

        A capture without a board, or whose code is silent around most corners, becomes a view that says so.
        """
        size = usual_size([c.lit for c in captures if c.lit is not None])
        return [self._observe(capture, size) for capture in captures]

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig that fits all printed corners in camera and projector best, each weighted by its own scatter.

        Errors: CalibrationError for fewer than two usable views, or views that do not determine the rig.
        """
        used = [v for v in views if v.problem is None]
        if len(used) < 2:
            raise CalibrationError(f"{len(used)} usable views of the board, but at least two are needed")
        camera, poses = solve.calibrate_camera(used, used[0].image_size, self.model.camera)
        placed = {v.name: pose for v, pose in zip(used, poses, strict=True)}
        return estimate("local-homography", views, placed, camera, self.projector, self.model)

    def _observe(self, capture: Capture, size: tuple[int, int]) -> BoardView:
        if capture.lit is None or capture.correspondences is None:
            return BoardView.unusable(capture.name, size, "it holds no decoded light")
        if picture_size(capture.lit) != size:
            return BoardView.unusable(capture.name, size, wrong_size(capture.lit, size))
        nx, ny = self.printed.corners
        found = find_checkerboard(to_8bit(capture.lit), (nx, ny))
        if found is None:
            problem = f"no printed checkerboard with {nx} x {ny} inner corners was found"
            return BoardView.unusable(capture.name, size, problem)
        camera_xy = found.reshape(-1, 2)
        projector_xy, sigma = transfer(found, capture.correspondences, self.window)
        seen = np.isfinite(camera_xy).all(axis=1)
        lit = int(np.isfinite(projector_xy[seen]).all(axis=1).sum())
        if lit < _FEWEST_CORNERS:
            problem = f"the code was read around {lit} of {nx * ny} corners only: light the whole board"
            return BoardView.unusable(capture.name, size, problem)
        notes = (f"the code was read around {lit} of {nx * ny} corners",) if lit < nx * ny else ()
        board_xy = self.printed.points()
        return BoardView(
            capture.name, size, board_xy[seen], camera_xy[seen], projector_xy[seen], sigma[seen], notes=notes
        )


def transfer(
    corners: Corners, correspondences: Correspondences, window: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the projector pixels (n, 2) of camera corners (ny, nx, 2) px and their sigma (n, 2) px.

    window: half side of the neighbourhood in squares. NaN where too few pixels around a corner carry both codes.
    Source: Moreno and Taubin (2012), section 4.
    """
    coded = np.isfinite(correspondences.projector_xy).all(axis=1)
    camera_xy = correspondences.camera_xy[coded].astype(np.float64)
    projector_xy = correspondences.projector_xy[coded].astype(np.float64)
    sigma = correspondences.sigma[coded].astype(np.float64)
    order = np.argsort(camera_xy[:, 1], kind="stable")
    camera_xy, projector_xy, sigma = camera_xy[order], projector_xy[order], sigma[order]
    halves = window * spacing_of(corners).ravel()
    found = np.full((len(halves), 2), np.nan)
    spread = np.full((len(halves), 2), np.nan)
    for i, (corner, half) in enumerate(zip(corners.reshape(-1, 2), halves, strict=True)):
        if np.isnan(corner).any() or not np.isfinite(half):
            continue
        first, last = np.searchsorted(camera_xy[:, 1], [corner[1] - half, corner[1] + half])
        near = first + np.flatnonzero(np.abs(camera_xy[first:last, 0] - corner[0]) <= half)
        if len(near) >= _FEWEST_PIXELS:
            found[i], spread[i] = _carry(corner, camera_xy[near], projector_xy[near], sigma[near])
    return found, spread


def _carry(
    corner: npt.NDArray[np.float64],
    camera_xy: npt.NDArray[np.float64],
    projector_xy: npt.NDArray[np.float64],
    sigma: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the projector pixel (2,) of a corner and its sigma (2,) by a homography that leaves out outliers."""
    nothing = np.full(2, np.nan)
    threshold = _OUTLIER_SIGMAS * float(np.median(np.linalg.norm(sigma, axis=1)))
    local = camera_xy - corner
    matrix: Any
    matrix, inliers = cv2.findHomography(local, projector_xy, cv2.RANSAC, max(threshold, 0.1))
    if matrix is None or inliers.sum() < max(_FEWEST_PIXELS, len(local) // 2):
        return nothing, nothing
    kept = inliers.ravel().astype(bool)
    predicted = cv2.perspectiveTransform(local[kept][None], matrix)[0]
    error = np.sqrt(((predicted - projector_xy[kept]) ** 2).mean(axis=0))
    return cv2.perspectiveTransform(np.zeros((1, 1, 2)), matrix)[0, 0], error / np.sqrt(kept.sum())
