"""What goes wrong with light, lens, board, pictures and numbers; one function a mistake.

All take a session, whether the mistake is the strong form, and a random generator that chooses views and directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slkit.geometry import Pinhole, Pose
from slkit.simulation.rig import working_distance
from slkit.simulation.session import CODED, MARKS, PRINTED, PROJECTED, Session, Shot
from slkit.simulation.surface import Doubles

Random = np.random.Generator


def swapped(session: Session, strong: bool, rng: Random) -> Session:
    """Exchange the two pictures of one pose, or of all."""
    those = _some(session, 1.0 if strong else 0.0, rng)
    return _each(session, lambda s: replace(s, shown=(1.0 - s.shown[0],)) if _white_side(s) and s.index in those else s)


def moved(session: Session, strong: bool, rng: Random) -> Session:
    """Move the board before the second picture: 3 mm and 0.5 degrees in two poses of ten, 20 mm and 4 degrees in half.

    Half of the motion goes along the board's normal: a board that slides in its own plane does no harm.
    """
    those = _some(session, 0.5 if strong else 0.2, rng)
    length, angle = (20.0, 4.0) if strong else (3.0, 0.5)

    def move(shot: Shot) -> Shot:
        if shot.role != PROJECTED or shot.index not in those:
            return shot
        around = rng.uniform(0, 2 * np.pi)
        shift = length * np.sqrt(0.5) * np.array([np.cos(around), np.sin(around), rng.choice([-1.0, 1.0])])
        turn = rng.normal(size=3)
        motion = Pose.from_rotation_vector(np.radians(angle) * turn / np.linalg.norm(turn), shift)
        return replace(shot, pose=shot.pose @ motion)

    return _each(session, move)


def stale(session: Session, strong: bool, rng: Random) -> Session:
    """Show what was shown before: planar half of it in two poses of ten, or all of it in half of them.

    Coded light: one frame of one pose, or all frames of half of the poses from one frame on.
    """
    those = _some(session, 0.5 if strong else 0.2 if session.method == "planar" else 0.0, rng)

    def lag(shot: Shot) -> Shot:
        if shot.index not in those:
            return shot
        if shot.role == PROJECTED:
            return replace(shot, shown=(0.0 if strong else 0.5,))
        if shot.role != CODED:
            return shot
        # Not the first frames: white shown for white, or black for black, would change nothing.
        late = int(rng.integers(3, max(len(shot.shown) * 2 // 3, 4)))
        last = len(shot.shown) if strong else late + 1
        return replace(shot, shown=tuple(p - 1 if late <= i < last else p for i, p in enumerate(shot.shown)))

    return _each(session, lag)


def not_native(session: Session, strong: bool, rng: Random) -> Session:
    """Squeeze columns or rows by 1.03 or 1.2 about the middle of the panel."""
    factors = np.ones(2)
    factors[rng.integers(2)] /= 1.2 if strong else 1.03
    return replace(session, warp=_about_middle(session, np.diag(factors)))


def keystone(session: Session, strong: bool, rng: Random) -> Session:
    """Narrow one edge of the image by 2 or 10 % of its width, unevenly, and one side by half as much of its height."""
    import cv2

    width, height = session.rig.projector.size
    size = 0.10 if strong else 0.02
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float64) - 0.5
    target = corners.copy()
    share, other = rng.uniform(0.3, 0.7, 2)
    left, right = ((0, 1), (3, 2))[rng.integers(2)]
    target[left, 0] += share * size * width
    target[right, 0] -= (1 - share) * size * width
    above, below = ((0, 3), (1, 2))[rng.integers(2)]
    target[above, 1] += other * size * height / 2
    target[below, 1] -= (1 - other) * size * height / 2
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), target.astype(np.float32))
    return replace(session, warp=np.asarray(matrix, dtype=np.float64))


def mirrored(session: Session, strong: bool, rng: Random) -> Session:
    """Mirror the image left to right, or upside down."""
    return replace(session, warp=_about_middle(session, np.diag([1.0, -1.0] if strong else [-1.0, 1.0])))


def turned(session: Session, strong: bool, rng: Random) -> Session:
    """Turn the image by 180 degrees, or by 90 and made to fit."""
    width, height = session.rig.projector.size
    fit = min(width, height) / max(width, height)
    turn = fit * np.array([[0.0, -1.0], [1.0, 0.0]]) if strong else -np.eye(2)
    return replace(session, warp=_about_middle(session, turn))


def wrong_corners(session: Session, strong: bool, rng: Random) -> Session:
    """Count one corner too few or too many in one direction; or two in both, or exchange the projected counts."""
    if strong and rng.integers(2):
        nx, ny = session.projected.corners if session.projected is not None else (0, 0)
        return replace(session, told={"projected": {"corners": (ny, nx)}})
    nx, ny = session.printed.corners
    step = int(rng.choice([-1, 1]))
    counts = (nx + 2 * step, ny + 2 * step) if strong else ((nx + step, ny), (nx, ny + step))[rng.integers(2)]
    return replace(session, told={"printed": {"corners": counts}})


def wrong_square(session: Session, strong: bool, rng: Random) -> Session:
    """Mistype the size of a square by a factor of 1.1, or of 2.54."""
    factor = (2.54 if strong else 1.1) ** int(rng.choice([-1, 1]))
    return replace(session, told={"printed": {"square_mm": factor * session.printed.square_mm}})


def wrong_marks(session: Session, strong: bool, rng: Random) -> Session:
    """Mistype one coordinate of one mark by 10 %, or all of them; or all by a factor of 2."""
    places = session.marks.points() if session.marks is not None else np.empty((0, 2))
    factor = (2.0 if strong else 1.1) ** int(rng.choice([-1, 1]))
    scale = np.ones_like(places)
    if strong or rng.integers(2):
        scale[:] = factor
    else:
        scale[rng.integers(len(places)), rng.integers(2)] = factor
    typed = tuple((float(x), float(y)) for x, y in places * scale)
    return replace(session, told={"marks": {"xy_mm": typed}})


def bent(session: Session, strong: bool, rng: Random) -> Session:
    """Bend the side that the projector lights to a cylinder of 2 or 5 mm."""
    sagitta = (5.0 if strong else 2.0) * rng.choice([-1.0, 1.0])
    bend = (float(sagitta), float(rng.uniform(0, 180)))
    return _each(session, lambda s: s if s.role == PRINTED else replace(s, bend=bend))


def saturated(session: Session, strong: bool, rng: Random) -> Session:
    """Expose a quarter of the poses three times as long, or all of them six times."""
    return _exposed(session, 6.0 if strong else 3.0, _some(session, 1.0 if strong else 0.25, rng))


def under_exposed(session: Session, strong: bool, rng: Random) -> Session:
    """Expose a quarter of the poses for a twelfth of the time, or all of them for a fiftieth."""
    return _exposed(session, 1 / 50 if strong else 1 / 12, _some(session, 1.0 if strong else 0.25, rng))


def blurred(session: Session, strong: bool, rng: Random) -> Session:
    """Blur a quarter of the poses by 0.12 of a square of the printed board, or all of them by 0.18."""
    those = _some(session, 1.0 if strong else 0.25, rng)
    camera = session.rig.camera
    square = session.printed.square_mm * float(camera.K[0, 0]) / working_distance(session.rig)
    blur = (0.18 if strong else 0.12) * square

    def change(shot: Shot) -> Shot:
        optics = replace(shot.optics, camera_blur_px=float(np.hypot(shot.optics.camera_blur_px, blur)))
        return replace(shot, optics=optics) if shot.index in those else shot

    return _each(session, change)


def zoomed(session: Session, strong: bool, rng: Random) -> Session:
    """Change focal length and principal point of the camera half way: 1 % and 3 px, or 6 % and 10 px."""
    factor, shift = (1.06, 10.0) if strong else (1.01, 3.0)
    camera, around = session.rig.camera, rng.uniform(0, 2 * np.pi)
    matrix = np.array(camera.K)
    matrix[:2, :2] *= factor ** int(rng.choice([-1, 1]))
    matrix[:2, 2] += shift * np.array([np.cos(around), np.sin(around)])
    rig = replace(session.rig, camera=Pinhole(camera.size, matrix, camera.distortion))
    half = (1 + max(s.index for s in session.shots)) / 2
    return _each(session, lambda s: replace(s, rig=rig) if s.index >= half else s)


def exif_rotated(session: Session, strong: bool, rng: Random) -> Session:
    """Turn the pictures of one pose, or of four in ten, by 90 degrees."""
    those, turns = _some(session, 0.4 if strong else 0.0, rng), int(rng.choice([1, 3]))
    return _each(session, lambda s: replace(s, turns=turns) if s.index in those else s)


def other_size(session: Session, strong: bool, rng: Random) -> Session:
    """Save the pictures of one pose at 0.8 of their size, or of four poses in ten at half of it."""
    those, scale = _some(session, 0.4 if strong else 0.0, rng), 0.5 if strong else 0.8
    return _each(session, lambda s: replace(s, scale=scale) if s.index in those else s)


def gamma(session: Session, strong: bool, rng: Random) -> Session:
    """Let the projector's light be the 1.6th or the 2.6th power of the value."""
    power = 2.6 if strong else 1.6
    return _each(session, lambda s: replace(s, optics=replace(s.optics, projector_gamma=power)))


def _exposed(session: Session, factor: float, those: frozenset[int]) -> Session:
    def change(shot: Shot) -> Shot:
        light: dict[str, Any] = {name: factor * getattr(shot.optics, name) for name in ("white_level", "ambient")}
        return replace(shot, optics=replace(shot.optics, **light)) if shot.index in those else shot

    return _each(session, change)


def _each(session: Session, change: Callable[[Shot], Shot]) -> Session:
    return replace(session, shots=tuple(change(s) for s in session.shots))


def _some(session: Session, share: float, rng: Random) -> frozenset[int]:
    """Return a share of the poses, at least one."""
    count = 1 + max(s.index for s in session.shots)
    return frozenset(rng.permutation(count)[: max(round(share * count), 1)].tolist())


def _white_side(shot: Shot) -> bool:
    return shot.role in (MARKS, PROJECTED)


def _about_middle(session: Session, linear: Doubles) -> Doubles:
    """Return a linear map (2, 2) of the panel about its middle as (3, 3)."""
    middle = (np.array(session.rig.projector.size) - 1) / 2
    matrix = np.eye(3)
    matrix[:2, :2] = linear
    matrix[:2, 2] = middle - linear @ middle
    return matrix
