"""The way through the room: the right method for each row, and light imports."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from slkit.data import Correspondences
from slkit.triangulation import ray_plane, triangulate, two_rays, with_normals


def test_each_row_goes_to_its_method_and_keeps_its_place(make_rig, make_pairs):
    rig = make_rig(2)
    found, xyz = make_pairs(rig, 2)
    coded = found.projector_xy.copy()
    silent = np.arange(len(found)) % 3
    useful = int(np.argmin([np.nanmedian(ray_plane(only(found, axis), rig).sigma_mm) for axis in (0, 1)]))
    coded[silent == 1, 1 - useful] = np.nan
    coded[silent == 2] = np.nan
    mixed = Correspondences(found.camera_xy, coded, found.sigma, found.confidence, found.color)
    cloud = triangulate(mixed, rig)
    kept = silent != 2
    assert len(cloud) == kept.sum()
    np.testing.assert_allclose(cloud.xyz, xyz[kept], atol=1e-3)
    np.testing.assert_array_equal(cloud.color, found.color[kept])
    np.testing.assert_array_equal(np.isnan(cloud.residual_px), silent[kept] == 1)
    two = two_rays(found.select(silent == 0), rig)
    np.testing.assert_array_equal(cloud.sigma_mm[silent[kept] == 0], two.sigma_mm)


def only(found: Correspondences, axis: int) -> Correspondences:
    coded = found.projector_xy.copy()
    coded[:, 1 - axis] = np.nan
    return Correspondences(found.camera_xy, coded, found.sigma, found.confidence, found.color)


def test_nothing_in_nothing_out(make_rig, make_pairs):
    rig = make_rig(0)
    found, _ = make_pairs(rig, 0)
    assert len(triangulate(found.select(np.zeros(0, dtype=int)), rig)) == 0
    silent = np.full_like(found.projector_xy, np.nan)
    assert len(triangulate(Correspondences(found.camera_xy, silent, silent, found.confidence, found.color), rig)) == 0


def test_importing_the_room_is_light():
    code = (
        "import sys, slkit.triangulation; "
        "sys.exit(', '.join({'numba', 'scipy', 'open3d', 'cv2'} & set(sys.modules)) or None)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_normals_of_a_plane_face_the_camera(plane_cloud):
    cloud = with_normals(plane_cloud)
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1, atol=1e-5)
    expected = np.array([0.3, 0.1, -1]) / np.linalg.norm([0.3, 0.1, -1])
    np.testing.assert_allclose(cloud.normals, np.broadcast_to(expected, cloud.xyz.shape), atol=1e-3)
    np.testing.assert_array_equal(cloud.xyz, plane_cloud.xyz)


def test_normals_of_too_few_points_look_at_the_camera(plane_cloud):
    two = with_normals(plane_cloud.select(np.array([0, 1])))
    np.testing.assert_allclose(two.normals, -two.xyz / np.linalg.norm(two.xyz, axis=1, keepdims=True), atol=1e-6)
    assert with_normals(plane_cloud.select(np.zeros(0, dtype=int))).normals.shape == (0, 3)
