import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.geometry import (
    Pinhole,
    Pose,
    Rig,
    as_size,
    homogeneous,
    intersect_plane,
    intersect_rays,
    pixel_grid,
    steeper_axis,
    working_volume,
)

angles = st.floats(-3.0, 3.0)
lengths = st.floats(-2000, 2000)
vectors = st.tuples(angles, angles, angles)
shifts = st.tuples(lengths, lengths, lengths)
lenses = st.tuples(
    st.floats(-0.25, 0.25), st.floats(-0.1, 0.1), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3), st.floats(-0.02, 0.02)
)


def lens(distortion=(0, 0, 0, 0, 0), skew=0.0) -> Pinhole:
    return Pinhole((800, 600), [[900, skew, 410], [0, 880, 900], [0, 0, 1]], distortion)


@given(vectors, shifts, shifts)
def test_poses_form_a_group(vector, shift, point):
    a = Pose.from_rotation_vector(vector, shift)
    b = Pose.from_rotation_vector(shift / np.array(1e3), vector)
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-8)
    np.testing.assert_allclose(a.inverse().apply(a.apply(point)), point, atol=1e-8)
    np.testing.assert_allclose((a @ a.inverse()).rotation, np.eye(3), atol=1e-12)


@given(vectors)
def test_rotation_vectors_are_those_of_rodrigues(vector):
    pose = Pose.from_rotation_vector(vector, (0, 0, 0))
    np.testing.assert_allclose(pose.rotation, cv2.Rodrigues(np.array(vector, dtype=float))[0], atol=1e-12)
    again = Pose.from_rotation_vector(pose.rotation_vector, (0, 0, 0))
    np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, np.pi - 1e-9, np.pi])
def test_rotation_vectors_at_the_ends_of_their_range(angle):
    vector = np.array([0.6, 0.0, 0.8]) * angle
    found = Pose.from_rotation_vector(vector, (0, 0, 0)).rotation_vector
    assert min(np.abs(found - vector).max(), np.abs(found + vector).max()) < 1e-7


@settings(max_examples=50)
@given(lenses, st.floats(-20, 20))
def test_normalize_inverts_the_lens(distortion, skew):
    device = lens(distortion, skew)
    xy = np.stack(np.meshgrid(np.linspace(0, 799, 9), np.linspace(300, 599, 7)), axis=-1)
    found = device.from_normalized(device.normalize(xy))
    known = np.isfinite(found).all(axis=-1)
    assert known.mean() > 0.5
    np.testing.assert_allclose(found[known], xy[known], atol=1e-7)


@settings(max_examples=30)
@given(lenses)
def test_projection_is_that_of_opencv(distortion):
    device = lens(distortion)
    xyz = np.random.default_rng(0).uniform([-300, -500, 900], [300, 100, 1500], (40, 3))
    expected = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), device.K.copy(), np.array(distortion))[0].reshape(-1, 2)
    np.testing.assert_allclose(device.project(xyz), expected, atol=1e-8)


def test_what_no_lens_images_is_nan():
    device = lens((-0.3, 0, 0, 0, 0))
    assert np.isnan(device.project([[0, 0, -5], [0, 0, 0]])).all()
    # r (1 - 0.3 r^2) never exceeds 0.70: nothing is imaged at two focal lengths from the axis.
    assert np.isnan(device.normalize([[410 + 1800.0, 900.0]])).all()
    assert device.rays().shape == (600, 800, 3)


def test_rays_meet_the_plane_they_are_aimed_at():
    rng = np.random.default_rng(1)
    normal = np.array([0.2, -0.1, 1.0])
    points = rng.uniform(-200, 200, (30, 3))
    points[:, 2] = (1000 - points[:, :2] @ normal[:2]) / normal[2]
    found = intersect_plane(points / points[:, 2:], normal, 1000.0)
    np.testing.assert_allclose(found, points, atol=1e-9)
    assert not np.isfinite(intersect_plane([1.0, 2.0, 0.0], [0.0, 0.0, 1.0], 5.0)).all()


def test_rays_to_one_point_meet_there_and_others_half_way():
    point, a, b = np.array([30.0, -20.0, 900.0]), np.zeros(3), np.array([250.0, 10.0, -30.0])
    found, gap = intersect_rays(a, point - a, b, 3 * (point - b))
    np.testing.assert_allclose(found, point, atol=1e-9)
    assert gap < 1e-9
    found, gap = intersect_rays([0, 0, 0], [0, 0, 1.0], [0, 8.0, 0], [1.0, 0, 0])
    np.testing.assert_allclose(found, [0, 4, 0], atol=1e-12)
    assert gap == pytest.approx(8)


