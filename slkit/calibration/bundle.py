"""Joint bundle adjustment: camera, projector, the pose between them and every board pose from all residuals at once.

Source: Triggs and others, Bundle adjustment - a modern synthesis (2000). The residual of a projected corner is the
camera's alone, for its projector pixel is exact; a decoded one is weighted by its own sigma.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.calibration._normal import Problem, free_parameters, minimize, normal_equations, total
from slkit.calibration._parameters import Array
from slkit.calibration._rejection import reject
from slkit.calibration._residuals import Block, Masks, Part, split
from slkit.calibration._scatter import beside_claims, far_better, inverted, levels, scatter_px, shares, steady, weigher
from slkit.calibration._state import State
from slkit.calibration.model import Model
from slkit.calibration.surfaces import Sheet, Surface
from slkit.data import BoardView, ResidualClass
from slkit.geometry import RIG_NAMES, Pose, Rig

_ROUNDS = 4
_ROUGHLY = 1e-3
"""Rounds that only weigh and reject need not be solved to the last digit."""


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
    return _robust(problem, state) if model.loss == "huber" else _plain(problem, state, every_row(parts))


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
    start, first = state, problem.blocks(state)
    blocks: Mapping[str, Block] = first
    level = levels(problem, blocks, kept, dof, robust=True)
    rounds, huber = 0, False
    while rounds < _ROUNDS:
        weigh = weigher(problem, level, kept, huber)
        state, blocks, matrices = minimize(problem, state, blocks, weigh, _ROUGHLY)
        dof = shares(problem, matrices, kept)
        before, level = level, levels(problem, blocks, kept, dof, robust=rounds < _ROUNDS - 1)
        if not huber and far_better(problem, before, level):
            # Without weights one view whose light is wrong has drawn all the others away from where they were right.
            state, blocks, level, huber = start, first, before, True
            continue
        count = len(rejected)
        changed = reject(problem, blocks, level, kept, rejected)
        if huber and not changed and steady(problem, before, level, 0.05):
            break
        huber = True
        # Views go one at a time, however many; only rounds that weigh and reject single rows are counted.
        rounds += len(rejected) == count
    return _finish(problem, state, blocks, kept, rejected, huber=True)


def without_rejected(found: Adjusted) -> Adjusted:
    """Return the solution of least squares of all rows but those of views that were rejected."""
    views = list(found.rejected)
    return _plain(found.problem, found.state, {p.name: ~np.isin(p.view, views) for p in found.problem.parts})


def _plain(problem: Problem, state: State, kept: Masks) -> Adjusted:
    return _finish(problem, state, problem.blocks(state), kept, {}, huber=False)


def _finish(
    problem: Problem, state: State, blocks: Mapping[str, Block], kept: Masks, rejected: Mapping[int, str], huber: bool
) -> Adjusted:
    """Solve to the end with each class weighted by its rms scatter, and take the covariance there."""
    dof = {p.name: 1.0 for p in problem.parts}
    level = levels(problem, blocks, kept, dof, robust=False)
    for _ in range(_ROUNDS):
        state, blocks, matrices = minimize(problem, state, blocks, weigher(problem, level, kept, huber))
        dof = shares(problem, matrices, kept)
        before, level = level, levels(problem, blocks, kept, dof, robust=False)
        if steady(problem, before, level, 0.02):
            break
    weights = weigher(problem, level, kept, huber)(blocks)
    matrices, _ = normal_equations(problem, blocks, weights, state)
    spread = problem.free.spread
    shared = problem.free.count
    covariance = spread @ inverted(total(matrices))[:shared, :shared] @ spread.T
    free = np.flatnonzero(np.abs(spread).sum(axis=1))
    classes = {
        p.name: ResidualClass(
            len(p.view),
            int((~kept[p.name]).sum()),
            float(dof[p.name] * 2 * kept[p.name].sum()),
            scatter_px(p, level[p.name]),
            beside_claims(p, level[p.name]),
        )
        for p in problem.parts
    }
    names = tuple(np.array(parameter_names(state))[free])
    return Adjusted(problem, state, names, covariance[np.ix_(free, free)], classes, weights, kept, dict(rejected))


def parameter_names(state: State) -> list[str]:
    """Return the names of all shared parameters."""
    names = [*RIG_NAMES, *(f"board{b}.warp_{a}" for b in range(len(state.surfaces)) for a in "xy")]
    return names + [
        f"board{b}.point{i}_{a}" for b, r in enumerate(state.released) for i in range(len(r)) for a in "xyz"
    ]
