"""What the calibration does to points: their covariance, and the 3D error to expect over a working volume.

Source: propagation of the calibration's covariance through triangulation by the implicit function theorem; mrcal's
projection uncertainty, here in millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import VolumeMap
from slkit.errors import InputError
from slkit.geometry import (
    RIG_NAMES,
    Rig,
    homogeneous,
    pixel_grid,
    project_with_derivatives,
    steeper_axis,
    working_volume,
)

Doubles = npt.NDArray[np.float64]

_PARALLEL = 1e-12
"""Sine of the angle between ray and sheet of light, roughly, below which they do not meet."""


def rig_covariance(rig: Rig) -> Doubles | None:
    """Return the covariance (26, 26) of RIG_NAMES, 1 sigma squared; zero where a parameter was not estimated.

    Other names that the rig's covariance holds, such as a board's, move no points. None where the rig has none, or one
    that is not finite. Errors: InputError where names and matrix do not fit together.
    """
    if rig.covariance is None:
        return None
    try:
        names = [str(n) for n in rig.covariance["parameters"]]
        matrix = np.asarray(rig.covariance["matrix"], dtype=np.float64).reshape(len(names), len(names))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            "the rig's covariance needs `parameters` and a `matrix` with a row and a column for each: "
            "calibrate again, or remove it"
        ) from error
    place = {name: index for index, name in enumerate(RIG_NAMES)}
    known = [i for i, name in enumerate(names) if name in place]
    to = [place[names[i]] for i in known]
    block = matrix[np.ix_(known, known)]
    if not known or not np.isfinite(block).all():
        return None
    result = np.zeros((len(RIG_NAMES),) * 2)
    result[np.ix_(to, to)] = block
    return result


def point_jacobian(rig: Rig, camera_xy: npt.ArrayLike, depth_mm: npt.ArrayLike, axis: int) -> Doubles:
    """Return d point / d RIG_NAMES (n, 3, 26) of points triangulated from one projector axis, 0: column, 1: row.

    camera_xy (n, 2) px; depth_mm (n,): z; camera pixel and projector coordinate are held. In mm per unit; NaN where no
    point is in front of both lenses or where ray and sheet of light are parallel.
    """
    pose = rig.projector_from_camera
    xyz = homogeneous(rig.camera.normalize(camera_xy)) * np.asarray(depth_mm, dtype=np.float64)[:, None]
    turned = xyz @ pose.rotation.T
    placed = turned + pose.translation
    there = (xyz[:, 2] > 0) & (placed[:, 2] > 0)
    _, seen, of_camera = project_with_derivatives(rig.camera, xyz[there])
    _, lit, of_projector = project_with_derivatives(rig.projector, placed[there])
    lit, of_projector = lit[:, axis], of_projector[:, axis]
    over_point = np.concatenate([seen, (lit @ pose.rotation)[:, None]], axis=1)
    over_rig = np.zeros((len(seen), 3, len(RIG_NAMES)))
    over_rig[:, :2, :10] = of_camera
    over_rig[:, 2, 10:20] = of_projector
    over_rig[:, 2, 20:23] = np.cross(turned[there], lit)
    over_rig[:, 2, 23:] = lit
    lengths = np.linalg.norm(over_point, axis=2).prod(axis=1)
    meet = np.abs(np.linalg.det(over_point)) > _PARALLEL * lengths
    result = np.full((len(xyz), 3, len(RIG_NAMES)), np.nan)
    result[np.flatnonzero(there)[meet]] = -np.linalg.solve(over_point[meet], over_rig[meet])
    return result


def point_covariance(rig: Rig, camera_xy: npt.ArrayLike, depth_mm: npt.ArrayLike, axis: int) -> Doubles:
    """Return the covariance (n, 3, 3) mm^2 that the calibration gives points from one projector axis.

    Arguments and NaN as for `point_jacobian`. Errors: InputError where the rig has no covariance.
    """
    jacobian = point_jacobian(rig, camera_xy, depth_mm, axis)
    return jacobian @ _known_covariance(rig) @ jacobian.transpose(0, 2, 1)


def uncertainty_map(
    rig: Rig,
    depths_mm: Sequence[float],
    aligned: bool = False,
    axis: int | None = None,
    step_px: float | None = None,
) -> VolumeMap:
    """Return 1 sigma of the 3D error that the covariance predicts, the root of its mean square, over the volume.

    depths_mm: z of each layer; axis: the projector axis that is decoded, default the one that tells depth better;
    step_px: of the grid of camera pixels, default a 24th of the longer side. As is: in the camera frame. aligned: what
    the rigid motion that brings all points of the map nearest to the truth leaves.
    Errors: InputError where the rig has no covariance or where less than three points lie in the volume.
    """
    covariance = _known_covariance(rig)
    camera_xy = pixel_grid(rig.camera.size, step_px)
    xyz, _ = working_volume(rig, camera_xy, depths_mm)
    inside = np.isfinite(xyz).all(axis=-1)
    if inside.sum() < 3:
        raise InputError("camera and projector share less than three points at these depths: give those of the boards")
    points = xyz[inside]
    pixels = np.broadcast_to(camera_xy, (*inside.shape, 2))[inside]
    jacobian = point_jacobian(rig, pixels, points[:, 2], steeper_axis(rig, points) if axis is None else axis)
    jacobian = _without_motion(points, jacobian) if aligned else jacobian
    value = np.full(inside.shape, np.nan)
    value[inside] = np.sqrt(np.maximum(np.einsum("nip,pq,niq->n", jacobian, covariance, jacobian, optimize=True), 0))
    return VolumeMap(np.asarray(depths_mm, dtype=np.float64), camera_xy, value)


def _known_covariance(rig: Rig) -> Doubles:
    covariance = rig_covariance(rig)
    if covariance is None:
        raise InputError("the rig has no covariance, so the uncertainty of its points is unknown: calibrate with slkit")
    return covariance


def _without_motion(points: Doubles, jacobian: Doubles) -> Doubles:
    """Return derivatives (n, 3, p) less the small rigid motion of all points (n, 3) that follows them best."""
    known = np.isfinite(jacobian).all(axis=(1, 2))
    arms = points[known] - points[known].mean(axis=0)
    arms /= max(float(np.abs(arms).max(initial=0)), 1e-12)
    motions = np.zeros((len(arms), 3, 6))
    motions[:, :, :3] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    motions[:, :, 3:] = np.eye(3)
    basis: Any = np.linalg.qr(motions.reshape(-1, 6))[0]
    moves = jacobian[known].reshape(-1, jacobian.shape[2])
    result = np.full_like(jacobian, np.nan)
    result[known] = (moves - basis @ (basis.T @ moves)).reshape(-1, *jacobian.shape[1:])
    return result
