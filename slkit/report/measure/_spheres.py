"""Balls in a cloud: where they are, and which points are on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.report.measure._points import Float64s, check_positive, finite_points, points_of
from slkit.report.measure._shapes import SphereFit, sphere_fit

_REACH = 1.1
"""A point belongs to a ball up to this distance from its centre, in radii."""
_DRAWS, _SAMPLE, _FINALISTS = 2000, 10_000, 20
_STRIDE, _THINNEST = 0.7, 0.1
"""Distance of the points of a triple, and the least area of its parallelogram, in radii and their square."""
_TOLERANCE = 0.03
_RADIUS_DOUBT = 0.1
"""How far the free radius may differ from the true one, of which it is a share; a plane's is infinite."""
_FEWEST, _FULL = 10, 0.5
"""Of the points where a ball is seen, how many must lie on it, and which share."""
_ROUNDS = 3


def points_on_sphere(
    xyz: npt.ArrayLike,
    center: npt.ArrayLike,
    radius_mm: float,
    viewpoint: npt.ArrayLike = (0.0, 0.0, 0.0),
    incidence_deg: float = 60.0,
) -> npt.NDArray[np.bool_]:
    """Return the mask (n,) of the points that count as a ball's: near enough to its centre, and seen steeply enough.

    xyz (n, 3) mm; center (3,) mm and radius_mm roughly known. A point counts up to 1.1 radii from the centre where the
    sphere's normal there is less than incidence_deg from the direction to the viewpoint (3,) mm, default the camera.
    No point is judged by its residual. Errors: InputError for a radius or an angle that is not positive.
    """
    check_positive(radius_mm, "radius_mm")
    check_positive(incidence_deg, "incidence_deg")
    points = points_of(xyz, "xyz")
    out = points - np.asarray(center, dtype=np.float64)
    distance = np.sqrt(np.einsum("ij,ij->i", out, out))
    near = np.flatnonzero(distance <= _REACH * radius_mm)
    look = np.asarray(viewpoint, dtype=np.float64) - points[near]
    cosine = np.einsum("ij,ij->i", out[near], look)
    mask = np.zeros(len(points), dtype=bool)
    mask[near] = cosine > np.cos(np.radians(incidence_deg)) * distance[near] * np.linalg.norm(look, axis=1)
    return mask


