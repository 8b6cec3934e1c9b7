"""The residuals of all board views under one rig, and how they move with every parameter.

Four classes: `printed` corners and `marks` seen by the camera; `projected` corners, whose projector pixel is exact, so
that their residual lies in the camera alone; `decoded` corners, whose projector pixel was read from coded light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.calibration._parameters import Array
from slkit.calibration._state import LENS, LENSES, MOTION, State
from slkit.calibration.surfaces import Sheet
from slkit.data import BoardView
from slkit.geometry import homogeneous, normalize_with_derivatives, project_with_derivatives

Ints = npt.NDArray[np.intp]
Masks = dict[str, npt.NDArray[np.bool_]]
"""By class which of its rows (n,) are meant."""
CLASSES = ("printed", "marks", "projected", "decoded")


@dataclass(frozen=True, eq=False)
class Part:
    """The rows of one class, ordered by view.

    rows: per view the rows of the BoardView; view (n,); board_xy, camera_xy, projector_xy, sigma (n, 2); face (n,);
    point (n,): the row's number among all printed points of all boards, -1 for a projected corner.
    """

    name: str
    rows: tuple[Ints, ...]
    view: Ints
    board_xy: Array
    camera_xy: Array
    projector_xy: Array
    sigma: Array
    face: Ints
    point: Ints


@dataclass(frozen=True, eq=False)
class Block:
    """Residuals of one class and their derivatives.

    error (n, 2) px: predicted minus seen, in the projector for `decoded`, else in the camera; shared (n, 2, s) over
    the shared parameters of `_state`; pose (n, 2, 6) over the motion of the row's view; local (n, 3) mm: the place on
    the target; height (n, 2): over a rise of the target's surface there.
    """

    error: Array
    shared: Array
    pose: Array
    local: Array
    height: Array


def rows_of(view: BoardView) -> dict[str, Ints]:
    """Return which rows of a view belong to each class; a decoded corner is a printed one too."""
    printed, projected = view.printed, view.projected
    bare = projected & ~printed
    # Printed points beside bare projected ones carry the board's pose: marks.
    marks = printed & bool(bare.any())
    masks = (printed & ~marks, marks, bare, printed & projected)
    return {name: np.flatnonzero(mask) for name, mask in zip(CLASSES, masks, strict=True)}


def split(views: Sequence[BoardView], board: Sequence[int]) -> tuple[list[Part], list[Array]]:
    """Return the classes that occur, and per board its printed points (k, 2) mm; board: which one each view shows."""
    points = [
        np.unique(np.concatenate([_key(v)[v.printed] for v, b in zip(views, board, strict=True) if b == k]), axis=0)
        for k in range(max(board) + 1)
    ]
    starts = np.cumsum([0, *(len(p) for p in points)])
    number = [
        {tuple(row): i + start for i, row in enumerate(p.tolist())}
        for p, start in zip(points, starts[:-1], strict=True)
    ]
    chosen = [rows_of(v) for v in views]
    parts: list[Part] = []
    for name in CLASSES:
        rows = tuple(c[name] for c in chosen)
        if not sum(len(r) for r in rows):
            continue
        keys = [(b, _key(v)[r].tolist()) for v, b, r in zip(views, board, rows, strict=True)]
        point = [number[b].get(tuple(key), -1) for b, part in keys for key in part]
        taken = [(v, r) for v, r in zip(views, rows, strict=True)]
        parts.append(
            Part(
                name,
                rows,
                np.repeat(np.arange(len(views)), [len(r) for r in rows]),
                np.concatenate([v.board_xy[r] for v, r in taken]),
                np.concatenate([v.camera_xy[r] for v, r in taken]),
                np.concatenate([v.projector_xy[r] for v, r in taken]),
                np.concatenate([v.sigma[r] for v, r in taken]),
                np.concatenate([v.faces[r] for v, r in taken]),
                np.array(point, dtype=np.intp),
            )
        )
    return parts, [p[:, :2] for p in points]


def block(part: Part, state: State, board: Ints) -> Block:
    """Return residuals and derivatives of one class; board (v,): which board each view shows."""
    if part.name == "projected":
        return _projected(part, state, board)
    local, tilt = places(part, state, board)
    turned = np.einsum("nij,nj->ni", state.rotations[part.view], local)
    xyz = turned + state.translations[part.view]
    shared = np.zeros((len(xyz), 2, len_shared(state)))
    rig = state.rig
    if part.name == "decoded":
        motion = rig.projector_from_camera
        from_center = xyz @ motion.rotation.T
        pixels, slope, lens = project_with_derivatives(rig.projector, from_center + motion.translation)
        shared[:, :, LENS:LENSES] = lens
        shared[:, :, LENSES : LENSES + 3] = _cross(from_center, slope)
        shared[:, :, LENSES + 3 : MOTION] = slope
        slope = slope @ motion.rotation
        error = pixels - part.projector_xy
    else:
        pixels, slope, lens = project_with_derivatives(rig.camera, xyz)
        shared[:, :, :LENS] = lens
        error = pixels - part.camera_xy
    pose = np.concatenate([_cross(turned, slope), slope], axis=2)
    local_slope = slope @ state.rotations[part.view]
    _add_board(shared, part, state, board, local_slope, tilt)
    return Block(error, shared, pose, local, local_slope[:, :, 2])


def _cross(arm: Array, slope: Array) -> Array:
    """Return the cross products (n, 2, 3) of arms (n, 3) with slopes (n, 2, 3); several times as fast as np.cross."""
    (x, y, z), (a, b, c) = arm.T[:, :, None], np.moveaxis(slope, 2, 0)
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=2)


def len_shared(state: State) -> int:
    """Return how many shared parameters there are."""
    return MOTION + 2 * len(state.surfaces) + 3 * sum(len(r) for r in state.released)


def _projected(part: Part, state: State, board: Ints) -> Block:
    """Return the camera's residuals of corners whose projector ray is known.

    The corner lies where that ray o + s d meets the board; a motion of ray or board shifts it along the ray so that
    it stays on the board.
    """
    rig, motion = state.rig, state.rig.projector_from_camera
    normalized, over_lens = normalize_with_derivatives(rig.projector, part.projector_xy)
    ray = homogeneous(normalized)
    direction, origin = ray @ motion.rotation, rig.projector_center
    turn = state.rotations[part.view]
    local, normal, raised = np.empty_like(ray), np.empty_like(ray), np.zeros((len(ray), 2))
    into = np.einsum("nji,nj->ni", turn, direction)
    start = np.einsum("nji,nj->ni", turn, origin - state.translations[part.view])
    for k, surface in enumerate(state.surfaces):
        mine = _shown(part, state, board, k)
        local[mine], normal[mine] = surface.intersect(start[mine], into[mine], part.face[mine])
        if isinstance(surface, Sheet):
            raised[mine] = surface.profile(local[mine][:, :2]) * normal[mine][:, 2:]
    turned = np.einsum("nij,nj->ni", turn, local)
    upright = np.einsum("nij,nj->ni", turn, normal)
    xyz = turned + state.translations[part.view]
    pixels, slope, lens = project_with_derivatives(rig.camera, xyz)
    length = ((xyz - origin) * direction).sum(axis=1) / (direction**2).sum(axis=1)
    along = (slope @ direction[:, :, None])[:, :, 0] / (upright * direction).sum(axis=1)[:, None]
    across = (slope - along[:, :, None] * upright[:, None]) @ motion.rotation.T
    shared = np.zeros((len(xyz), 2, len_shared(state)))
    shared[:, :, :LENS] = lens
    shared[:, :, LENS:LENSES] = length[:, None, None] * (across[:, :, :2] @ over_lens)
    turning = np.cross(motion.translation, across) - length[:, None, None] * _cross(ray, across)
    shared[:, :, LENSES : LENSES + 3] = turning
    shared[:, :, LENSES + 3 : MOTION] = -across
    for k in range(len(state.surfaces)):
        mine = _shown(part, state, board, k)
        shared[mine, :, MOTION + 2 * k : MOTION + 2 * k + 2] = along[mine, :, None] * raised[mine, None]
    pose = along[:, :, None] * np.concatenate([np.cross(turned, upright), upright], axis=1)[:, None]
    return Block(pixels - part.camera_xy, shared, pose, local, along * normal[:, 2:])


def places(part: Part, state: State, board: Ints) -> tuple[Array, Array]:
    """Return the points (n, 3) mm of printed rows in their target's frame, and how the warp raises them (n, 2)."""
    local, raised = np.empty((len(part.view), 3)), np.zeros((len(part.view), 2))
    for k, surface in enumerate(state.surfaces):
        mine = _shown(part, state, board, k)
        local[mine] = surface.place(part.board_xy[mine], part.face[mine])
        if isinstance(surface, Sheet):
            raised[mine] = surface.profile(part.board_xy[mine])
    released = np.concatenate(state.released)
    if len(released):
        local += released[part.point]
    return local, raised


def _add_board(shared: Array, part: Part, state: State, board: Ints, local_slope: Array, raised: Array) -> None:
    """Write the derivatives over warp and released points; local_slope (n, 2, 3): over the target's own frame."""
    for k in range(len(state.surfaces)):
        mine = _shown(part, state, board, k)
        shared[mine, :, MOTION + 2 * k : MOTION + 2 * k + 2] = local_slope[mine, :, 2:] * raised[mine, None]
    if sum(len(r) for r in state.released):
        first = MOTION + 2 * len(state.surfaces) + 3 * part.point
        rows = np.arange(len(first))
        for axis in range(3):
            shared[rows, :, first + axis] = local_slope[:, :, axis]


def _shown(part: Part, state: State, board: Ints, number: int) -> slice | npt.NDArray[np.bool_]:
    """Return the rows of a part that show one board."""
    return slice(None) if len(state.surfaces) == 1 else board[part.view] == number


def _key(view: BoardView) -> Array:
    """Return what names a printed point: its place to a nanometre, and its face, (n, 3)."""
    return np.column_stack([np.round(view.board_xy, 6), view.faces.astype(np.float64)])
