"""What a calibration alone tells: where its boards were, view by view."""

from dataclasses import replace

import numpy as np
import pytest

from slkit.calibration.diagnose import board_depths, diagnosed, seen_points
from slkit.calibration.local_homography import LocalHomography
from slkit.data import Calibration
from slkit.geometry import Pose, homogeneous, ninths
from slkit.simulation import paper_rig, views_with_fault


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    told, views = views_with_fault(None, "mild", paper_rig(), np.random.default_rng(5), "coded", 6)
    return LocalHomography(**told).solve(views)


def flat_view(name: str, depth_mm: float, tilt_deg: float, calibration: Calibration):
    """A view of a board at a depth, tilted about its own x axis."""
    result = calibration.views[0]
    assert result.view is not None and result.kept is not None
    middle = result.view.board_xy.mean(axis=0)
    turn = Pose.from_rotation_vector([np.radians(tilt_deg), 0, 0], np.zeros(3)).rotation
    place = np.array([0, 0, depth_mm]) - turn @ [*middle, 0]
    return replace(result, name=name, pose=Pose(turn, place), kept=np.ones_like(result.kept))


def test_depths_are_those_of_the_middles(calibration: Calibration):
    views = tuple(flat_view(str(d), d, 20, calibration) for d in (900.0, 1000.0, 1200.0))
    assert board_depths(replace(calibration, views=views)) == pytest.approx((900, 1050, 1200))


def test_depths_of_boards_at_one_depth_are_those_of_their_points(calibration: Calibration):
    views = tuple(flat_view(str(tilt), 1000, tilt, calibration) for tilt in (30.0, 0.0))
    near, middle, far = board_depths(replace(calibration, views=views))
    assert near < 960 and far > 1040 and middle == pytest.approx((near + far) / 2)
    parallel = replace(calibration, views=(flat_view("a", 1000, 0, calibration),))
    assert board_depths(parallel) == pytest.approx((1000,))
    assert board_depths(replace(calibration, views=())) == ()


def test_every_view_has_its_place_in_both_devices(calibration: Calibration):
    devices = diagnosed(calibration).devices
    for name, motion in (("camera", Pose.identity()), ("projector", calibration.rig.projector_from_camera)):
        device = devices[name]
        assert list(device.views) == [r.name for r in calibration.views]
        np.testing.assert_array_equal(sum(p.coverage for p in device.views.values()), device.coverage)
        for result in calibration.views:
            assert result.view is not None and result.pose is not None
            depths = (motion @ result.pose).apply(np.column_stack([result.view.board_xy, np.zeros(70)]))[:, 2]
            near, far = device.views[result.name].depth_mm
            # Single points may have been rejected.
            assert depths.min() - 1e-6 < near < far < depths.max() + 1e-6
    first = calibration.views[0].view
    assert first is not None
    whole = ninths(first.camera_xy, first.image_size)
    assert (devices["camera"].views[calibration.views[0].name].coverage <= whole).all()


def test_points_of_a_solid_lie_where_both_rays_meet(calibration: Calibration):
    rig, result = calibration.rig, calibration.views[0]
    assert result.view is not None
    xyz = 1000 * homogeneous(rig.camera.normalize(result.view.camera_xy))
    solid = replace(result.view, face=np.zeros(len(xyz), dtype=np.intp), projector_xy=rig.to_projector(xyz))
    np.testing.assert_allclose(seen_points(rig, solid, Pose.identity()), xyz, atol=1e-6)
    place = diagnosed(replace(calibration, views=(replace(result, view=solid),))).devices["camera"].views[result.name]
    assert np.isnan(place.tilt_deg) and place.depth_mm == pytest.approx((1000, 1000))
