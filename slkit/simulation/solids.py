"""Objects of several flat faces: how they are rendered, where a rig sees them, and what is projected on them."""

from __future__ import annotations

import numpy as np

from slkit.errors import InputError
from slkit.geometry import Pose, Rig, flat
from slkit.simulation.rig import in_view, working_volume
from slkit.simulation.surface import Doubles, Print, Scene, Surface
from slkit.targets import Face, ProjectedCheckerboard, ProjectedFaces, SolidTarget

_DRAWS_PER_POSE = 3000
_LOWEST = 0.25
"""Smallest cosine between a face's normal and the direction to a device."""
_MARGIN_PX = 8.0
_TURN_DEG, _SHIFT = 7.0, 0.1
"""How far poses differ from the one that suits best: about each axis, and in radii of the working volume."""
_FILLED = 0.75
_ROLLS = 24
_ROWS, _LEAST_PX = 7, 9.0
"""Squares of a checkerboard's shorter side; fewer where they would be smaller than this in the camera's picture."""


def folded(target: SolidTarget, camera_from_solid: Pose) -> Scene:
    """Return a folded sheet with its tags, one surface a face."""
    return Scene(tuple(_surface(target, face, camera_from_solid @ face.solid_from_face) for face in target.faces))


def facing(rig: Rig, target: SolidTarget) -> Pose:
    """Return the pose camera_from_solid in the middle of the working volume that shows all faces to both devices.

    Its faces look, on average, at the point half-way between camera and projector; of the turns about that direction
    the one is taken that gives the smallest checkerboard of `boards_on` most room.
    """
    middle, _ = working_volume(rig)
    forward = middle - rig.projector_center / 2
    forward /= np.linalg.norm(forward)
    normal = -np.mean([face.solid_from_face.rotation[:, 2] for face in target.faces], axis=0)
    upright = _shortest(normal / np.linalg.norm(normal), np.array([0, 0, -1.0]))
    poses: list[Pose] = []
    for roll in np.linspace(0, 2 * np.pi, _ROLLS, endpoint=False):
        about = Pose.from_rotation_vector([0, 0, roll], np.zeros(3)).rotation
        turn = _shortest(np.array([0, 0, 1.0]), forward) @ about @ upright
        poses.append(Pose(turn, middle - turn @ _middle(target)))
    return max(poses, key=lambda pose: min(half.min() for _, half in _boxes(rig, target, pose)))


def solid_poses(
    rig: Rig, target: SolidTarget, projected: ProjectedFaces, count: int, rng: np.random.Generator
) -> tuple[Pose, ...]:
    """Return random poses camera_from_solid, some degrees and centimetres from `facing`, that a rig can calibrate from.

    Both devices see all faces, and every checkerboard falls on its face, clear of the tags.
    Errors: InputError where so many random draws find too few.
    """
    near, (_, radius), center = facing(rig, target), working_volume(rig), _middle(target)
    poses: list[Pose] = []
    for _ in range(_DRAWS_PER_POSE * count):
        if len(poses) == count:
            break
        turn = Pose.from_rotation_vector(np.radians(_TURN_DEG) * rng.uniform(-1, 1, 3), np.zeros(3)).rotation
        turn = turn @ near.rotation
        pose = Pose(turn, near.apply(center) + _SHIFT * radius * rng.uniform(-1, 1, 3) - turn @ center)
        if _suits(rig, target, pose) and _falls(rig, target, pose, projected):
            poses.append(pose)
    if len(poses) < count:
        raise InputError(
            f"{_DRAWS_PER_POSE * count} random draws found {len(poses)} of {count} poses at which this rig sees all "
            "faces of the object and lights each with its checkerboard: it is too large, or its faces stand too steep"
        )
    return tuple(poses)


