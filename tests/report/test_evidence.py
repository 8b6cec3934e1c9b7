"""Where the points of a calibration are taken from, and where they lie in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slkit.data import BoardView
from slkit.report._evidence import device_points, placed_views


def test_points_of_each_device(calibration):
    camera, projector = (device_points(calibration, d) for d in ("camera", "projector"))
    # Three views of 63 printed corners, four of 63 printed and 63 projected ones; one of each view is rejected.
    assert len(camera.seen_xy) == 3 * 63 + 4 * 126
    assert len(projector.seen_xy) == 4 * 63
    assert (~camera.kept).sum() == 7
    assert (~projector.kept).sum() == 4
    np.testing.assert_array_equal(np.unique(projector.view), [3, 4, 5, 6])
    assert camera.lens is calibration.rig.camera
    assert len(camera.with_error.seen_xy) == len(camera.seen_xy)


def test_points_without_errors_are_seen_but_have_no_residual(calibration):
    views = tuple(replace(v, camera_xy_error=None, kept=None) for v in calibration.views)
    points = device_points(replace(calibration, views=views), "camera")
    assert len(points.seen_xy) == 3 * 63 + 4 * 126
    assert points.kept.all()
    assert len(points.with_error.seen_xy) == 0


def test_points_lie_on_the_board_printed_or_not(calibration):
    placed = placed_views(calibration)
    assert [p.number for p in placed] == [1, 2, 3, 4, 5, 6, 7]
    for p in placed:
        assert p.result.pose is not None
        away = p.result.pose.inverse().apply(p.points_xyz)[:, 2]
        np.testing.assert_allclose(away, 0, atol=1e-6)
        middle = p.result.pose.inverse().apply(p.middle_xyz)
        np.testing.assert_allclose(middle, [160, 120, 0], atol=1e-9)


def test_points_of_a_solid_target_lie_where_their_rays_meet(calibration):
    rig = calibration.rig
    xyz = np.array([[0, 0, 1000], [50, 20, 1100], [-40, 60, 950.0]])
    nothing = np.full((3, 2), np.nan)
    camera_xy, projector_xy = rig.camera.project(xyz), rig.to_projector(xyz)
    projector_xy[2] = np.nan
    face = np.array([0, 1, 1])
    view = BoardView("solid", rig.camera.size, np.zeros((3, 2)), camera_xy, projector_xy, nothing, face=face)
    solid = replace(calibration.views[3], view=view, kept=None)
    (placed,) = placed_views(replace(calibration, views=(solid,)))
    np.testing.assert_allclose(placed.points_xyz[:2], xyz[:2], atol=1e-6)
    assert np.isnan(placed.points_xyz[2]).all()
    assert placed.outline_xyz.shape == (0, 3)
    np.testing.assert_allclose(placed.middle_xyz, xyz[:2].mean(axis=0), atol=1e-6)


@pytest.mark.parametrize("absent", ["view", "pose"])
def test_views_without_a_place_are_not_drawn(calibration, absent):
    views = (replace(calibration.views[0], **{absent: None}), *calibration.views[1:])
    assert [p.number for p in placed_views(replace(calibration, views=views))] == [2, 3, 4, 5, 6, 7]
