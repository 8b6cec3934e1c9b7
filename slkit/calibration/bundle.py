"""Joint bundle adjustment: camera, projector, the pose between them and every board pose from all residuals at once.

Source: Triggs and others, Bundle adjustment - a modern synthesis (2000). The residual of a projected corner is the
camera's alone, for its projector pixel is exact; a decoded one is weighted by its own sigma. Each class of residuals is
weighted by its own scatter, degrees of freedom counted (Helmert's variance components).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.calibration._normal import Problem, free_parameters, minimize, normal_equations, total
from slkit.calibration._parameters import Array
from slkit.calibration._residuals import Block, Part, split
from slkit.calibration._state import State
from slkit.calibration.model import Model
from slkit.calibration.surfaces import Sheet, Surface
from slkit.data import BoardView, ResidualClass
from slkit.geometry import RIG_NAMES, Pose, Rig

Masks = dict[str, npt.NDArray[np.bool_]]

_HUBER = 2.5
"""Distance from which a row is weighed down, in 1 sigma of one coordinate; 4 % of clean rows lie beyond."""
_FALSE_ALARMS = 0.01
"""How many clean rows of a class the test for single corners may reject, on average."""
_VIEW_RATIO = 3.0
"""A view whose median distance exceeds that of all views this many times is rejected."""
_FEWEST_VIEWS = 5
"""With fewer views that have a class, a bad one cannot be told from the good."""
_LEAST_PX = 1e-4
_CALLED = {
    "printed": "printed points",
    "marks": "marks",
    "projected": "projected corners",
    "decoded": "decoded corners",
}
_ROUNDS = 4
_ROUGHLY = 1e-3
"""Rounds that only weigh and reject need not be solved to the last digit."""
_HALVINGS = 14
# The median of the squared length of a normal 2-vector of unit variance.
_MEDIAN = 2 * np.log(2)


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result of `adjust`.

    state: rig, poses, surfaces; names, covariance (p, p): of the rig's and the boards' free parameters, 1 sigma
    squared; sigma (n,) and kept (n,) of every row by class, in the order of the parts; rejected: view to reason.
    """

    problem: Problem
    state: State
    names: tuple[str, ...]
    covariance: Array
    classes: Mapping[str, ResidualClass]
    weights: Mapping[str, Array]
    kept: Masks
    rejected: Mapping[int, str]

    def kept_rows(self, views: Sequence[BoardView]) -> list[npt.NDArray[np.bool_]]:
        """Return per view which of its rows (n,) were kept; a row counts as rejected when one of its classes does."""
        masks = [np.ones(len(v.camera_xy), dtype=bool) for v in views]
        for part in self.problem.parts:
            for index, rows in enumerate(part.rows):
                masks[index][rows] &= self.kept[part.name][part.view == index]
        return masks


def adjust(
    rig: Rig,
    poses: Sequence[Pose],
    views: Sequence[BoardView],
    model: Model,
    boards: Sequence[int] | None = None,
    surfaces: Sequence[Surface | None] | None = None,
) -> Adjusted:
    """Return rig, poses and board shapes of least weighted residuals, with their covariance.

    rig, poses: a first guess; poses camera_from_target, one a view. boards: which board each view shows, default one
    for all. surfaces: one a board, None for a sheet. First all rows count; then rows far out are weighed down after
    Huber, single rows that lie beyond what one clean row in a hundred captures would are rejected, and so are views
    whose median distance exceeds that of all views three times.
    """
    board = list(boards or [0] * len(views))
    parts, points = split(views, board)
    state = start_of(rig, poses, points, model, surfaces)
    problem = Problem(parts, np.array(board, dtype=np.intp), free_parameters(model, state, parts))
    return _robust(problem, state) if model.loss == "huber" else _plain(problem, state)


def start_of(
    rig: Rig, poses: Sequence[Pose], points: Sequence[Array], model: Model, surfaces: Sequence[Surface | None] | None
) -> State:
    """Return the state to start from; points (k, 2) mm: the printed points of each board."""
    given = surfaces or [None] * len(points)
    shapes = tuple(Sheet.flat(p) if s is None else s for s, p in zip(given, points, strict=True))
    return State(
        Rig(model.camera.held(rig.camera), model.projector.held(rig.projector), rig.projector_from_camera),
        np.array([p.rotation for p in poses]),
        np.array([p.translation for p in poses]),
        shapes,
        tuple(np.zeros((len(p) if model.release_mm is not None else 0, 3)) for p in points),
    )


