"""Both axes coded: the point that explains the camera's and the projector's pixel best."""

from __future__ import annotations

from slkit.data import Correspondences, PointCloud
from slkit.geometry import Rig
from slkit.triangulation._run import run


def two_rays(correspondences: Correspondences, rig: Rig) -> PointCloud:
    """Return the points with the smallest weighted reprojection error in camera and projector.

    One point a row, in the camera frame in mm; NaN where an axis is silent or where no point in front of both lenses
    was found. A sigma holds the camera's share already, so the variance is divided: the camera gets half of the
    smaller angular variance of the two axes, sigma / focal length, and each axis keeps the rest. Sigmas below 0.001 px
    count as 0.001 px; rows without sigmas weigh all four residuals by the same angle and have a sigma_mm of NaN.
    residual_px = sqrt(du^2 + dv^2 + dx^2 + dy^2), unweighted, in px of either device.
    sigma_decoding_mm: 1 sigma along the viewing ray, from (J^T W J)^-1. sigma_cal_mm: what the covariance of the rig
    adds, from the derivative of the least-squares point where its residual is small.
    Errors: InputError where names and matrix of that covariance do not fit together.

    Source: Hartley and Sturm (1997), the optimal triangulation criterion; minimised by Gauss-Newton over direction
    and inverse depth, started from the ray-plane point of the better axis.
    """
    from slkit.triangulation._two_rays_block_kernels import two_rays_blocks
    from slkit.triangulation._two_rays_kernels import two_rays_rows

    return run(two_rays_blocks, two_rays_rows, correspondences, rig)
