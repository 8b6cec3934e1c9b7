"""The rigid motion between two sets of points."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.report.measure._points import points_of


def rigid_alignment(a: npt.ArrayLike, b: npt.ArrayLike) -> Pose:
    """Return b_from_a, the rotation and shift without scale that brings points a (n, 3) nearest to points b (n, 3), mm.

    Errors: InputError for different shapes or fewer than three points, or points on one line.
    Source: Kabsch (1976), with the determinant's sign of Umeyama (1991).
    """
    pa, pb = points_of(a, "a"), points_of(b, "b")
    if pa.shape != pb.shape or len(pa) < 3:
        raise InputError(f"an alignment needs three or more pairs of points, not {len(pa)} and {len(pb)}")
    ca, cb = pa.mean(axis=0), pb.mean(axis=0)
    u, s, vt = np.linalg.svd((pa - ca).T @ (pb - cb))
    if s[1] <= 1e-12 * s[0] or s[0] == 0:
        raise InputError("an alignment needs points that are not all on one line")
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = vt.T @ flip @ u.T
    return Pose(rotation, cb - rotation @ ca)
