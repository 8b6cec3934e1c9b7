"""Board views computed from a rig, without pictures: the solver's input with known truth."""

import numpy as np

from slkit.data import BoardView
from slkit.geometry import Pinhole, Pose, Rig, intersect_plane
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard

PRINTED = Checkerboard((11, 8), 30.0)
MARKS = CornerMarks(((-300.0, -200.0), (300.0, -200.0), (300.0, 200.0), (-300.0, 200.0)), 12.0)


def paper_rig(rng: np.random.Generator | None = None) -> Rig:
    """The rig of the paper; with rng, focal lengths, principal points, lenses and position vary by some per cent."""
    vary = (lambda spread: 0.0) if rng is None else (lambda spread: float(rng.uniform(-spread, spread)))
    camera = Pinhole(
        (768, 576),
        [[900 + vary(60), 0, 384 + vary(15)], [0, 902 + vary(60), 290 + vary(15)], [0, 0, 1]],
        [-0.2 + vary(0.05), 0.08 + vary(0.03), vary(1e-3), vary(1e-3), 0],
    )
    projector = Pinhole(
        (1024, 768),
        [[1900 + vary(120), 0, 512 + vary(25)], [0, 1905 + vary(120), 830 + vary(80)], [0, 0, 1]],
        [-0.08 + vary(0.04), 0.05 + vary(0.03), vary(1e-3), vary(1e-3), 0],
    )
    center = np.array([500 + vary(60), 30 + vary(80), vary(80)])
    aim = np.array([0, -140 + vary(30), 1130])
    forward = (aim - center) / np.linalg.norm(aim - center)
    # The image centre, not the axis, looks at the scene: the axis passes below it by the lens shift.
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    turn = Pose.from_rotation_vector([np.arctan2(830 - 384, 1900), 0, 0], np.zeros(3)).rotation @ turn
    return Rig(camera, projector, Pose(turn, -turn @ center))


def pose(rng: np.random.Generator, depth: tuple[float, float], tilt_deg: float) -> Pose:
    """A random pose camera_from_board in front of the camera."""
    axis = rng.normal(size=3)
    axis[2] *= 0.4
    turn = axis / np.linalg.norm(axis) * np.radians(rng.uniform(5, tilt_deg))
    return Pose.from_rotation_vector(turn, [rng.uniform(-30, 30), rng.uniform(-25, 25), rng.uniform(*depth)])


def printed_views(rig: Rig, rng: np.random.Generator, count: int, noise_px: float) -> list[BoardView]:
    """Views of side A that fill the image."""
    board = PRINTED.points()
    views = []
    for i in range(count):
        placed = pose(rng, (420, 620), 40)
        center = placed.rotation @ np.append(board.mean(axis=0), 0)
        xyz = np.pad(board, ((0, 0), (0, 1))) @ placed.rotation.T + placed.translation - center
        seen = rig.camera.project(xyz)
        silent = np.full_like(seen, np.nan)
        noisy = seen + noise_px * rng.normal(size=seen.shape)
        views.append(BoardView(f"a{i}", rig.camera.size, board, noisy, silent, silent))
    return views


def white_views(
    rig: Rig, rng: np.random.Generator, count: int, noise_px: float, pattern: ProjectedCheckerboard
) -> list[BoardView]:
    """Views of side B: marks and projected corners, both with noise in the camera."""
    lens = rig.projector
    rays = np.concatenate([lens.normalize(pattern.points()), np.ones((len(pattern.points()), 1))], axis=1)
    views = []
    for i in range(count):
        placed = pose(rng, (1000, 1300), 30)
        in_projector = rig.projector_from_camera @ placed
        normal = in_projector.rotation[:, 2]
        xyz = intersect_plane(rays, normal, float(normal @ in_projector.translation))
        corners = rig.camera.project(rig.projector_from_camera.inverse().apply(xyz))
        marks = rig.camera.project(placed.apply(np.pad(MARKS.points(), ((0, 0), (0, 1)))))
        camera_xy = np.concatenate([marks, corners])
        silent = np.full_like(marks, np.nan)
        views.append(
            BoardView(
                f"b{i}",
                rig.camera.size,
                np.concatenate([MARKS.points(), np.full_like(corners, np.nan)]),
                camera_xy + noise_px * rng.normal(size=camera_xy.shape),
                np.concatenate([silent, pattern.points()]),
                np.concatenate([silent, np.zeros_like(corners)]),
            )
        )
    return views


def coded_views(rig: Rig, rng: np.random.Generator, count: int, noise_px: float) -> list[BoardView]:
    """Views of a printed board under coded light: each corner with noise in camera and projector."""
    board = Checkerboard((9, 7), 40.0).points()
    views = []
    for i in range(count):
        placed = pose(rng, (1000, 1300), 35)
        xyz = placed.apply(np.pad(board - board.mean(axis=0), ((0, 0), (0, 1))))
        camera_xy, projector_xy = rig.camera.project(xyz), rig.to_projector(xyz)
        views.append(
            BoardView(
                f"c{i}",
                rig.camera.size,
                board,
                camera_xy + noise_px * rng.normal(size=camera_xy.shape),
                projector_xy + noise_px * rng.normal(size=camera_xy.shape),
                np.full_like(camera_xy, noise_px),
            )
        )
    return views
