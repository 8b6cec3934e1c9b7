"""Mistakes that the poses of the boards show: alike, at one depth, in one corner."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from slkit.calibration._parameters import Array
from slkit.calibration.diagnose import ONE_DEPTH, seen_points
from slkit.data import BoardView, Finding
from slkit.geometry import Pinhole, Pose, Rig, pixel_grid, working_volume

_ALIKE_DEG = 8.0
_COVERS = 0.18
"""Points whose outline covers a smaller share of an image, or of what both devices see of it, cover one corner."""


def pose_findings(rig: Rig, views: Sequence[BoardView], poses: Sequence[Pose], side: str) -> Iterator[Finding]:
    """Name poses of one side of the board that determine too little: alike, or at one depth."""
    if len(views) < 2:
        return
    normals = np.array([p.rotation[:, 2] for p in poses])
    widest = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1))).max())
    if widest < _ALIKE_DEG:
        fault = f"all views of {side} are parallel within {widest:.1f} degrees"
        yield Finding(fault, "", "tilt the board by 20 to 40 degrees to all sides", "parallel-poses")
    middles = [float(seen_points(rig, v, p)[:, 2].mean()) for v, p in zip(views, poses, strict=True)]
    spread = (max(middles) - min(middles)) / float(np.mean(middles))
    if min(middles) > 0 and spread < ONE_DEPTH:
        fault = f"all views of {side} are at one depth within {100 * spread:.1f} %"
        yield Finding(fault, "", "move the board nearer and farther, over the depth of what you will scan", "one-depth")


def coverage_findings(rig: Rig, views: Sequence[BoardView], poses: Sequence[Pose]) -> Iterator[Finding]:
    """Name points that cover one corner of a device's image only, of what the other device lets them cover."""
    lit = [i for i, v in enumerate(views) if v.projected.any()]
    if not lit:
        return
    boards = np.array([seen_points(rig, views[i], poses[i]).mean(axis=0) for i in lit])
    exchanged = Rig(rig.projector, rig.camera, rig.projector_from_camera.inverse())
    camera_xy = np.concatenate([v.camera_xy for v in views])
    projector_xy = np.concatenate([views[i].projector_xy[views[i].projected] for i in lit])
    # A printed board can be anywhere in the camera's image; one that light must fall on cannot.
    free = len(lit) < len(views)
    shared = 1.0 if free else _shared(rig, boards[:, 2])
    yield from _one_corner(camera_xy, rig.camera, shared, "camera", "take views that fill the image, its corners too")
    shared = _shared(exchanged, rig.projector_from_camera.apply(boards)[:, 2])
    remedy = "use a larger pattern, or take views in which the board catches light from all of the image"
    yield from _one_corner(projector_xy, rig.projector, shared, "projector", remedy)


def _one_corner(xy: Array, device: Pinhole, possible: float, name: str, remedy: str) -> Iterator[Finding]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        share = float(ConvexHull(xy).volume) / (device.size[0] * device.size[1])
    except (QhullError, ValueError):
        return
    if share < _COVERS * possible:
        usable = "" if possible == 1 else f"; board and both devices would let them cover {100 * possible:.0f} %"
        yield Finding(f"the points cover {100 * share:.0f} % of the {name}'s image{usable}", "", remedy, "one-corner")


def _shared(rig: Rig, depths: Array) -> float:
    """Return the share of the camera's image in which it sees, at one of some depths in mm, what is lit."""
    xyz, _ = working_volume(rig, pixel_grid(rig.camera.size), depths)
    return float(np.isfinite(xyz[..., 0]).any(axis=0).mean())
