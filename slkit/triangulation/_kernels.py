"""The compiled loops of triangulation. Importing this module imports numba: do it inside functions only.

A viewing ray is held as undistorted normalised coordinates x, y and inverse depth w = 1 / z: along it the projector's
picture is a ratio of two linear functions of w, so that Newton's method is well behaved from the nearest point to
infinity. The derivatives are analytic. A lens is (fx, skew, cx, fy, cy, k1, k2, p1, p2, k3, width, height), a pose the
nine numbers of the rotation, row by row, and the translation.

All that is compiled stays in this one file: numba's cache does not see a change in the file of a function it calls.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
_Three = tuple[float, float, float]
_Best = tuple[float, float, float, int]

_compiled = njit(cache=True, nogil=True, error_model="numpy")  # a division by zero is data, not an error

_STEPS = 30
_EXACT_PX = 1e-9  # Newton stops here; a double holds a thousand pixels to 1e-13
_SOLVED_PX = 1e-6
_MARGIN = 0.1  # of the projector image: room for a rig that is not perfect
_SMALLEST_SIGMA_PX = 1e-3  # a float32 pixel coordinate is not better


@_compiled
def _distort(x: float, y: float, lens: Doubles) -> tuple[float, float, float, float, float]:
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


@_compiled
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


@_compiled
def _pixel(x: float, y: float, lens: Doubles) -> tuple[float, float, float, float, float, float]:
    """Return the pixel u, v of an undistorted normalised point and du/dx, du/dy, dv/dx, dv/dy."""
    dx, dy, a, b, c = _distort(x, y, lens)
    u = lens[0] * dx + lens[1] * dy + lens[2]
    v = lens[3] * dy + lens[4]
    return u, v, lens[0] * a + lens[1] * b, lens[0] * b + lens[1] * c, lens[3] * b, lens[3] * c


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
def _over_lens(x: float, y: float, lens: Doubles, along: Doubles, gradient: Doubles) -> None:
    """Write along . d(u, v) / d lens (10,) to gradient, in the order of geometry.LENS_NAMES."""
    dx, dy, _, _, _ = _distort(x, y, lens)
    over_dx = along[0] * lens[0]
    over_dy = along[0] * lens[1] + along[1] * lens[3]
    r2, radial = x * x + y * y, over_dx * x + over_dy * y
    gradient[0], gradient[1], gradient[4] = along[0] * dx, along[1] * dy, along[0] * dy
    gradient[2], gradient[3] = along[0], along[1]
    gradient[5], gradient[6], gradient[9] = radial * r2, radial * r2**2, radial * r2**3
    gradient[7] = over_dx * 2.0 * x * y + over_dy * (r2 + 2.0 * y * y)
    gradient[8] = over_dx * (r2 + 2.0 * x * x) + over_dy * 2.0 * x * y


@_compiled
def _calibration_sigma(
    theta: Doubles, along: Doubles, camera: Doubles, lens: Doubles, pose: Doubles, covariance: Doubles, slopes: Doubles
) -> float:
    """Return 1 sigma in mm along the ray from the covariance (26, 26) of the rig; NaN where that is empty.

    along (4,): mm along the ray a px of u, v, x, y. The parameters are those of uncertainty.RIG_NAMES.
    """
    if covariance.shape[0] == 0:
        return math.nan
    x, y, w = theta
    _over_lens(x, y, camera, along[:2], slopes[:10])
    tx = (pose[0] * x + pose[1] * y + pose[2]) / w
    ty = (pose[3] * x + pose[4] * y + pose[5]) / w
    tz = (pose[6] * x + pose[7] * y + pose[8]) / w
    z = tz + pose[11]
    nx, ny = (tx + pose[9]) / z, (ty + pose[10]) / z
    _over_lens(nx, ny, lens, along[2:], slopes[10:20])
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


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
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


@_compiled
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
