"""The paper's sequence: camera, then board poses, then the projector; and how its errors add up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from slkit.calibration._normal import Problem, free_parameters, whole_jacobian
from slkit.calibration._parameters import Array, covariance_of
from slkit.calibration._residuals import Block, split
from slkit.calibration._state import LENS, MOTION
from slkit.calibration.bundle import Adjusted, every_row, parameter_names, start_of
from slkit.calibration.model import Model
from slkit.calibration.surfaces import Surface
from slkit.data import BoardView, ResidualClass
from slkit.geometry import Pose, Rig


def in_sequence(
    rig: Rig,
    poses: Sequence[Pose],
    views: Sequence[BoardView],
    model: Model,
    boards: Sequence[int],
    surfaces: Sequence[Surface | None] | None = None,
) -> Adjusted:
    """Return a rig as the sequence left it, with its covariance; arguments as for `bundle.adjust`.

    The camera and the board poses scatter as their own residuals tell; the projector scatters with its residuals and,
    through the points that it is fitted to, with camera and poses.
    """
    parts, points = split(views, boards)
    lenses = Model(model.camera, model.projector)
    state = start_of(rig, poses, points, lenses, surfaces)
    problem = Problem(parts, np.array(boards, dtype=np.intp), free_parameters(lenses, state, parts))
    blocks = problem.blocks(state)
    jacobian, residuals, of_camera = _stacked(problem, blocks)
    spread = problem.free.spread
    shared = problem.free.count
    is_late = np.zeros(jacobian.shape[1], dtype=bool)
    is_late[:shared] = np.abs(spread[LENS:MOTION]).sum(axis=0) > 0
    late, early = np.flatnonzero(is_late), np.flatnonzero(~is_late)
    before = covariance_of(jacobian[np.ix_(of_camera, early)], residuals[of_camera])
    after = jacobian[np.ix_(~of_camera, late)]
    carry = -np.linalg.lstsq(after, jacobian[np.ix_(~of_camera, early)], rcond=None)[0]
    whole = np.zeros((jacobian.shape[1],) * 2)
    whole[np.ix_(early, early)] = before
    whole[np.ix_(late, late)] = covariance_of(after, residuals[~of_camera]) + carry @ before @ carry.T
    whole[np.ix_(late, early)] = carry @ before
    whole[np.ix_(early, late)] = whole[np.ix_(late, early)].T
    free = np.flatnonzero(np.abs(spread).sum(axis=1))
    covariance = (spread @ whole[:shared, :shared] @ spread.T)[np.ix_(free, free)]
    names = tuple(np.array(parameter_names(state))[free])
    # Parameters take up residuals where these are fitted: camera and poses first, then the projector.
    taken = np.empty(len(residuals))
    taken[of_camera], taken[~of_camera] = _leverage(jacobian[np.ix_(of_camera, early)]), _leverage(after)
    ends = 2 * np.cumsum([len(p.view) for p in parts])
    shares = zip(parts, np.split(taken, ends[:-1]), strict=True)
    classes = {part.name: _scatter(blocks[part.name].error, share) for part, share in shares}
    return Adjusted(problem, state, names, covariance, classes, {}, every_row(parts), {})


def _stacked(problem: Problem, blocks: Mapping[str, Block]) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Return the Jacobian over all free parameters, the residuals, and the mask of those that lie in the camera.

    The sequence fits projected corners in the projector's image: their camera residuals are carried over there.
    """
    rows: list[Array] = []
    errors: list[Array] = []
    for part in problem.parts:
        found = blocks[part.name]
        jacobian, error = whole_jacobian(problem, part, found), found.error
        if part.name == "projected":
            # A pixel shifts with its projector's principal point: that derivative is minus the local slope.
            across = np.linalg.inv(found.shared[:, :, LENS + 2 : LENS + 4])
            jacobian, error = across @ jacobian, (across @ error[:, :, None])[:, :, 0]
        rows.append(jacobian.reshape(-1, jacobian.shape[2]))
        errors.append(error.ravel())
    of_camera = [np.full(2 * len(p.view), p.name in ("printed", "marks")) for p in problem.parts]
    return np.concatenate(rows), np.concatenate(errors), np.concatenate(of_camera)


def _leverage(jacobian: Array) -> Array:
    """Return which share of each residual (m,) the parameters take up; they sum to their number."""
    basis = np.linalg.svd(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300), full_matrices=False)
    return np.asarray((basis.U[:, basis.S > 1e-10 * basis.S[0]] ** 2).sum(axis=1))


def _scatter(error: Array, taken: Array) -> ResidualClass:
    """Return the scatter of a class from its residuals (n, 2) px and what parameters take up of them (2n,)."""
    dof = max(error.size - float(taken.sum()), 1.0)
    return ResidualClass(len(error), 0, dof, float(np.sqrt((error**2).sum() / dof)))
