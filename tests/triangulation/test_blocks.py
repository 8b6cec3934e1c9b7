"""The loops that take blocks of rows against those that take a row at a time."""

import numpy as np
import pytest

from slkit.data import Correspondences
from slkit.triangulation import ray_plane, two_rays
from slkit.triangulation._block_kernels import BLOCK
from slkit.triangulation._kernels import ray_plane_rows
from slkit.triangulation._run import run
from slkit.triangulation._two_rays_kernels import two_rays_rows

from .test_uncertainty import some_covariance, uncertain

METHODS = {"x": (ray_plane, ray_plane_rows), "y": (ray_plane, ray_plane_rows), "both": (two_rays, two_rays_rows)}


def rough(found: Correspondences, seed: int, axes: str) -> Correspondences:
    """Pairs with noise, every 7th without a sigma, every 11th without a code, every 13th coded wrong by far."""
    rng = np.random.default_rng(seed)
    coded = found.projector_xy + rng.normal(0, 0.3, found.projector_xy.shape).astype(np.float32)
    sigma = rng.uniform(0.05, 0.6, coded.shape).astype(np.float32)
    sigma[::7] = np.nan
    coded[::13] += rng.uniform(-700, 700, coded[::13].shape).astype(np.float32)
    coded[::11] = np.nan
    if axes != "both":
        coded[:, 1 if axes == "x" else 0] = np.nan
    return Correspondences(found.camera_xy, coded, sigma, found.confidence, found.color)


def none_found(*arguments) -> None:
    """A kernel that leaves every row to the other one."""
    arguments[7][:] = np.nan


@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize("axes", METHODS)
@pytest.mark.parametrize("seed", range(4))
def test_blocks_give_what_rows_give(make_rig, make_pairs, seed, axes, calibrated):
    rig = uncertain(make_rig(seed), some_covariance(0)) if calibrated else make_rig(seed)
    method, rows = METHODS[axes]
    found = rough(make_pairs(rig, seed, count=2 * BLOCK + 400)[0], seed, axes)
    assert len(found) > 2 * BLOCK
    got, want = method(found, rig), run(none_found, rows, found, rig)
    there = np.isfinite(want.xyz[:, 0])
    assert 0.5 * len(found) < there.sum() < 0.95 * len(found)
    more = np.isfinite(got.xyz[:, 0]) & ~there
    # Of pairs that do not belong together only the start decides whether a point is found.
    assert (got.residual_px[more] > 50).all() and more.sum() < 3
    for name in ("xyz", "sigma_mm", "residual_px", "sigma_cal_mm"):
        np.testing.assert_allclose(
            getattr(got, name)[~more], getattr(want, name)[~more], rtol=2e-5, atol=1e-4, err_msg=name
        )


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1])
def test_any_number_of_rows(make_rig, make_pairs, count):
    rig = make_rig(1)
    found, xyz = make_pairs(rig, 1)
    some = found.select(np.arange(count))
    np.testing.assert_allclose(two_rays(some, rig).xyz, xyz[:count], atol=1e-2)
    np.testing.assert_array_equal(ray_plane(some, rig).xyz, ray_plane(found, rig).xyz[:count])
