"""Clouds and labels against the truth, with known shares dropped, displaced and wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.data import Correspondences
from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.report.measure import compare_to_mesh, compare_to_points, label_error, mesh_samples

SQUARE = np.array([[0, 0, 500], [100, 0, 500], [100, 100, 500], [0, 100, 500.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def grid() -> np.ndarray:
    """Ten thousand points on a plane, 10 mm apart."""
    x, y = np.meshgrid(10.0 * np.arange(100), 10.0 * np.arange(100))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 500.0)])


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    dropped=st.integers(0, 9000),
    displaced=st.integers(0, 500),
    strays=st.integers(0, 400),
    size=st.floats(0.01, 100),
)
def test_known_shares_come_back(seed, dropped, displaced, strays, size):
    rng = np.random.default_rng(seed)
    truth = rng.permutation(grid())
    cloud = truth[dropped:].copy()
    cloud[:displaced, 2] += 1.5
    cloud[displaced : displaced + strays, 2] -= 4
    cloud[displaced + strays :, 2] += 0.25
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(0, 300, 3))
    cloud, truth = size * pose.apply(cloud), size * pose.apply(truth)
    cloud[-1] = np.nan
    found = compare_to_points(cloud, truth, tolerance_mm=size, outlier_mm=2 * size)
    points = 10_000 - dropped - 1
    good = points - displaced - strays
    precision, completeness = good / points, good / 10_000
    assert (found.points, found.truth_points) == (points, 10_000)
    assert found.outliers == pytest.approx(strays / points)
    assert found.precision == pytest.approx(precision)
    assert found.completeness == pytest.approx(completeness)
    assert found.f_score == pytest.approx(2 * good / (points + 10_000))
    away = size * np.repeat([0.25, 1.5], [good, displaced])
    assert found.rms_mm == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-5)
    assert found.mean_mm == pytest.approx(away.mean(), rel=1e-5)
    assert found.median_mm == pytest.approx(np.median(away), rel=1e-4)
    assert found.p95_mm == pytest.approx(np.quantile(away, 0.95), rel=1e-4)


def test_noise_across_a_mesh():
    rng = np.random.default_rng(0)
    count, sigma = 40_000, 0.1
    cloud = np.column_stack([rng.uniform(0, 100, (count, 2)), rng.normal(500, sigma, count)])
    found = compare_to_mesh(cloud, SQUARE, FACES)
    assert found.rms_mm == pytest.approx(sigma, rel=0.015)
    assert found.mean_mm == pytest.approx(sigma * np.sqrt(2 / np.pi), rel=0.02)
    assert found.median_mm == pytest.approx(0.6745 * sigma, rel=0.02)
    assert found.p95_mm == pytest.approx(1.96 * sigma, rel=0.02)
    assert (found.points, found.outliers, found.precision) == (count, 0, 1)
    assert found.truth_points == 100_000
    assert found.completeness > 0.999


def test_half_a_mesh_and_the_half_that_can_be_seen():
    rng = np.random.default_rng(1)
    cloud = rng.uniform(0, 100, (40_000, 3)) * [0.5, 1, 0] + [0, 0, 500]
    # Samples up to the tolerance beyond the scanned half are still complete.
    assert compare_to_mesh(cloud, SQUARE, FACES).completeness == pytest.approx(0.51, abs=0.002)
    samples = mesh_samples(SQUARE, FACES, 10_000)
    seen = compare_to_mesh(cloud, SQUARE, FACES, samples[samples[:, 0] < 50])
    assert seen.completeness > 0.999
    assert seen.f_score > 0.999


def test_samples_are_even_over_the_area():
    vertices = np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5.0]])
    found = mesh_samples(vertices, [[0, 1, 2], [3, 4, 5]], 40_000)
    upper = found[:, 2] > 2
    assert upper.sum() == pytest.approx(10_000, abs=1)
    np.testing.assert_array_equal(found[:, 2], np.where(upper, 5, 0))
    # The middle triangle and the three at the corners have a quarter each.
    for u, v in (found[upper][:, :2].T, (found[~upper][:, :2] / [3, 1]).T):
        assert (u >= 0).all()
        assert (u + v <= 1 + 1e-12).all()
        for part in (u > 0.5, v > 0.5, u + v < 0.5):
            assert part.mean() == pytest.approx(0.25, abs=0.003)
    np.testing.assert_array_equal(found, mesh_samples(vertices, [[0, 1, 2], [3, 4, 5]], 40_000))


def test_samples_of_many_small_triangles_are_not_always_at_the_same_place_in_them():
    x = np.arange(5001.0)
    vertices = np.concatenate([np.column_stack([x, 0 * x, 0 * x]), np.column_stack([x, 0 * x + 1, 0 * x])])
    i = np.arange(5000)
    faces = np.concatenate([np.column_stack([i, i + 1, i + 5001]), np.column_stack([i + 1, i + 5002, i + 5001])])
    inside = mesh_samples(vertices, faces, 10_000)[:, :2] % 1
    np.testing.assert_allclose(inside.mean(axis=0), 0.5, atol=0.01)
    np.testing.assert_allclose(inside.var(axis=0), 1 / 12, rtol=0.03)


def test_a_cloud_of_nothing_and_a_truth_of_nothing():
    empty = np.empty((0, 3))
    for found in (compare_to_points(empty, grid()), compare_to_mesh(np.full((3, 3), np.nan), SQUARE, FACES)):
        assert (found.points, found.completeness, found.f_score) == (0, 0, 0)
        assert np.isnan([found.rms_mm, found.mean_mm, found.median_mm, found.p95_mm, found.precision]).all()
    far = compare_to_points(grid() + [0, 0, 50], grid())
    assert (far.outliers, far.precision, far.completeness, far.f_score) == (1, 0, 0, 0)
    assert np.isnan([far.rms_mm, far.mean_mm, far.median_mm, far.p95_mm]).all()
    with pytest.raises(InputError, match="nothing to compare"):
        compare_to_points(grid(), empty)
    with pytest.raises(InputError, match="tolerance_mm"):
        compare_to_points(grid(), grid(), tolerance_mm=0)
    with pytest.raises(InputError, match="outlier_mm"):
        compare_to_mesh(grid(), SQUARE, FACES, outlier_mm=-1)
    with pytest.raises(InputError, match="area"):
        mesh_samples(np.ones((3, 3)), [[0, 1, 2]], 10)
    with pytest.raises(InputError, match="faces"):
        mesh_samples(SQUARE, np.empty((0, 3), int), 10)


def decoded(projector_xy: np.ndarray) -> Correspondences:
    rows = len(projector_xy)
    return Correspondences(np.zeros((rows, 2)), projector_xy, np.ones((rows, 2)), np.ones(rows), np.zeros((rows, 3)))


@pytest.mark.parametrize("axis", [0, 1])
def test_wrong_labels_are_counted_and_the_others_measured(axis):
    rng = np.random.default_rng(2)
    truth = rng.uniform(0, 1000, (10_000, 2))
    found = truth + rng.normal(0, 0.05, truth.shape)
    found[:500, axis] += rng.choice([-8, 8, 16], 500)
    found[:, 1 - axis] += 100
    found[500:700, axis] = np.nan
    truth[700:1000] = np.nan
    error = label_error(decoded(found), truth, 8.0, axis)
    assert (error.points, error.unknown) == (9500, 300)
    assert error.wrong == pytest.approx(500 / 9500)
    assert error.rms_px == pytest.approx(0.05, rel=4 / np.sqrt(2 * 9000))
    assert label_error(decoded(found), truth, 40.0, axis).wrong == 0
    assert label_error(decoded(found), truth, 40.0, 1 - axis).wrong == 1


def test_labels_of_nothing():
    none = np.full((3, 2), np.nan)
    error = label_error(decoded(none), np.zeros((3, 2)), 8.0)
    assert (error.points, error.unknown) == (0, 0)
    assert np.isnan([error.wrong, error.rms_px]).all()
    with pytest.raises(InputError, match="a row for each"):
        label_error(decoded(none), np.zeros((4, 2)), 8.0)
    with pytest.raises(InputError, match="axis"):
        label_error(decoded(none), none, 8.0, 2)
    with pytest.raises(InputError, match="period_px"):
        label_error(decoded(none), none, 0.0)
