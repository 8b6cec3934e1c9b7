"""One coded axis: against the truth, against a plain NumPy twin, and the honesty of sigma_mm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.data import Correspondences, PointCloud
from slkit.geometry import Pinhole, Pose, Rig, homogeneous
from slkit.triangulation import ray_plane

USEFUL_MM_PER_PX = 10.0  # an axis along the epipolar lines says nothing of depth


def with_one_axis(found: Correspondences, axis: int) -> Correspondences:
    coded, sigma = found.projector_xy.copy(), found.sigma.copy()
    coded[:, 1 - axis] = sigma[:, 1 - axis] = np.nan
    return Correspondences(found.camera_xy, coded, sigma, found.confidence, found.color)


def mm_per_px(rig: Rig, xyz: np.ndarray, axis: int) -> np.ndarray:
    step = 0.05 * xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    return 0.1 / np.abs((rig.to_projector(xyz + step) - rig.to_projector(xyz - step))[:, axis])


def twin(found: Correspondences, rig: Rig, axis: int, xyz: np.ndarray) -> np.ndarray:
    """Newton's method on depth in plain NumPy with a numeric derivative, started a tenth away from the truth."""
    rays = homogeneous(rig.camera.normalize(found.camera_xy))
    target, z = found.projector_xy[:, axis].astype(float), 1.1 * xyz[:, 2]
    for _ in range(50):
        h = 1e-4 * z
        value = [rig.to_projector(rays * (z + d)[:, None])[:, axis] for d in (-h, 0, h)]
        z = z - (value[1] - target) * 2 * h / (value[2] - value[0])
    return rays * z[:, None]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), axis=st.integers(0, 1))
def test_points_come_back_from_exact_pairs(make_rig, make_pairs, seed, axis):
    rig = make_rig(seed)
    found, xyz = make_pairs(rig, seed)
    useful = mm_per_px(rig, xyz, axis) < USEFUL_MM_PER_PX
    found, xyz = with_one_axis(found, axis).select(useful), xyz[useful]
    cloud = ray_plane(found, rig)
    error = np.linalg.norm(cloud.xyz - xyz, axis=1)
    # A float32 pixel coordinate near 1000 is known to 3e-5 px.
    assert error.max(initial=0) < 1e-3
    assert np.isnan(cloud.residual_px).all()
    np.testing.assert_array_equal(cloud.color, found.color)
    np.testing.assert_array_equal(cloud.camera_xy, found.camera_xy)


@pytest.mark.parametrize(("seed", "axis"), [(168, 1), (2334, 0)])
def test_distortion_that_moves_the_sheet_more_than_depth_does(make_rig, make_pairs, seed, axis):
    # On these two the plane of light without distortion gives a start from which Newton's method is lost.
    rig = make_rig(seed)
    found, xyz = make_pairs(rig, seed)
    useful = mm_per_px(rig, xyz, axis) < USEFUL_MM_PER_PX
    cloud = ray_plane(with_one_axis(found, axis).select(useful), rig)
    assert useful.sum() > 5
    np.testing.assert_allclose(cloud.xyz, xyz[useful], atol=1e-3)


def test_a_projector_in_the_camera_sees_no_depth(make_rig, make_pairs):
    rig = make_rig(0)
    found, _ = make_pairs(rig, 0)
    nowhere = Rig(rig.camera, rig.projector, Pose(rig.projector_from_camera.rotation, np.zeros(3)))
    assert np.isnan(ray_plane(found, nowhere).xyz).all()


@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_the_numpy_twin_on_noisy_pairs(make_rig, make_pairs, seed):
    rig = make_rig(seed)
    found, xyz = make_pairs(rig, seed)
    axis = int(np.argmin([np.median(mm_per_px(rig, xyz, a)) for a in (0, 1)]))
    noisy = found.projector_xy + np.random.default_rng(seed).normal(0, 0.5, found.projector_xy.shape)
    found = with_one_axis(Correspondences(found.camera_xy, noisy, found.sigma, found.confidence, found.color), axis)
    np.testing.assert_allclose(ray_plane(found, rig).xyz, twin(found, rig, axis, xyz), atol=1e-3)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_better_of_two_axes_is_used(make_rig, make_pairs, seed):
    rig = make_rig(seed)
    found, xyz = make_pairs(rig, seed)
    cloud = ray_plane(found, rig)
    assert np.linalg.norm(cloud.xyz - xyz, axis=1).max() < 1e-3
    assert cloud.residual_px.max() < 1e-3
    one, other = (ray_plane(with_one_axis(found, axis), rig).sigma_mm for axis in (0, 1))
    np.testing.assert_array_equal(cloud.sigma_mm, np.fmin(one, other))


def test_sigma_decides_between_the_axes_and_the_other_one_gives_the_residual(make_rig, make_pairs):
    rig = make_rig(1)
    found, _ = make_pairs(rig, 1)
    sigma = np.tile(np.float32([1e4, 0.1]), (len(found), 1))
    shifted = found.projector_xy + np.float32([3.0, 0.0])
    cloud = ray_plane(Correspondences(found.camera_xy, shifted, sigma, found.confidence, found.color), rig)
    np.testing.assert_allclose(cloud.residual_px, 3.0, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_sigma_mm_is_the_scatter_along_the_viewing_ray(make_rig, make_pairs, seed):
    rig, draws, rows, sigma = make_rig(seed), 4000, 10, 0.1
    found, xyz = make_pairs(rig, seed, sigma=sigma)
    found, xyz = found.select(np.arange(rows)), xyz[:rows]
    axis = int(np.argmin([np.median(mm_per_px(rig, xyz, a)) for a in (0, 1)]))
    many = found.select(np.repeat(np.arange(rows), draws))
    coded = many.projector_xy + np.random.default_rng(seed).normal(0, sigma, many.projector_xy.shape)
    many = with_one_axis(Correspondences(many.camera_xy, coded, many.sigma, many.confidence, many.color), axis)
    depth = np.linalg.norm(ray_plane(many, rig).xyz.astype(float), axis=1).reshape(rows, draws)
    # A standard deviation of 4000 draws is known to 1.1 %.
    expected = ray_plane(with_one_axis(found, axis), rig).sigma_mm
    np.testing.assert_allclose(depth.std(axis=1), expected, rtol=0.05)


def simple_rig(distortion=(0, 0, 0, 0, 0)) -> Rig:
    lens = Pinhole((1000, 800), [[1000, 0, 500], [0, 1000, 400], [0, 0, 1]], distortion)
    return Rig(lens, lens, Pose(np.eye(3), np.array([-200.0, 0, 0])))


def pairs(camera_xy, projector_xy, sigma=0.1) -> Correspondences:
    coded = np.float32(projector_xy)
    rows = len(coded)
    return Correspondences(
        np.float32(camera_xy), coded, np.where(np.isfinite(coded), sigma, np.nan), np.ones(rows), np.ones((rows, 3))
    )


def test_rectified_rig_by_hand():
    # Disparity 250 px at a focal length of 1000 px and a baseline of 200 mm is a depth of 800 mm.
    cloud = ray_plane(pairs([[600, 400]], [[350, np.nan]]), simple_rig())
    np.testing.assert_allclose(cloud.xyz, [[80, 0, 800]], atol=1e-4)
    # z^2 / (f b) mm a px, and the ray is longer than its z.
    np.testing.assert_allclose(cloud.sigma_mm, [0.1 * 800**2 / 200_000 * np.hypot(1, 0.1)], rtol=1e-5)


def test_rows_without_a_point_are_nan():
    silent, behind, parallel, far_outside = [np.nan, np.nan], [700, np.nan], [600, np.nan], [np.nan, 400]
    cloud = ray_plane(pairs([[600, 400]] * 4, [silent, behind, parallel, far_outside]), simple_rig())
    assert isinstance(cloud, PointCloud)
    assert np.isnan(cloud.xyz).all()
    assert np.isnan(cloud.sigma_mm).all()


def test_a_camera_pixel_without_a_ray_gives_nan():
    # With k1 = -0.6 the picture of everything ends at 0.497 of the focal length from the principal point.
    rig = simple_rig((-0.6, 0, 0, 0, 0))
    cloud = ray_plane(pairs([[500, 400], [500 + 480, 400], [500 + 500, 400]], [[350, np.nan]] * 3), rig)
    assert np.isfinite(cloud.xyz[:2]).all()
    assert np.isnan(cloud.xyz[2]).all()


def test_light_from_beyond_the_projector_image_is_no_point():
    rig = simple_rig()
    cloud = ray_plane(pairs([[600, 860], [600, 1000]], [[350, np.nan]] * 2), rig)
    assert np.isfinite(cloud.xyz[0]).all()
    assert np.isnan(cloud.xyz[1]).all()


def test_unknown_sigma_still_gives_points():
    cloud = ray_plane(pairs([[600, 400]], [[350, 400]], sigma=np.nan), simple_rig())
    np.testing.assert_allclose(cloud.xyz, [[80, 0, 800]], atol=1e-4)
    assert np.isnan(cloud.sigma_mm).all()


def test_no_rows_and_read_only_rows():
    nothing = ray_plane(pairs(np.empty((0, 2)), np.empty((0, 2))), simple_rig())
    assert len(nothing) == 0
    found = pairs([[600, 400]], [[350, np.nan]])
    found.camera_xy.flags.writeable = False
    assert np.isfinite(ray_plane(found, simple_rig()).xyz).all()


def test_slices_on_threads_give_the_same_as_one_run():
    rng = np.random.default_rng(0)
    camera_xy = rng.uniform([500, 100], [900, 700], (50_000, 2))
    found = pairs(camera_xy, np.stack([camera_xy[:, 0] - 250, np.full(50_000, np.nan)], axis=1))
    whole = ray_plane(found, simple_rig()).xyz
    np.testing.assert_allclose(whole[:, 2], 800, atol=1e-3)
    np.testing.assert_array_equal(whole[-5:], ray_plane(found.select(np.arange(49_995, 50_000)), simple_rig()).xyz)
