"""A calibration as it is carried out: which boards, which poses, which light, and what the user says of them.

A session is taken as pictures (`take`) or computed as board views (`simulation.views`); a fault changes a session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from slkit.data import Frames, Image
from slkit.geometry import Pose, Rig, flat, ninths
from slkit.simulation.boards import board_poses, boards_for, rim
from slkit.simulation.rig import working_volume
from slkit.simulation.scanner import Optics, SimulatedScanner
from slkit.simulation.scene import Bend, Extent, board
from slkit.simulation.surface import Doubles
from slkit.targets import PAPER, Checkerboard, CornerMarks, ProjectedCheckerboard

PRINTED, MARKS, PROJECTED, CODED = "printed", "marks", "projected", "coded"
_VARIED = 0.1
"""Depths of a board that a careful user holds nearer and farther span at least this share of their mean."""
_BRIGHTEST = 0.93
"""Share of full scale that the brightest paper of a well exposed picture reaches."""
_COVERED = 14
"""Of the eighteen ninths of both images a careful user covers so many, if it can be done."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What one release of the camera, or one sequence of coded light, really sees.

    name: file or folder; role: printed, marks, projected or coded; index: which pose; pose: camera_from_board; rig and
    optics: as they are at that moment; first: place of its first picture in the sequence of patterns; shown: for each
    picture the place in the sequence that is really lit, 0.5 being half of 0 and half of 1; () for room light. bend:
    how far the board is from flat. turns, scale: what happens to its pictures later: quarter turns, and a factor.
    """

    name: str
    role: str
    index: int
    pose: Pose
    rig: Rig
    optics: Optics
    seed: int
    first: int = 0
    shown: tuple[float, ...] = ()
    bend: Bend = (0.0, 0.0)
    turns: int = 0
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Session:
    """All shots of a calibration. marks, projected: None for coded light on the printed board.

    patterns: what is sent to the projector; for a two-sided board white and the checkerboard. told: what
    calibration.toml says other than the truth. warp: (3, 3), from pixels of a pattern to pixels of the panel.
    """

    rig: Rig
    printed: Checkerboard
    marks: CornerMarks | None
    projected: ProjectedCheckerboard | None
    patterns: Frames
    shots: tuple[Shot, ...]
    told: Mapping[str, Any] = field(default_factory=dict)
    warp: Doubles | None = None

    @property
    def method(self) -> str:
        """`planar` or `coded`: what a fault applies to."""
        return "coded" if self.marks is None else "planar"

    def target(self, shot: Shot) -> Checkerboard | CornerMarks:
        """Return the side of the board that a shot sees."""
        return self.printed if self.marks is None or shot.role == PRINTED else self.marks

    def sheet(self, target: Checkerboard | CornerMarks) -> Extent:
        """Return the panel as a side sees it, x min, y min, x max, y max in mm: both sides are equally large."""
        sides = (self.printed,) if self.marks is None else (self.printed, self.marks)
        size = np.max([np.subtract(side.extent()[2:], side.extent()[:2]) for side in sides], axis=0)
        middle = np.add(target.extent()[2:], target.extent()[:2]) / 2
        (x0, y0), (x1, y1) = middle - size / 2, middle + size / 2
        return float(x0), float(y0), float(x1), float(y1)


def planar_session(
    rig: Rig, poses: int, rng: np.random.Generator, optics: Optics | None = None, seed: int = 0
) -> Session:
    """Return a calibration with a two-sided board: side A under room light, side B under white and the pattern.

    Errors: InputError where no pose is visible.
    """
    printed, marks, projected = boards_for(rig)
    side_a = board_poses(rig, printed.extent(), poses, rng)
    side_b = _varied(lambda n: board_poses(rig, marks.extent(), n, rng, projected=projected, marks=marks), poses)
    optics = optics or _exposed(rig, marks.extent(), side_b)
    # Every pose has its own noise, also for the frames that all poses have in common.
    shots = [Shot(f"side_a/{i:03d}", PRINTED, i, p, rig, optics, 1000 * seed + i) for i, p in enumerate(side_a)]
    for i, pose in enumerate(side_b):
        own = 1000 * seed + poses + i
        shots.append(Shot(f"side_b_white/{i:03d}", MARKS, i, pose, rig, optics, own, 0, (0.0,)))
        shots.append(Shot(f"side_b_pattern/{i:03d}", PROJECTED, i, pose, rig, optics, own, 1, (1.0,)))
    return Session(rig, printed, marks, projected, planar_patterns(rig, projected), tuple(shots))


def _varied(draw: Callable[[int], tuple[Pose, ...]], count: int) -> tuple[Pose, ...]:
    """Return poses that are not all at one depth; where they are, nearest and farthest are taken from twice as many."""
    poses = draw(count)
    depths = [pose.translation[2] for pose in poses]
    if count < 3 or np.ptp(depths) > _VARIED * np.mean(depths):
        return poses
    others = draw(count)
    near, far = int(np.argmin(depths)), int(np.argmax(depths))
    nearest, *_, farthest = sorted([*others, poses[near], poses[far]], key=lambda pose: float(pose.translation[2]))
    return tuple({near: nearest, far: farthest}.get(i, pose) for i, pose in enumerate(poses))


def _spread(draw: Callable[[int], tuple[Pose, ...]], count: int, rig: Rig, printed: Checkerboard) -> tuple[Pose, ...]:
    """Return poses that cover both images; where they cover little, those of more poses that cover the most."""

    def covered(pose: Pose) -> Any:
        xyz = pose.apply(flat(printed.points()))
        seen = ((rig.camera.project(xyz), rig.camera), (rig.to_projector(xyz), rig.projector))
        return np.concatenate([ninths(xy, device.size).ravel() > 0 for xy, device in seen])

    pool = list(draw(count))
    if np.any([covered(p) for p in pool], axis=0).sum() >= _COVERED:
        return tuple(pool)
    pool += draw(2 * count)
    chosen: list[Pose] = []
    filled = np.zeros(18, dtype=bool)
    while len(chosen) < count:
        chosen.append(pool.pop(int(np.argmax([(covered(p) & ~filled).sum() for p in pool]))))
        filled |= covered(chosen[-1])
    return tuple(chosen)


def _exposed(rig: Rig, sheet: Extent, poses: tuple[Pose, ...]) -> Optics:
    """Return optics whose exposure suits the brightest place of all boards, as a careful user sets it."""
    optics, eye = Optics(), rig.projector_center
    reference = float(np.linalg.norm(working_volume(rig)[0] - eye))
    brightest = 0.0
    for pose in poses:
        away = pose.apply(rim(sheet)) - eye
        distance = np.linalg.norm(away, axis=1)
        light = np.abs(away @ pose.rotation[:, 2]) / distance * (reference / distance) ** 2
        brightest = max(brightest, PAPER * (optics.white_level * float(light.max()) + optics.ambient))
    factor = min(_BRIGHTEST / brightest, 1.0)
    return replace(optics, white_level=factor * optics.white_level, ambient=factor * optics.ambient)


def coded_session(
    rig: Rig, poses: int, patterns: Frames, rng: np.random.Generator, optics: Optics | None = None, seed: int = 0
) -> Session:
    """Return a calibration with coded light, the frames `patterns`, on a printed board.

    Errors: InputError where no pose is visible.
    """
    printed = boards_for(rig, lit=True)[0]
    found = _spread(lambda n: board_poses(rig, printed.extent(), n, rng, lit=True), poses, rig, printed)
    optics = optics or _exposed(rig, printed.extent(), found)
    shown = tuple(float(i) for i in range(len(patterns)))
    shots = tuple(
        Shot(f"pose{i}", CODED, i, pose, rig, optics, 1000 * seed + i, 0, shown) for i, pose in enumerate(found)
    )
    return Session(rig, printed, None, None, patterns, shots)


def planar_patterns(rig: Rig, projected: ProjectedCheckerboard) -> Frames:
    """Return white and the checkerboard as frames for the rig's projector."""
    width, height = rig.projector.size
    white = np.full((height, width), 255, np.uint8)
    return Frames.of([white, projected.draw((width, height))], ["white", "pattern"])