def every_row(parts: Sequence[Part]) -> Masks:
    """Return the masks (n,) per class that keep all rows."""
    return {part.name: np.ones(len(part.view), dtype=bool) for part in parts}


def _robust(problem: Problem, state: State) -> Adjusted:
    kept = every_row(problem.parts)
    rejected: dict[int, str] = {}
    dof = {p.name: 1.0 for p in problem.parts}
    blocks = problem.blocks(state)
    level = _levels(problem, blocks, kept, dof, robust=True)
    for round_ in range(_ROUNDS):
        last = round_ == _ROUNDS - 1
        state, blocks, matrices = minimize(
            problem, state, blocks, _weigher(problem, level, kept, huber=round_ > 0), _ROUGHLY
        )
        dof = _shares(problem, matrices, kept)
        before, level = level, _levels(problem, blocks, kept, dof, robust=not last)
        steady = _steady(problem, before, level, 0.05)
        changed = _reject(problem, blocks, level, kept, rejected)
        if steady and not changed and round_ > 0:
            break
    return _finish(problem, state, blocks, kept, rejected, huber=True)


def _plain(problem: Problem, state: State) -> Adjusted:
    return _finish(problem, state, problem.blocks(state), every_row(problem.parts), {}, huber=False)


def _finish(
    problem: Problem, state: State, blocks: Mapping[str, Block], kept: Masks, rejected: Mapping[int, str], huber: bool
) -> Adjusted:
    """Solve to the end with each class weighted by its rms scatter, and take the covariance there."""
    dof = {p.name: 1.0 for p in problem.parts}
    level = _levels(problem, blocks, kept, dof, robust=False)
    for _ in range(_ROUNDS):
        state, blocks, matrices = minimize(problem, state, blocks, _weigher(problem, level, kept, huber))
        dof = _shares(problem, matrices, kept)
        before, level = level, _levels(problem, blocks, kept, dof, robust=False)
        if _steady(problem, before, level, 0.02):
            break
    weights = _weigher(problem, level, kept, huber)(blocks)
    matrices, _ = normal_equations(problem, blocks, weights, state)
    spread = problem.free.spread
    shared = problem.free.count
    covariance = spread @ _inverse(total(matrices))[:shared, :shared] @ spread.T
    free = np.flatnonzero(np.abs(spread).sum(axis=1))
    classes = {
        p.name: ResidualClass(
            len(p.view),
            int((~kept[p.name]).sum()),
            float(dof[p.name] * 2 * kept[p.name].sum()),
            _rms(_sigma(p, level[p.name])),
            _rms(_sigma(p, level[p.name])) / max(_rms(_claimed(p)), _LEAST_PX) if p.name == "decoded" else 1.0,
        )
        for p in problem.parts
    }
    names = tuple(np.array(parameter_names(state))[free])
    return Adjusted(problem, state, names, covariance[np.ix_(free, free)], classes, weights, kept, dict(rejected))


def _weigher(
    problem: Problem, level: Mapping[str, float], kept: Masks, huber: bool
) -> Callable[[Mapping[str, Block]], dict[str, Array]]:
    def weigh(blocks: Mapping[str, Block]) -> dict[str, Array]:
        weights: dict[str, Array] = {}
        for part in problem.parts:
            sigma = _sigma(part, level[part.name])
            weight = kept[part.name][:, None] / sigma**2
            if huber:
                distance = np.linalg.norm(blocks[part.name].error / sigma, axis=1)
                weight = weight * np.minimum(1, _HUBER / np.maximum(distance, 1e-12))[:, None]
            weights[part.name] = weight
        return weights

    return weigh


def _sigma(part: Part, level: float) -> Array:
    """Return the scatter (n, 2) px of the residuals of a class.

    A decoded corner scatters by what its code claims and by what all of them have in common: print, and transfer.
    """
    if part.name != "decoded":
        return np.full((len(part.view), 2), level)
    return np.hypot(_claimed(part), level)


