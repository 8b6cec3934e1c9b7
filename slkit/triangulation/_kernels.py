"""The compiled loops of ray-plane triangulation, and what that of two rays shares with them.

Importing this module imports numba: do it inside functions only.

A viewing ray is held as undistorted normalised coordinates x, y and inverse depth w = 1 / z: along it the projector's
picture is a ratio of two linear functions of w, so that Newton's method is well behaved from the nearest point to
infinity. The derivatives are analytic. A lens is (fx, skew, cx, fy, cy, k1, k2, p1, p2, k3, width, height), a pose the
nine numbers of the rotation, row by row, and the translation.

Numba's cache does not see a change in the file of a function that is called: after one here delete the __pycache__
folder beside it, or whatever calls it goes on with the old code.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Numbers = tuple[float, ...]
_Three = tuple[float, float, float]
_Ten = tuple[float, float, float, float, float, float, float, float, float, float]
_Best = tuple[float, float, float, int]

compiled = njit(cache=True, nogil=True, error_model="numpy")  # a division by zero is data, not an error

_STEPS = 30
_EXACT_PX = 1e-9  # Newton stops here; a double holds a thousand pixels to 1e-13
_SOLVED_PX = 1e-6
_MARGIN = 0.1  # of the projector image: room for a rig that is not perfect
_SMALLEST_SIGMA_PX = 1e-3  # a float32 pixel coordinate is not better


@compiled
def _distort(x: float, y: float, lens: Doubles | Numbers) -> tuple[float, float, float, float, float]:
    """Return the distorted point and the three entries of the symmetric Jacobian."""
    k1, k2, p1, p2, k3 = lens[5], lens[6], lens[7], lens[8], lens[9]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
    dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    a = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    b = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    c = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return dx, dy, a, b, c


@compiled
def _normalize(u: float, v: float, lens: Doubles) -> tuple[float, float]:
    """Return the undistorted normalised point of a pixel, NaN where the lens model has no inverse."""
    target_y = (v - lens[4]) / lens[3]
    target_x = (u - lens[2] - lens[1] * target_y) / lens[0]
    x, y = target_x, target_y
    for _ in range(_STEPS):
        dx, dy, a, b, c = _distort(x, y, lens)
        ex, ey = dx - target_x, dy - target_y
        determinant = a * c - b * b
        # Beyond the fold of the polynomial lie roots that no light ray takes.
        if abs(ex) + abs(ey) < 1e-13:
            return (x, y) if determinant > 0.0 and a > 0.0 else (math.nan, math.nan)
        x -= (c * ex - b * ey) / determinant
        y -= (a * ey - b * ex) / determinant
    dx, dy, a, b, c = _distort(x, y, lens)
    if abs(dx - target_x) + abs(dy - target_y) < 1e-9 and a * c - b * b > 0.0 and a > 0.0:
        return x, y
    return math.nan, math.nan


@compiled
def _pixel(x: float, y: float, lens: Doubles | Numbers) -> tuple[float, float, float, float, float, float]:
    """Return the pixel u, v of an undistorted normalised point and du/dx, du/dy, dv/dx, dv/dy."""
    dx, dy, a, b, c = _distort(x, y, lens)
    u = lens[0] * dx + lens[1] * dy + lens[2]
    v = lens[3] * dy + lens[4]
    return u, v, lens[0] * a + lens[1] * b, lens[0] * b + lens[1] * c, lens[3] * b, lens[3] * c


@compiled
def _seen(x: float, y: float, w: float, pose: Doubles, lens: Doubles, jacobian: Doubles) -> tuple[float, float]:
    """Return the projector pixel of (x, y, 1) / w and write d(u, v) / d(x, y, w) to jacobian (2, 3)."""
    qx = pose[0] * x + pose[1] * y + pose[2] + w * pose[9]
    qy = pose[3] * x + pose[4] * y + pose[5] + w * pose[10]
    qz = pose[6] * x + pose[7] * y + pose[8] + w * pose[11]
    if not qz > 0.0:
        return math.nan, math.nan
    nx, ny = qx / qz, qy / qz
    u, v, ux, uy, vx, vy = _pixel(nx, ny, lens)
    if not (ux * vy - uy * vx > 0.0 and vy > 0.0):
        return math.nan, math.nan
    for k in range(3):
        place = 9 if k == 2 else k
        step = 1 if k == 2 else 3
        dz = pose[place + 2 * step]
        dnx = (pose[place] - nx * dz) / qz
        dny = (pose[place + step] - ny * dz) / qz
        jacobian[0, k] = ux * dnx + uy * dny
        jacobian[1, k] = vx * dnx + vy * dny
    return u, v


@compiled
def _newton(
    ax: float, ay: float, az: float, w: float, axis: int, target: float, pose: Doubles, lens: Doubles
) -> _Three:
    """Return the w near a start where the ray meets one projector coordinate, its slope, and the other coordinate.

    (ax, ay, az): the ray's direction (x, y, 1), turned into the projector's frame.
    """
    tx, ty, tz = pose[9], pose[10], pose[11]
    other, slope, error = math.nan, math.nan, math.inf
    for _ in range(_STEPS):
        qz = az + w * tz
        if not qz > 0.0:
            return math.nan, math.nan, math.nan
        nx, ny = (ax + w * tx) / qz, (ay + w * ty) / qz
        u, v, ux, uy, vx, vy = _pixel(nx, ny, lens)
        if not (ux * vy - uy * vx > 0.0 and vy > 0.0):
            return math.nan, math.nan, math.nan
        dnx, dny = (tx - nx * tz) / qz, (ty - ny * tz) / qz
        error, other = (u - target, v) if axis == 0 else (v - target, u)
        slope = ux * dnx + uy * dny if axis == 0 else vx * dnx + vy * dny
        if slope == 0.0 or not math.isfinite(error):
            return math.nan, math.nan, math.nan
        if abs(error) < _EXACT_PX:
            break
        w -= error / slope
    # A bent sheet of light can meet the ray twice; where the sheet's image ends no light comes from.
    extent = lens[11 - axis]
    lit = -_MARGIN * extent <= other <= (1.0 + _MARGIN) * extent
    if abs(error) > _SOLVED_PX or not w > 0.0 or not lit:
        return math.nan, math.nan, math.nan
    return w, slope, other


@compiled
def _inverse_depth(x: float, y: float, axis: int, target: float, pose: Doubles, lens: Doubles) -> _Three:
    """Return w where the ray through (x, y) meets one projector coordinate, its slope d target / dw, and the other."""
    kx = lens[0] if axis == 0 else 0.0
    ky = lens[1] if axis == 0 else lens[3]
    kz = (lens[2] if axis == 0 else lens[4]) - target
    ax = pose[0] * x + pose[1] * y + pose[2]
    ay = pose[3] * x + pose[4] * y + pose[5]
    az = pose[6] * x + pose[7] * y + pose[8]
    here = kx * ax + ky * ay + kz * az
    along = kx * pose[9] + ky * pose[10] + kz * pose[11]
    if along != 0.0:
        w, slope, other = _newton(ax, ay, az, -here / along, axis, target, pose, lens)
        if math.isfinite(w):
            return w, slope, other
    # Where distortion moves the sheet more than depth does, its plane misleads: try depths by the baseline's length.
    baseline = math.sqrt(pose[9] ** 2 + pose[10] ** 2 + pose[11] ** 2)
    for length in (2.0, 4.0, 8.0, 1.0, 16.0):
        w, slope, other = _newton(ax, ay, az, 1.0 / (length * baseline), axis, target, pose, lens)
        if math.isfinite(w):
            return w, slope, other
    return math.nan, math.nan, math.nan


@compiled
def _best_axis(x: float, y: float, px: Doubles, sigma: Doubles, pose: Doubles, lens: Doubles) -> _Best:
    """Return w, the mm of depth uncertainty along the ray, the other axis' error, and the better coded axis."""
    best_w, best_sigma, best_error, best_cost, best = math.nan, math.nan, math.nan, math.inf, 0
    known = math.isfinite(sigma[0]) and math.isfinite(sigma[1])
    for axis in range(2):
        if not math.isfinite(px[axis]):
            continue
        w, slope, other = _inverse_depth(x, y, axis, px[axis], pose, lens)
        per_px = math.sqrt(x * x + y * y + 1.0) / (abs(slope) * w * w)
        cost = per_px * max(sigma[axis], _SMALLEST_SIGMA_PX) if known else per_px
        if cost < best_cost:
            best_w, best_cost, best = w, cost, axis
            best_sigma = per_px * sigma[axis]
            best_error = abs(other - px[1 - axis])
    return best_w, best_sigma, best_error, best


