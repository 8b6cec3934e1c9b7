"""Speeds as ratios within one run; `make bench` runs it. Each time is the least of several.

python tests/benchmarks.py
"""

import time
from collections.abc import Callable

import cv2
import numpy as np

from slkit.calibration.bundle import adjust
from slkit.calibration.model import Model
from slkit.data import BoardView
from slkit.geometry import Pinhole, Pose, Rig
from slkit.targets import grid

VIEWS, CORNERS, SQUARE_MM = 30, (10, 10), 30.0


def least_seconds(work: Callable[[], object], times: int = 7) -> float:
    """Return the least time that a call takes."""
    seconds = []
    for _ in range(times):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def bundle_views(rng: np.random.Generator) -> tuple[Rig, list[Pose], list[BoardView]]:
    """Return a rig, poses and views of a board of 100 corners under coded light, 0.1 px of noise in both devices."""
    camera = Pinhole((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]], [-0.1, 0.05, 1e-3, -1e-3, 0])
    projector = Pinhole((1280, 800), [[1800, 0, 640], [0, 1800, 750], [0, 0, 1]], [-0.03, 0.02, 0, 0, 0])
    rig = Rig(camera, projector, Pose.from_rotation_vector([0, 0.3, 0], [-350, 0, 60]))
    board = (grid(CORNERS) - 4.5) * SQUARE_MM
    poses, views = [], []
    for i in range(VIEWS):
        turn = rng.uniform(-0.5, 0.5, 3) * [1, 1, 0.3]
        poses.append(Pose.from_rotation_vector(turn, [*rng.uniform(-60, 60, 2), rng.uniform(800, 1100)]))
        xyz = poses[-1].apply(np.pad(board, ((0, 0), (0, 1))))
        seen, lit = camera.project(xyz), rig.to_projector(xyz)
        noise = 0.1 * rng.normal(size=(2, *seen.shape))
        views.append(BoardView(str(i), camera.size, board, seen + noise[0], lit + noise[1], np.full_like(seen, 0.1)))
    return rig, poses, views


def started_off(rig: Rig, poses: list[Pose], rng: np.random.Generator) -> tuple[Rig, list[Pose]]:
    """Return what a first guess is like: one per cent off in the lenses, millimetres and milliradians in the poses."""
    devices = [
        Pinhole(d.size, d.K * [[1.01, 1, 1.01], [1, 1.01, 1.01], [1, 1, 1]], np.zeros(5))
        for d in (rig.camera, rig.projector)
    ]
    moved = [Pose.from_rotation_vector(3e-3 * rng.normal(size=3), 3 * rng.normal(size=3)) @ p for p in poses]
    return Rig(*devices, rig.projector_from_camera), moved


def bundle() -> None:
    """Compare the joint adjustment of 30 views with one cv2.calibrateCamera call on the camera's share of them."""
    rng = np.random.default_rng(0)
    rig, poses, views = bundle_views(rng)
    rough, placed = started_off(rig, poses, rng)
    objects = [np.pad(v.board_xy, ((0, 0), (0, 1))).astype(np.float32) for v in views]
    for name, pixels, size in (
        ("camera", "camera_xy", rig.camera.size),
        ("projector", "projector_xy", rig.projector.size),
    ):
        images = [getattr(v, pixels).astype(np.float32) for v in views]
        opencv = least_seconds(lambda: cv2.calibrateCamera(objects, images, size, None, None, flags=cv2.CALIB_FIX_K3))  # noqa: B023
        print(f"cv2.calibrateCamera, {name}, {VIEWS} views of {len(views[0].board_xy)} corners: {1e3 * opencv:.0f} ms")
    for loss in ("squares", "huber"):
        ours = least_seconds(lambda: adjust(rough, placed, views, Model(loss=loss)))  # noqa: B023
        print(f"joint adjustment ({loss}): {1e3 * ours:.0f} ms, {ours / opencv:.2f} times cv2.calibrateCamera")


if __name__ == "__main__":
    bundle()
