"""Cameras and projectors: pinholes with skew and Brown distortion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry.checks import Floats, as_floats, as_size
from slkit.geometry.rays import homogeneous

DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3")
LENS_NAMES = ("fx", "fy", "cx", "cy", "skew", *DISTORTION_NAMES)
"""The parameters of a lens in the order of `Pinhole.parameters` and of every `d_lens`."""
_UNDISTORTION_STEPS = 20
_UNDISTORTION_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A camera, or a projector seen as an inverse camera.

    size (width, height) px; K (3, 3) with skew K[0, 1]; distortion (5,) k1 k2 p1 p2 k3. The principal point may lie
    outside the image. Errors: InputError where a size or focal length is not positive or a shape is wrong.
    Source: Fernandez and Salvi (2011), equations (1) and (2) with K[2, 2] = 1; Brown's distortion.
    """

    size: tuple[int, int]
    K: Floats
    distortion: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", as_size(self.size, "size"))
        matrix = as_floats(self.K, (3, 3), "K")
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise InputError("K must have positive focal lengths")
        if np.any(matrix[[1, 2, 2, 2], [0, 0, 1, 2]] != [0, 0, 0, 1]):
            raise InputError("K must be upper triangular with 1 in its last corner")
        object.__setattr__(self, "K", matrix)
        object.__setattr__(self, "distortion", as_floats(self.distortion, (5,), "distortion"))

    @property
    def parameters(self) -> npt.NDArray[np.float64]:
        """The values (10,) of LENS_NAMES, px and unitless."""
        (fx, skew, cx), (_, fy, cy), _ = self.K
        return np.array([fx, fy, cx, cy, skew, *self.distortion], dtype=np.float64)

    def project(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pixels (..., 2) at which points (..., 3) of this device's own frame (mm) appear.

        Points at or behind the lens give NaN.
        """
        points = np.asarray(xyz, dtype=np.float64)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return self.from_normalized(points[..., :2] / z[..., None])

    def from_normalized(self, xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pixels (..., 2) of undistorted normalised coordinates (..., 2), unitless."""
        d = distort(np.asarray(xy, dtype=np.float64), self.distortion)
        return np.asarray(d @ self.K[:2, :2].T + self.K[:2, 2], dtype=np.float64)

    def normalize(self, xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the undistorted normalised coordinates (..., 2), unitless, of pixels (..., 2).

        Newton's method on the distortion polynomial; where it has no inverse (far outside the image) the result is NaN.
        """
        pixels = np.asarray(xy, dtype=np.float64) - self.K[:2, 2]
        y = pixels[..., 1] / self.K[1, 1]
        target = np.stack([(pixels[..., 0] - self.K[0, 1] * y) / self.K[0, 0], y], axis=-1)
        if not self.distortion.any():
            return target
        found = target.copy()
        with np.errstate(all="ignore"):
            for _ in range(_UNDISTORTION_STEPS):
                error = distort(found, self.distortion) - target
                a, b, c, d = distort_slopes(found, self.distortion)
                determinant = a * d - b * c
                step = np.stack(
                    [(d * error[..., 0] - b * error[..., 1]), (a * error[..., 1] - c * error[..., 0])], axis=-1
                )
                found = found - step / determinant[..., None]
                if not np.nanmax(np.abs(error), initial=0) > _UNDISTORTION_TOLERANCE:
                    break
            wrong = np.abs(distort(found, self.distortion) - target).max(axis=-1) > 1e-9
            # Beyond the fold of the polynomial another point has the same image; no lens works there.
            a, b, c, d = distort_slopes(found, self.distortion)
            wrong = wrong | (a <= 0) | (a * d - b * c <= 0)
        found[wrong] = np.nan
        return found

    def rays(self) -> npt.NDArray[np.float64]:
        """Return for every pixel the direction (height, width, 3) with z = 1."""
        width, height = self.size
        xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return homogeneous(self.normalize(xy))


def distort(xy: Floats, distortion: Floats) -> npt.NDArray[np.float64]:
    """Return normalised coordinates (..., 2) as the lens bends them; distortion k1 k2 p1 p2 k3. Source: Brown."""
    k1, k2, p1, p2, k3 = distortion
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def distort_slopes(xy: Floats, distortion: Floats) -> tuple[Any, Any, Any, Any]:
    """Return the derivatives of `distort`, each (...): of x over x, of x over y, of y over x, of y over y."""
    k1, k2, p1, p2, k3 = distortion
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (
        radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
        mixed,
        mixed,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )
