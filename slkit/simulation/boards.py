"""Calibration boards that suit a rig, at random poses that its devices can see."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slkit.errors import InputError
from slkit.geometry import Pose, Rig, flat, homogeneous, intersect_plane
from slkit.simulation.rig import in_view, seen_by, working_distance, working_volume
from slkit.simulation.scene import Extent
from slkit.simulation.surface import Doubles
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard

_DRAWS_PER_POSE = 3000
_MARGIN_PX = 8.0
_DEPTHS = (0.78, 1.2)
_STEEPEST = np.cos(np.radians(65))


def boards_for(rig: Rig, lit: bool = False) -> tuple[Checkerboard, CornerMarks, ProjectedCheckerboard]:
    """Return side A, side B (its sheet is marks.extent()) and the projected pattern that suit a rig.

    Side B holds the whole projected pattern at the working distance with its marks at the pattern's corners. The
    pattern is slkit's own for that projector, made smaller where the camera would not see all of it. lit: side A is
    small enough for the projector to light it whole, for coded light on the printed board.
    """
    distance = working_distance(rig)
    width, height = rig.camera.size
    focal_x, focal_y = rig.camera.K[0, 0], rig.camera.K[1, 1]
    view = np.array([width / focal_x, height / focal_y]) * distance
    pattern = _pattern(rig, distance, view)
    marks = marks_for(rig, pattern)
    # 13 x 10 squares with the margin: about six tenths of what the camera sees.
    square = 0.62 * float(min(view / [13, 10]))
    if lit:
        square = min(square, 1.2 * working_volume(rig)[1] / float(np.hypot(6.5, 5)))
    return Checkerboard((10, 7), _round(square)), marks, pattern


def marks_for(rig: Rig, pattern: ProjectedCheckerboard) -> CornerMarks:
    """Return side B for a projected pattern: its marks lie at the pattern's corners at the working distance."""
    distance = working_distance(rig)
    span = _span(rig, distance, pattern)
    # Ten camera px, unless the marks would come too near the projected corners.
    squares = span / (np.array(pattern.corners) + 1)
    cell = _round(min(10 * distance / min(rig.camera.K[0, 0], rig.camera.K[1, 1]), 0.5 * float(squares.min())))
    half = np.maximum(1.16 * span / 2 - 3 * cell, 4 * cell)
    x, y = (_round(float(v)) for v in half)
    return CornerMarks(((-x, -y), (x, -y), (x, y), (-x, y)), cell)


def projected_outline(pattern: ProjectedCheckerboard, squares: float = 1.0) -> Doubles:
    """Return points (n, 2) px around the pattern's inner corners, that many squares outside them."""
    first, last = pattern.points()[0] - squares * pattern.step_px, pattern.points()[-1] + squares * pattern.step_px
    return _perimeter((first[0], first[1], last[0], last[1]))


def board_poses(
    rig: Rig,
    extent: Extent,
    count: int,
    rng: np.random.Generator,
    *,
    lit: bool = False,
    projected: ProjectedCheckerboard | None = None,
    marks: CornerMarks | None = None,
    tilt_deg: tuple[float, float] = (5.0, 38.0),
    depths: tuple[float, float] = _DEPTHS,
    rotation: Callable[[], Doubles] | None = None,
    accept: Callable[[Pose], bool] | None = None,
) -> tuple[Pose, ...]:
    """Return random poses camera_from_board of a sheet that the camera sees whole.

    extent: x min, y min, x max, y max in mm. lit: the projector's image covers it too. projected: that pattern, every
    outer square included, falls on the sheet; then marks stay clear of its corners and off the border of the
    projector's light. tilt_deg: smallest and largest angle between the sheet and the camera's image. depths: nearest
    and farthest, in working distances. rotation: draws (3, 3) instead. accept: whether a pose will do.
    Errors: InputError where so many random draws find none.
    """
    middle, radius = working_volume(rig)

    def draw() -> Pose | None:
        turn = _rotation(rng, tilt_deg) if rotation is None else rotation()
        depth = middle[2] * rng.uniform(*depths)
        if projected is not None:
            return _under_pattern(rig, extent, turn, middle * depth / middle[2], projected, marks, rng)
        if lit:
            place = middle + np.append(rng.uniform(-0.6, 0.6, 2), 0) * radius
        else:
            pixel = rng.uniform(0.15, 0.85, 2) * rig.camera.size
            place = homogeneous(rig.camera.normalize(pixel))
        pose = _placed(extent, turn, place * depth / place[2])
        return pose if _visible(rig, extent, pose, lit) else None

    return _accepted(draw, accept or (lambda pose: True), count, extent)


def _accepted(
    draw: Callable[[], Pose | None], accept: Callable[[Pose], bool], count: int, extent: Extent
) -> tuple[Pose, ...]:
    poses: list[Pose] = []
    for _ in range(_DRAWS_PER_POSE * count):
        if len(poses) == count:
            break
        pose = draw()
        if pose is not None and accept(pose):
            poses.append(pose)
    if len(poses) < count:
        size = f"{extent[2] - extent[0]:.0f} x {extent[3] - extent[1]:.0f} mm"
        raise InputError(
            f"{_DRAWS_PER_POSE * count} random draws found {len(poses)} of {count} poses at which this rig sees all it"
            f" must of a board of {size}: the board is too large or too small for it, or the tilt too steep"
        )
    return tuple(poses)