def _claimed(part: Part) -> Array:
    """Return the sigma (n, 2) px that codes claim, the usual one where a code claims nothing."""
    return np.where(np.isfinite(part.sigma), part.sigma, np.nanmedian(part.sigma, axis=0))


def _levels(
    problem: Problem, blocks: Mapping[str, Block], kept: Masks, dof: Mapping[str, float], robust: bool
) -> dict[str, float]:
    """Return the scatter in px of each class, of the decoded one that beyond its claims.

    dof: the share of the residuals that is free. robust: by the median instead of the mean of the squares.
    """
    levels: dict[str, float] = {}
    for part in problem.parts:
        mask, free = kept[part.name], max(dof[part.name], 0.02)
        squares = blocks[part.name].error[mask] ** 2
        if part.name == "decoded":
            levels[part.name] = _beyond(squares, _claimed(part)[mask] ** 2, free, robust)
        else:
            levels[part.name] = max(float(np.sqrt(_typical(squares, robust) / free)), _LEAST_PX)
    # Where the parameters fit a class at any price its scatter says nothing; it is not believed to be ten times better.
    camera = max((s for n, s in levels.items() if n != "decoded"), default=0.0)
    return {n: s if n == "decoded" else max(s, camera / 10) for n, s in levels.items()}


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


def _steady(problem: Problem, before: Mapping[str, float], now: Mapping[str, float], share: float) -> bool:
    """Tell whether the scatter of every class has changed by less than a share of it."""
    was, is_now = (np.array([_rms(_sigma(p, level[p.name])) for p in problem.parts]) for level in (before, now))
    return bool(np.all(np.abs(is_now / was - 1) < share))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _shares(problem: Problem, matrices: Mapping[str, Array], kept: Masks) -> dict[str, float]:
    """Return for each class which share of its residuals is not taken up by parameters (its redundancy)."""
    inverse = _inverse(total(matrices))
    return {
        p.name: 1 - float((inverse * matrices[p.name]).sum()) / max(2 * int(kept[p.name].sum()), 1)
        for p in problem.parts
    }


def _reject(
    problem: Problem, blocks: Mapping[str, Block], level: Mapping[str, float], kept: Masks, rejected: dict[int, str]
) -> bool:
    """Take out the worst view, if any is beyond the test, else single rows; return whether anything changed."""
    from scipy.stats import chi2

    distances = {p.name: np.linalg.norm(blocks[p.name].error / _sigma(p, level[p.name]), axis=1) for p in problem.parts}
    worst = _worst_view(problem, distances, kept)
    if worst is not None:
        view, name, ratio = worst
        rejected[view] = f"its {_CALLED[name]} lie {ratio:.1f} times as far from the model as those of the other views"
        for part in problem.parts:
            kept[part.name][part.view == view] = False
        return True
    changed = False
    for part in problem.parts:
        limit = float(np.sqrt(chi2.isf(_FALSE_ALARMS / max(len(part.view), 1), 2)))
        beyond = kept[part.name] & (distances[part.name] > limit)
        kept[part.name] &= ~beyond
        changed |= bool(beyond.any())
    return changed


def _worst_view(problem: Problem, distances: Mapping[str, Array], kept: Masks) -> tuple[int, str, float] | None:
    worst = None
    for part in problem.parts:
        mask = kept[part.name]
        views, medians = _medians(distances[part.name][mask], part.view[mask])
        if len(views) < _FEWEST_VIEWS:
            continue
        ratios = medians / max(float(np.median(medians)), 1e-12)
        top = int(np.argmax(ratios))
        if ratios[top] > _VIEW_RATIO and (worst is None or ratios[top] > worst[2]):
            worst = int(views[top]), part.name, float(ratios[top])
    return worst


def _medians(values: Array, view: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the views that occur, and the upper median of the values (n,) of each."""
    views, starts, counts = np.unique(view, return_index=True, return_counts=True)
    return views, values[np.lexsort((values, view))][starts + counts // 2]


def _inverse(matrix: Array) -> Array:
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


def parameter_names(state: State) -> list[str]:
    """Return the names of all shared parameters."""
    names = [*RIG_NAMES, *(f"board{b}.warp_{a}" for b in range(len(state.surfaces)) for a in "xy")]
    return names + [
        f"board{b}.point{i}_{a}" for b, r in enumerate(state.released) for i in range(len(r)) for a in "xyz"
    ]
