"""The kernels against their plain twins in geometry and NumPy."""

import numpy as np
import pytest

from slkit.geometry import Pinhole, homogeneous
from slkit.simulation import random_rig
from slkit.simulation._kernels import gather, illuminate, look
from slkit.simulation.rig import field_radius


@pytest.mark.parametrize("seed", range(4))
def test_look_is_normalize(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = random_rig(rng).camera
    matrix = np.array(camera.K)
    matrix[0, 1] = 3.0
    camera = Pinhole(camera.size, matrix, camera.distortion)
    xy = rng.uniform(-0.5, camera.size, (500, 2))
    rays = np.empty((500, 3))
    look(xy, camera.K, camera.distortion, rays)
    np.testing.assert_allclose(rays, homogeneous(camera.normalize(xy)), atol=1e-12)


def test_look_sends_a_ray_without_an_inverse_backwards() -> None:
    rays = np.empty((2, 3))
    look(
        np.array([[320.0, 240.0], [5000.0, 240.0]]),
        np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]),
        np.array([-0.3, 0, 0, 0, 0]),
        rays,
    )
    np.testing.assert_allclose(rays, [[0, 0, 1], [0, 0, -1]], atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_illuminate_is_to_projector(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    xyz = homogeneous(rig.camera.normalize(rng.uniform(0, rig.camera.size, (500, 2)))) * rng.uniform(
        500, 2000, (500, 1)
    )
    pose = np.column_stack([rig.projector_from_camera.rotation, rig.projector_from_camera.translation])
    xy, radius = np.empty((500, 2)), field_radius(rig.projector)
    off = illuminate(xyz, pose, rig.projector.K, rig.projector.distortion, radius, rig.projector.size, xy)
    known = np.isfinite(xy[:, 0])
    expected = rig.to_projector(xyz)
    np.testing.assert_allclose(xy[known], expected[known], atol=1e-9)
    width, height = rig.projector.size
    inside = (np.abs(expected - [(width - 1) / 2, (height - 1) / 2]) <= [width / 2, height / 2]).all(axis=1)
    assert 20 < inside.sum() < 500
    np.testing.assert_array_equal(off <= 0, inside)


@pytest.mark.parametrize(("patterns", "channels"), [(1, 1), (3, 1), (1, 3), (3, 3)])
def test_gather_is_a_weighted_sum_of_bilinear_samples(patterns: int, channels: int) -> None:
    rng = np.random.default_rng(0)
    pattern = rng.uniform(size=(12, 17, patterns)).astype(np.float32)
    xy = rng.uniform(-3, 20, (5, 6, 4, 2)).astype(np.float32)
    weight = np.maximum(rng.uniform(-0.5, 1, (5, 6, 4, channels)), 0).astype(np.float32)
    weight[0] = 0
    out = np.full((5, 6, max(patterns, channels)), np.nan, dtype=np.float32)
    gather(pattern, xy, weight, 0.9, 0.4, out)
    place = xy.astype(np.float64) * 0.9 + 0.4
    expected = np.zeros(out.shape)
    low = np.floor(place).astype(int)
    for index in np.ndindex(5, 6, 4):
        (j, i), (a, b) = low[index], place[index] - low[index]
        if 0 <= i < 11 and 0 <= j < 16:
            top = pattern[i, j] * (1 - a) + pattern[i, j + 1] * a
            bottom = pattern[i + 1, j] * (1 - a) + pattern[i + 1, j + 1] * a
            expected[index[:2]] += weight[index] * (top * (1 - b) + bottom * b)
    np.testing.assert_allclose(out, expected, atol=1e-5)
