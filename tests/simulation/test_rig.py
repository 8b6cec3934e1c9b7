import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose, Rig, homogeneous
from slkit.simulation import in_view, one_to_one_rig, paper_rig, random_rig, seen_by, working_distance, working_volume

seeds = st.integers(0, 2**32 - 1)


def test_the_paper_rig_is_the_paper_s() -> None:
    rig = paper_rig()
    assert rig.camera.size == (768, 576)
    assert rig.projector.size == (1024, 768)
    assert np.linalg.norm(rig.projector_center) == pytest.approx(500, abs=0.01)
    assert rig.projector.K[1, 2] > 768, "the principal point lies below the image"
    assert working_distance(rig) == pytest.approx(1100, abs=1e-6)


def test_one_projector_pixel_covers_one_camera_pixel() -> None:
    rig = one_to_one_rig()
    center = (np.array(rig.camera.size) - 1) / 2
    plane = homogeneous(rig.camera.normalize(center + [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])) * 1000
    a, b, c, d = rig.to_projector(plane)
    np.testing.assert_allclose([np.linalg.norm(e) for e in (b - a, d - c)], 1, atol=0.005)
    np.testing.assert_allclose([np.linalg.norm(e) for e in (c - a, d - b)], 1, atol=0.06)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_a_random_rig_looks_at_one_place_and_measures_a_ball_there(seed: int) -> None:
    rig = random_rig(np.random.default_rng(seed))
    distance = working_distance(rig)
    target = homogeneous(rig.camera.normalize((np.array(rig.camera.size) - 1) / 2)) * distance
    np.testing.assert_allclose(rig.to_projector(target), (np.array(rig.projector.size) - 1) / 2, atol=1e-6)
    assert 0.15 * distance < np.linalg.norm(rig.projector_center) < 0.5 * distance
    center, radius = working_volume(rig)
    directions = np.random.default_rng(0).standard_normal((500, 3))
    ball = center + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert radius > 0.05 * distance
    assert in_view(rig, ball).all()


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_every_pixel_of_a_random_rig_has_a_ray(seed: int) -> None:
    rig = random_rig(np.random.default_rng(seed))
    for device in (rig.camera, rig.projector):
        width, height = device.size
        grid = np.stack(np.meshgrid(np.linspace(-0.5, width - 0.5, 21), np.linspace(-0.5, height - 0.5, 21)), axis=-1)
        rays = homogeneous(device.normalize(grid))
        np.testing.assert_allclose(device.project(rays), grid, atol=1e-6)
        assert seen_by(device, rays, -1e-6).all()


def test_equal_generators_draw_equal_rigs() -> None:
    a, b, c = (random_rig(np.random.default_rng(seed)) for seed in (7, 7, 8))
    np.testing.assert_array_equal(a.projector_from_camera.translation, b.projector_from_camera.translation)
    assert not np.allclose(a.projector_from_camera.translation, c.projector_from_camera.translation)


def test_a_point_that_the_distortion_folds_into_the_image_is_not_seen() -> None:
    device = Pinhole((640, 480), np.array([[600, 0, 320], [0, 600, 240], [0, 0, 1]]), np.array([-0.3, 0, 0, 0, 0]))
    folded = np.array([1.75, 0.0, 1.0])
    assert 0 < device.project(folded)[0] < 639, "the polynomial does fold this point into the image"
    assert not seen_by(device, folded)
    assert seen_by(device, np.array([0.3, 0.0, 1.0]))
    assert not seen_by(device, np.array([0.0, 0.0, -1.0]))


def _parallel(pose: Pose) -> Rig:
    device = Pinhole((640, 480), np.array([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]]), np.zeros(5))
    return Rig(device, device, pose)


def test_parallel_axes_still_have_a_working_volume() -> None:
    rig = _parallel(Pose(np.eye(3), np.array([-200.0, 0, 0])))
    center, radius = working_volume(rig)
    assert 400 < center[2] < 4000
    assert in_view(rig, center + [[radius, 0, 0], [-radius, 0, 0]]).all()


def test_devices_that_look_away_from_each_other_are_refused() -> None:
    with pytest.raises(InputError, match="share no volume"):
        working_volume(_parallel(Pose.from_rotation_vector([0, 3.0, 0], [-200, 0, 0])))
