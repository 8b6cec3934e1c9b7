"""Two-ray triangulation by blocks of rows. Importing this module imports numba: do it inside functions only."""

from __future__ import annotations

import math

import numpy as np

from slkit.triangulation import _block_kernels as blocks
from slkit.triangulation._block_kernels import (
    AP,
    AQ,
    AU,
    AV,
    BLOCK,
    CAL,
    MISS,
    MM,
    RIG,
    SLOTS,
    SX,
    SY,
    Numbers,
    P,
    Q,
    U,
    V,
    W,
    X,
    Y,
)
from slkit.triangulation._kernels import _SMALLEST_SIGMA_PX, _STEPS, Doubles, Singles, _pixel, compiled

WU, WV, WP, WQ = (k * BLOCK for k in range(SLOTS, SLOTS + 4))
"""1 / variance of camera and projector pixel."""
UX, UY, VX, VY, PX, PY, PW, QX, QY, QW = (k * BLOCK for k in range(SLOTS + 4, SLOTS + 14))
"""Derivatives of camera and projector pixel over x, y, w."""
M0, M1, M2, M3, M4, M5 = (k * BLOCK for k in range(SLOTS + 14, SLOTS + 20))
"""The normal equations' matrix: xx, xy, yy, xw, yw, ww."""
R0, R1, R2, SQUARE = (k * BLOCK for k in range(SLOTS + 20, SLOTS + 24))
"""Their right side, and the squared residual in px."""
S0, S1, S2 = (k * BLOCK for k in range(SLOTS + 24, SLOTS + 27))
"""Their solution."""
_ALL = SLOTS + 27

_ABOUT_PX = 1.0  # where Gauss-Newton takes over
_NEARLY = 1e-9  # of a variance; every step leaves a small share of what the one before moved


@compiled
def _weigh(s: Doubles, camera: Numbers, lens: Numbers) -> None:
    """Share each variance between camera and projector and write 1 / variance of u, v, p, q."""
    for i in range(BLOCK):
        sx, sy = s[SX + i], s[SY + i]
        known = math.isfinite(sx + sy)
        sx = max(sx, _SMALLEST_SIGMA_PX) / lens[0] if known else 1.0 / lens[0]
        sy = max(sy, _SMALLEST_SIGMA_PX) / lens[3] if known else 1.0 / lens[3]
        least = min(sx, sy)
        shared = 0.5 * least * least
        s[WU + i], s[WV + i] = 1.0 / (shared * camera[0] * camera[0]), 1.0 / (shared * camera[3] * camera[3])
        s[WP + i] = 1.0 / ((sx * sx - shared) * lens[0] * lens[0])
        s[WQ + i] = 1.0 / ((sy * sy - shared) * lens[3] * lens[3])


@compiled
def _linearize(s: Doubles, camera: Numbers, lens: Numbers, pose: Numbers) -> None:
    """Write errors, derivatives and normal equations at (x, y, w); NaN behind the projector or its fold."""
    for i in range(BLOCK):
        x, y, w = s[X + i], s[Y + i], s[W + i]
        u, v, ux, uy, vx, vy = _pixel(x, y, camera)
        depth = pose[6] * x + pose[7] * y + pose[8] + w * pose[11]
        over = 1.0 / depth
        nx = (pose[0] * x + pose[1] * y + pose[2] + w * pose[9]) * over
        ny = (pose[3] * x + pose[4] * y + pose[5] + w * pose[10]) * over
        p, q, a, b, c, d = _pixel(nx, ny, lens)
        over = over if (depth > 0.0) & (a * d - b * c > 0.0) & (d > 0.0) else math.nan
        dx, dy = (pose[0] - nx * pose[6]) * over, (pose[3] - ny * pose[6]) * over
        px, qx = a * dx + b * dy, c * dx + d * dy
        dx, dy = (pose[1] - nx * pose[7]) * over, (pose[4] - ny * pose[7]) * over
        py, qy = a * dx + b * dy, c * dx + d * dy
        dx, dy = (pose[9] - nx * pose[11]) * over, (pose[10] - ny * pose[11]) * over
        pw, qw = a * dx + b * dy, c * dx + d * dy
        wu, wv, wp, wq = s[WU + i], s[WV + i], s[WP + i], s[WQ + i]
        u, v, p, q = s[U + i] - u, s[V + i] - v, s[P + i] - p, s[Q + i] - q
        s[UX + i], s[UY + i], s[VX + i], s[VY + i] = ux, uy, vx, vy
        s[PX + i], s[PY + i], s[PW + i], s[QX + i], s[QY + i], s[QW + i] = px, py, pw, qx, qy, qw
        s[M0 + i] = wu * ux * ux + wv * vx * vx + wp * px * px + wq * qx * qx
        s[M1 + i] = wu * ux * uy + wv * vx * vy + wp * px * py + wq * qx * qy
        s[M2 + i] = wu * uy * uy + wv * vy * vy + wp * py * py + wq * qy * qy
        s[M3 + i], s[M4 + i] = wp * px * pw + wq * qx * qw, wp * py * pw + wq * qy * qw
        s[M5 + i] = wp * pw * pw + wq * qw * qw
        s[R0 + i] = wu * ux * u + wv * vx * v + wp * px * p + wq * qx * q
        s[R1 + i] = wu * uy * u + wv * vy * v + wp * py * p + wq * qy * q
        s[R2 + i] = wp * pw * p + wq * qw * q
        s[SQUARE + i] = u * u + v * v + p * p + q * q


