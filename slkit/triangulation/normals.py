"""Surface normals on request."""

from __future__ import annotations

import dataclasses

import numpy as np

from slkit.data import PointCloud

_NEIGHBORS = 30  # reaches the next lines of a scan whose lines are six times as far apart as its points


def with_normals(cloud: PointCloud) -> PointCloud:
    """Return the cloud with normals (m, 3) of length 1 that face the camera, from planes through 30 neighbours.

    Points that are NaN get a normal that is NaN; where fewer than three points exist the normal is the direction to
    the camera.
    """
    normals = np.full((len(cloud), 3), np.nan, dtype=np.float32)
    there = cloud.finite
    if there.sum() >= 3:
        points = cloud.select(there).to_open3d()
        points.estimate_normals(max_nn=_NEIGHBORS)
        points.orient_normals_towards_camera_location()
        normals[there] = points.point["normals"].numpy()
    else:
        normals[there] = -cloud.xyz[there] / np.linalg.norm(cloud.xyz[there], axis=1, keepdims=True)
    return dataclasses.replace(cloud, normals=normals)