def test_the_rig_knows_where_its_projector_stands():
    pose = Pose.from_rotation_vector([0.1, -0.3, 0.2], [-200, 30, 50])
    rig = Rig(lens(), lens(), pose)
    np.testing.assert_allclose(pose.apply(rig.projector_center), 0, atol=1e-10)
    xyz = np.array([[10.0, 20.0, 1000.0]])
    np.testing.assert_allclose(rig.to_projector(xyz), rig.projector.project(pose.apply(xyz)))


def test_arrays_inside_are_not_to_be_changed():
    device = lens()
    with pytest.raises(ValueError, match="read-only"):
        device.K[0, 0] = 1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Pose(2 * np.eye(3), np.zeros(3)), "orthonormal"),
        (lambda: Pose(np.diag([1.0, 1, -1]), np.zeros(3)), "determinant"),
        (lambda: Pose(np.eye(3), np.array([0, 0, np.nan])), "finite"),
        (lambda: Pose(np.eye(2), np.zeros(3)), "shape 3 x 3"),
        (lambda: Pinhole((0, 5), np.eye(3), np.zeros(5)), "positive whole numbers"),
        (lambda: Pinhole((5, 5), np.diag([-1.0, 1, 1]), np.zeros(5)), "focal"),
        (lambda: Pinhole((5, 5), np.eye(3) + np.eye(3, k=-1), np.zeros(5)), "upper triangular"),
        (lambda: Pinhole((5, 5), np.eye(3), np.zeros(4)), "distortion"),
        (lambda: as_size("wide", "size"), "size must be"),
        (lambda: as_size((3.5, 2), "size"), "3.5 x 2"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_homogeneous_appends_one():
    assert homogeneous(np.zeros((4, 2))).tolist() == [[0, 0, 1]] * 4


def test_a_grid_of_pixels_covers_the_image_evenly():
    np.testing.assert_array_equal(pixel_grid((4, 2), 1.0), np.stack(np.meshgrid(range(4), range(2)), axis=-1))
    for size in ((640, 480), (481, 640), (192, 144)):
        grid = pixel_grid(size)
        assert max(grid.shape) == 24
        border = 0.5 * max(size) / 24
        for axis, length in enumerate(size):
            assert grid[..., axis].min() == pytest.approx(border - 0.5)
            assert length - 0.5 - 2 * border <= grid[..., axis].max() <= length - 0.5


def test_the_working_volume_is_what_both_devices_reach():
    rig = Rig(lens(), lens((-0.2, 0.05, 1e-3, 0, 0)), Pose.from_rotation_vector([0, 0.1, 0], [-300, 20, 5]))
    grid = pixel_grid(rig.camera.size)
    xyz, projector_xy = working_volume(rig, grid, [800, 1200])
    assert xyz.shape == (2, *grid.shape[:2], 3)
    there = np.isfinite(xyz).all(axis=-1)
    assert 0.1 < there.mean() < 0.9
    np.testing.assert_array_equal(np.isfinite(projector_xy).all(axis=-1), there)
    np.testing.assert_allclose(
        rig.camera.project(xyz[there]), np.broadcast_to(grid, (2, *grid.shape))[there], atol=1e-6
    )
    np.testing.assert_array_equal(np.unique(xyz[0][there[0]][:, 2]), 800)
    seen = rig.to_projector(np.stack([z * homogeneous(rig.camera.normalize(grid)) for z in (800, 1200)]))
    inside = ((seen >= -0.5) & (seen <= [799.5, 599.5])).all(axis=-1)
    np.testing.assert_array_equal(there, inside)
    np.testing.assert_array_equal(projector_xy[there], seen[there])


@pytest.mark.parametrize(("shift", "axis"), [((300, 10, 0), 0), ((-10, 300, 0), 1), ((200, -250, 90), 1)])
def test_the_steeper_axis_is_the_one_along_the_baseline(shift, axis):
    points = np.random.default_rng(0).uniform([-200, -200, 800], [200, 200, 1200], (50, 3))
    points[3] = np.nan
    assert steeper_axis(Rig(lens(), lens(), Pose(np.eye(3), np.array(shift, dtype=float))), points) == axis