def boards_on(rig: Rig, target: SolidTarget) -> ProjectedFaces:
    """Return a checkerboard for each face, about as large as fits between the tags at `facing`, and a little around.

    Columns and rows add up to an odd number of corners, so that a board differs from itself turned.
    """
    near, boards = facing(rig, target), list[ProjectedCheckerboard]()
    middle, _ = working_volume(rig)
    scale = rig.projector.K[0, 0] / rig.projector_from_camera.apply(middle)[2] / (rig.camera.K[0, 0] / middle[2])
    for middle, half in _boxes(rig, target, near):
        (x, y), (half_x, half_y) = middle, _FILLED * half
        step = max(2 * min(half_x, half_y) // _ROWS, np.ceil(_LEAST_PX * scale))
        columns, rows = int(2 * half_x // step), int(2 * half_y // step)
        columns -= (columns + rows) % 2 == 0
        first = np.floor([x - columns * step / 2, y - rows * step / 2]) + step + 0.5
        corner = float(first[0]), float(first[1])
        boards.append(ProjectedCheckerboard((columns - 1, rows - 1), corner, float(step), origin_marks=()))
    return ProjectedFaces(tuple(boards))


def _surface(target: SolidTarget, face: Face, pose: Pose) -> Surface:
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(pose.apply(flat(face.outline())), triangles, Print(target.sheet, pose))


def _suits(rig: Rig, target: SolidTarget, camera_from_solid: Pose) -> bool:
    """Tell whether both devices see all faces of the object, none at a low angle."""
    if not in_view(rig, camera_from_solid.apply(_outlines(target)), _MARGIN_PX).all():
        return False
    for face in target.faces:
        pose = camera_from_solid @ face.solid_from_face
        center, normal = pose.apply(flat(face.outline()).mean(axis=0)), pose.rotation[:, 2]
        for eye in (np.zeros(3), rig.projector_center):
            # The printed side looks at the face's own -z.
            if normal @ (center - eye) < _LOWEST * np.linalg.norm(center - eye):
                return False
    return True


def _falls(rig: Rig, target: SolidTarget, camera_from_solid: Pose, projected: ProjectedFaces) -> bool:
    """Tell whether every checkerboard falls on the clear part of its face."""
    for quad, board in zip(_quads(rig, target, camera_from_solid), projected.boards, strict=True):
        first, step = np.array(board.first_xy) - board.step_px, board.step_px * (np.array(board.corners) + 1)
        corners = first + step * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        if not _within(quad, corners):
            return False
    return True


def _boxes(rig: Rig, target: SolidTarget, camera_from_solid: Pose) -> list[tuple[Doubles, Doubles]]:
    """Return middle (2,) and half sides (2,) px of a large upright box on each face, clear of the tags."""
    return [_largest_box(quad) for quad in _quads(rig, target, camera_from_solid)]


def _quads(rig: Rig, target: SolidTarget, camera_from_solid: Pose) -> list[Doubles]:
    """Return for each face the corners (4, 2), in projector px, of what is clear of tags."""
    motions = [camera_from_solid @ face.solid_from_face for face in target.faces]
    clear = [flat(_clear(face, target.tag_mm)) for face in target.faces]
    return [rig.to_projector(motion.apply(xyz)) for motion, xyz in zip(motions, clear, strict=True)]


def _largest_box(quad: Doubles) -> tuple[Doubles, Doubles]:
    """Return middle (2,) and half sides (2,) of a large upright box in a convex quadrilateral (4, 2)."""
    side = np.roll(quad, -1, axis=0) - quad
    inward = np.stack([-side[:, 1], side[:, 0]], axis=-1)
    inward *= np.sign((inward * (quad.mean(axis=0) - quad)).sum(axis=1))[:, None]
    boxes: list[tuple[float, Doubles, Doubles]] = []
    for place in np.stack(np.meshgrid(*[np.linspace(0.3, 0.7, 9)] * 2), axis=-1).reshape(-1, 2):
        top, bottom = quad[0] + place[0] * (quad[1] - quad[0]), quad[3] + place[0] * (quad[2] - quad[3])
        middle = top + place[1] * (bottom - top)
        room = (inward * (middle - quad)).sum(axis=1)
        for aspect in np.geomspace(0.6, 1 / 0.6, 9):
            shape = np.sqrt([aspect, 1 / aspect])
            # The corner of the box that is nearest to an edge touches it first.
            size = float((room / (np.abs(inward) @ shape)).min())
            boxes.append((size, middle, size * shape))
    _, middle, half = max(boxes, key=lambda box: box[0])
    return middle, half


def _within(quad: Doubles, points: Doubles) -> bool:
    """Tell whether all points (n, 2) lie in a convex quadrilateral (4, 2), whichever way round it is given."""
    side = np.roll(quad, -1, axis=0) - quad
    away = points[:, None] - quad
    cross = side[:, 0] * away[..., 1] - side[:, 1] * away[..., 0]
    return bool((cross > 0).all() or (cross < 0).all())


def _clear(face: Face, tag_mm: float) -> Doubles:
    """Return the corners (4, 2) mm of the band between the tags, which stand in the corners of the face."""
    inset = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * tag_mm * np.array([1 / 3, 5 / 3])
    return np.asarray(face.outline() + inset, dtype=np.float64)


def _outlines(target: SolidTarget) -> Doubles:
    return np.concatenate([face.solid_from_face.apply(flat(face.outline())) for face in target.faces])


def _middle(target: SolidTarget) -> Doubles:
    points = _outlines(target)
    return (points.min(axis=0) + points.max(axis=0)) / 2


def _shortest(a: Doubles, b: Doubles) -> Doubles:
    """Return the rotation (3, 3) by the smallest angle that turns one unit vector (3,) into another."""
    axis = np.cross(a, b)
    length = float(np.linalg.norm(axis))
    vector = axis / max(length, 1e-12) * np.arctan2(length, float(a @ b))
    return np.asarray(Pose.from_rotation_vector(vector, np.zeros(3)).rotation, dtype=np.float64)
