"""How well a rig predicts a view that it was not solved from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slkit.calibration._parameters import Array
from slkit.calibration.bundle import adjust
from slkit.calibration.estimate import points_of
from slkit.calibration.model import Model
from slkit.calibration.solve import board_pose
from slkit.data import BoardView, Calibration, ViewResult
from slkit.errors import CalibrationError
from slkit.geometry import Rig
from slkit.protocols import Calibrator

Solver = Callable[[Sequence[ViewResult]], Rig]
"""What makes a rig of some of the views of a calibration."""
_FEWEST_HALVES = 6


def left_out(
    calibration: Calibration, solve: Solver, tell: Callable[[int, int], None] | None = None
) -> dict[str, Array]:
    """Return for each view that was used the errors (n, 2) px with which a rig solved without it predicts it.

    The view's pose comes from its printed points in the camera; the errors are those of its projected points in the
    projector, or of the printed ones where nothing is projected. Solids, and views without which too little is left,
    are left away. tell: is called with how many are done, and of how many.
    """
    used = [r for r in calibration.views if r.used and r.view is not None and r.view.face is None]
    errors: dict[str, Array] = {}
    for index, result in enumerate(used):
        if tell is not None:
            tell(index, len(used))
        others = [r for r in used if r is not result]
        if not _enough([_kept(r) for r in others]):
            continue
        try:
            error = predicted(solve(others), _kept(result))
        except CalibrationError:
            continue
        if error is not None:
            errors[result.name] = error
    return errors


def jointly(calibration: Calibration, model: Model) -> Solver:
    """Return what adjusts the rig of a calibration to some of its views, the rows that were kept weighed alike.

    model: what is estimated, also another than the calibration's.
    """
    whole = replace(model, loss="squares")

    def solve(chosen: Sequence[ViewResult]) -> Rig:
        names = sorted({r.board for r in chosen})
        poses = [pose for r in chosen if (pose := r.pose) is not None]
        boards = [names.index(r.board) for r in chosen]
        return adjust(calibration.rig, poses, [_kept(r) for r in chosen], whole, boards).state.rig

    return solve


def solver_of(calibration: Calibration, calibrator: Calibrator, model: Model) -> Solver:
    """Return what solves some views of a calibration as it was solved: jointly, or by the steps of its own method.

    model: what is estimated, also another than the calibrator's own.
    """
    # The steps of a paper are judged by what they predict themselves, not by what an adjustment makes of them.
    if model.refine and calibration.covariance is not None:
        return jointly(calibration, model)
    known: Any = calibrator
    own: Calibrator = known if known.model == model else replace(known, model=model)
    return lambda chosen: own.solve([_kept(r) for r in chosen]).rig


def _kept(result: ViewResult) -> BoardView:
    """Return the rows of a view that were not rejected."""
    view, kept = result.view, result.kept
    if view is None or kept is None:
        raise ValueError(f"{result.name} was not used")
    return view.select(kept)


def _enough(views: Sequence[BoardView]) -> bool:
    """Tell whether views determine a rig: two that locate the projector, and two with printed points."""
    return sum(bool(v.projected.any()) for v in views) >= 2 and sum(bool(v.printed.any()) for v in views) >= 2


def predicted(rig: Rig, view: BoardView) -> Array | None:
    """Return the errors (n, 2) px with which a rig predicts a view of a flat board that it was not solved from.

    As `left_out` says; None where the view's own pose cannot be had.
    """
    printed = view.printed
    try:
        pose, _, _ = board_pose(rig.camera, view.board_xy[printed], view.camera_xy[printed])
    except CalibrationError:
        return None
    points = points_of(rig.camera, pose, view)
    lit = view.projected
    if lit.any():
        error = rig.to_projector(points[lit]) - view.projector_xy[lit]
    else:
        error = rig.camera.project(points) - view.camera_xy
    return error if np.isfinite(error).all() else None


def halves(views: Sequence[BoardView]) -> tuple[list[BoardView], list[BoardView]] | None:
    """Return two halves of the usable views, every second one of each kind, or None where there are too few.

    Kinds are views with projected points and without.
    """
    parts: tuple[list[BoardView], list[BoardView]] = ([], [])
    for lit in (False, True):
        kind = [v for v in views if v.problem is None and bool(v.projected.any()) == lit]
        if kind and len(kind) < _FEWEST_HALVES:
            return None
        for index, view in enumerate(kind):
            parts[index % 2].append(view)
    return parts if all(parts) else None
