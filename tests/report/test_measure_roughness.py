"""The roughness of clouds whose noise is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.report.measure import roughness


def plate(rng: np.random.Generator, count: int, sigma: float) -> np.ndarray:
    return np.column_stack([rng.uniform(-50, 50, (count, 2)), rng.normal(0, sigma, count)])


def dome(rng: np.random.Generator, count: int, sigma: float, radius: float = 40.0) -> np.ndarray:
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:, 2] = -np.abs(normals[:, 2])
    return (radius + rng.normal(0, sigma, count))[:, None] * normals


# From 25 to 225 points in a neighbourhood; up to 64 of them, and six degrees of freedom, in 2000 places.
@pytest.mark.parametrize("radius", [2.0, 3.0, 6.0])
@pytest.mark.parametrize("shape", [plate, dome])
def test_white_noise_comes_back(radius, shape):
    found = roughness(shape(np.random.default_rng(0), 20_000, 0.05), radius)
    assert found.points == 20_000
    assert found.neighborhoods > 1900
    assert found.radius_mm == radius
    # A tenth of the neighbourhoods are independent; the median scatters by 1.25 of what the mean does.
    assert found.sigma_mm == pytest.approx(0.05, rel=4 * 1.25 / np.sqrt(2 * 15 * 200))


def test_few_neighbours_lose_their_degrees_of_freedom():
    # About 20 points a neighbourhood. Not counting the six lost would read 0.84 of the noise, the median uncorrected
    # 0.975 of it; one cloud scatters by 0.009.
    clouds = [plate(np.random.default_rng(seed), 16_000, 0.05) for seed in range(10)]
    assert np.mean([roughness(c, 2.0).sigma_mm for c in clouds]) == pytest.approx(0.05, rel=4 * 0.009 / np.sqrt(10))


def test_curvature_is_no_roughness():
    # Across the neighbourhood the sphere bends by r^2 / 2R = 0.2 mm; past the quadric r^4 / 8R^3 is left.
    assert roughness(dome(np.random.default_rng(2), 20_000, 0.0), 4.0).sigma_mm < 4**4 / (8 * 40**3)


def test_edges_and_strays_do_not_count():
    rng = np.random.default_rng(3)
    steps = plate(rng, 40_000, 0.05)
    steps[:, 2] += 5 * (np.floor(steps[:, 0] / 15) % 2)
    assert roughness(steps, 2.0).sigma_mm == pytest.approx(0.05, rel=0.05)
    strays = plate(rng, 40_000, 0.05)
    strays[:800, 2] += rng.uniform(-10, 10, 800)
    assert roughness(strays, 3.0).sigma_mm == pytest.approx(0.05, rel=0.05)


def test_lines_need_a_radius_that_reaches_the_next():
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(0, 90, 3.0), np.arange(0, 90, 0.2))
    lines = np.column_stack([x.ravel(), y.ravel(), rng.normal(0, 0.05, x.size)])
    alone = roughness(lines, 2.0)
    assert alone.neighborhoods == 0
    assert np.isnan(alone.sigma_mm)
    assert roughness(lines, 4.0).sigma_mm == pytest.approx(0.05, rel=0.05)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.floats(0.01, 100))
def test_motion_changes_nothing_and_scale_scales(seed, size):
    rng = np.random.default_rng(seed)
    cloud = plate(rng, 2000, 0.2)
    cloud[5] = np.nan
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(0, 300, 3))
    here, there = roughness(cloud, 6.0), roughness(size * pose.apply(cloud), 6.0 * size)
    assert here.points == there.points == 1999
    # The tree cuts along the axes, so that other neighbourhoods are looked at.
    assert there.sigma_mm == pytest.approx(size * here.sigma_mm, rel=0.1)


def test_too_little_is_told():
    few = roughness(plate(np.random.default_rng(5), 10, 0.1), 100.0)
    assert (few.points, few.neighborhoods) == (10, 0)
    assert np.isnan(few.sigma_mm)
    assert roughness(np.empty((0, 3)), 1.0).points == 0
    flat = roughness(plate(np.random.default_rng(6), 2000, 0.0), 10.0)
    assert flat.sigma_mm < 1e-9
    with pytest.raises(InputError, match="radius_mm"):
        roughness(np.zeros((9, 3)), 0.0)
