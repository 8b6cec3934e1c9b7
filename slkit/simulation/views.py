"""Board views of a session computed from its geometry, without pictures: a calibrator's input within milliseconds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from slkit.data import BoardView
from slkit.geometry import homogeneous, transformed
from slkit.simulation.scene import bent_mm
from slkit.simulation.session import CODED, MARKS, PRINTED, PROJECTED, Session, Shot
from slkit.simulation.surface import Doubles

_BENDS = 30


def told_targets(session: Session) -> dict[str, Any]:
    """Return what calibration.toml says, right or wrong, as the fields of a calibrator: projector, printed, ..."""
    known = {"printed": session.printed, "marks": session.marks, "projected": session.projected}
    targets: dict[str, Any] = {name: target for name, target in known.items() if target is not None}
    return {"projector": session.rig.projector.size} | {
        name: replace(target, **session.told.get(name, {})) for name, target in targets.items()
    }


def board_views(session: Session, rng: np.random.Generator, noise_px: float = 0.1) -> list[BoardView]:
    """Return one view a pose, every point found with a Gaussian noise of that sigma in both directions.

    What the pictures alone would tell (light, focus, size, exchanged pictures) leaves no trace here.
    """
    by_role = {role: [s for s in session.shots if s.role == role] for role in (PRINTED, MARKS, PROJECTED, CODED)}
    views = [_printed_view(session, shot, rng, noise_px) for shot in by_role[PRINTED]]
    views += [_coded_view(session, shot, rng, noise_px) for shot in by_role[CODED]]
    pairs = zip(by_role[MARKS], by_role[PROJECTED], strict=True)
    return views + [_white_view(session, white, pattern, rng, noise_px) for white, pattern in pairs]


def _printed_view(session: Session, shot: Shot, rng: np.random.Generator, noise_px: float) -> BoardView:
    camera_xy = _noisy(_seen(session, shot), rng, noise_px)
    silent = np.full_like(camera_xy, np.nan)
    told = told_targets(session)["printed"].points()
    return BoardView(shot.name, shot.rig.camera.size, told, camera_xy, silent, silent)


def _coded_view(session: Session, shot: Shot, rng: np.random.Generator, noise_px: float) -> BoardView:
    camera_xy = _noisy(_seen(session, shot), rng, noise_px)
    panel_xy = shot.rig.to_projector(_points(session, shot))
    projector_xy = _noisy(transformed(np.linalg.inv(_warp(session)), panel_xy), rng, noise_px)
    told = told_targets(session)["printed"].points()
    sigma = np.full_like(camera_xy, noise_px)
    return BoardView(shot.name, shot.rig.camera.size, told, camera_xy, projector_xy, sigma)


def _white_view(session: Session, white: Shot, pattern: Shot, rng: np.random.Generator, noise_px: float) -> BoardView:
    told = told_targets(session)
    corners = told["projected"].points()
    lit = pattern.rig.camera.project(_lit_points(session, pattern, corners))
    camera_xy = np.concatenate([_noisy(_seen(session, white), rng, noise_px), _noisy(lit, rng, noise_px)])
    board_xy = told["marks"].points()
    unknown, silent = np.full_like(corners, np.nan), np.full_like(board_xy, np.nan)
    return BoardView(
        white.name,
        white.rig.camera.size,
        np.concatenate([board_xy, unknown]),
        camera_xy,
        np.concatenate([silent, corners]),
        np.concatenate([silent, np.zeros_like(corners)]),
    )


def _points(session: Session, shot: Shot) -> Doubles:
    """Return where the printed points of a board really are, (n, 3) mm in the camera frame."""
    target = session.target(shot)
    xy = target.points()
    return shot.pose.apply(np.column_stack([xy, bent_mm(xy, target.extent(), shot.bend)]))


def _seen(session: Session, shot: Shot) -> Doubles:
    return shot.rig.camera.project(_points(session, shot))


def _lit_points(session: Session, shot: Shot, projector_xy: Doubles) -> Doubles:
    """Return where the light of projector pixels (n, 2) meets the board, (n, 3) mm in the camera frame."""
    panel_xy = transformed(_warp(session), projector_xy)
    board_from_projector = (shot.rig.projector_from_camera @ shot.pose).inverse()
    rays = homogeneous(shot.rig.projector.normalize(panel_xy)) @ board_from_projector.rotation.T
    origin, extent = board_from_projector.translation, session.target(shot).extent()
    points = np.zeros_like(rays)
    for _ in range(_BENDS):
        height = bent_mm(points[:, :2], extent, shot.bend)
        points = origin + rays * ((height - origin[2]) / rays[:, 2])[:, None]
    return shot.pose.apply(points)


def _warp(session: Session) -> Doubles:
    return np.eye(3) if session.warp is None else session.warp


def _noisy(xy: Doubles, rng: np.random.Generator, noise_px: float) -> Doubles:
    return xy + noise_px * rng.standard_normal(xy.shape)
