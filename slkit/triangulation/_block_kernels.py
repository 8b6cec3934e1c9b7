"""What the compiled loops of triangulation do for a block of rows at a time, so that every step is vector arithmetic.

Importing this module imports numba: do it inside functions only. Rays, lenses and poses are those of `_kernels`, with
lenses and poses as tuples.

The numbers of a block lie in one flat array, a slot of BLOCK values each at a constant place: with an array each the
compiler would have to doubt whether they overlap. Newton's method steps all rows of a block until the last has arrived.
What cannot be solved becomes NaN; the caller tries those rows one by one. Only the place of arrival is judged, not the
way there: where extreme distortion leaves several, it may be another one than that of the loop of single rows.
"""

from __future__ import annotations

import math

from slkit.triangulation._kernels import (
    _SMALLEST_SIGMA_PX,
    _STEPS,
    Doubles,
    Numbers,
    Singles,
    _distort,
    _over_lens,
    _pixel,
    compiled,
)

BLOCK = 64
"""Rows at a time: all that is known of them stays in the processor's nearest cache."""
SLOTS = 24
U, V, P, Q, SX, SY = (k * BLOCK for k in range(6))
"""Camera pixel, projector pixel, standard deviations of the latter, in px."""
X, Y, W = (k * BLOCK for k in range(6, 9))
"""The ray's normalised coordinates, and 1 / z."""
AX, AY, AZ = (k * BLOCK for k in range(9, 12))
"""The ray's direction (x, y, 1) in the projector's frame."""
T, FIRST = (k * BLOCK for k in range(12, 14))
"""The coordinate that is met, and 1 where that is x, 0 where it is y."""
AU, AV, AP, AQ = (k * BLOCK for k in range(14, 18))
"""mm along the ray a px of camera and projector."""
MM, MISS, CAL, PART = (k * BLOCK for k in range(18, 22))
"""sigma_decoding_mm, residual_px, sigma_cal_mm; a sum in the making."""
A, B = (k * BLOCK for k in range(22, 24))
"""For use within one step."""

RIG = 26
"""So many parameters a rig has; the slopes have two slots more, which are zero, to be taken four at a time."""
_NEARLY = 1e-8  # Newton's last step squares what is missing


@compiled
def load(s: Doubles, first: int, count: int, camera_xy: Singles, projector_xy: Singles, sigma: Singles) -> None:
    """Fill the first six slots from so many rows; beyond them all is NaN, which no step waits for."""
    s[: 6 * BLOCK] = math.nan
    for i in range(count):
        s[U + i], s[V + i] = camera_xy[first + i, 0], camera_xy[first + i, 1]
        s[P + i], s[Q + i] = projector_xy[first + i, 0], projector_xy[first + i, 1]
        s[SX + i], s[SY + i] = sigma[first + i, 0], sigma[first + i, 1]


@compiled
def normalize(s: Doubles, lens: Numbers) -> None:
    """Write the undistorted normalised point of each camera pixel, NaN where the lens model has no inverse."""
    for i in range(BLOCK):
        y = (s[V + i] - lens[4]) / lens[3]
        x = (s[U + i] - lens[2] - lens[1] * y) / lens[0]
        s[A + i] = s[X + i] = x
        s[B + i] = s[Y + i] = y
    for _ in range(_STEPS):
        left = 0
        for i in range(BLOCK):
            x, y = s[X + i], s[Y + i]
            dx, dy, a, b, c = _distort(x, y, lens)
            ex, ey = dx - s[A + i], dy - s[B + i]
            over = 1.0 / (a * c - b * b)
            s[X + i] = x - (c * ex - b * ey) * over
            s[Y + i] = y - (a * ey - b * ex) * over
            left += abs(ex) + abs(ey) > _NEARLY
        if left == 0:
            break
    for i in range(BLOCK):
        dx, dy, a, b, c = _distort(s[X + i], s[Y + i], lens)
        miss = abs(dx - s[A + i]) + abs(dy - s[B + i])
        # Beyond the fold of the polynomial lie roots that no light ray takes.
        good = (miss < 1e-9) & (a * c - b * b > 0.0) & (a > 0.0)
        s[X + i] = s[X + i] if good else math.nan


@compiled
def turn(s: Doubles, pose: Numbers) -> None:
    """Turn the rays into the projector's frame."""
    for i in range(BLOCK):
        x, y = s[X + i], s[Y + i]
        s[AX + i] = pose[0] * x + pose[1] * y + pose[2]
        s[AY + i] = pose[3] * x + pose[4] * y + pose[5]
        s[AZ + i] = pose[6] * x + pose[7] * y + pose[8]


@compiled
def begin(s: Doubles, lens: Numbers, pose: Numbers) -> None:
    """Choose an axis for each row, and write where the ray meets its coordinate without distortion.

    Of two coded axes it is the one whose sigma is the shorter way along the ray.
    """
    for i in range(BLOCK):
        p, q, ax, ay, az = s[P + i], s[Q + i], s[AX + i], s[AY + i], s[AZ + i]
        along_x = lens[0] * pose[9] + lens[1] * pose[10] + (lens[2] - p) * pose[11]
        along_y = lens[3] * pose[10] + (lens[4] - q) * pose[11]
        known = math.isfinite(s[SX + i] + s[SY + i])
        sx = max(s[SX + i], _SMALLEST_SIGMA_PX) if known else 1.0
        sy = max(s[SY + i], _SMALLEST_SIGMA_PX) if known else 1.0
        first = (abs(along_x) * sy >= abs(along_y) * sx) | math.isnan(q)
        here_x = lens[0] * ax + lens[1] * ay + (lens[2] - p) * az
        here_y = lens[3] * ay + (lens[4] - q) * az
        s[FIRST + i] = 1.0 if first else 0.0
        s[T + i] = p if first else q
        s[W + i] = -here_x / along_x if first else -here_y / along_y


