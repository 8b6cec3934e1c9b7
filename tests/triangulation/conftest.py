"""Random rigs of every awkward kind, and exact correspondences on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slkit.data import Correspondences, PointCloud
from slkit.geometry import Pinhole, Pose, Rig, homogeneous


def random_rig(seed: int) -> Rig:
    """A baseline in any direction, a projector that is shifted until its principal point leaves the image, strong
    distortion and skew on both devices; camera and projector look at the same place about 0.9 m away."""
    rng = np.random.default_rng(seed)
    camera = Pinhole(
        (800, 600),
        [
            [rng.uniform(800, 1500), rng.uniform(-3, 3), rng.uniform(340, 460)],
            [0, rng.uniform(800, 1500), 300],
            [0, 0, 1],
        ],
        rng.uniform([-0.3, -0.05, -0.005, -0.005, -0.05], [0.2, 0.1, 0.005, 0.005, 0.05]),
    )
    off_axis = rng.permutation([rng.uniform(-150, 150), rng.uniform(400, 600) * rng.choice([-1, 1])])
    projector = Pinhole(
        (1024, 768),
        [
            [rng.uniform(1400, 2200), rng.uniform(-3, 3), 512 + off_axis[0]],
            [0, rng.uniform(1400, 2200), 384 + off_axis[1]],
            [0, 0, 1],
        ],
        rng.uniform([-0.2, -0.05, -0.004, -0.004, -0.03], [0.15, 0.05, 0.004, 0.004, 0.03]),
    )
    angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(150, 500)
    center = length * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.3, 0.3)])
    target = np.array([0, 0, 900.0]) - center
    seen = homogeneous(projector.normalize([512.0, 384.0]))
    roll = Pose.from_rotation_vector(rng.uniform(-0.2, 0.2) * seen / np.linalg.norm(seen), np.zeros(3)).rotation
    rotation = roll @ between(target, seen)
    return Rig(camera, projector, Pose(rotation, -rotation @ center))


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest rotation that takes direction a to direction b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    vector = axis / sine * np.arctan2(sine, a @ b) if sine > 0 else np.zeros(3)
    return Pose.from_rotation_vector(vector, np.zeros(3)).rotation


def exact_pairs(rig: Rig, seed: int, count: int = 400, sigma: float = 0.1) -> tuple[Correspondences, np.ndarray]:
    """Correspondences with both axes at random places that both devices see, and the points (n, 3) mm."""
    rng = np.random.default_rng(seed)
    camera_xy = rng.uniform(0, np.array(rig.camera.size) - 1, (count, 2)).astype(np.float32)
    xyz = homogeneous(rig.camera.normalize(camera_xy)) * rng.uniform(650, 1200, (count, 1))
    projector_xy = rig.to_projector(xyz)
    inside = ((projector_xy >= 0) & (projector_xy <= np.array(rig.projector.size) - 1)).all(axis=1)
    rows = int(inside.sum())
    color = rng.uniform(0, 1, (rows, 3))
    found = Correspondences(camera_xy[inside], projector_xy[inside], np.full((rows, 2), sigma), np.ones(rows), color)
    return found, xyz[inside]


@pytest.fixture(scope="session")
def make_rig() -> Callable[[int], Rig]:
    return random_rig


@pytest.fixture(scope="session")
def make_pairs() -> Callable[..., tuple[Correspondences, np.ndarray]]:
    return exact_pairs


def cloud_of(
    xyz: np.ndarray, residual_px: float | np.ndarray = np.nan, sigma_mm: float | np.ndarray = 0.1
) -> PointCloud:
    rows = len(xyz)
    return PointCloud(
        np.float32(xyz),
        np.full((rows, 3), 0.5),
        np.broadcast_to(np.float32(sigma_mm), rows),
        np.broadcast_to(np.float32(residual_px), rows),
        1000 * xyz[:, :2] / xyz[:, 2:],
    )


@pytest.fixture(scope="session")
def make_cloud() -> Callable[..., PointCloud]:
    return cloud_of


@pytest.fixture
def plane_cloud() -> PointCloud:
    """A plane with the normal (0.3, 0.1, -1), 800 mm away, points twice as far apart in x as in y."""
    xy = np.stack(np.meshgrid(np.arange(-60, 60, 2.0), np.arange(-40, 40, 1.0)), axis=-1).reshape(-1, 2)
    return cloud_of(np.column_stack([xy, 800 + xy @ [0.3, 0.1]]))
