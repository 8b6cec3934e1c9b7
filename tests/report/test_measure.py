"""The numbers, on shapes whose answers are known."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.data import PointCloud
from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose, Rig
from slkit.report.measure import (
    cloud_against_truth,
    distances_to_mesh,
    plane_fit,
    rigid_alignment,
    volume_difference,
    volume_error,
)
from slkit.triangulation import ray_plane, triangulate

DATA = Path(os.environ.get("SLKIT_DATA", "../shared/data"))
TRUTH = DATA / "planar_capture" / "truth"
SQUARE = np.array([[0, 0, 500], [100, 0, 500], [100, 100, 500], [0, 100, 500.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), flat=st.booleans())
def test_alignment_undoes_a_rigid_motion(seed, flat):
    rng = np.random.default_rng(seed)
    a = rng.normal(0, 100, (30, 3)) * [1, 1, not flat]
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(0, 500, 3))
    found = rigid_alignment(a, pose.apply(a))
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-7)


def test_alignment_neither_scales_nor_mirrors():
    a = np.random.default_rng(0).normal(0, 100, (30, 3))
    assert np.linalg.det(rigid_alignment(a, a * [1, 1, -1]).rotation) == pytest.approx(1)
    np.testing.assert_allclose(rigid_alignment(a, 2 * a).rotation, np.eye(3), atol=1e-12)


def test_alignment_is_the_least_squares_one():
    rng = np.random.default_rng(1)
    a = rng.normal(0, 100, (40, 3))
    b = a + rng.normal(0, 5, a.shape)
    best = rigid_alignment(a, b)
    least = np.sum((best.apply(a) - b) ** 2)
    for _ in range(20):
        near = Pose.from_rotation_vector(rng.normal(0, 0.01, 3), rng.normal(0, 0.1, 3)) @ best
        assert np.sum((near.apply(a) - b) ** 2) > least


@pytest.mark.parametrize(
    "points", [np.zeros((2, 3)), np.outer(np.arange(5), [1, 2, 3]), np.ones((5, 3)), np.zeros((4, 2))]
)
def test_alignment_of_too_little_is_refused(points):
    with pytest.raises(InputError):
        rigid_alignment(points, points)


def test_plane_fit_of_a_noisy_plane():
    rng = np.random.default_rng(2)
    normal = np.array([2.0, -1, 5]) / np.sqrt(30)
    points = rng.uniform(-100, 100, (20_000, 3))
    points += np.outer(400 - points @ normal + rng.normal(0, 0.25, 20_000), normal)
    found, offset, rms = plane_fit(points)
    np.testing.assert_allclose(found, normal, atol=1e-4)
    assert offset == pytest.approx(400, abs=0.01)
    assert rms == pytest.approx(0.25, rel=0.02)
    with pytest.raises(InputError, match="three or more"):
        plane_fit(points[:2])


def test_distances_to_a_square():
    points = np.array([[50, 50, 507], [50, 50, 490], [130, 140, 500], [-3, 50, 504], [20, 30, 500.0]])
    np.testing.assert_allclose(distances_to_mesh(points, SQUARE, FACES), [7, 10, 50, 5, 0], atol=1e-4)
    with pytest.raises(InputError, match="faces"):
        distances_to_mesh(points, SQUARE, np.empty((0, 3), int))


def square_scan(offsets_mm: np.ndarray, camera_xy: np.ndarray) -> PointCloud:
    rows = len(offsets_mm)
    xyz = np.column_stack([camera_xy, 500 + offsets_mm])
    return PointCloud(xyz, np.zeros((rows, 3)), np.ones(rows), np.ones(rows), camera_xy)


def test_scan_against_truth_counts_as_defined():
    # The truth is the pixels (0..9, 0..9) of a camera that sees pixel (x, y) at (x, y, 500) mm.
    pixels = np.stack(np.meshgrid(np.arange(10), np.arange(10)), axis=-1).reshape(-1, 2)
    truth_xyz = np.column_stack([pixels, np.full(100, 500)])
    # Good: 0.3 off at every fourth place; a stray 5 mm off at an object pixel; one seen outside the object; one NaN.
    places = np.array([[0, 0], [4, 0], [0.4, 4.4], [4, 4], [2, 2], [60, 60], [8, 8]], dtype=float)
    cloud = square_scan(np.array([0.3, -0.3, 0.3, -0.3, 5.0, 0.0, np.nan]), places)
    error = cloud_against_truth(cloud, SQUARE, FACES, pixels, truth_xyz)
    assert error.points == 5
    assert error.outliers == pytest.approx(0.2)
    assert error.rms_mm == pytest.approx(0.3, abs=1e-3)
    assert error.median_mm == pytest.approx(0.3, abs=1e-3)
    kept = cloud.xyz[:5]
    near = (np.linalg.norm(truth_xyz[:, None] - kept, axis=2) <= 1).any(axis=1)
    assert error.completeness == pytest.approx(near.mean())
    assert 0.05 < near.mean() < 0.2


def test_a_scan_of_nothing():
    pixels = np.array([[1, 1], [2, 2]])
    error = cloud_against_truth(
        square_scan(np.zeros(3), np.full((3, 2), 90.0)), SQUARE, FACES, pixels, np.column_stack([pixels, [500, 500]])
    )
    assert error.points == 0
    assert error.completeness == 0
    assert np.isnan([error.rms_mm, error.median_mm, error.outliers]).all()


@pytest.fixture(scope="module")
def truth() -> Rig:
    path = TRUTH / "rig.json"
    if not path.is_file():
        pytest.skip(f"{path} is absent: set SLKIT_DATA to the folder of the real captures")
    data = json.loads(path.read_text(encoding="utf-8"))
    camera, projector = (
        Pinhole(tuple(data[d]["size"]), data[d]["K"], data[d]["distortion"]) for d in ("camera", "projector")
    )
    pose = data["projector_from_camera"]
    return Rig(camera, projector, Pose(pose["rotation"], pose["translation"]))


DEPTHS_MM = (612, 666, 720, 774, 828)


def test_the_volume_of_planar_capture_has_its_points(truth):
    error = volume_error(truth, truth, ray_plane, DEPTHS_MM)
    assert (error.points, error.missing) == (1289, 0)
    assert error.rms_mm < 1e-3
    assert error.aligned_mm < 1e-3


def test_volume_error_of_a_turned_camera_is_gone_after_alignment(truth):
    # A principal point that is off by a pixel turns what the camera sees; a longer baseline cannot be aligned away.
    pose = truth.projector_from_camera
    moved = Pose.from_rotation_vector([0, 0.001, 0], [0.3, 0, 0])
    turned = Rig(truth.camera, truth.projector, pose @ moved)
    error = volume_error(turned, truth, ray_plane, DEPTHS_MM)
    assert error.rms_mm > 0.3
    longer = Rig(truth.camera, truth.projector, Pose(pose.rotation, 1.01 * pose.translation))
    scaled = volume_error(longer, truth, ray_plane, DEPTHS_MM)
    assert scaled.rms_mm == pytest.approx(0.01 * np.sqrt(np.mean(volume_lengths(truth) ** 2)), rel=0.02)
    assert 0.1 < scaled.aligned_mm < scaled.rms_mm


def volume_lengths(truth: Rig) -> np.ndarray:
    grid = np.stack(np.meshgrid(np.arange(32, 1280, 64), np.arange(32, 960, 64)), -1).reshape(-1, 2)
    rays = np.column_stack([truth.camera.normalize(grid), np.ones(len(grid))])
    xyz = np.concatenate([z * rays for z in DEPTHS_MM])
    seen = truth.to_projector(xyz)
    return np.linalg.norm(xyz[((seen >= -0.5) & (seen <= [1279.5, 799.5])).all(axis=1)], axis=1)


def test_volume_error_wants_one_point_a_row(truth):
    behind = Rig(truth.camera, truth.projector, Pose(np.eye(3), [0, 0, 0.0]))
    with pytest.raises(InputError, match="one point a row"):
        volume_error(behind, truth, triangulate, DEPTHS_MM)
    with pytest.raises(InputError, match="nothing to compare"):
        volume_error(behind, truth, ray_plane, DEPTHS_MM)


def test_the_map_of_two_rigs_is_their_volume_error_point_by_point(truth):
    pose = truth.projector_from_camera
    other = Rig(truth.camera, truth.projector, Pose(pose.rotation, 1.01 * pose.translation))
    error = volume_error(other, truth, ray_plane, DEPTHS_MM)
    for align, rms_mm in ((False, error.rms_mm), (True, error.aligned_mm)):
        found = volume_difference(truth, other, ray_plane, DEPTHS_MM, align, step_px=64)
        assert found.value_mm.shape == (5, 15, 20)
        assert found.rms_mm == pytest.approx(rms_mm, rel=0.01)
    # A projector that is farther away by a hundredth makes everything so: each point moves along its ray.
    as_is = volume_difference(truth, other, ray_plane, DEPTHS_MM, align=False)
    rays = np.linalg.norm(truth.camera.rays(), axis=-1)
    at = np.rint(as_is.camera_xy).astype(int)
    expected = 0.01 * np.array(DEPTHS_MM)[:, None, None] * rays[at[..., 1], at[..., 0]]
    there = np.isfinite(as_is.value_mm)
    assert 0.3 < there.mean() < 1
    np.testing.assert_allclose(as_is.value_mm[there], expected[there], rtol=2e-3)


def test_it_does_not_matter_which_of_two_rigs_is_asked_first(truth):
    moved = Pose.from_rotation_vector([0.002, -0.001, 0.003], [3, -2, 5])
    other = Rig(truth.camera, truth.projector, truth.projector_from_camera @ moved)
    there, back = (volume_difference(*pair, ray_plane, DEPTHS_MM).rms_mm for pair in ((truth, other), (other, truth)))
    assert there == pytest.approx(back, rel=0.1)
    assert there > 0.1
    assert volume_difference(truth, truth, ray_plane, DEPTHS_MM).rms_mm < 1e-3


def test_the_axis_that_tells_depth_is_found():
    lens = Pinhole((800, 600), [[1000, 0, 400], [0, 1000, 300], [0, 0, 1]], np.zeros(5))
    above, longer = (Rig(lens, lens, Pose(np.eye(3), [0.0, b, 0])) for b in (100, 101))
    found = volume_difference(above, longer, ray_plane, DEPTHS_MM, align=False)
    middle = np.argmin(np.linalg.norm(found.camera_xy - [400, 300], axis=-1))
    np.testing.assert_allclose(found.value_mm.reshape(5, -1)[:, middle], 0.01 * np.array(DEPTHS_MM), rtol=1e-2)
    with pytest.raises(InputError, match="nothing to compare"):
        volume_difference(above, longer, ray_plane, DEPTHS_MM, axis=0)


def test_the_true_points_of_planar_capture_come_back(truth):
    found = np.load(TRUTH / "object.npz")
    from slkit.data import Correspondences

    rows = np.arange(0, len(found["xyz_mm"]), 10)
    none = np.full((len(rows), 2), np.nan)
    both = Correspondences(
        found["camera_xy"][rows], found["projector_xy"][rows], none, np.ones(len(rows)), np.ones((len(rows), 3))
    )
    cloud = triangulate(both, truth)
    assert np.linalg.norm(cloud.xyz - found["xyz_mm"][rows], axis=1).max() < 1e-3
    assert cloud.residual_px.max() < 1e-3