def _span(rig: Rig, distance: float, pattern: ProjectedCheckerboard) -> Doubles:
    """Return the width and height (2,) in mm of a pattern on a plane at a distance."""
    plane = Pose(np.eye(3), np.array([0, 0, distance]))
    return np.ptp(_on_board(rig, plane, projected_outline(pattern)), axis=0)


def _pattern(rig: Rig, distance: float, view: Doubles) -> ProjectedCheckerboard:
    """Return slkit's own pattern, or a smaller one where the camera would not see all of it."""
    pattern = ProjectedCheckerboard.for_projector(rig.projector.size)
    span = _span(rig, distance, pattern)
    if (span <= 0.8 * view).all():
        return pattern
    shrink = float(np.min(0.68 * view / span))
    squares = np.array(pattern.corners) + 1
    step = float(max(np.floor(pattern.step_px * shrink), 8))
    size = np.array(rig.projector.size)
    middle = rig.to_projector(working_volume(rig)[0])
    first = np.clip(np.rint(middle - squares * step / 2), 0, size - squares * step)
    corner = (float(first[0] + step - 0.5), float(first[1] + step - 0.5))
    return ProjectedCheckerboard(pattern.corners, corner, step)


def _under_pattern(
    rig: Rig,
    extent: Extent,
    rotation: Doubles,
    place: Doubles,
    pattern: ProjectedCheckerboard,
    marks: CornerMarks | None,
    rng: np.random.Generator,
) -> Pose | None:
    """Return the sheet in the plane through `place`, shifted so that the pattern falls on it, or None."""
    low, high = np.array(extent[:2]), np.array(extent[2:])
    through = Pose(rotation, place)
    outline = _on_board(rig, through, projected_outline(pattern))
    if not np.isfinite(outline).all():
        return None
    slack = (high - low) - np.ptp(outline, axis=0)
    if (slack < 0).any():
        return None
    shift = outline.min(axis=0) - low - rng.uniform(0, 1, 2) * slack
    pose = Pose(rotation, through.apply(flat(shift)))
    if not _visible(rig, extent, pose, lit=False):
        return None
    return pose if marks is None or _marks_clear(rig, pose, pattern, marks) else None


def _marks_clear(rig: Rig, pose: Pose, pattern: ProjectedCheckerboard, marks: CornerMarks) -> bool:
    corners = _on_board(rig, pose, pattern.points())
    away = np.linalg.norm(marks.points()[:, None] - corners, axis=-1)
    if away.min() < 2.5 * marks.cell_mm:
        return False
    around = marks.points()[:, None] + 1.7 * marks.cell_mm * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0]])
    lit = seen_by(rig.projector, rig.projector_from_camera.apply(pose.apply(flat(around))), 2.0)
    return bool((lit.all(axis=1) | ~lit.any(axis=1)).all())


def _on_board(rig: Rig, camera_from_board: Pose, projector_xy: Doubles) -> Doubles:
    """Return the board points (n, 2) mm that projector pixels light, NaN where the ray does not meet the board."""
    board_from_projector = (rig.projector_from_camera @ camera_from_board).inverse()
    rays = homogeneous(rig.projector.normalize(projector_xy)) @ board_from_projector.rotation.T
    origin = board_from_projector.translation
    points = origin + intersect_plane(rays, np.array([0, 0, 1]), -origin[2])
    ahead = rays[:, 2] * -origin[2] > 0
    return np.where(ahead[:, None], points[:, :2], np.nan)


def _visible(rig: Rig, extent: Extent, pose: Pose, lit: bool) -> bool:
    points = pose.apply(flat(_perimeter(extent)))
    if not seen_by(rig.camera, points, _MARGIN_PX).all() or (lit and not in_view(rig, points, _MARGIN_PX).all()):
        return False
    normal, center = pose.rotation[:, 2], pose.apply(_middle(extent))
    # The printed side looks at the board's own -z; both devices must stand on that side, and not too low.
    cosines = [view @ normal / np.linalg.norm(view) for view in (center, center - rig.projector_center)]
    return bool(cosines[0] > _STEEPEST and (cosines[1] > _STEEPEST or not lit))


def _rotation(rng: np.random.Generator, tilt_deg: tuple[float, float]) -> Doubles:
    angle, tilt, roll = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*tilt_deg)), np.radians(rng.uniform(-9, 9))
    lean = Pose.from_rotation_vector(tilt * np.array([np.cos(angle), np.sin(angle), 0]), np.zeros(3))
    return np.asarray(lean.rotation @ Pose.from_rotation_vector([0, 0, roll], np.zeros(3)).rotation)


def _placed(extent: Extent, rotation: Doubles, place: Doubles) -> Pose:
    return Pose(rotation, place - rotation @ _middle(extent))


def _middle(extent: Extent) -> Doubles:
    return rim(extent).mean(axis=0)


def rim(extent: Extent) -> Doubles:
    """Return the corners (4, 3) mm of a sheet, TL TR BR BL."""
    x0, y0, x1, y1 = extent
    return flat([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _perimeter(extent: Extent, count: int = 13) -> Doubles:
    x, y = np.linspace(extent[0], extent[2], count), np.linspace(extent[1], extent[3], count)
    rows = [np.stack([x, np.full(count, v)], axis=-1) for v in (y[0], y[-1])]
    columns = [np.stack([np.full(count, u), y], axis=-1) for u in (x[0], x[-1])]
    return np.concatenate(rows + columns)


def _round(length_mm: float) -> float:
    """Return a length to two digits, so that boards have sizes a person can print."""
    return float(f"{length_mm:.2g}")