class Camera:
    """Takes the pictures of a session; shots of one board at one place share the tracing of rays.

    keep: how many places are held in memory.
    """

    def __init__(self, session: Session, keep: int = 1) -> None:
        self._session = session
        self._keep = keep
        self._lit: dict[float, Image] = {}
        self._traced: dict[tuple[Any, ...], SimulatedScanner] = {}

    def of(self, session: Session) -> Camera:
        """Return a camera for a session that has places in common with this one, which are not traced again."""
        other = Camera(session, self._keep)
        other._traced = self._traced
        return other

    def take(self, shot: Shot) -> Frames:
        """Return the pictures of a shot, each rendered when it is asked for; names as the patterns'."""
        scanner = self._scanner(shot)
        if shot.role == PRINTED:
            return Frames(("photograph",), lambda _: _finished(scanner.photograph(), shot))
        names = self._session.patterns.names
        lit = {shot.first + i: place for i, place in enumerate(shot.shown)}
        seen = scanner.capture(Frames(names, lambda i: self._light(lit[i])))
        wanted = list(lit)
        return Frames(tuple(names[i] for i in wanted), lambda i: _finished(seen[wanted[i]], shot))

    def _scanner(self, shot: Shot) -> SimulatedScanner:
        target = self._session.target(shot)
        key = (target, shot.pose, shot.rig, shot.bend, shot.optics.samples)
        if key not in self._traced:
            while len(self._traced) >= self._keep:
                self._traced.pop(next(iter(self._traced)))
            self._traced[key] = SimulatedScanner(
                board(target, shot.pose, self._session.sheet(target), shot.bend), shot.rig, shot.optics
            )
        return self._traced[key].under(shot.optics, shot.seed)

    def _light(self, place: float) -> Image:
        """Return what leaves the panel at a place of the sequence."""
        if place not in self._lit:
            low, share = int(place), place % 1
            picture = self._session.patterns[low]
            if share:
                after = self._session.patterns[low + 1]
                picture = ((1 - share) * picture + share * after + 0.5).astype(np.uint8)
            # Only what is used again is kept: a sequence of coded light would fill the memory.
            if len(self._lit) > 2:
                self._lit.clear()
            self._lit[place] = _warped(picture, self._session.warp)
        return self._lit[place]


def _warped(picture: Image, warp: Doubles | None) -> Image:
    if warp is None:
        return picture
    import cv2

    warped: Any = cv2.warpPerspective(picture, warp, picture.shape[1::-1], flags=cv2.INTER_LINEAR)
    return warped


def _finished(picture: Image, shot: Shot) -> Image:
    stored: Any = picture
    if shot.scale != 1:
        import cv2

        stored = cv2.resize(stored, None, fx=shot.scale, fy=shot.scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.rot90(stored, shot.turns))


def changed(session: Session, *shots: Shot) -> Session:
    """Return the session with shots put in the place of those of the same name."""
    new = {shot.name: shot for shot in shots}
    return replace(session, shots=tuple(new.get(shot.name, shot) for shot in session.shots))
