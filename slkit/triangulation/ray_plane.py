"""One coded axis: where the viewing ray meets the sheet of light, bent by the projector's lens."""

from __future__ import annotations

from slkit.data import Correspondences, PointCloud
from slkit.device import on_cuda
from slkit.geometry import Rig
from slkit.triangulation._run import run, run_on_cuda


def ray_plane(correspondences: Correspondences, rig: Rig) -> PointCloud:
    """Return the point on each viewing ray whose projection has the coded coordinate, exact with lens distortion.

    One point a row, in the camera frame in mm; NaN where the code is silent, where the equation has no solution in
    front of both lenses and within a tenth of the projector image, or where a lens model has no inverse. Where both
    axes are coded, the one that gives the smaller sigma_decoding_mm is used, and residual_px is by how many px the
    point misses the other one; with one axis residual_px is NaN. sigma_decoding_mm = sigma / |d x_p / d z| *
    |(x, y, 1)|: 1 sigma along the viewing ray, NaN where sigma is; without sigmas the steeper axis is used.
    sigma_cal_mm: what the covariance of the rig adds, camera pixel and projector coordinate held.
    Errors: InputError where names and matrix of that covariance do not fit together.

    Source: the scalar equation proj(R z m + T) = x_p, solved by Newton's method on 1 / z with analytic derivatives,
    started where the distortion-free plane of light is.
    """
    if on_cuda():
        return run_on_cuda(correspondences, rig)
    from slkit.triangulation._kernels import ray_plane_rows
    from slkit.triangulation._ray_plane_block_kernels import ray_plane_blocks

    return run(ray_plane_blocks, ray_plane_rows, correspondences, rig)
