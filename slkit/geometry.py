"""Poses, lenses and rays in NumPy.

Pixel (0, 0) is the centre of the top-left pixel; x right, y down, z forward; millimetres. `docs/conventions.md` has
the whole list.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError

Floats = npt.NDArray[np.floating[Any]]

_UNDISTORTION_STEPS = 20
_UNDISTORTION_TOLERANCE = 1e-12


def as_floats(value: npt.ArrayLike, shape: tuple[int | None, ...], name: str) -> npt.NDArray[np.float64]:
    """Return `value` as a read-only float64 array of `shape` (None: any length).

    Errors: InputError naming `name` where the shape differs or a number is not finite.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers") from error
    fits = array.ndim == len(shape) and all(s in (None, n) for s, n in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = " x ".join("n" if s is None else str(s) for s in shape)
        raise InputError(f"{name} must have the shape {wanted}, not {' x '.join(map(str, array.shape)) or 'a scalar'}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds a number that is not finite")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion, named `b_from_a`: it takes points of frame a to frame b.

    rotation (3, 3), orthonormal with determinant +1; translation (3,) in mm.
    Errors: InputError where the rotation is not a rotation.
    """

    rotation: Floats
    translation: Floats

    def __post_init__(self) -> None:
        rotation = as_floats(self.rotation, (3, 3), "rotation")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise InputError("rotation must be orthonormal with determinant +1")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", as_floats(self.translation, (3,), "translation"))

    @classmethod
    def identity(cls) -> Pose:
        """Return the pose that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, vector: npt.ArrayLike, translation: npt.ArrayLike) -> Pose:
        """Return the pose that turns by |vector| radians about vector (3,) and then shifts by translation (3,) mm.

        Source: Rodrigues' formula.
        """
        v = as_floats(vector, (3,), "rotation vector")
        angle = float(np.linalg.norm(v))
        x, y, z = v
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        sine = np.sinc(angle / np.pi)
        cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
        return cls(np.eye(3) + sine * cross + cosine * cross @ cross, np.asarray(translation, dtype=np.float64))

    @property
    def rotation_vector(self) -> npt.NDArray[np.float64]:
        """The rotation as an axis times an angle in radians, (3,)."""
        # The quaternion is the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix: stable at every angle.
        r = self.rotation
        k = np.empty((4, 4))
        k[:3, :3] = r + r.T - np.trace(r) * np.eye(3)
        k[3, :3] = k[:3, 3] = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
        k[3, 3] = np.trace(r)
        q = np.linalg.eigh(k)[1][:, -1]
        q = q if q[3] >= 0 else -q
        length = float(np.linalg.norm(q[:3]))
        scale = 2.0 if length < 1e-12 else 2 * np.arctan2(length, q[3]) / length
        return scale * q[:3]

    @property
    def angle_deg(self) -> float:
        """The angle of the rotation in degrees, 0 to 180."""
        return float(np.degrees(np.linalg.norm(self.rotation_vector)))

    def __matmul__(self, other: Pose) -> Pose:
        """Return the pose that applies `other` first: c_from_b @ b_from_a is c_from_a."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        """Return a_from_b."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Move points (..., 3) in mm."""
        return np.asarray(np.asarray(xyz, dtype=np.float64) @ self.rotation.T + self.translation, dtype=np.float64)


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

    def project(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pixels (..., 2) at which points (..., 3) of this device's own frame (mm) appear.

        Points at or behind the lens give NaN.
        """
        points = np.asarray(xyz, dtype=np.float64)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return self.from_normalized(points[..., :2] / z[..., None])

    def from_normalized(self, xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pixels (..., 2) of undistorted normalised coordinates (..., 2), unitless."""
        d = _distort(np.asarray(xy, dtype=np.float64), self.distortion)
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
                error = _distort(found, self.distortion) - target
                a, b, c, d = _distort_jacobian(found, self.distortion)
                determinant = a * d - b * c
                step = np.stack(
                    [(d * error[..., 0] - b * error[..., 1]), (a * error[..., 1] - c * error[..., 0])], axis=-1
                )
                found = found - step / determinant[..., None]
                if not np.nanmax(np.abs(error), initial=0) > _UNDISTORTION_TOLERANCE:
                    break
            wrong = np.abs(_distort(found, self.distortion) - target).max(axis=-1) > 1e-9
            # Beyond the fold of the polynomial another point has the same image; no lens works there.
            a, b, c, d = _distort_jacobian(found, self.distortion)
            wrong = wrong | (a <= 0) | (a * d - b * c <= 0)
        found[wrong] = np.nan
        return found

    def rays(self) -> npt.NDArray[np.float64]:
        """Return for every pixel the direction (height, width, 3) with z = 1."""
        width, height = self.size
        xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return homogeneous(self.normalize(xy))


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera and a projector, and where the projector stands.

    projector_from_camera takes camera-frame points (mm) to the projector's frame. covariance maps names to arrays as
    the solver left them; photometry maps names to arrays (colour mixing, response).
    """

    camera: Pinhole
    projector: Pinhole
    projector_from_camera: Pose
    covariance: Mapping[str, Any] | None = None
    photometry: Mapping[str, Any] | None = None

    @property
    def projector_center(self) -> npt.NDArray[np.float64]:
        """The projector's centre in the camera frame, (3,) mm."""
        return np.array(self.projector_from_camera.inverse().translation, dtype=np.float64)

    def to_projector(self, xyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the projector pixels (..., 2) that light camera-frame points (..., 3) in mm."""
        return self.projector.project(self.projector_from_camera.apply(xyz))


def as_size(value: Any, name: str) -> tuple[int, int]:
    """Return `value` as (width, height) in px.

    Errors: InputError naming `name` unless it is two positive whole numbers.
    """
    try:
        width, height = (float(v) for v in value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be two whole numbers, width and height") from error
    if not (width >= 1 and height >= 1 and width.is_integer() and height.is_integer()):
        raise InputError(f"{name} must be two positive whole numbers, not {width:g} x {height:g}")
    return int(width), int(height)


def homogeneous(xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return (..., 2) coordinates with a 1 appended, (..., 3)."""
    xy = np.asarray(xy, dtype=np.float64)
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)


def intersect_plane(directions: npt.ArrayLike, normal: npt.ArrayLike, offset: float) -> npt.NDArray[np.float64]:
    """Return the points (..., 3) mm at which rays from the origin meet the plane normal . X = offset.

    directions (..., 3); normal (3,); offset in mm. A ray that is parallel to the plane gives infinity.
    Source: the corrected form of Fernandez and Salvi (2011), equation (6).
    """
    rays = np.asarray(directions, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return rays * (offset / (rays @ np.asarray(normal, dtype=np.float64)))[..., None]


def intersect_rays(
    origin_a: npt.ArrayLike, direction_a: npt.ArrayLike, origin_b: npt.ArrayLike, direction_b: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the point (..., 3) mm half-way between two rays where they are nearest, and their distance (...) mm.

    Origins (3,) or (..., 3) mm, directions (..., 3) of any length.
    """
    oa, da, ob, db = (np.asarray(v, dtype=np.float64) for v in (origin_a, direction_a, origin_b, direction_b))
    between = ob - oa
    aa, ab, bb = (da * da).sum(-1), (da * db).sum(-1), (db * db).sum(-1)
    ra, rb = (da * between).sum(-1), (db * between).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = aa * bb - ab * ab
        s, t = (ra * bb - rb * ab) / determinant, (ra * ab - rb * aa) / determinant
    on_a, on_b = oa + s[..., None] * da, ob + t[..., None] * db
    return (on_a + on_b) / 2, np.linalg.norm(on_a - on_b, axis=-1)


def _distort(xy: npt.NDArray[np.float64], distortion: Floats) -> npt.NDArray[np.float64]:
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


def _distort_jacobian(xy: npt.NDArray[np.float64], distortion: Floats) -> tuple[Any, Any, Any, Any]:
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