@compiled
def _over_lens(x: float, y: float, lens: Doubles | Numbers, along_u: float, along_v: float) -> _Ten:
    """Return along . d(u, v) / d lens in the order of geometry.LENS_NAMES."""
    dx, dy, _, _, _ = _distort(x, y, lens)
    over_dx = along_u * lens[0]
    over_dy = along_u * lens[1] + along_v * lens[3]
    r2, radial = x * x + y * y, over_dx * x + over_dy * y
    return (
        along_u * dx,
        along_v * dy,
        along_u,
        along_v,
        along_u * dy,
        radial * r2,
        radial * r2 * r2,
        over_dx * 2.0 * x * y + over_dy * (r2 + 2.0 * y * y),
        over_dx * (r2 + 2.0 * x * x) + over_dy * 2.0 * x * y,
        radial * r2 * r2 * r2,
    )


@compiled
def _calibration_sigma(
    theta: Doubles, along: Doubles, camera: Doubles, lens: Doubles, pose: Doubles, covariance: Doubles, slopes: Doubles
) -> float:
    """Return 1 sigma in mm along the ray from the covariance (26, 26) of the rig; NaN where that is empty.

    along (4,): mm along the ray a px of u, v, x, y. The parameters are those of uncertainty.RIG_NAMES.
    """
    if covariance.shape[0] == 0:
        return math.nan
    x, y, w = theta
    slopes[:10] = _over_lens(x, y, camera, along[0], along[1])
    tx = (pose[0] * x + pose[1] * y + pose[2]) / w
    ty = (pose[3] * x + pose[4] * y + pose[5]) / w
    tz = (pose[6] * x + pose[7] * y + pose[8]) / w
    z = tz + pose[11]
    nx, ny = (tx + pose[9]) / z, (ty + pose[10]) / z
    slopes[10:20] = _over_lens(nx, ny, lens, along[2], along[3])
    _, _, ux, uy, vx, vy = _pixel(nx, ny, lens)
    fx, fy = (along[2] * ux + along[3] * vx) / z, (along[2] * uy + along[3] * vy) / z
    fz = -(fx * nx + fy * ny)
    slopes[20], slopes[21], slopes[22] = ty * fz - tz * fy, tz * fx - tx * fz, tx * fy - ty * fx
    slopes[23], slopes[24], slopes[25] = fx, fy, fz
    total = 0.0
    for a in range(26):
        partial = 0.0
        for b in range(a):
            partial += covariance[a, b] * slopes[b]
        total += slopes[a] * (2.0 * partial + covariance[a, a] * slopes[a])
    return 0.0 if total < 0.0 else math.sqrt(total)


@compiled
def _along_the_ray(
    theta: Doubles, axis: int, camera: Doubles, lens: Doubles, pose: Doubles, jacobian: Doubles, out: Doubles
) -> None:
    """Write mm along the ray a px of u, v, x, y (4,) of the point that camera pixel and one projector axis give."""
    x, y, w = theta
    _seen(x, y, w, pose, lens, jacobian)
    _, _, ux, uy, vx, vy = _pixel(x, y, camera)
    length = math.sqrt(x * x + y * y + 1.0)
    out[3 - axis] = 0.0
    out[2 + axis] = -length / (w * w * jacobian[axis, 2])
    a = x / (w * length) - out[2 + axis] * jacobian[axis, 0]
    b = y / (w * length) - out[2 + axis] * jacobian[axis, 1]
    determinant = ux * vy - uy * vx
    out[0], out[1] = (a * vy - b * vx) / determinant, (b * ux - a * uy) / determinant


@compiled
def ray_plane_rows(
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
    """Write the ray-plane point of every row."""
    jacobian, theta, along, slopes = np.empty((2, 3)), np.empty(3), np.empty(4), np.empty(26)
    px, deviation = np.empty(2), np.empty(2)
    for i in range(camera_xy.shape[0]):
        px[0], px[1] = projector_xy[i, 0], projector_xy[i, 1]
        deviation[0], deviation[1] = sigma[i, 0], sigma[i, 1]
        x, y = _normalize(float(camera_xy[i, 0]), float(camera_xy[i, 1]), camera)
        w, sigma_mm[i], residual_px[i], axis = _best_axis(x, y, px, deviation, pose, projector)
        xyz[i, 0], xyz[i, 1], xyz[i, 2] = x / w, y / w, 1.0 / w
        if covariance.shape[0] == 0:
            sigma_cal_mm[i] = math.nan
            continue
        theta[0], theta[1], theta[2] = x, y, w
        _along_the_ray(theta, axis, camera, projector, pose, jacobian, along)
        sigma_cal_mm[i] = _calibration_sigma(theta, along, camera, projector, pose, covariance, slopes)
