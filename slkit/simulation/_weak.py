"""Poses that tell too little: parallel, at one depth, in one corner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slkit.geometry import Pose
from slkit.simulation.boards import board_poses, marks_for, projected_outline, rim
from slkit.simulation.rig import working_volume
from slkit.simulation.session import CODED, MARKS, PRINTED, Session, planar_patterns
from slkit.simulation.surface import Doubles
from slkit.targets import ProjectedCheckerboard

_JITTER_DEG = 1.5
_DEPTH_RANGE = {False: 1.03, True: 1.001}
_SHRINK = {False: 0.5, True: 0.35}


def parallel(session: Session, strong: bool, rng: np.random.Generator) -> Session:
    """Turn all boards of a side alike: within 1.5 degrees, or exactly."""

    def drawn_like(base: Pose) -> Callable[[], Doubles]:
        def draw() -> Doubles:
            jitter = np.zeros(3) if strong else np.radians(rng.uniform(-_JITTER_DEG, _JITTER_DEG, 3))
            return Pose.from_rotation_vector(jitter, np.zeros(3)).rotation @ base.rotation

        return draw

    def flattest(role: str) -> Pose:
        # A steep board fits into few places, and all the others must find one like it.
        return max((s.pose for s in session.shots if s.role == role), key=lambda pose: float(pose.rotation[2, 2]))

    first = CODED if session.method == "coded" else PRINTED
    side_b = {} if session.method == "coded" else {"rotation": drawn_like(flattest(MARKS))}
    return _redrawn(session, rng, {"rotation": drawn_like(flattest(first))}, side_b)


def one_depth(session: Session, strong: bool, rng: np.random.Generator) -> Session:
    """Put the middle of all boards at one distance: within 3 %, or within 0.1 %."""
    middle = float(working_volume(session.rig)[0][2])

    def depths(role: str) -> dict[str, Any]:
        # The middle one of the depths that this board has: not every board fits into the working distance.
        shots = sorted(float(s.pose.translation[2]) for s in session.shots if s.role == role)
        share = shots[len(shots) // 2] / middle
        return {"depths": (share, share * _DEPTH_RANGE[strong])}

    if session.method == "coded":
        return _redrawn(session, rng, depths(CODED), {})
    return _redrawn(session, rng, depths(PRINTED), depths(MARKS))


def one_corner(session: Session, strong: bool, rng: np.random.Generator) -> Session:
    """Use a small board, and a small pattern, in one quarter of the picture."""
    shrink = _SHRINK[strong]
    corner = rng.choice([-1.0, 1.0], 2)
    printed = replace(session.printed, square_mm=float(f"{shrink * session.printed.square_mm:.2g}"))
    small = replace(session, printed=printed)
    if session.projected is not None:
        projected = _cornered(session.projected, session.rig.projector.size, shrink, corner)
        marks, patterns = marks_for(session.rig, projected), planar_patterns(session.rig, projected)
        small = replace(small, projected=projected, marks=marks, patterns=patterns)
    camera = session.rig.camera
    middle = np.array(camera.size) / 2
    if session.method == "coded":
        middle = camera.project(working_volume(session.rig)[0])
    slack = 0.0 if strong else 0.08 * min(camera.size)
    corners = rim(printed.extent())

    def inside(pose: Pose) -> bool:
        return bool(((camera.project(pose.apply(corners)) - middle) * corner > -slack).all())

    return _redrawn(small, rng, {"accept": inside}, {})


def _cornered(
    pattern: ProjectedCheckerboard, size: tuple[int, int], shrink: float, corner: Doubles
) -> ProjectedCheckerboard:
    step = max(float(np.floor(shrink * pattern.step_px)), 8.0)
    smaller = replace(pattern, step_px=step)
    outline = projected_outline(smaller)
    low = np.where(corner < 0, -0.5, np.array(size) - 0.5 - np.ptp(outline, axis=0))
    first = np.array(smaller.first_xy) + low - outline.min(axis=0)
    return replace(smaller, first_xy=(float(first[0]), float(first[1])))


def _redrawn(session: Session, rng: np.random.Generator, side_a: dict[str, Any], side_b: dict[str, Any]) -> Session:
    """Return the session with new poses; side_a, side_b: how `board_poses` draws them."""
    coded = session.method == "coded"
    count = 1 + max(s.index for s in session.shots)
    first = board_poses(session.rig, session.printed.extent(), count, rng, lit=coded, **side_a)
    second = first
    if session.marks is not None:
        extent, given = session.marks.extent(), {"projected": session.projected, "marks": session.marks}
        second = board_poses(session.rig, extent, count, rng, **given, **side_b)
    shots = tuple(replace(s, pose=(first if s.role in (PRINTED, CODED) else second)[s.index]) for s in session.shots)
    return replace(session, shots=shots)