@compiled
def meet(s: Doubles, lens: Numbers, pose: Numbers, nearly: float) -> None:
    """Move along the ray to where it meets the coordinate; the last step starts from `nearly` px at most."""
    tx, ty, tz = pose[9], pose[10], pose[11]
    for _ in range(_STEPS):
        left = 0
        for i in range(BLOCK):
            w = s[W + i]
            over = 1.0 / (s[AZ + i] + w * tz)
            nx, ny = (s[AX + i] + w * tx) * over, (s[AY + i] + w * ty) * over
            u, v, ux, uy, vx, vy = _pixel(nx, ny, lens)
            dnx, dny = (tx - nx * tz) * over, (ty - ny * tz) * over
            first = s[FIRST + i] > 0.5
            error = (u if first else v) - s[T + i]
            slope = ux * dnx + uy * dny if first else vx * dnx + vy * dny
            s[W + i] = w - error / slope
            left += abs(error) > nearly
        if left == 0:
            break


@compiled
def _put(slopes: Doubles, place: int, ten: Numbers) -> None:
    """Write ten numbers, a slot each."""
    slopes[place], slopes[place + BLOCK], slopes[place + 2 * BLOCK] = ten[0], ten[1], ten[2]
    slopes[place + 3 * BLOCK], slopes[place + 4 * BLOCK], slopes[place + 5 * BLOCK] = ten[3], ten[4], ten[5]
    slopes[place + 6 * BLOCK], slopes[place + 7 * BLOCK] = ten[6], ten[7]
    slopes[place + 8 * BLOCK], slopes[place + 9 * BLOCK] = ten[8], ten[9]


@compiled
def aim(
    s: Doubles,
    first: int,
    count: int,
    given: tuple[Singles, Singles, Singles],
    camera: Numbers,
    lens: Numbers,
    pose: Numbers,
    nearly: float,
) -> None:
    """Write rays, and where they meet the better coordinate, of so many rows; nearly: see `meet`."""
    load(s, first, count, given[0], given[1], given[2])
    normalize(s, camera)
    turn(s, pose)
    begin(s, lens, pose)
    meet(s, lens, pose, nearly)


@compiled
def over_rig(s: Doubles, slopes: Doubles, camera: Numbers, lens: Numbers, pose: Numbers) -> None:
    """Write mm along the ray a unit of each of uncertainty.RIG_NAMES to slopes (26 * BLOCK,), from those a px."""
    for i in range(BLOCK):
        _put(slopes, i, _over_lens(s[X + i], s[Y + i], camera, s[AU + i], s[AV + i]))
    for i in range(BLOCK):
        z = 1.0 / s[W + i]
        tx, ty, tz = s[AX + i] * z, s[AY + i] * z, s[AZ + i] * z
        over = 1.0 / (tz + pose[11])
        nx, ny = (tx + pose[9]) * over, (ty + pose[10]) * over
        _put(slopes, 10 * BLOCK + i, _over_lens(nx, ny, lens, s[AP + i], s[AQ + i]))
        _, _, ux, uy, vx, vy = _pixel(nx, ny, lens)
        fx = (s[AP + i] * ux + s[AQ + i] * vx) * over
        fy = (s[AP + i] * uy + s[AQ + i] * vy) * over
        fz = -(fx * nx + fy * ny)
        slopes[20 * BLOCK + i] = ty * fz - tz * fy
        slopes[21 * BLOCK + i] = tz * fx - tx * fz
        slopes[22 * BLOCK + i] = tx * fy - ty * fx
        slopes[23 * BLOCK + i], slopes[24 * BLOCK + i], slopes[25 * BLOCK + i] = fx, fy, fz


@compiled
def calibration_sigma(s: Doubles, slopes: Doubles, half: Doubles) -> None:
    """Write sigma_cal_mm from the slopes and the rig's covariance (26, 28): below its diagonal, and half of that."""
    s[CAL : CAL + BLOCK] = 0.0
    for a in range(RIG):
        if half[a, a] == 0.0:  # not estimated
            continue
        s[PART : PART + BLOCK] = 0.0
        # Four at a time: their sum is loaded and stored once.
        for b in range(0, a + 1, 4):
            c0, c1, c2, c3 = half[a, b], half[a, b + 1], half[a, b + 2], half[a, b + 3]
            at = b * BLOCK
            for i in range(BLOCK):
                k = at + i
                two = c0 * slopes[k] + c1 * slopes[k + BLOCK]
                s[PART + i] += two + (c2 * slopes[k + 2 * BLOCK] + c3 * slopes[k + 3 * BLOCK])
        for i in range(BLOCK):
            s[CAL + i] += slopes[a * BLOCK + i] * s[PART + i]
    for i in range(BLOCK):
        s[CAL + i] = math.sqrt(max(2.0 * s[CAL + i], 0.0))


@compiled
def store(
    s: Doubles,
    first: int,
    count: int,
    xyz: Singles,
    sigma_mm: Singles,
    residual_px: Singles,
    sigma_cal_mm: Singles,
) -> None:
    """Write the points and results of so many rows."""
    for i in range(count):
        z = 1.0 / s[W + i]
        xyz[first + i, 0], xyz[first + i, 1], xyz[first + i, 2] = s[X + i] * z, s[Y + i] * z, z
        sigma_mm[first + i], residual_px[first + i] = s[MM + i], s[MISS + i]
        sigma_cal_mm[first + i] = s[CAL + i]
