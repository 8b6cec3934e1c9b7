"""Balls among other things: which points are theirs, and where they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.report.measure import find_spheres, points_on_sphere, probing_error

CENTERS = np.array([[-60.0, 5, 950], [70, -20, 1000]])


def seen_ball(rng: np.random.Generator, center: np.ndarray, radius: float, count: int, sigma: float) -> np.ndarray:
    """Points as even in the picture as a camera at the origin sees them."""
    look = -center / np.linalg.norm(center)
    normals = rng.normal(size=(20 * count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = normals @ look
    normals = normals[rng.uniform(size=len(normals)) < cosine][:count]
    return center + (radius + rng.normal(0, sigma, len(normals)))[:, None] * normals


def scene(rng: np.random.Generator, count: int, sigma: float, diameters: tuple[float, ...] = (40, 40)) -> np.ndarray:
    """Two balls with 3 % of the points each, a bar between them, a plane behind them and 1 % anywhere."""
    balls = [seen_ball(rng, c, d / 2, 3 * count // 100, sigma) for c, d in zip(CENTERS, diameters, strict=True)]
    along = CENTERS[1] - CENTERS[0]
    turn = rng.uniform(0, np.pi, count // 50)
    bar = CENTERS[0] + rng.uniform(0, 1, (count // 50, 1)) * along
    bar += 6 * np.column_stack([np.zeros_like(turn), np.cos(turn), -np.sin(turn)])
    bar = bar[(np.linalg.norm(bar[:, None] - CENTERS, axis=2) > np.array(diameters) / 2).all(axis=1)]
    plane = rng.uniform(-250, 250, (90 * count // 100, 3)) * [1, 1, 0]
    plane[:, 2] = 1030 + 0.1 * plane[:, 0] + rng.normal(0, sigma, len(plane))
    strays = rng.uniform([-250, -250, 850], [250, 250, 1150], (count // 100, 3))
    return rng.permutation(np.concatenate([*balls, bar, plane, strays]))


def test_a_quarter_of_a_sphere_is_seen_steeply_enough():
    # From afar the cap up to 60 degrees is a quarter of the sphere's area.
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(100_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 20 * normals + [0, 0, 1e6]
    mask = points_on_sphere(points, [0, 0, 1e6], 20)
    assert mask.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 100_000))
    np.testing.assert_array_equal(mask, normals[:, 2] < -0.5)
    assert points_on_sphere(points, [0, 0, 1e6], 20, [0, 0, 2e6])[normals[:, 2] > 0.51].all()
    right = points_on_sphere(points, [0, 0, 1e6], 20, incidence_deg=90).mean()
    assert right == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 100_000))


def test_the_rule_looks_at_place_and_not_at_residual():
    front = np.array([[0, 0, 1000 - 20 * f] for f in (0.5, 1, 1.09, 1.11)] + [[0, 0, 1020.0], [np.nan] * 3])
    np.testing.assert_array_equal(points_on_sphere(front, [0, 0, 1000], 20), [True] * 3 + [False] * 3)
    for radius, angle in ((-20, 60), (20, 0)):
        with pytest.raises(InputError, match="positive"):
            points_on_sphere(front, [0, 0, 1000], radius, incidence_deg=angle)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.floats(0.01, 100))
def test_segments_move_and_scale_with_the_world(seed, size):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-30, 30, (300, 3)) + CENTERS[0]
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(0, 300, 3))
    there = size * pose.apply(CENTERS[0]), 20 * size, size * pose.translation
    np.testing.assert_array_equal(
        points_on_sphere(points, CENTERS[0], 20), points_on_sphere(size * pose.apply(points), *there)
    )


@pytest.mark.parametrize(
    ("count", "sigma", "diameters"),
    [
        (2000, 0.05, (40, 40)),
        (2000, 0.4, (30, 40)),
        (20_000, 0.4, (40, 30)),
        (300_000, 0.05, (38, 40)),
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_two_balls_before_a_plane_are_found(count, sigma, diameters, seed):
    rng = np.random.default_rng(seed)
    points = scene(rng, count, sigma, diameters)
    found = find_spheres(points, diameters, rng)
    centers = np.array([ball.center for ball in found])
    assert [ball.radius_mm for ball in found] == [d / 2 for d in diameters]
    if diameters[0] == diameters[1]:
        centers = centers[np.argsort(centers[:, 0])]
        assert found[0].points >= found[1].points
    # Depth is the least certain, about twice the noise over the root of the points; neighbours in the tolerance pull.
    assert np.linalg.norm(centers - CENTERS, axis=1).max() < 0.01 * 20 + 5 * sigma / np.sqrt(0.03 * count)
    for center, diameter in zip(centers, diameters, strict=True):
        mask = points_on_sphere(points, center, diameter / 2)
        # Of what is seen, as even in the picture, the cap up to 60 degrees holds sin^2 60 = 3/4.
        assert mask.sum() == pytest.approx(0.75 * 0.03 * count, rel=0.03, abs=5 * np.sqrt(0.03 * count))


def test_a_found_ball_is_measured():
    rng = np.random.default_rng(3)
    points = scene(rng, 100_000, 0.05)
    ball = find_spheres(points, [40], rng)[0]
    measured = probing_error(points[points_on_sphere(points, ball.center, 20)], 40, discard=0.003)
    assert measured.sigma_mm == pytest.approx(0.05, rel=0.1)
    assert measured.size_mm == pytest.approx(0, abs=0.02)


def test_the_same_generator_finds_the_same_balls_wherever_they_are():
    points = scene(np.random.default_rng(4), 5000, 0.1)
    pose = Pose.from_rotation_vector([0.5, -1, 2], [100, 50, -20])
    here = find_spheres(points, [40, 40], np.random.default_rng(5))
    moved = find_spheres(
        2 * pose.apply(points), [80, 80], np.random.default_rng(5), viewpoint=2 * np.array(pose.translation)
    )
    again = find_spheres(points, [40, 40], np.random.default_rng(5))
    for a, b, c in zip(here, moved, again, strict=True):
        np.testing.assert_array_equal(a.center, c.center)
        # The random directions do not turn with the scene: the draws differ, the balls do not.
        np.testing.assert_allclose(2 * pose.apply(a.center), b.center, atol=0.4)


@pytest.mark.parametrize("count", [2000, 50_000])
def test_what_is_no_ball_of_that_diameter_is_refused(count):
    points = scene(np.random.default_rng(6), count, 0.05)
    bare = points[(np.linalg.norm(points[:, None] - CENTERS, axis=2) > 21).all(axis=1)]
    for cloud, diameters, missing in (
        (bare, [40], "40 mm"),
        (points, [40, 40, 40], "diameter 40 mm"),
        (points, [40, 60], "60 mm"),
        (points, [35], "35 mm"),
        (points, [46], "46 mm"),
        (points[:5], [40], "40 mm"),
    ):
        with pytest.raises(InputError, match=missing):
            find_spheres(cloud, diameters, np.random.default_rng(7))
    for diameters, tolerance in (([-40], None), ([40], 0.0)):
        with pytest.raises(InputError, match="positive"):
            find_spheres(points, diameters, np.random.default_rng(7), tolerance)