@compiled
def _solve(s: Doubles) -> None:
    """Solve the normal equations by L D L^T; NaN where their matrix is not positive."""
    for i in range(BLOCK):
        d0 = s[M0 + i]
        l1, l3 = s[M1 + i] / d0, s[M3 + i] / d0
        d1 = s[M2 + i] - l1 * s[M1 + i]
        n4 = s[M4 + i] - l3 * s[M1 + i]
        l4 = n4 / d1
        d2 = s[M5 + i] - l3 * s[M3 + i] - l4 * n4
        y1 = s[R1 + i] - l1 * s[R0 + i]
        y2 = s[R2 + i] - l3 * s[R0 + i] - l4 * y1
        s2 = y2 / d2 if (d0 > 0.0) & (d1 > 0.0) & (d2 > 0.0) else math.nan
        s1 = y1 / d1 - l4 * s2
        s[S0 + i], s[S1 + i], s[S2 + i] = s[R0 + i] / d0 - l1 * s1 - l3 * s2, s1, s2


@compiled
def _refine(s: Doubles, camera: Numbers, lens: Numbers, pose: Numbers) -> None:
    """Move ray and depth by Gauss-Newton to where the weighted error is smallest, and linearize there."""
    for _ in range(_STEPS):
        _linearize(s, camera, lens, pose)
        _solve(s)
        left = 0
        for i in range(BLOCK):
            a, b, c = s[S0 + i], s[S1 + i], s[S2 + i]
            s[X + i] += a
            s[Y + i] += b
            s[W + i] += c
            # A step is judged by what it moves in the pictures, in units of sigma.
            left += s[M0 + i] * a * a + s[M2 + i] * b * b + s[M5 + i] * c * c > _NEARLY
        if left == 0:
            break
    _linearize(s, camera, lens, pose)


@compiled
def _judge(s: Doubles) -> None:
    """Make NaN what is no solution; write sigma, residual, and mm along the ray a px of either device."""
    for i in range(BLOCK):
        x, y, w = s[X + i], s[Y + i], s[W + i]
        a, b, c = s[S0 + i], s[S1 + i], s[S2 + i]
        moved = s[M0 + i] * a * a + s[M2 + i] * b * b + s[M5 + i] * c * c
        w = w if (w > 0.0) & (moved <= _NEARLY) else math.nan
        length = math.sqrt(x * x + y * y + 1.0)
        s[W + i] = w
        s[MISS + i] = math.sqrt(s[SQUARE + i]) + 0.0 * w
        s[R0 + i], s[R1 + i], s[R2 + i] = x / (w * length), y / (w * length), -length / (w * w)
    _solve(s)
    for i in range(BLOCK):
        a, b, c = s[S0 + i], s[S1 + i], s[S2 + i]
        sx, sy = s[SX + i], s[SY + i]
        s[MM + i] = math.sqrt(s[R0 + i] * a + s[R1 + i] * b + s[R2 + i] * c) + 0.0 * (sx + sy)
        s[AU + i] = s[WU + i] * (s[UX + i] * a + s[UY + i] * b)
        s[AV + i] = s[WV + i] * (s[VX + i] * a + s[VY + i] * b)
        s[AP + i] = s[WP + i] * (s[PX + i] * a + s[PY + i] * b + s[PW + i] * c)
        s[AQ + i] = s[WQ + i] * (s[QX + i] * a + s[QY + i] * b + s[QW + i] * c)


@compiled
def two_rays_blocks(
    camera_xy: Singles,
    projector_xy: Singles,
    sigma: Singles,
    camera: Numbers,
    lens: Numbers,
    pose: Numbers,
    half: Doubles,
    xyz: Singles,
    sigma_mm: Singles,
    residual_px: Singles,
    sigma_cal_mm: Singles,
) -> None:
    """Write the reprojection-optimal point of every row, NaN where none is found from the plane without distortion."""
    s, slopes = np.zeros(_ALL * BLOCK), np.zeros((RIG + 2) * BLOCK)
    s[CAL : CAL + BLOCK] = math.nan
    for first in range(0, len(camera_xy), BLOCK):
        count = min(BLOCK, len(camera_xy) - first)
        blocks.aim(s, first, count, (camera_xy, projector_xy, sigma), camera, lens, pose, _ABOUT_PX)
        _weigh(s, camera, lens)
        _refine(s, camera, lens, pose)
        _judge(s)
        if len(half):
            blocks.turn(s, pose)
            blocks.over_rig(s, slopes, camera, lens, pose)
            blocks.calibration_sigma(s, slopes, half)
        blocks.store(s, first, count, xyz, sigma_mm, residual_px, sigma_cal_mm)
