"""The numba kernels of the simulator; imported only when rays are traced or a picture is taken."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from slkit.geometry import Floats

Whole = npt.NDArray[np.int64]


@numba.njit(cache=True, nogil=True, inline="always")
def _row(table: Floats, index: int) -> tuple[float, float, float]:
    return table[index, 0], table[index, 1], table[index, 2]


@numba.njit(cache=True, nogil=True, inline="always")
def _dot(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True, nogil=True)
def gather(pattern: Floats, xy: Floats, weight: Floats, scale: float, shift: float, out: Floats) -> None:
    """Add up what every sample of a camera pixel receives.

    pattern (H, W, p) with bilinear interpolation, 0 outside; xy (h, w, k, 2) px, looked up at scale * xy + shift;
    weight (h, w, k, c); out (h, w, max(p, c)) is overwritten.
    """
    rows, columns, patterns = pattern.shape
    height, width, samples, channels = weight.shape
    for row in range(height):
        for column in range(width):
            out[row, column] = 0
            for k in range(samples):
                if weight[row, column, k].max() <= 0:
                    continue
                x = scale * xy[row, column, k, 0] + shift
                y = scale * xy[row, column, k, 1] + shift
                i, j = int(np.floor(y)), int(np.floor(x))
                if i < 0 or j < 0 or i >= rows - 1 or j >= columns - 1:
                    continue
                b, a = np.float32(y - i), np.float32(x - j)
                for channel in range(out.shape[2]):
                    p = channel if patterns > 1 else 0
                    top = pattern[i, j, p] + a * (pattern[i, j + 1, p] - pattern[i, j, p])
                    low = pattern[i + 1, j, p] + a * (pattern[i + 1, j + 1, p] - pattern[i + 1, j, p])
                    share = weight[row, column, k, channel if channels > 1 else 0]
                    out[row, column, channel] += share * (top + b * (low - top))


@numba.njit(cache=True, nogil=True)
def look(xy: Floats, matrix: Floats, lens: Floats, rays: Floats) -> None:
    """Write to rays (m, 3) the directions, z = 1, of camera positions xy (m, 2) px.

    matrix, lens: K and distortion. Where the distortion has no inverse the ray is sent backwards (z = -1): there is
    nothing to see. Source: `Pinhole.normalize`, Newton's method.
    """
    k1, k2, p1, p2, k3 = lens
    for i in range(len(xy)):
        v = (xy[i, 1] - matrix[1, 2]) / matrix[1, 1]
        u = (xy[i, 0] - matrix[0, 2] - matrix[0, 1] * v) / matrix[0, 0]
        x, y, error, proper = u, v, np.inf, False
        for _ in range(20):
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
            ex = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - u
            ey = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - v
            error = max(abs(ex), abs(ey))
            a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
            b = x * y * slope + 2 * p1 * x + 2 * p2 * y
            d = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
            determinant = a * d - b * b
            # Beyond the turning point of the polynomial lie other roots, which no light takes.
            proper = radial > 0 and determinant > 0
            if error < 1e-13 or determinant == 0:
                break
            x -= (d * ex - b * ey) / determinant
            y -= (a * ey - b * ex) / determinant
        rays[i] = (x, y, 1.0)
        if not (error < 1e-9 and proper):
            rays[i] = (0.0, 0.0, -1.0)


@numba.njit(cache=True, nogil=True)
def meet(
    rays: Floats,
    depth: Floats,
    face: Whole,
    uv: Floats,
    vertices: Floats,
    faces: Whole,
    face_normals: Floats,
    normals: Floats,
    center: Floats,
    xyz: Floats,
    cosine: Floats,
) -> None:
    """Find where rays (m, 3) from the origin meet their triangles, and how squarely light from `center` falls there.

    depth (m,), face (m,), uv (m, 2): what the ray caster found, in single precision; xyz (m, 3) and cosine (m,) are
    overwritten. The cosine is that of the interpolated normal, 0 where the light is on the side away from the camera.
    """
    for i in range(len(rays)):
        flat = _row(face_normals, face[i])
        a, b, c = faces[face[i]]
        ray = _row(rays, i)
        exact = _dot(flat, _row(vertices, a)) / _dot(flat, ray)
        z = exact if abs(exact - depth[i]) < 1e-4 * depth[i] else depth[i]
        point = (ray[0] * z, ray[1] * z, ray[2] * z)
        xyz[i] = point
        towards = (center[0] - point[0], center[1] - point[1], center[2] - point[2])
        cosine[i] = 0
        if _dot(flat, ray) * _dot(flat, towards) < 0:
            na, nb, nc = _row(normals, a), _row(normals, b), _row(normals, c)
            p, q, r = 1 - uv[i, 0] - uv[i, 1], uv[i, 0], uv[i, 1]
            x, y = p * na[0] + q * nb[0] + r * nc[0], p * na[1] + q * nb[1] + r * nc[1]
            smooth = (x, y, p * na[2] + q * nb[2] + r * nc[2])
            lengths = np.sqrt(_dot(smooth, smooth) * _dot(towards, towards))
            side = -1.0 if _dot(smooth, ray) > 0 else 1.0
            cosine[i] = max(side * _dot(smooth, towards) / max(lengths, 1e-300), 0.0)


@numba.njit(cache=True, nogil=True)
def illuminate(
    xyz: Floats, pose: Floats, matrix: Floats, lens: Floats, radius: float, size: tuple[int, int], xy: Floats
) -> Floats:
    """Write to xy (m, 2) the projector pixels that light points xyz (m, 3) mm; return how far (m,) px off its image.

    A point outside the lens's field has NaN and lies infinitely far off; one inside the image has a negative number.

    pose (3, 4): projector_from_camera; matrix, lens, size: K, distortion and image; radius: of the field of view in
    normalised units, outside which the distortion polynomial may fold back. Source: `Pinhole.project`.
    """
    k1, k2, p1, p2, k3 = lens
    off = np.full(len(xyz), np.inf)
    for i in range(len(xyz)):
        point = _row(xyz, i)
        px, py = _dot(_row(pose, 0), point) + pose[0, 3], _dot(_row(pose, 1), point) + pose[1, 3]
        pz = _dot(_row(pose, 2), point) + pose[2, 3]
        xy[i] = np.nan
        if pz <= 0:
            continue
        x, y = px / pz, py / pz
        r2 = x * x + y * y
        if r2 > radius * radius:
            continue
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        xy[i, 0] = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]
        xy[i, 1] = matrix[1, 1] * v + matrix[1, 2]
        outside_x = abs(xy[i, 0] - (size[0] - 1) / 2) - size[0] / 2
        off[i] = max(outside_x, abs(xy[i, 1] - (size[1] - 1) / 2) - size[1] / 2)
    return off
