"""The compiled loops of two-ray triangulation. Importing this module imports numba: do it inside functions only."""

from __future__ import annotations

import math

import numpy as np

from slkit.triangulation._kernels import (
    _SMALLEST_SIGMA_PX,
    _STEPS,
    Doubles,
    Singles,
    _best_axis,
    _calibration_sigma,
    _normalize,
    _pixel,
    _seen,
    compiled,
)


@compiled
def _solve3(m: Doubles, r: Doubles, out: Doubles) -> bool:
    """Write m^-1 r for a symmetric positive m (3, 3) to out by Cholesky's method; tell whether m was positive."""
    a = math.sqrt(m[0, 0]) if m[0, 0] > 0.0 else 0.0
    if a == 0.0:
        return False
    b, d = m[1, 0] / a, m[2, 0] / a
    c = m[1, 1] - b * b
    if not c > 0.0:
        return False
    c = math.sqrt(c)
    e = (m[2, 1] - b * d) / c
    f = m[2, 2] - d * d - e * e
    if not f > 0.0:
        return False
    y0 = r[0] / a
    y1 = (r[1] - b * y0) / c
    y2 = (r[2] - d * y0 - e * y1) / f
    out[2] = y2
    out[1] = (y1 - e * y2) / c
    out[0] = (y0 - b * out[1] - d * y2) / a
    return True


@compiled
def _weights(sigma: Doubles, lens: Doubles, camera: Doubles, weight: Doubles) -> bool:
    """Share each variance between camera and projector and write 1 / variance of u, v, x, y; False if unknown."""
    known = math.isfinite(sigma[0]) and math.isfinite(sigma[1])
    sx = max(sigma[0], _SMALLEST_SIGMA_PX) / lens[0] if known else 1.0 / lens[0]
    sy = max(sigma[1], _SMALLEST_SIGMA_PX) / lens[3] if known else 1.0 / lens[3]
    shared = 0.5 * min(sx, sy) ** 2
    weight[0] = 1.0 / (shared * camera[0] ** 2)
    weight[1] = 1.0 / (shared * camera[3] ** 2)
    weight[2] = 1.0 / ((sx * sx - shared) * lens[0] ** 2)
    weight[3] = 1.0 / ((sy * sy - shared) * lens[3] ** 2)
    return known


@compiled
def _normal_equations(
    theta: Doubles,
    seen: Doubles,
    weight: Doubles,
    camera: Doubles,
    lens: Doubles,
    pose: Doubles,
    jacobian: Doubles,
    m: Doubles,
    r: Doubles,
) -> float:
    """Write J^T W J to m and -J^T W e to r for theta = (x, y, w); return the squared residual in px."""
    u, v, ux, uy, vx, vy = _pixel(theta[0], theta[1], camera)
    p, q = _seen(theta[0], theta[1], theta[2], pose, lens, jacobian[2:])
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = ux, uy, 0.0
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = vx, vy, 0.0
    error = (u - seen[0], v - seen[1], p - seen[2], q - seen[3])
    for a in range(3):
        r[a] = 0.0
        for k in range(4):
            r[a] -= jacobian[k, a] * weight[k] * error[k]
        for b in range(a + 1):
            total = 0.0
            for k in range(4):
                total += jacobian[k, a] * weight[k] * jacobian[k, b]
            m[a, b] = total
            m[b, a] = total
    return error[0] ** 2 + error[1] ** 2 + error[2] ** 2 + error[3] ** 2


@compiled
def _refine(
    theta: Doubles,
    seen: Doubles,
    weight: Doubles,
    camera: Doubles,
    lens: Doubles,
    pose: Doubles,
    jacobian: Doubles,
    m: Doubles,
    r: Doubles,
    step: Doubles,
) -> float:
    """Run Gauss-Newton on theta; return the squared residual in px, NaN without convergence."""
    for _ in range(_STEPS):
        square = _normal_equations(theta, seen, weight, camera, lens, pose, jacobian, m, r)
        if not math.isfinite(square) or not _solve3(m, r, step):
            return math.nan
        for a in range(3):
            theta[a] += step[a]
        # The size of a step is judged by what it moves in the pictures, in units of sigma.
        moved = m[0, 0] * step[0] ** 2 + m[1, 1] * step[1] ** 2 + m[2, 2] * step[2] ** 2
        if moved < 1e-14:
            return square if theta[2] > 0.0 else math.nan
    return math.nan


@compiled
def two_rays_rows(
    camera_xy: Singles,
    projector_xy: Singles,
    sigma: Singles,
    camera: Doubles,
    projector: Doubles,
    pose: Doubles,
    covariance: Doubles,
    xyz: Singles,
    sigma_mm: Singles,
    residual_px: Singles,
    sigma_cal_mm: Singles,
) -> None:
    """Write the reprojection-optimal point of every row that has both axes."""
    jacobian, m, r, step = np.empty((4, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    theta, seen, weight, deviation = np.empty(3), np.empty(4), np.empty(4), np.empty(2)
    along, slopes = np.empty(4), np.empty(26)
    for i in range(camera_xy.shape[0]):
        xyz[i, :] = math.nan
        sigma_mm[i] = sigma_cal_mm[i] = residual_px[i] = math.nan
        seen[0], seen[1] = camera_xy[i, 0], camera_xy[i, 1]
        seen[2], seen[3] = projector_xy[i, 0], projector_xy[i, 1]
        deviation[0], deviation[1] = sigma[i, 0], sigma[i, 1]
        if not (math.isfinite(seen[2]) and math.isfinite(seen[3])):
            continue
        theta[0], theta[1] = _normalize(seen[0], seen[1], camera)
        theta[2] = _best_axis(theta[0], theta[1], seen[2:], deviation, pose, projector)[0]
        known = _weights(deviation, projector, camera, weight)
        square = _refine(theta, seen, weight, camera, projector, pose, jacobian, m, r, step)
        if not math.isfinite(square):
            continue
        x, y, w = theta
        xyz[i, 0], xyz[i, 1], xyz[i, 2] = x / w, y / w, 1.0 / w
        residual_px[i] = math.sqrt(square)
        length = math.sqrt(x * x + y * y + 1.0)
        r[0], r[1], r[2] = x / (w * length), y / (w * length), -length / (w * w)
        if not _solve3(m, r, step):
            continue
        if known:
            sigma_mm[i] = math.sqrt(r[0] * step[0] + r[1] * step[1] + r[2] * step[2])
        for k in range(4):
            along[k] = weight[k] * (jacobian[k, 0] * step[0] + jacobian[k, 1] * step[1] + jacobian[k, 2] * step[2])
        sigma_cal_mm[i] = _calibration_sigma(theta, along, camera, projector, pose, covariance, slopes)
