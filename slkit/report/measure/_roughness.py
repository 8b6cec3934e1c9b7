"""The noise of a cloud from itself: how far its points scatter about a smooth surface through their neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.report.measure._points import Float64s, check_positive, finite_points

_PLACES, _MOST, _FEWEST = 2000, 64, 16
"""Neighbourhoods that are looked at, and the points that one may and must have."""
_SLIM = 0.05
"""Least moment across a neighbourhood over that along it: points on one line show no surface."""
_SINGULAR = 1e-10
_ROUNDS, _FAR = 4, 5.0
"""How often a neighbourhood is fitted, and the residual that is left out then, in sigmas."""
_MAD = 1.4826


@dataclass(frozen=True)
class Roughness:
    """How rough a cloud is at one scale.

    points: of the cloud; neighborhoods: how many were looked at; radius_mm: of each; sigma_mm: 1 sigma of the distance
    to the local surface, NaN where no neighbourhood has points enough.
    """

    points: int
    neighborhoods: int
    radius_mm: float
    sigma_mm: float


def roughness(xyz: npt.ArrayLike, radius_mm: float) -> Roughness:
    """Return the local roughness of a cloud (n, 3) mm, rows that are not finite left out.

    Around each of up to 2000 points, spread over the cloud, a quadric z = a + bx + cy + dx^2 + exy + fy^2 in the frame
    of the local plane is fitted to up to 64 of the points within radius_mm, those beyond 5 sigma left out; its variance
    is the sum of squares over the degrees of freedom, six less than the points. sigma_mm is the root of the median
    over the neighbourhoods, as it would be of normal noise: neighbourhoods across an edge do not count while they are
    the fewer. A neighbourhood has at least 16 points that are not on one line. Bends as wide as the radius are
    roughness, curvature is not; choose the radius several times the noise.
    Errors: InputError for a radius that is not positive.
    """
    check_positive(radius_mm, "radius_mm")
    points = finite_points(xyz, "xyz")
    local, there = _neighborhoods(points, radius_mm)
    if not len(local):
        return Roughness(len(points), 0, float(radius_mm), np.nan)
    variance, spare = _variances(local, there)
    # The median of chi-square over its degrees of freedom, after Wilson and Hilferty.
    sigma = radius_mm * np.sqrt(np.median(variance / (1 - 2 / (9 * spare)) ** 3))
    return Roughness(len(points), len(local), float(radius_mm), float(sigma))


def _neighborhoods(points: Float64s, radius: float) -> tuple[Float64s, npt.NDArray[np.bool_]]:
    """Return neighbourhoods (k, 64, 3) in radii, z across their plane, and which of the entries are points."""
    from scipy.spatial import KDTree

    if not len(points):
        return np.empty((0, _MOST, 3)), np.empty((0, _MOST), dtype=bool)
    tree = KDTree(points)
    # The tree's own order runs through the cloud part by part: even steps in it are spread over the cloud.
    places: npt.NDArray[np.intp] = np.asarray(tree.indices)[:: -(-len(points) // _PLACES)]
    near: Any = tree.query_ball_point(points[places], radius, workers=-1)
    full = [(place, n[:: -(-len(n) // _MOST)]) for place, n in zip(places, near, strict=True) if len(n) >= _FEWEST]
    local, there = np.zeros((len(full), _MOST, 3)), np.zeros((len(full), _MOST), dtype=bool)
    for row, (place, chosen) in enumerate(full):
        local[row, : len(chosen)] = (points[chosen] - points[place]) / radius
        there[row, : len(chosen)] = True
    return _turned(local, there)


def _turned(local: Float64s, there: npt.NDArray[np.bool_]) -> tuple[Float64s, npt.NDArray[np.bool_]]:
    """Return neighbourhoods about their mean in the frame of their plane, without those that are a line."""
    local = np.where(there[..., None], local - (local.sum(axis=1) / there.sum(axis=1)[:, None])[:, None], 0.0)
    moments, axes = np.linalg.eigh(local.transpose(0, 2, 1) @ local)
    wide = moments[:, 1] > _SLIM * moments[:, 2]
    return (local[wide] @ axes[wide])[..., ::-1], there[wide]


def _variances(local: Float64s, there: npt.NDArray[np.bool_]) -> tuple[Float64s, Float64s]:
    """Return the variance (k,) about the quadric of each neighbourhood, and its degrees of freedom."""
    x, y, z = np.moveaxis(local, -1, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    keep, residuals, lost = there, z, np.zeros(len(z))
    for step in range(_ROUNDS):
        weighted = terms * keep[..., None]
        values, vectors = np.linalg.eigh(weighted.transpose(0, 2, 1) @ terms)
        # A coefficient that the points leave open is not fitted and costs no degree of freedom.
        fitted = values > _SINGULAR * values[:, -1:]
        shares = (vectors.transpose(0, 2, 1) @ (weighted.transpose(0, 2, 1) @ z[..., None]))[..., 0]
        shares = np.divide(shares, values, out=np.zeros_like(shares), where=fitted)
        residuals = z - (terms @ (vectors @ shares[..., None]))[..., 0]
        lost = fitted.sum(axis=1)
        if step < _ROUNDS - 1:
            count = keep.sum(axis=1)
            spread = np.nanmedian(np.where(keep, np.abs(residuals), np.nan), axis=1)
            limit = _FAR * _MAD * spread * np.sqrt(count / np.maximum(count - lost, 1))
            keep = there & (np.abs(residuals) <= np.maximum(limit, _SINGULAR)[:, None])
    spare = keep.sum(axis=1) - lost
    return np.einsum("ij,ij->i", residuals * keep, residuals) / spare, spare.astype(np.float64)
