"""The conformance suite of calibrators."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.calibration.surfaces import Sheet, Surface
from slkit.data import BoardView, Calibration, Capture, ViewResult
from slkit.geometry import Pose, Rig, homogeneous
from slkit.protocols import Calibrator
from slkit.testing._require import require, require_refusal

_FEWEST_POINTS = 4
# A reported rms may be this much below the least that any pose reaches: rounding, and a solver that stopped early.
_SHARE, _SLACK_PX = 0.98, 0.005


def check_calibrator(
    calibrator: Calibrator, captures: Sequence[Capture], surface: Surface | None = None, fewest: int = 2
) -> None:
    """Try whether a calibrator keeps the promises that the rest of slkit relies on.

    captures: of boards that it can calibrate from, with two usable views or more. surface: what the target of views
    with a `face` looks like, None for flat boards. fewest: how many usable views it needs at the least.
    Errors: AssertionError with a sentence that says which promise is broken.
    """
    given: Any = calibrator
    require(isinstance(given, Calibrator), "a calibrator must have the methods observe and solve")
    require(dataclasses.is_dataclass(calibrator), "a calibrator must be a dataclass whose fields are its parameters")
    try:
        views = list(calibrator.observe([*captures, _blank(captures[-1])]))
    except Exception as error:
        raise AssertionError(
            f"a blank capture must not make observe() raise {type(error).__name__}: {error}"
        ) from error
    _check_views(views, captures)
    result = calibrator.solve(views)
    _check_result(result, views, fewest)
    for view, reported in zip(views, result.views, strict=True):
        if reported.used and view.printed.sum() >= _FEWEST_POINTS and np.isfinite(reported.rms_joint):
            least = _least_rms(result.rig, _kept(view, reported), surface if view.face is not None else None)
            require(
                reported.rms_joint >= _SHARE * least - _SLACK_PX,
                f"view {view.name} reports a joint rms of {reported.rms_joint:.3f} px, but with that rig no pose of "
                f"the board fits better than {least:.3f} px",
            )
    unusable = [v for v in views if v.problem is not None]
    usable = [v for v in views if v.problem is None]
    for few in ([], usable[: fewest - 1], unusable):
        what = f"solving from {len(few)} views, too few of them usable,"
        require_refusal(lambda few=few: calibrator.solve(few), what)


def _blank(capture: Capture) -> Capture:
    """Return a capture of the same kind in which nothing is seen."""
    changes: dict[str, Any] = {"name": "blank"}
    for field in ("printed", "marks", "projected", "lit"):
        image = getattr(capture, field)
        changes[field] = None if image is None else np.zeros_like(image)
    if capture.correspondences is not None:
        changes["correspondences"] = capture.correspondences.select(np.zeros(len(capture.correspondences), dtype=bool))
    return dataclasses.replace(capture, **changes)


def _check_views(views: Sequence[BoardView], captures: Sequence[Capture]) -> None:
    names = [v.name for v in views]
    wanted = [c.name for c in captures] + ["blank"]
    require(names == wanted, f"observe() must give one view a capture, in order: {wanted}, not {names}")
    require(views[-1].problem, "a blank capture must become a view whose problem says why it cannot be used")
    for view in views:
        rows = {len(a) for a in (view.board_xy, view.camera_xy, view.projector_xy, view.sigma)}
        require(len(rows) == 1, f"view {view.name}: board_xy, camera_xy, projector_xy and sigma differ in length")
        require(view.problem is None or rows == {0}, f"view {view.name} has a problem, so it must have no rows")
        require(np.isfinite(view.camera_xy).all(), f"view {view.name}: camera_xy holds a number that is not finite")
        known = view.printed | view.projected
        require(known.all(), f"view {view.name}: a row needs a place on the board or in the projector image")
        require(view.face is None or {len(view.face)} == rows, f"view {view.name}: face needs one number a row")


def _check_result(result: Any, views: Sequence[BoardView], fewest: int) -> None:
    require(isinstance(result, Calibration), "solve() must return a Calibration")
    names = [v.name for v in result.views]
    require(names == [v.name for v in views], f"the calibration must tell of every view, in order; it tells of {names}")
    for view, reported in zip(views, result.views, strict=True):
        require(not (reported.used and view.problem), f"view {view.name} has a problem and cannot have been used")
        require(reported.used or reported.reason, f"view {view.name} was not used: the reason must be given")
    require(sum(v.used for v in result.views) >= fewest, f"fewer than {fewest} views were used")
    for name in ("rms_camera", "rms_projector", "rms_joint"):
        value = getattr(result, name)
        require(np.isfinite(value) and value >= 0, f"{name} must be a number of pixels, not {value}")
    sizes = {v.image_size for v in views if v.problem is None}
    require(
        result.rig.camera.size in sizes, f"the camera of the rig has the size {result.rig.camera.size}, not {sizes}"
    )


def _kept(view: BoardView, reported: ViewResult) -> BoardView:
    """Return the view without the rows that were rejected: the reported figures leave them out."""
    if reported.kept is None:
        return view
    return view.select(reported.kept)


def _least_rms(rig: Rig, view: BoardView, surface: Surface | None) -> float:
    """Return the least rms in px of camera and projector residuals of a view under one shared pose."""
    import cv2
    from scipy.optimize import least_squares

    shape, face = surface or Sheet.flat(view.board_xy[view.printed]), view.faces
    places = shape.place(view.board_xy[view.printed], face[view.printed])
    undistorted = rig.camera.normalize(view.camera_xy[view.printed])
    flags = cv2.SOLVEPNP_IPPE if surface is None else cv2.SOLVEPNP_SQPNP
    _, turn, shift = cv2.solvePnP(places, undistorted, np.eye(3), np.zeros(5), flags=flags)
    start = Pose.from_rotation_vector(np.ravel(turn), np.ravel(shift))

    def residuals(motion: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        pose = Pose.from_rotation_vector(motion[:3], motion[3:]) @ start
        return np.nan_to_num(_residuals(rig, pose, view, shape), nan=1e3).ravel()

    best = least_squares(residuals, np.zeros(6), x_scale=[1e-3, 1e-3, 1e-3, 1, 1, 1])
    return float(np.sqrt(2 * np.mean(best.fun**2)))


def _residuals(rig: Rig, pose: Pose, view: BoardView, surface: Surface) -> npt.NDArray[np.float64]:
    """Return camera residuals of the printed rows and projector residuals of the projected ones, (n, 2) px.

    A projected row that is not printed lies where its camera ray meets the surface.
    """
    printed, face = view.printed, view.faces
    rays = homogeneous(rig.camera.normalize(view.camera_xy)) @ pose.rotation
    local = surface.intersect(np.tile(pose.inverse().translation, (len(rays), 1)), rays, face)[0]
    local[printed] = surface.place(view.board_xy[printed], face[printed])
    xyz = pose.apply(local)
    camera = rig.camera.project(xyz[printed]) - view.camera_xy[printed]
    return np.concatenate([camera, rig.to_projector(xyz[view.projected]) - view.projector_xy[view.projected]])
