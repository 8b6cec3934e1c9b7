"""Points of planes and images, and viewing rays: where they meet a plane, and where two of them are nearest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def homogeneous(xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return (..., 2) coordinates with a 1 appended, (..., 3)."""
    xy = np.asarray(xy, dtype=np.float64)
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)


def flat(xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return points (..., 2) mm of a board as (..., 3) mm, z = 0."""
    xy = np.asarray(xy, dtype=np.float64)
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], axis=-1)


def transformed(homography: npt.ArrayLike, xy: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return points (n, 2) under a homography (3, 3), or under each of several (m, 3, 3) as (m, n, 2).

    A point that goes to infinity becomes infinite or NaN.
    """
    places = homogeneous(xy) @ np.swapaxes(np.asarray(homography, dtype=np.float64), -1, -2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return places[..., :2] / places[..., 2:]


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