def find_spheres(
    xyz: npt.ArrayLike,
    diameters_mm: Sequence[float],
    rng: np.random.Generator,
    tolerance_mm: float | None = None,
    viewpoint: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> tuple[SphereFit, ...]:
    """Return the balls of known diameters that a cloud shows among other things, in the order of the diameters.

    xyz (n, 3) mm; tolerance_mm: how far a point of a ball may lie off it, default 3 % of the radius; viewpoint (3,) mm:
    where the surface is seen from, default the camera. A ball needs about one of 200 points. Each fit is of the points
    within the tolerance, with the radius held; measure the ball from `points_on_sphere` around it. Of balls of one
    diameter the one with more points comes first.
    Errors: InputError naming the diameters of which no ball is found.
    Source: Fischler and Bolles, Random sample consensus (1981), scored as MSAC of Torr and Zisserman (2000).
    """
    for diameter in diameters_mm:
        check_positive(diameter, "each of diameters_mm")
    if tolerance_mm is not None:
        check_positive(tolerance_mm, "tolerance_mm")
    eye = np.asarray(viewpoint, dtype=np.float64)
    rest = finite_points(xyz, "xyz")
    pending = list(range(len(diameters_mm)))
    found: dict[int, SphereFit] = {}
    while pending:
        radii = sorted({diameters_mm[i] / 2 for i in pending})
        # The right diameter explains more points of a ball than a wrong one: the best of all comes first.
        balls = [b for r in radii if (b := _best(rest, r, tolerance_mm or _TOLERANCE * r, eye, rng)) is not None]
        if not balls:
            names = ", ".join(f"{diameters_mm[i]:g}" for i in pending)
            raise InputError(f"no ball of diameter {names} mm is found: is it in view, and is the diameter in mm?")
        best = max(balls, key=lambda ball: ball.points)
        place = next(i for i in pending if diameters_mm[i] / 2 == best.radius_mm)
        pending.remove(place)
        found[place] = best
        rest = rest[np.linalg.norm(rest - best.center, axis=1) > _REACH * best.radius_mm]
    return tuple(found[i] for i in range(len(diameters_mm)))


def _best(
    points: Float64s, radius: float, tolerance: float, eye: Float64s, rng: np.random.Generator
) -> SphereFit | None:
    """Return the ball with most support, or None where none is one."""
    if len(points) < _FEWEST:
        return None
    sample = points[rng.choice(len(points), min(len(points), _SAMPLE), replace=False)]
    centers = _drawn(sample, radius, eye, rng)
    scores = _support(sample, centers, radius, tolerance)
    best: SphereFit | None = None
    for index in np.argsort(-scores)[:_FINALISTS]:
        ball = _refined(points, centers[index], radius, tolerance, eye)
        if ball is not None and (best is None or ball.points > best.points):
            best = ball
    return best


def _drawn(sample: Float64s, radius: float, eye: Float64s, rng: np.random.Generator) -> Float64s:
    """Return the centres (k, 3) of spheres through triples of neighbouring points, on the side turned away."""
    from scipy.spatial import KDTree

    tree = KDTree(sample)
    first = sample[rng.integers(len(sample), size=_DRAWS)]
    toward = rng.normal(size=(2, _DRAWS, 3))
    toward *= _STRIDE * radius / np.linalg.norm(toward, axis=-1, keepdims=True)
    a, b = sample[tree.query(first + toward)[1]] - first
    normal = np.cross(a, b)
    area2 = (normal * normal).sum(axis=1)
    fair = area2 > (_THINNEST * radius**2) ** 2
    first, a, b, normal, area2 = first[fair], a[fair], b[fair], normal[fair], area2[fair, None]
    middle = np.cross((a * a).sum(axis=1)[:, None] * b - (b * b).sum(axis=1)[:, None] * a, normal) / (2 * area2)
    height2 = radius**2 - (middle * middle).sum(axis=1, keepdims=True)
    middle += first
    away = np.sign(((middle - eye) * normal).sum(axis=1, keepdims=True))
    centers = middle + away * normal * np.sqrt(np.maximum(height2, 0) / area2)
    return centers[height2[:, 0] > 0]


def _support(sample: Float64s, centers: Float64s, radius: float, tolerance: float) -> Float64s:
    """Return the score (k,) of each centre: the sum over the points of 1 - (residual / tolerance)^2, not below 0."""
    origin = sample.mean(axis=0)
    # Single precision about the middle of the cloud, and (d^2 - r^2) / 2r for d - r: enough to rank by.
    points, places = ((v - origin).astype(np.float32) for v in (sample, centers))
    squares = (points * points).sum(axis=1) - np.float32(radius**2)
    scores = np.zeros(len(places))
    for start in range(0, len(places), 100):
        part = places[start : start + 100]
        gap = (part * part).sum(axis=1)[:, None] + squares - 2 * (part @ points.T)
        gap *= np.float32(0.5 / (radius * tolerance))
        scores[start : start + 100] = np.maximum(1 - gap * gap, 0).sum(axis=1)
    return scores


def _refined(points: Float64s, center: Float64s, radius: float, tolerance: float, eye: Float64s) -> SphereFit | None:
    """Return the sphere through the points near one, or None where what is there is no ball of that radius."""
    near = points[np.linalg.norm(points - center, axis=1) <= 1.5 * radius]

    def through(middle: Float64s) -> SphereFit:
        return sphere_fit(near[np.abs(np.linalg.norm(near - middle, axis=1) - radius) <= tolerance], radius)

    try:
        fit = through(center)
        for _ in range(_ROUNDS):
            fit = through(fit.center)
        # Points within a tolerance of a sphere look like one whatever they are: a ball is judged by all that is there.
        seen = near[points_on_sphere(near, fit.center, radius, eye)]
        free = sphere_fit(seen)
    except InputError:
        return None
    on = np.abs(np.linalg.norm(seen - fit.center, axis=1) - radius) <= tolerance
    right = abs(free.radius_mm - radius) <= _RADIUS_DOUBT * radius
    return fit if right and on.sum() >= max(_FEWEST, _FULL * len(on)) else None
