"""The corner-board method: a small checkerboard in one corner of a white plane gives the pose of the plane.

Source: Falcao, Hurtos and Massich, Plane-based calibration of a projector-camera system (2008), and the toolbox that
they released with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from slkit.calibration import solve
from slkit.calibration._observe import Printed, Projected
from slkit.calibration._parameters import Array, rms
from slkit.calibration._sequence import in_sequence
from slkit.calibration._two_sides import SIDES, Placed, observe_sides, place_sides
from slkit.calibration.estimate import assembled, estimate, points_of
from slkit.calibration.model import Model
from slkit.data import BoardView, Calibration, Capture
from slkit.geometry import Pinhole, Pose, Rig, as_size, flat
from slkit.targets import Checkerboard

_NAME = "corner-board"


@dataclass(frozen=True)
class CornerBoard:
    """Calibrate with a small printed checkerboard in one corner of a white plane.

    projector: size (w, h) px; printed: side A; corner_board: the small one on side B; projected: the pattern in the
    projector image. undistort: remove the camera's distortion from projected corners; extrinsics: `shared`, one pose
    of the projector for all views, or `first-view`, the projector calibrated by Zhang's method with a pose a view, of
    which the first is taken. model: what is estimated. The released toolbox is undistort = False and `first-view`;
    with either of them nothing is refined, whatever the model says. Errors: InputError for a projector that cannot be.
    """

    projector: tuple[int, int]
    printed: Printed
    corner_board: Checkerboard
    projected: Projected
    undistort: bool = True
    extrinsics: Literal["shared", "first-view"] = "shared"
    model: Model = field(default_factory=Model)

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed corners of side A, or the small board and projected corners of side B.

        A picture in which nothing is found, or of another size than most, becomes a view that says so.
        """
        return observe_sides(captures, self.printed, self.corner_board, self.projected)

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig: camera from side A by Zhang's method, poses from the small board, then the projector.

        Errors: CalibrationError for fewer than two views of a side, or views that do not determine the rig.
        """
        placed = place_sides(views, self.model.camera)
        if not self.undistort or self.extrinsics == "first-view":
            return self._as_released(placed)
        arguments = (placed.views, placed.poses, placed.camera, self.projector, self.model, placed.sides)
        return estimate(_NAME, *arguments, sides=SIDES)

    def _as_released(self, placed: Placed) -> Calibration:
        """Return the rig of the released steps; its rms_projector is the residual that they report themselves."""
        used = [v for v in placed.views if v.name in placed.poses]
        white = [v for v in used if placed.sides[v.name]]
        poses = [placed.poses[v.name] for v in white]
        lens = placed.camera if self.undistort else replace(placed.camera, distortion=np.zeros(5))
        points = [points_of(lens, pose, v)[v.projected] for v, pose in zip(white, poses, strict=True)]
        fit = self._first_view if self.extrinsics == "first-view" else self._shared
        projector, projector_from_camera, residuals = fit(white, poses, points)
        rig = Rig(placed.camera, projector, projector_from_camera)
        model = replace(self.model, refine=False)
        found = in_sequence(
            rig, [placed.poses[v.name] for v in used], used, model, [placed.sides[v.name] for v in used]
        )
        result = assembled(_NAME, placed.views, used, found, model)
        own = {v.name: rms(r) for v, r in zip(white, residuals, strict=True)}
        # A covariance belongs to a least-squares solution, which this is not.
        return replace(
            result,
            rig=rig,
            covariance=None,
            views=tuple(replace(v, rms_projector=own.get(v.name, v.rms_projector)) for v in result.views),
            rms_projector=rms(np.concatenate(residuals)),
            notes=(*result.notes, "the released method has no joint refinement: none was made"),
        )

    def _shared(
        self, white: Sequence[BoardView], poses: Sequence[Pose], points: Sequence[Array]
    ) -> tuple[Pinhole, Pose, Sequence[Array]]:
        """Return the projector, its pose, and the residuals (n, 2) px a view under that pose."""
        pixels = [v.projector_xy[v.projected] for v in white]
        fit = solve.solve_projector(
            np.concatenate(points), np.concatenate(pixels), self.projector, lens=self.model.projector
        )
        ends = np.cumsum([len(p) for p in points])[:-1]
        return fit.projector, fit.projector_from_camera, np.split(fit.residual_xy, ends)

    def _first_view(
        self, white: Sequence[BoardView], poses: Sequence[Pose], points: Sequence[Array]
    ) -> tuple[Pinhole, Pose, Sequence[Array]]:
        """Return the projector, its pose in the first view, and the residuals (n, 2) px a view under its own pose."""
        local = [pose.inverse().apply(p)[:, :2] for p, pose in zip(points, poses, strict=True)]
        pixels = [v.projector_xy[v.projected] for v in white]
        views = [
            BoardView(v.name, self.projector, xy, seen, np.full_like(seen, np.nan), np.full_like(seen, np.nan))
            for v, xy, seen in zip(white, local, pixels, strict=True)
        ]
        projector, found = solve.calibrate_camera(views, self.projector, self.model.projector)
        residuals = [
            projector.project(pose.apply(flat(xy))) - seen for pose, xy, seen in zip(found, local, pixels, strict=True)
        ]
        return projector, found[0] @ poses[0].inverse(), residuals
