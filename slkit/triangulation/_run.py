"""Runs a compiled loop over the rows of correspondences, in slices on plain threads.

Plain threads, because numba's own thread pool does not survive a fork, and a pool of processes may call this.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, PointCloud
from slkit.device import side_by_side, threads
from slkit.geometry import Pinhole, Pose, Rig
from slkit.triangulation.uncertainty import rig_covariance

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
_Given = tuple[Singles, Singles, Singles]
_Devices = tuple[Doubles, Doubles, Doubles]

_SMALLEST_SLICE = 20_000


def run(blocks: Callable[..., None], rows: Callable[..., None], found: Correspondences, rig: Rig) -> PointCloud:
    """Return the points, one a row, of a kernel that takes blocks, and of one for each of the rows which that leaves.

    Errors: InputError where names and matrix of the rig's covariance do not fit together.
    """
    given, devices, full = _told(found, rig)
    numbers = [tuple(device.tolist()) for device in devices]
    half = np.pad(np.tril(full) - np.diag(full.diagonal() / 2), ((0, 0), (0, 2)))
    xyz, decoding, residual_px, calibration = results = _empty(len(found))
    whole = np.empty_like(decoding)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        blocks(*(a[part] for a in given), *numbers, half, *(a[part] for a in results))
        left = first + np.flatnonzero(np.isnan(xyz[part, 0]))
        if len(left):
            some = _empty(len(left))
            rows(*(a[left] for a in given), *devices, full, *some)
            for result, values in zip(results, some, strict=True):
                result[left] = values
        whole[part] = _both(decoding[part], calibration[part]) if len(full) else decoding[part]

    in_parts(work, len(found))
    return PointCloud(xyz, found.color, whole, residual_px, found.camera_xy, sigma_cal_mm=calibration)


def run_on_cuda(found: Correspondences, rig: Rig) -> PointCloud:
    """Return the ray-plane points, one a row, by the loop of single rows on a CUDA device. Errors: as `run`."""
    from slkit.triangulation._cuda_kernels import ray_plane

    out = ray_plane(*_told(found, rig))
    whole = _both(out[:, 3], out[:, 5])
    return PointCloud(out[:, :3], found.color, whole, out[:, 4], found.camera_xy, sigma_cal_mm=out[:, 5])


def _told(found: Correspondences, rig: Rig) -> tuple[_Given, _Devices, Doubles]:
    """Return rows, devices and covariance (26, 26), or (0, 0) without one, as the kernels take them."""
    a, b, c = (
        np.require(array, np.float32, ["C_CONTIGUOUS", "WRITEABLE"])
        for array in (found.camera_xy, found.projector_xy, found.sigma)
    )
    covariance = rig_covariance(rig)
    devices = _lens(rig.camera), _lens(rig.projector), _pose(rig.projector_from_camera)
    return (a, b, c), devices, np.empty((0, 0)) if covariance is None else covariance


def _empty(rows: int) -> tuple[Singles, Singles, Singles, Singles]:
    a, b, c = (np.empty(rows, np.float32) for _ in range(3))
    return np.empty((rows, 3), np.float32), a, b, c


def _both(decoding: Singles, calibration: Singles) -> Singles:
    return np.where(np.isnan(calibration), decoding, np.hypot(decoding, calibration))


def in_parts(work: Callable[[int, int], None], rows: int, smallest: int = _SMALLEST_SLICE, turns: int = 1) -> None:
    """Call work(first, last) for parts of so many rows, none much below the smallest, on all cores.

    turns: parts for each core; several where some take longer than others.
    """
    side_by_side(work, np.linspace(0, rows, min(turns * threads(), rows // smallest + 1) + 1).astype(int).tolist())


def _lens(device: Pinhole) -> Doubles:
    k = device.K
    return np.concatenate([[k[0, 0], k[0, 1], k[0, 2], k[1, 1], k[1, 2]], device.distortion, device.size]).astype(
        np.float64
    )


def _pose(pose: Pose) -> Doubles:
    return np.concatenate([pose.rotation.ravel(), pose.translation]).astype(np.float64)
