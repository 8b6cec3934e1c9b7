"""Both axes: against the truth, against SciPy's least squares, and the honesty of sigma_mm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from slkit.data import Correspondences
from slkit.geometry import Rig, homogeneous, intersect_rays
from slkit.triangulation import ray_plane, two_rays


def shares(sigma: np.ndarray, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """1 sigma of the camera's u, v and of the projector's x, y in px, as the docstring of two_rays divides them."""
    camera_f, projector_f = (np.array([d.K[0, 0], d.K[1, 1]]) for d in (rig.camera, rig.projector))
    camera = np.min(sigma / projector_f) / np.sqrt(2)
    return camera * camera_f, np.sqrt((sigma / projector_f) ** 2 - camera**2) * projector_f


def noisy(found: Correspondences, seed: int, camera_px: np.ndarray, projector_px: np.ndarray) -> Correspondences:
    rng = np.random.default_rng(seed)
    camera_xy = found.camera_xy + rng.normal(size=found.camera_xy.shape) * camera_px
    projector_xy = found.projector_xy + rng.normal(size=found.projector_xy.shape) * projector_px
    return Correspondences(camera_xy, projector_xy, found.sigma, found.confidence, found.color)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_points_come_back_from_exact_pairs(make_rig, make_pairs, seed):
    rig = make_rig(seed)
    found, xyz = make_pairs(rig, seed)
    cloud = two_rays(found, rig)
    assert np.linalg.norm(cloud.xyz - xyz, axis=1).max() < 1e-3
    assert cloud.residual_px.max() < 1e-3
    np.testing.assert_array_equal(cloud.color, found.color)


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_least_squares_from_the_midpoint(make_rig, make_pairs, seed):
    rig, sigma = make_rig(seed), np.array([0.3, 0.1])
    found, _ = make_pairs(rig, seed)
    found = noisy(found.select(np.arange(12)), seed, np.array([0.2, 0.2]), np.array([0.4, 0.4]))
    found = Correspondences(found.camera_xy, found.projector_xy, np.tile(sigma, (12, 1)), found.confidence, found.color)
    pose, (camera_px, projector_px) = rig.projector_from_camera, shares(sigma, rig)
    start, _ = intersect_rays(
        np.zeros(3),
        homogeneous(rig.camera.normalize(found.camera_xy)),
        rig.projector_center,
        homogeneous(rig.projector.normalize(found.projector_xy)) @ pose.rotation,
    )
    cloud = two_rays(found, rig)
    for i in range(12):

        def errors(xyz, i=i):
            return np.concatenate(
                [rig.camera.project(xyz) - found.camera_xy[i], rig.to_projector(xyz) - found.projector_xy[i]]
            )

        weight = 1 / np.concatenate([camera_px, projector_px])
        best = least_squares(lambda p, w=weight: w * errors(p), start[i], x_scale=100.0, xtol=1e-14, ftol=1e-14)
        np.testing.assert_allclose(cloud.xyz[i], best.x, atol=2e-3)
        np.testing.assert_allclose(cloud.residual_px[i], np.linalg.norm(errors(best.x)), rtol=1e-4)


@pytest.mark.parametrize(("seed", "sigma"), [(0, (0.1, 0.1)), (1, (0.05, 0.3)), (2, (0.3, 0.05))])
def test_sigma_mm_is_the_scatter_along_the_viewing_ray(make_rig, make_pairs, seed, sigma):
    rig, draws, rows, sigma = make_rig(seed), 4000, 10, np.array(sigma)
    found, xyz = make_pairs(rig, seed)
    many = found.select(np.repeat(np.arange(rows), draws))
    sigmas = np.tile(sigma, (rows * draws, 1))
    many = Correspondences(many.camera_xy, many.projector_xy, sigmas, many.confidence, many.color)
    direction = xyz[:rows, None] / np.linalg.norm(xyz[:rows, None], axis=2, keepdims=True)

    def scatter(camera_px, projector_px):
        cloud = two_rays(noisy(many, seed, camera_px, projector_px), rig)
        along = (cloud.xyz.reshape(rows, draws, 3).astype(float) * direction).sum(axis=2)
        return along.std(axis=1) / np.median(cloud.sigma_mm.reshape(rows, draws), axis=1)

    # The noise that the weights stand for; a standard deviation of 4000 draws is known to 1.1 %.
    np.testing.assert_allclose(scatter(*shares(sigma, rig)), 1, rtol=0.05)
    # All of it on the projector's side: the division is then not the true one, and the estimate only near.
    np.testing.assert_allclose(scatter(np.zeros(2), sigma), 1, rtol=0.2)


def test_it_beats_the_ray_plane_point_under_its_own_noise(make_rig, make_pairs):
    sigma = np.array([0.5, 0.5])
    ratios = []
    for seed in range(5):
        rig = make_rig(seed)
        found, xyz = make_pairs(rig, seed, sigma=0.5)
        shaken = noisy(found, seed, *shares(sigma, rig))
        ratios.append([np.sqrt(np.mean((f(shaken, rig).xyz - xyz) ** 2)) for f in (two_rays, ray_plane)])
    two, one = np.array(ratios).T
    assert (two < one).all()


def test_residual_is_the_distance_from_the_epipolar_line_shared_by_both(make_rig, make_pairs):
    rig = make_rig(3)
    found, _ = make_pairs(rig, 3)
    off = Correspondences(
        found.camera_xy, found.projector_xy + np.float32([2, 2]), found.sigma, found.confidence, found.color
    )
    residual = two_rays(off, rig).residual_px
    assert (residual < np.hypot(2, 2) + 1e-3).all()
    assert residual.max() > 0.5


def test_rows_without_both_axes_or_without_a_point_are_nan(make_rig, make_pairs):
    rig = make_rig(0)
    found, _ = make_pairs(rig, 0)
    coded = found.projector_xy[:3].copy()
    coded[0, 0] = np.nan
    coded[1] = np.nan
    found = found.select(np.arange(3))
    found = Correspondences(found.camera_xy, coded, found.sigma, found.confidence, found.color)
    cloud = two_rays(found, rig)
    for field in (cloud.xyz.sum(axis=1), cloud.sigma_mm, cloud.residual_px):
        np.testing.assert_array_equal(np.isfinite(field), [False, False, True])


def test_unknown_sigma_gives_points_but_no_sigma_mm(make_rig, make_pairs):
    rig = make_rig(0)
    found, xyz = make_pairs(rig, 0, sigma=np.nan)
    cloud = two_rays(found, rig)
    assert np.linalg.norm(cloud.xyz - xyz, axis=1).max() < 1e-3
    assert np.isnan(cloud.sigma_mm).all()


def test_exact_pairs_with_sigma_zero(make_rig, make_pairs):
    rig = make_rig(0)
    found, xyz = make_pairs(rig, 0, sigma=0.0)
    cloud = two_rays(found, rig)
    assert np.linalg.norm(cloud.xyz - xyz, axis=1).max() < 1e-3
    assert (cloud.sigma_mm < 0.01).all()
