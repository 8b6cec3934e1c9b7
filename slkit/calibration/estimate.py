"""From board views and a first guess of camera and poses to a calibration: what all methods have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from slkit.calibration._geometry_findings import geometry_findings
from slkit.calibration._parameters import Array, rms
from slkit.calibration._residuals import places
from slkit.calibration._sequence import in_sequence
from slkit.calibration._start import start_projector
from slkit.calibration.bundle import Adjusted, adjust, without_rejected
from slkit.calibration.model import Lens, Model
from slkit.calibration.surfaces import PointSet, Sheet, Surface
from slkit.calibration.verdict import verdict_of
from slkit.data import BoardView, Calibration, Finding, ViewResult
from slkit.geometry import Pinhole, Pose, Rig, homogeneous

_FEWEST_POINTS = 4
ENOUGH_VIEWS = 5
"""With fewer views of a flat board that locate the projector no calibration is called good."""


def estimate(
    method: str,
    views: Sequence[BoardView],
    placed: Mapping[str, Pose],
    camera: Pinhole,
    projector: tuple[int, int],
    model: Model,
    boards: Mapping[str, int] | None = None,
    surfaces: Sequence[Surface | None] | None = None,
    sides: Sequence[str] = ("the board",),
    enough_views: int = ENOUGH_VIEWS,
) -> Calibration:
    """Return the calibration that explains the views.

    placed: a first pose camera_from_target of every view that counts, by name; camera: a first guess, projector: size
    (w, h) px; boards: by name which board a view shows, default all the same; surfaces: one a board, None for a sheet;
    sides: how to call each board in a sentence; enough_views: that locate the projector, for a good verdict.
    Errors: CalibrationError where the points do not determine a projector.
    """
    used = [v for v in views if v.name in placed]
    poses = [placed[v.name] for v in used]
    shown = [(boards or {}).get(v.name, 0) for v in used]
    given = list(surfaces or [None] * (max(shown) + 1))
    points = [points_of(camera, p, v, given[b])[v.projected] for p, v, b in zip(poses, used, shown, strict=True)]
    pixels = [v.projector_xy[v.projected] for v in used]
    start = start_projector(points, pixels, projector, model.projector)
    rough = Rig(camera, start.projector, start.projector_from_camera)
    arguments = (rough, poses, used, model, shown, given)
    found = adjust(*arguments) if model.refine else in_sequence(*arguments)
    whole = all(mask.all() for mask in found.kept.values())
    plain = found if whole and found.weights else adjust(*arguments[:3], replace(model, loss="squares"), shown, given)
    rest = without_rejected(found) if found.rejected else plain
    findings = geometry_findings(found, plain, rest, used, sides, model)
    return assembled(method, views, used, found, model, findings, enough_views)


def points_of(camera: Pinhole, pose: Pose, view: BoardView, surface: Surface | None = None) -> Array:
    """Return the camera-frame points (n, 3) mm of a view's rows: on the target where printed, else by their ray.

    surface: of the target, None for a flat sheet.
    """
    printed, face = view.printed, view.faces
    surface = surface or Sheet(np.zeros(2), np.zeros(2), np.ones(2))
    local = np.empty((len(printed), 3))
    local[printed] = surface.place(view.board_xy[printed], face[printed])
    rays = homogeneous(camera.normalize(view.camera_xy[~printed])) @ pose.rotation
    eye = np.tile(pose.inverse().translation, (len(rays), 1))
    local[~printed] = surface.intersect(eye, rays, face[~printed])[0]
    return pose.apply(local)


def alone(
    device: Pinhole, lens: Lens, poses: Sequence[Pose], points: Sequence[Array], pixels: Sequence[Array]
) -> list[Array]:
    """Return the residuals (n, 2) px a view of a device that is adjusted by itself, each view with its own pose.

    poses: a first guess device_from_target, one a view; points: (n, 3) mm a view, pixels: (n, 2) px a view.
    """
    ends = np.cumsum([len(p) for p in points])
    numbers = np.split(np.arange(ends[-1]), ends[:-1])
    nothing = [np.full(p.shape, np.nan) for p in pixels]
    views = [
        BoardView(str(i), device.size, np.column_stack([n, n]).astype(np.float64), p, silent, silent, face=n)
        for i, (n, p, silent) in enumerate(zip(numbers, pixels, nothing, strict=True))
    ]
    model = Model(camera=lens, loss="squares")
    both = Rig(device, device, Pose.identity())
    found = adjust(both, poses, views, model, surfaces=[PointSet(np.concatenate(points))])
    error = found.problem.blocks(found.state)["printed"].error
    return np.split(error, ends[:-1])


def assembled(
    method: str,
    views: Sequence[BoardView],
    used: Sequence[BoardView],
    found: Adjusted,
    model: Model,
    findings: Sequence[Finding] = (),
    enough_views: int = ENOUGH_VIEWS,
) -> Calibration:
    """Return rig, residuals and verdict of what was found, as a calibration; used: the views that it was found from."""
    state, rejected = found.state, {used[i].name: reason for i, reason in found.rejected.items()}
    names = [v.name for v in used]
    poses = dict(zip(names, state.poses, strict=True))
    kept = dict(zip(names, found.kept_rows(used), strict=True))
    shown = dict(zip(names, found.problem.board.tolist(), strict=True))
    local = _local_points(used, found)
    errors = dict(zip(names, _errors(used, found, local), strict=True))
    own = dict(zip(names, _own_residuals(used, found, local, model), strict=True))
    results: list[ViewResult] = []
    pooled: list[Array] = []
    for view in views:
        if view.name not in poses or view.name in rejected:
            reason = rejected.get(view.name) or view.problem or "not needed"
            results.append(ViewResult(view.name, False, reason))
            continue
        (camera, projector), mask = errors[view.name], kept[view.name]
        joint = np.concatenate([camera[view.printed & mask], projector[view.projected & mask]])
        pooled.append(joint)
        reason = "; ".join([*view.notes, *_rejections(mask)])
        rms_camera, rms_projector = (rms(r) for r in own[view.name])
        results.append(
            ViewResult(
                view.name,
                True,
                reason,
                rms_camera,
                rms_projector,
                rms(joint),
                view,
                poses[view.name],
                camera,
                projector,
                mask,
                shown[view.name],
            )
        )
    evidence = {"parameters": list(found.names), "matrix": found.covariance}
    rms_joint = rms(np.concatenate(pooled))
    rms_camera, rms_projector = (rms(np.concatenate([own[r.name][k] for r in results if r.used])) for k in (0, 1))
    return Calibration(
        rig=replace(state.rig, covariance=evidence),
        method=method,
        views=tuple(results),
        rms_camera=rms_camera,
        rms_projector=rms_projector,
        rms_joint=rms_joint,
        covariance=evidence,
        verdict=verdict_of(rms_joint, results, findings, enough_views),
        notes=tuple(f"{r.name}: {r.reason}" for r in results if r.reason),
        classes=found.classes,
    )


def _rejections(mask: npt.NDArray[np.bool_]) -> list[str]:
    count = int((~mask).sum())
    return [f"{count} of {len(mask)} points lie too far out and were rejected"] if count else []


def _local_points(used: Sequence[BoardView], found: Adjusted) -> list[Array]:
    """Return per view its points (n, 3) mm in the target's frame, bare ones where their camera ray meets it."""
    state, problem = found.state, found.problem
    points: list[Array] = []
    for index, (view, pose) in enumerate(zip(used, state.poses, strict=True)):
        surface = state.surfaces[problem.board[index]]
        local = pose.inverse().apply(points_of(state.rig.camera, pose, view, surface))
        for part in problem.parts:
            if part.name in ("printed", "marks"):
                local[part.rows[index]] = places(part, state, problem.board)[0][part.view == index]
        points.append(local)
    return points


