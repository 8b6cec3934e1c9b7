"""Ray-plane triangulation by blocks of rows. Importing this module imports numba: do it inside functions only."""

from __future__ import annotations

import math

import numpy as np

from slkit.triangulation import _block_kernels as blocks
from slkit.triangulation._block_kernels import (
    AP,
    AQ,
    AU,
    AV,
    AX,
    AY,
    AZ,
    BLOCK,
    CAL,
    FIRST,
    MISS,
    MM,
    SLOTS,
    SX,
    SY,
    A,
    B,
    Numbers,
    P,
    Q,
    T,
    W,
    X,
    Y,
)
from slkit.triangulation._kernels import _MARGIN, _SMALLEST_SIGMA_PX, _SOLVED_PX, Doubles, Singles, _pixel, compiled

_NEARLY_PX = 1e-4


@compiled
def _choose(s: Doubles, lens: Numbers, pose: Numbers) -> int:
    """Choose again between two coded axes, where they are met; return how many rows change to the other one."""
    tx, ty, tz = pose[9], pose[10], pose[11]
    changed = 0
    for i in range(BLOCK):
        w, p, q, sx, sy = s[W + i], s[P + i], s[Q + i], s[SX + i], s[SY + i]
        over = 1.0 / (s[AZ + i] + w * tz)
        nx, ny = (s[AX + i] + w * tx) * over, (s[AY + i] + w * ty) * over
        _, _, ux, uy, vx, vy = _pixel(nx, ny, lens)
        dnx, dny = tx - nx * tz, ty - ny * tz
        known = math.isfinite(sx + sy)
        along_x = abs(ux * dnx + uy * dny) * (max(sy, _SMALLEST_SIGMA_PX) if known else 1.0)
        along_y = abs(vx * dnx + vy * dny) * (max(sx, _SMALLEST_SIGMA_PX) if known else 1.0)
        both, before = math.isfinite(p + q) & math.isfinite(w), s[FIRST + i]
        after = (1.0 if along_x >= along_y else 0.0) if both else before
        s[FIRST + i] = after
        s[T + i] = p if after > 0.5 else q
        changed += after != before
    return changed


@compiled
def _judge(s: Doubles, lens: Numbers, pose: Numbers) -> None:
    """Make NaN what is no solution; write sigma, residual and mm along the ray a px of the projector."""
    tx, ty, tz = pose[9], pose[10], pose[11]
    for i in range(BLOCK):
        x, y, w, first = s[X + i], s[Y + i], s[W + i], s[FIRST + i] > 0.5
        depth = s[AZ + i] + w * tz
        over = 1.0 / depth
        nx, ny = (s[AX + i] + w * tx) * over, (s[AY + i] + w * ty) * over
        u, v, ux, uy, vx, vy = _pixel(nx, ny, lens)
        p, q, sx, sy = s[P + i], s[Q + i], s[SX + i], s[SY + i]
        error, miss = (u - p, v - q) if first else (v - q, u - p)
        over_x, over_y = (ux, uy) if first else (vx, vy)
        slope = (over_x * (tx - nx * tz) + over_y * (ty - ny * tz)) * over
        # A bent sheet of light can meet the ray twice; where the sheet's image ends no light comes from.
        other, extent = (v, lens[11]) if first else (u, lens[10])
        lit = (other >= -_MARGIN * extent) & (other <= (1.0 + _MARGIN) * extent)
        ahead = (w > 0.0) & (depth > 0.0) & (ux * vy - uy * vx > 0.0) & (vy > 0.0)
        w = w if ahead & lit & (abs(error) < _SOLVED_PX) else math.nan
        a_px = math.sqrt(x * x + y * y + 1.0) / (w * w * slope)
        s[W + i] = w
        s[AP + i], s[AQ + i] = -a_px if first else 0.0, 0.0 if first else -a_px
        s[MM + i] = abs(a_px) * (sx if first else sy)
        s[MISS + i] = abs(miss) + 0.0 * w
        # What the coordinate changes a unit of x and of y.
        s[A + i] = (over_x * (pose[0] - nx * pose[6]) + over_y * (pose[3] - ny * pose[6])) * over
        s[B + i] = (over_x * (pose[1] - nx * pose[7]) + over_y * (pose[4] - ny * pose[7])) * over


@compiled
def _along(s: Doubles, camera: Numbers) -> None:
    """Write mm along the ray a px of the camera."""
    for i in range(BLOCK):
        x, y, w = s[X + i], s[Y + i], s[W + i]
        _, _, ux, uy, vx, vy = _pixel(x, y, camera)
        length = math.sqrt(x * x + y * y + 1.0)
        a_px = s[AP + i] + s[AQ + i]
        a = x / (w * length) - a_px * s[A + i]
        b = y / (w * length) - a_px * s[B + i]
        determinant = ux * vy - uy * vx
        s[AU + i], s[AV + i] = (a * vy - b * vx) / determinant, (b * ux - a * uy) / determinant


@compiled
def ray_plane_blocks(
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
    """Write the ray-plane point of every row, NaN where none is found from the plane without distortion."""
    s, slopes = np.zeros(SLOTS * BLOCK), np.zeros((blocks.RIG + 2) * BLOCK)
    s[CAL : CAL + BLOCK] = math.nan
    for first in range(0, len(camera_xy), BLOCK):
        count = min(BLOCK, len(camera_xy) - first)
        blocks.aim(s, first, count, (camera_xy, projector_xy, sigma), camera, lens, pose, _NEARLY_PX)
        if _choose(s, lens, pose):
            blocks.meet(s, lens, pose, _NEARLY_PX)
        _judge(s, lens, pose)
        if len(half):
            _along(s, camera)
            blocks.over_rig(s, slopes, camera, lens, pose)
            blocks.calibration_sigma(s, slopes, half)
        blocks.store(s, first, count, xyz, sigma_mm, residual_px, sigma_cal_mm)
