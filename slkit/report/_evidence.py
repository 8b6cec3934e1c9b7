"""The points of a calibration, pooled per device, and where they lie in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import BoardView, Calibration, ViewResult
from slkit.geometry import Floats, Pinhole, Pose, flat, homogeneous, intersect_plane

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class DevicePoints:
    """All points of the used views in one device's image.

    seen_xy, error_xy (n, 2) px, error NaN where there is none; view (n,): place of the view among `Calibration.views`;
    kept (n,): the rows that were not rejected.
    """

    device: str
    lens: Pinhole
    seen_xy: Floats
    error_xy: Floats
    view: npt.NDArray[np.intp]
    kept: Mask

    def select(self, mask: Mask) -> DevicePoints:
        """Return the rows of a mask (n,)."""
        rows = (self.seen_xy[mask], self.error_xy[mask], self.view[mask], self.kept[mask])
        return DevicePoints(self.device, self.lens, *rows)

    @property
    def with_error(self) -> DevicePoints:
        """The rows whose error is known."""
        return self.select(np.asarray(np.isfinite(self.error_xy).all(axis=1)))


@dataclass(frozen=True, eq=False)
class Placed:
    """A used view in space, camera frame, mm.

    number: its line in the table of views; outline_xyz (4, 3): the rectangle around its printed points, (0, 3) for a
    target that is not flat; points_xyz (n, 3): its rows, NaN where they cannot be placed; middle_xyz (3,).
    """

    number: int
    result: ViewResult
    view: BoardView
    outline_xyz: Floats
    points_xyz: Floats
    middle_xyz: Floats

    @property
    def extent_xyz(self) -> Floats:
        """The points (n, 3) that a figure must hold."""
        return self.outline_xyz if len(self.outline_xyz) else self.points_xyz


def device_points(calibration: Calibration, device: str) -> DevicePoints:
    """Return what the used views of a calibration say of `camera` or `projector`."""
    camera = device == "camera"
    lens = calibration.rig.camera if camera else calibration.rig.projector
    seen: list[Floats] = [np.empty((0, 2))]
    error: list[Floats] = [np.empty((0, 2))]
    place, kept = [np.empty(0, np.intp)], [np.empty(0, np.bool_)]
    for index, result in enumerate(calibration.views):
        if not result.used or result.view is None:
            continue
        xy = result.view.camera_xy if camera else result.view.projector_xy
        errors = result.camera_xy_error if camera else result.projector_xy_error
        known = np.isfinite(xy).all(axis=1)
        seen.append(xy[known])
        error.append(np.full_like(xy, np.nan)[known] if errors is None else errors[known])
        place.append(np.full(known.sum(), index, np.intp))
        kept.append(kept_rows(result)[known])
    xy, errors = np.concatenate(seen), np.concatenate(error)
    return DevicePoints(device, lens, xy, errors, np.concatenate(place), np.concatenate(kept))


def kept_rows(result: ViewResult) -> Mask:
    """Return the mask (n,) of a view's rows that were not rejected, empty for a view without rows."""
    rows = 0 if result.view is None else len(result.view.camera_xy)
    return np.ones(rows, np.bool_) if result.kept is None else np.asarray(result.kept, np.bool_)


def placed_views(calibration: Calibration) -> list[Placed]:
    """Return the used views whose pose is known, in the camera frame."""
    placed: list[Placed] = []
    for number, result in enumerate(calibration.views, 1):
        view, pose = result.view, result.pose
        if not result.used or view is None or pose is None or not view.printed.any():
            continue
        if view.face is None:
            (x0, y0), (x1, y1) = (f(view.board_xy[view.printed], axis=0) for f in (np.min, np.max))
            outline = pose.apply(np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]]))
            points, middle = _on_board(calibration.rig.camera, pose, view), outline.mean(axis=0)
        else:
            outline, points = np.empty((0, 3)), calibration.rig.meet(view.camera_xy, view.projector_xy)
            middle = np.nanmean(points, axis=0) if np.isfinite(points).any() else pose.translation
        placed.append(Placed(number, result, view, outline, points, middle))
    return placed


def _on_board(camera: Pinhole, pose: Pose, view: BoardView) -> Floats:
    """Return where each row lies (n, 3) mm: on the board where printed, else where its camera ray meets the board."""
    points = pose.apply(flat(view.board_xy))
    rays = homogeneous(camera.normalize(view.camera_xy[~view.printed]))
    normal = pose.rotation[:, 2]
    points[~view.printed] = intersect_plane(rays, normal, float(normal @ pose.translation))
    points[~np.isfinite(points).all(axis=1)] = np.nan
    return points
