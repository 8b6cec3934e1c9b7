"""How residuals scatter, class by class, and what weight this gives each row.

Each class of residuals is weighted by its own scatter, degrees of freedom counted (Helmert's variance components);
rows far out weigh less (Huber).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from slkit.calibration._normal import Problem, total
from slkit.calibration._parameters import Array
from slkit.calibration._residuals import Block, Masks, Part

_HUBER = 2.5
"""Distance from which a row is weighed down, in 1 sigma of one coordinate; 4 % of clean rows lie beyond."""
_LEAST_PX = 1e-4
_HALVINGS = 14
# The median of the squared length of a normal 2-vector of unit variance.
_MEDIAN = 2 * np.log(2)


def weigher(
    problem: Problem, level: Mapping[str, float], kept: Masks, huber: bool
) -> Callable[[Mapping[str, Block]], dict[str, Array]]:
    """Return what gives each row its weights (n, 2) by its residuals; huber: rows far out weigh less."""

    def weigh(blocks: Mapping[str, Block]) -> dict[str, Array]:
        weights: dict[str, Array] = {}
        for part in problem.parts:
            sigma = row_sigma(part, level[part.name])
            weight = kept[part.name][:, None] / sigma**2
            if huber:
                distance = np.linalg.norm(blocks[part.name].error / sigma, axis=1)
                weight = weight * np.minimum(1, _HUBER / np.maximum(distance, 1e-12))[:, None]
            weights[part.name] = weight
        return weights

    return weigh


def row_sigma(part: Part, level: float) -> Array:
    """Return the scatter (n, 2) px of the residuals of a class.

    A decoded corner scatters by what its code claims and by what all of them have in common: print, and transfer.
    """
    if part.name != "decoded":
        return np.full((len(part.view), 2), level)
    return np.hypot(claimed(part), level)


def claimed(part: Part) -> Array:
    """Return the sigma (n, 2) px that codes claim, the usual one where a code claims nothing, 0 where none does."""
    known = np.isfinite(part.sigma)
    usual = np.nanmedian(part.sigma, axis=0) if known.any() else 0.0
    return np.where(known, part.sigma, usual)


def levels(
    problem: Problem, blocks: Mapping[str, Block], kept: Masks, dof: Mapping[str, float], robust: bool
) -> dict[str, float]:
    """Return the scatter in px of each class, of the decoded one that beyond its claims.

    dof: the share of the residuals that is free. robust: by the median instead of the mean of the squares.
    """
    found: dict[str, float] = {}
    for part in problem.parts:
        mask, free = kept[part.name], max(dof[part.name], 0.02)
        squares = blocks[part.name].error[mask] ** 2
        if part.name == "decoded":
            found[part.name] = _beyond(squares, claimed(part)[mask] ** 2, free, robust)
        else:
            found[part.name] = max(float(np.sqrt(_typical(squares, robust) / free)), _LEAST_PX)
    # Where the parameters fit a class at any price its scatter says nothing; it is not believed to be ten times better.
    camera = max((s for n, s in found.items() if n != "decoded"), default=0.0)
    return {n: s if n == "decoded" else max(s, camera / 10) for n, s in found.items()}


def _typical(squares: Array, robust: bool) -> float:
    """Return the mean of squares (n, 2), or what it would be by their median if they were those of normal noise."""
    lengths = squares.sum(axis=1)
    return float(np.median(lengths)) / _MEDIAN if robust else float(lengths.mean()) / 2


def _beyond(squares: Array, claimed: Array, free: float, robust: bool) -> float:
    """Return the scatter in px that explains, beside the claimed variances (n, 2), the squares (n, 2) of residuals."""
    low, high = 0.0, float(np.sqrt(_typical(squares, robust) / free)) + _LEAST_PX
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if _typical(squares / (claimed + middle**2), robust) > free:
            low = middle
        else:
            high = middle
    return max(high, _LEAST_PX)


def steady(problem: Problem, before: Mapping[str, float], now: Mapping[str, float], share: float) -> bool:
    """Tell whether the scatter of every class has changed by less than a share of it."""
    was, is_now = (np.array([scatter_px(p, level[p.name]) for p in problem.parts]) for level in (before, now))
    return bool(np.all(np.abs(is_now / was - 1) < share))


def far_better(problem: Problem, level: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Tell whether residuals scatter by less than half as much as others do, on the geometric mean over all rows."""
    gains = [
        len(p.view) * np.log(2 * scatter_px(p, level[p.name]) / scatter_px(p, other[p.name])) for p in problem.parts
    ]
    return bool(sum(gains) < 0)


def scatter_px(part: Part, level: float) -> float:
    """Return the scatter in px of a class, root mean square over its rows."""
    return float(np.sqrt(np.mean(row_sigma(part, level) ** 2)))


def beside_claims(part: Part, level: float) -> float:
    """Return how many times more a class scatters than it claims; 1 for one that claims nothing."""
    if part.name != "decoded":
        return 1.0
    return scatter_px(part, level) / max(scatter_px(part, 0.0), _LEAST_PX)


def shares(problem: Problem, matrices: Mapping[str, Array], kept: Masks) -> dict[str, float]:
    """Return for each class which share of its residuals is not taken up by parameters (its redundancy)."""
    inverse = inverted(total(matrices))
    return {
        p.name: 1 - float((inverse * matrices[p.name]).sum()) / max(2 * int(kept[p.name].sum()), 1)
        for p in problem.parts
    }


def inverted(matrix: Array) -> Array:
    """Return the inverse of normal equations (q, q); rows of parameters that nothing depends on are let be."""
    diagonal = np.diag(matrix)
    # The motion of a view that was rejected is undetermined: any number stands for it, nothing depends on it.
    idle = diagonal <= 0
    scale = np.where(idle, 1.0, np.sqrt(np.maximum(diagonal, 1e-300)))
    scaled = matrix / np.outer(scale, scale) + np.diag(idle.astype(np.float64))
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(scaled, hermitian=True)
    return inverse / np.outer(scale, scale)
