"""Runs a compiled loop over the rows of correspondences, in slices on plain threads.

Plain threads, because numba's own thread pool does not survive a fork, and a pool of processes may call this.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, PointCloud
from slkit.geometry import Pinhole, Pose, Rig
from slkit.triangulation.uncertainty import rig_covariance

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]

_SMALLEST_SLICE = 20_000


def run(kernel: Callable[..., None], found: Correspondences, rig: Rig) -> PointCloud:
    """Return the points of a kernel run in slices on all cores, one a row.

    Errors: InputError where names and matrix of the rig's covariance do not fit together.
    """
    rows = len(found)
    given = [
        np.require(a, np.float32, ["C_CONTIGUOUS", "WRITEABLE"])
        for a in (found.camera_xy, found.projector_xy, found.sigma)
    ]
    results = (np.empty((rows, 3), np.float32), *(np.empty(rows, np.float32) for _ in range(3)))
    covariance = rig_covariance(rig)
    fixed = (
        _lens(rig.camera),
        _lens(rig.projector),
        _pose(rig.projector_from_camera),
        np.empty((0, 0)) if covariance is None else covariance,
    )

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        kernel(*(a[part] for a in given), *fixed, *(a[part] for a in results))

    in_parts(work, rows)
    xyz, decoding, residual_px, calibration = results
    whole = np.where(np.isnan(calibration), decoding, np.hypot(decoding, calibration))
    return PointCloud(xyz, found.color, whole, residual_px, found.camera_xy, sigma_cal_mm=calibration)


def in_parts(work: Callable[[int, int], None], rows: int) -> None:
    """Call work(first, last) for parts of so many rows, on all cores."""
    from numba.core import config

    threads = int(getattr(config, "NUMBA_NUM_THREADS"))  # noqa: B009 - numba sets it where no checker sees it
    cuts = np.linspace(0, rows, min(threads, rows // _SMALLEST_SLICE + 1) + 1).astype(int).tolist()
    parts = list(zip(cuts[:-1], cuts[1:], strict=True))
    if len(parts) == 1:
        work(*parts[0])
        return
    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(work, *zip(*parts, strict=True)))


def _lens(device: Pinhole) -> Doubles:
    k = device.K
    return np.concatenate([[k[0, 0], k[0, 1], k[0, 2], k[1, 1], k[1, 2]], device.distortion, device.size]).astype(
        np.float64
    )


def _pose(pose: Pose) -> Doubles:
    return np.concatenate([pose.rotation.ravel(), pose.translation]).astype(np.float64)