def _errors(used: Sequence[BoardView], found: Adjusted, local_points: Sequence[Array]) -> list[tuple[Array, Array]]:
    """Return per view the errors (n, 2) px of every row in the camera and in the projector, NaN where none."""
    state, problem = found.state, found.problem
    blocks = problem.blocks(state)
    result: list[tuple[Array, Array]] = []
    for index, (view, pose, local) in enumerate(zip(used, state.poses, local_points, strict=True)):
        camera, projector = np.full(view.camera_xy.shape, np.nan), np.full(view.camera_xy.shape, np.nan)
        for part in problem.parts:
            if part.name != "decoded":
                camera[part.rows[index]] = blocks[part.name].error[part.view == index]
        lit = view.projected
        projector[lit] = state.rig.to_projector(pose.apply(local[lit])) - view.projector_xy[lit]
        result.append((camera, projector))
    return result


def _own_residuals(
    used: Sequence[BoardView], found: Adjusted, local: Sequence[Array], model: Model
) -> list[tuple[Array, Array]]:
    """Return per view the residuals (n, 2) and (m, 2) px of camera and projector, each adjusted by itself."""
    state = found.state
    kept = [
        mask if index not in found.rejected else np.zeros(len(mask), dtype=bool)
        for index, mask in enumerate(found.kept_rows(used))
    ]
    result: list[list[Array]] = []
    for device, lens, motion, seen, pixels in (
        (state.rig.camera, model.camera, Pose.identity(), "printed", "camera_xy"),
        (state.rig.projector, model.projector, state.rig.projector_from_camera, "projected", "projector_xy"),
    ):
        rows = [getattr(v, seen) & mask for v, mask in zip(used, kept, strict=True)]
        chosen = [i for i, r in enumerate(rows) if r.sum() >= _FEWEST_POINTS]
        residuals = alone(
            device,
            lens,
            [motion @ state.poses[i] for i in chosen],
            [local[i][rows[i]] for i in chosen],
            [getattr(used[i], pixels)[rows[i]] for i in chosen],
        )
        by_view = dict(zip(chosen, residuals, strict=True))
        result.append([by_view.get(i, np.empty((0, 2))) for i in range(len(used))])
    return list(zip(*result, strict=True))
