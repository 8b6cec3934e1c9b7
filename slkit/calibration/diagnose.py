"""The numbers behind a verdict: coverage, poses, uncertain parameters, corners that are off in every view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from slkit.calibration._parameters import Array, rms
from slkit.data import BoardView, Calibration, DeviceDiagnosis, Diagnosis, ViewPlace, ViewResult
from slkit.geometry import (
    LENS_NAMES,
    MOTION_NAMES,
    Pinhole,
    Pose,
    Rig,
    flat,
    ninths,
    sigmas_of,
)

_ALIKE = 0.99
ONE_DEPTH = 0.05
"""Boards whose middles differ by a smaller share of their depth are at one depth."""


def diagnosed(calibration: Calibration) -> Diagnosis:
    """Return what can be told from a calibration alone; `left_out` and maps are added by who can solve again."""
    used = [v for v in calibration.views if v.used and v.view is not None and v.pose is not None]
    rig = calibration.rig
    devices = {
        "camera": _device(rig.camera, used, Pose.identity(), "camera_xy", calibration),
        "projector": _device(rig.projector, used, rig.projector_from_camera, "projector_xy", calibration),
    }
    return Diagnosis(devices, _correlations(calibration), repeating(used))


def repeating(used: Sequence[ViewResult]) -> dict[str, tuple[Array, Array, Array]]:
    """Return for `printed` and `projected` points where they are, their mean camera error and its 1 sigma.

    Points (n, 2) mm on the board or px in the projector, seen in two views or more; mean (n, 2) px; sigma (n,) px.
    """
    result: dict[str, tuple[Array, Array, Array]] = {}
    for name, place in (("printed", "board_xy"), ("projected", "projector_xy")):
        rows: dict[tuple[float, ...], list[Array]] = {}
        for r in used:
            view, error, kept = r.view, r.camera_xy_error, r.kept
            if view is None or error is None or kept is None:
                continue
            bare = view.projected & ~view.printed
            chosen = kept & (bare if name == "projected" else view.printed & (not bare.any()))
            for xy, e in zip(getattr(view, place)[chosen], error[chosen], strict=True):
                rows.setdefault(tuple(np.round(xy, 6).tolist()), []).append(e)
        often = {k: np.array(v) for k, v in rows.items() if len(v) > 1}
        if not often:
            continue
        means = np.array([e.mean(axis=0) for e in often.values()])
        within = np.concatenate([e - e.mean(axis=0) for e in often.values()])
        dof = len(within) - len(often)
        scatter = float(np.sqrt((within**2).sum() / (2 * max(dof, 1))))
        result[name] = np.array(list(often)), means, np.array([scatter / np.sqrt(len(e)) for e in often.values()])
    return result


def seen_points(rig: Rig, view: BoardView, pose: Pose) -> Array:
    """Return points (n, 3) mm in the camera's frame that lie on the board of a view: its printed ones.

    Of a solid, whose sheet is folded, those in which the rays of camera and projector meet; rays that do not are left
    out. pose: camera_from_target.
    """
    if view.face is None:
        return pose.apply(flat(view.board_xy[view.printed]))
    points = rig.meet(view.camera_xy[view.projected], view.projector_xy[view.projected])
    return points[np.isfinite(points).all(axis=1)]


def board_depths(calibration: Calibration) -> tuple[float, ...]:
    """Return three depths in mm, nearest, middle and farthest, of the boards' middles that light fell on.

    Of boards at one depth those of their points; where these are at one depth too, this one.
    """
    points = [
        seen_points(calibration.rig, r.view.select(r.kept), r.pose)[:, 2]
        for r in calibration.views
        if r.used and r.pose is not None and r.view is not None and r.kept is not None and r.view.projected.any()
    ]
    points = [p for p in points if len(p)]
    if not points:
        return ()
    depths = [float(p.mean()) for p in points]
    if np.ptp(depths) < ONE_DEPTH * np.mean(depths):
        depths = np.concatenate(points).tolist()
    low, high = min(depths), max(depths)
    return (low, (low + high) / 2, high) if high > (1 + 1e-6) * low else (low,)


def with_left_out(diagnosis: Diagnosis, errors: Mapping[str, Array], calibration: Calibration) -> Diagnosis:
    """Return the diagnosis with leave-one-view-out errors; the total is over the views that locate the projector."""
    lit = [r.name for r in calibration.views if r.view is not None and r.view.projected.any()]
    chosen = [errors[n] for n in lit if n in errors]
    total = rms(np.concatenate(chosen)) if chosen else float("nan")
    return replace(diagnosis, left_out_px={n: rms(e) for n, e in errors.items()}, left_out_rms_px=total)


def _device(
    device: Pinhole, used: Sequence[ViewResult], motion: Pose, pixels: str, calibration: Calibration
) -> DeviceDiagnosis:
    places: dict[str, ViewPlace] = {}
    middles: list[float] = []
    for r in used:
        view, pose, kept = r.view, r.pose, r.kept
        if view is None or pose is None or kept is None:
            continue
        xy = getattr(view, pixels)[kept]
        xy = xy[np.isfinite(xy).all(axis=1)]
        depths = motion.apply(seen_points(calibration.rig, view.select(kept), pose))[:, 2]
        if not len(xy) or not len(depths):
            continue
        cosine = np.nan if view.face is not None else abs((motion @ pose).rotation[2, 2])
        tilt = float(np.degrees(np.arccos(np.clip(cosine, 0, 1))))
        places[r.name] = ViewPlace(ninths(xy, device.size), (float(depths.min()), float(depths.max())), tilt)
        middles.append(float(depths.mean()))
    counts = np.sum([np.zeros((3, 3), dtype=np.intp), *(p.coverage for p in places.values())], axis=0)
    tilts = [p.tilt_deg for p in places.values() if np.isfinite(p.tilt_deg)]
    name = "camera" if pixels == "camera_xy" else "projector"
    parameters = _parameters(name, device, motion, calibration)
    return DeviceDiagnosis(counts, _range(middles), _range(tilts), parameters, places)


def _range(values: Sequence[float]) -> tuple[float, float]:
    return (min(values), max(values)) if values else (float("nan"), float("nan"))


def _parameters(name: str, device: Pinhole, motion: Pose, calibration: Calibration) -> dict[str, tuple[float, float]]:
    """Return the device's free parameters with their 1 sigma; the motion's rotation as the motion it would take."""
    sigmas = sigmas_of(calibration.covariance)
    values = zip(LENS_NAMES, device.parameters.tolist(), strict=True)
    found = {n: (v, sigmas[f"{name}.{n}"]) for n, v in values if f"{name}.{n}" in sigmas}
    if name == "projector":
        moves = [*np.degrees(motion.rotation_vector), *motion.translation]
        for part, value in zip(MOTION_NAMES, moves, strict=True):
            sigma = sigmas.get(f"projector_from_camera.{part}")
            if sigma is not None:
                found[part] = float(value), float(np.degrees(sigma)) if part.startswith("r") else sigma
    return found


def _correlations(calibration: Calibration) -> tuple[tuple[str, str, float], ...]:
    """Return the pairs of parameters whose errors go together almost wholly, strongest first."""
    if calibration.covariance is None:
        return ()
    names, matrix = calibration.covariance["parameters"], np.asarray(calibration.covariance["matrix"])
    sigma = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    correlation = matrix / np.outer(sigma, sigma)
    rows, cols = np.nonzero(np.triu(np.abs(correlation) > _ALIKE, 1))
    pairs = [(str(names[i]), str(names[j]), float(correlation[i, j])) for i, j in zip(rows, cols, strict=True)]
    # Released points of a board follow each other by the hundred; only the rig's own parameters are of interest.
    own = [p for p in pairs if not any(n.startswith("board") for n in p[:2])]
    return tuple(sorted(own, key=lambda p: -abs(p[2])))
