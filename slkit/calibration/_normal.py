"""Weighted least squares over shared parameters and one motion a view: the normal equations, block by block."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.calibration._parameters import Array
from slkit.calibration._residuals import Block, Part, block
from slkit.calibration._state import LENS, LENSES, MOTION, State, shared_values
from slkit.calibration.model import Lens, Model
from slkit.calibration.surfaces import Sheet
from slkit.errors import CalibrationError
from slkit.geometry import DISTORTION_NAMES

Ints = npt.NDArray[np.intp]
_STEPS = 60
_LARGEST_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class Free:
    """Which shared parameters are estimated, and what is known of them beforehand.

    spread (s, p): all shared parameters over the free ones. Priors: rows (k, s), whose product with the shared
    parameters should be value (k,) within 1 sigma (k,).
    """

    spread: Array
    rows: Array
    value: Array
    sigma: Array

    @property
    def count(self) -> int:
        """How many parameters are free."""
        return self.spread.shape[1]

    def misses(self, state: State) -> Array:
        """Return by how many sigma (k,) a state misses what is known beforehand."""
        return (self.rows @ shared_values(state) - self.value) / self.sigma

    def of(self, shared: Array) -> Array:
        """Return derivatives (n, 2, s) over all shared parameters as derivatives (n, 2, p) over the free ones."""
        single = (self.spread != 0).sum(axis=0) == 1
        # A lens of known aspect moves two parameters at once; all others are taken as they are, which is far quicker.
        return shared[:, :, self.spread.argmax(axis=0)] if single.all() else shared @ self.spread


@dataclass(frozen=True, eq=False)
class Problem:
    """The parts whose residuals count, the board of each view, and the free parameters."""

    parts: Sequence[Part]
    board: Ints
    free: Free

    def blocks(self, state: State) -> dict[str, Block]:
        """Return residuals and derivatives of every class."""
        return {part.name: block(part, state, self.board) for part in self.parts}


def free_parameters(model: Model, state: State, parts: Sequence[Part]) -> Free:
    """Return the free parameters of a model, for the classes of residuals that there are."""
    names = {part.name for part in parts}
    values = shared_values(state)
    columns: list[Array] = []
    priors: list[tuple[Array, float, float]] = []
    unit = np.eye(len(values))
    devices = [(0, model.camera, state.rig.camera.size)]
    if names & {"projected", "decoded"}:
        devices.append((LENS, model.projector, state.rig.projector.size))
        columns += list(unit[LENSES:MOTION])
    for first, lens, size in devices:
        columns += lens_columns(unit[first : first + LENS], lens)
        if lens.throw_ratio is not None:
            ratio, sigma = lens.throw_ratio
            priors.append((unit[first], ratio * size[0], sigma * size[0]))
        if lens.offset is not None:
            offset, sigma = lens.offset
            half = size[1] / 2
            priors.append((unit[first + 3], half - 0.5 + offset * half, sigma * half))
    first = MOTION
    for surface in state.surfaces:
        if model.warp and isinstance(surface, Sheet):
            columns += [unit[first], unit[first + 1]]
        first += 2
    if model.release_mm is not None:
        columns += list(unit[first:])
        priors += [(row, 0.0, model.release_mm) for row in unit[first:]]
    rows, value, sigma = (np.array([p[i] for p in priors]) for i in range(3))
    return Free(np.stack(columns, axis=1), rows.reshape(-1, len(values)), value, sigma)


def lens_columns(unit: Array, lens: Lens) -> list[Array]:
    """Return the free parameters of a lens as combinations of the unit rows (10, s) of all its parameters."""
    fx, fy, cx, cy, skew, *distortion = unit
    columns = [fx, fy] if lens.aspect is None else [fx + lens.aspect * fy]
    columns += [cx, cy] if lens.principal_point is None else []
    columns += [skew] if lens.skew else []
    return columns + [c for c, n in zip(distortion, DISTORTION_NAMES, strict=True) if n in lens.distortion]


def normal_equations(
    problem: Problem, blocks: Mapping[str, Block], weights: Mapping[str, Array], state: State
) -> tuple[dict[str, Array], Array]:
    """Return J^T W J of each class, and of the priors as `prior`, (q, q) each, and J^T W r (q,).

    weights: per class (n, 2), 1 / sigma^2 of each residual. The q parameters are the free shared ones, then six a view.
    """
    free, views = problem.free, len(problem.board)
    shared = free.count
    gradient = np.zeros(shared + 6 * views)
    matrices: dict[str, Array] = {}
    for part in problem.parts:
        found, weight = blocks[part.name], weights[part.name]
        matrix = np.zeros((len(gradient), len(gradient)))
        jacobian = np.concatenate([free.of(found.shared), found.pose], axis=2).reshape(-1, shared + 6)
        weighted = jacobian * weight.reshape(-1, 1)
        error = found.error.ravel()
        matrix[:shared, :shared] = weighted[:, :shared].T @ jacobian[:, :shared]
        ends = 2 * np.cumsum([len(r) for r in part.rows])
        for view, (first, last) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
            if first == last:
                continue
            own = slice(shared + 6 * view, shared + 6 * view + 6)
            crossed = weighted[first:last, shared:].T @ jacobian[first:last]
            matrix[own, :shared], matrix[own, own] = crossed[:, :shared], crossed[:, shared:]
            gradient[own] += weighted[first:last, shared:].T @ error[first:last]
        matrix[:shared, shared:] = matrix[shared:, :shared].T
        gradient[:shared] += weighted[:, :shared].T @ error
        matrices[part.name] = matrix
    if len(free.rows):
        rows = np.pad((free.rows @ free.spread) / free.sigma[:, None], ((0, 0), (0, 6 * views)))
        matrices["prior"] = rows.T @ rows
        gradient += rows.T @ free.misses(state)
    return matrices, gradient


def total(matrices: Mapping[str, Array]) -> Array:
    """Return the sum of the matrices of all classes."""
    return np.asarray(np.sum(list(matrices.values()), axis=0))


def whole_jacobian(problem: Problem, part: Part, found: Block) -> Array:
    """Return d error / d the free parameters (n, 2, q) of a class: the shared ones, then six a view."""
    free = problem.free
    own = np.zeros((len(part.view), 2, len(problem.board), 6))
    own[np.arange(len(part.view)), :, part.view] = found.pose
    return np.concatenate([free.of(found.shared), own.reshape(len(part.view), 2, -1)], axis=2)


def cost(problem: Problem, blocks: Mapping[str, Block], weights: Mapping[str, Array], state: State) -> float:
    """Return half the weighted sum of squares; infinite where a point left the view of a lens."""
    squares = sum(float((weights[n] * b.error**2).sum()) for n, b in blocks.items())
    squares += float((problem.free.misses(state) ** 2).sum())
    return squares / 2 if np.isfinite(squares) else np.inf


def minimize(
    problem: Problem,
    state: State,
    blocks: Mapping[str, Block],
    weigh: Callable[[Mapping[str, Block]], Mapping[str, Array]],
    tolerance: float = 1e-9,
) -> tuple[State, Mapping[str, Block], dict[str, Array]]:
    """Return the state of least weighted squares, its residuals, and J^T W J of each class there.

    blocks: the residuals at the start; weigh: from them to the weights, which then stay; tolerance: of the squares, as
    a share of them, at which it stops. Source: Levenberg and Marquardt, with the damping of each parameter in
    proportion to its curvature. Errors: CalibrationError where the residuals at the start are not finite.
    """
    weights = weigh(blocks)
    here, damping = cost(problem, blocks, weights, state), 1e-6
    if not np.isfinite(here):
        raise CalibrationError("no rig explains the views: look for one whose pose or light is wrong altogether")
    for _ in range(_STEPS):
        matrices, gradient = normal_equations(problem, blocks, weights, state)
        matrix = total(matrices)
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix / np.outer(scale, scale)
        better = False
        while damping < _LARGEST_DAMPING:
            step = _solve(scaled + damping * np.eye(len(scaled)), -gradient / scale) / scale
            if -float(gradient @ step) < tolerance * here + 1e-18:
                return state, blocks, matrices
            if np.isfinite(step).all():
                moved = _step(problem, state, step)
                with np.errstate(all="ignore"):
                    tried = problem.blocks(moved)
                there = cost(problem, tried, weights, moved)
                if there < here:
                    better = True
                    break
            damping *= 10
        if not better:
            return state, blocks, matrices
        state, blocks, here, damping = moved, tried, there, max(damping / 10, 1e-9)  # pyright: ignore[reportPossiblyUnboundVariable]
    return state, blocks, normal_equations(problem, blocks, weights, state)[0]


def _step(problem: Problem, state: State, step: Array) -> State:
    shared = problem.free.count
    return state.moved(problem.free.spread @ step[:shared], step[shared:].reshape(-1, 6))


def _solve(matrix: Array, right: Array) -> Array:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right, rcond=None)[0]
