"""Ray-plane triangulation on a CUDA device, one thread a row: the functions of `_kernels`, compiled once more.

Importing this module imports numba's CUDA: do it inside functions only.
"""

from __future__ import annotations

import math
from types import FunctionType
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda as _typed
from numba import float64

from slkit.triangulation import _kernels

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]

# numba's own types of it are not complete.
cuda: Any = _typed

_THREADS = 128
# Callees before their callers.
_FUNCTIONS = (
    "_distort",
    "_normalize",
    "_pixel",
    "_seen",
    "_newton",
    "_inverse_depth",
    "_best_axis",
    "_over_lens",
    "_along_the_ray",
    "_calibration_sigma",
)


@cuda.jit(device=True)
def _larger(a: float, b: float) -> float:
    # numba 0.68 cannot compile max() for CUDA.
    return b if b > a else a


def _on_device() -> dict[str, Any]:
    """Return the functions of `_kernels` compiled for the device, calling one another."""
    space: dict[str, Any] = {**vars(_kernels), "max": _larger}
    for name in _FUNCTIONS:
        body = space[name].py_func
        space[name] = cuda.jit(device=True)(FunctionType(body.__code__, space, name, body.__defaults__))
    return space


_own = _on_device()
_normalize, _best_axis = _own["_normalize"], _own["_best_axis"]
_along_the_ray, _calibration_sigma = _own["_along_the_ray"], _own["_calibration_sigma"]


def _row(
    camera_xy: Singles,
    projector_xy: Singles,
    sigma: Singles,
    camera: Doubles,
    lens: Doubles,
    pose: Doubles,
    covariance: Doubles,
    out: Singles,
) -> None:
    """Write x, y, z, sigma_decoding_mm, residual_px and sigma_cal_mm of the thread's row to out (n, 6)."""
    i = cuda.grid(1)
    if i >= camera_xy.shape[0]:
        return
    px, deviation = cuda.local.array(2, float64), cuda.local.array(2, float64)
    for axis in range(2):
        px[axis], deviation[axis] = projector_xy[i, axis], sigma[i, axis]
    x, y = _normalize(float64(camera_xy[i, 0]), float64(camera_xy[i, 1]), camera)
    w, spread, residual, best = _best_axis(x, y, px, deviation, pose, lens)
    out[i, 0], out[i, 1], out[i, 2] = x / w, y / w, 1.0 / w
    out[i, 3], out[i, 4], out[i, 5] = spread, residual, math.nan
    if covariance.shape[0] == 0:
        return
    theta, along, slopes = cuda.local.array(3, float64), cuda.local.array(4, float64), cuda.local.array(26, float64)
    jacobian = cuda.local.array((2, 3), float64)
    theta[0], theta[1], theta[2] = x, y, w
    _along_the_ray(theta, best, camera, lens, pose, jacobian, along)
    out[i, 5] = _calibration_sigma(theta, along, camera, lens, pose, covariance, slopes)


_rows = cuda.jit(_row)


def ray_plane(
    given: tuple[Singles, Singles, Singles], devices: tuple[Doubles, Doubles, Doubles], covariance: Doubles
) -> Singles:
    """Return x, y, z, sigma_decoding_mm, residual_px and sigma_cal_mm (n, 6) of rows.

    given: camera_xy, projector_xy and sigma (n, 2); devices: camera, projector and pose; see `_kernels`.
    """
    count = len(given[0])
    out = np.empty((count, 6), np.float32)
    if count:
        on_device = [cuda.to_device(a) for a in (*given, *devices, covariance)]
        result = cuda.to_device(out)
        _rows[-(-count // _THREADS), _THREADS](*on_device, result)
        result.copy_to_host(out)
    return out
