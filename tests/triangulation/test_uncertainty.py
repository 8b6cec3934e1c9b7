"""The calibration's share of a point's uncertainty: every derivative against numeric ones, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slkit.data import Correspondences
from slkit.errors import InputError
from slkit.geometry import RIG_NAMES, Pinhole, Pose, Rig, homogeneous
from slkit.report.measure import volume_error
from slkit.triangulation import point_covariance, ray_plane, triangulate, two_rays, uncertainty_map
from slkit.triangulation.uncertainty import point_jacobian, rig_covariance

MOVE_MM = 2.0
"""How far numeric derivatives move the farthest point: a float32 point is known to 6e-5 mm."""
DEPTHS_MM = (700.0, 900.0, 1100.0)


def moved(rig: Rig, name: str, step: float) -> Rig:
    """The rig after a step of one parameter, as docs/formats.md describes them."""
    device, _, parameter = name.partition(".")
    if device == "projector_from_camera":
        motion = step * (np.array(["rx", "ry", "rz", "tx", "ty", "tz"]) == parameter)
        pose = rig.projector_from_camera
        turn = Pose.from_rotation_vector(motion[:3], np.zeros(3)).rotation
        return replace(rig, projector_from_camera=Pose(turn @ pose.rotation, pose.translation + motion[3:]))
    lens: Pinhole = getattr(rig, device)
    matrix, distortion = lens.K.copy(), lens.distortion.copy()
    place = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2), "skew": (0, 1)}
    if parameter in place:
        matrix[place[parameter]] += step
    else:
        distortion[["k1", "k2", "p1", "p2", "k3"].index(parameter)] += step
    return replace(rig, **{device: Pinhole(lens.size, matrix, distortion)})


def uncertain(rig: Rig, covariance: np.ndarray, names: tuple[str, ...] = RIG_NAMES) -> Rig:
    return replace(rig, covariance={"parameters": list(names), "matrix": covariance})


def some_covariance(seed: int) -> np.ndarray:
    """Of full rank, correlated, each parameter by about as much as moves a pixel by a tenth."""
    lens = [0.3, 0.3, 0.2, 0.2, 0.1, 1e-3, 2e-3, 2e-4, 2e-4, 2e-3]
    root = (
        np.random.default_rng(seed).normal(size=(26, 30)) * np.array([*lens, *lens, *[1e-4] * 3, *[0.1] * 3])[:, None]
    )
    return root @ root.T / 30


def vertical_rig() -> Rig:
    """A projector straight above the camera, strong distortion and skew: columns say nothing of depth."""
    camera = Pinhole((800, 600), [[1000, 2.5, 420], [0, 990, 310], [0, 0, 1]], [-0.35, 0.15, 2e-3, -1e-3, -0.03])
    projector = Pinhole((1024, 768), [[1500, -3, 500], [0, 1510, -150], [0, 0, 1]], [-0.15, 0.1, -2e-3, 2e-3, 0.05])
    return Rig(camera, projector, Pose(np.eye(3), np.array([0.0, 300, 0])))


SOLE = [("vertical", 1), (0, 0), (1, 1), (2, 0), (2, 1), (5, 0)]
"""Rigs, and an axis that tells depth on each; the other one does so on rig 2 alone."""


@pytest.fixture
def rig(which: str | int, make_rig: Callable[[int], Rig]) -> Rig:
    return vertical_rig() if isinstance(which, str) else make_rig(which)


def only(found: Correspondences, axis: int) -> Correspondences:
    coded, sigma = found.projector_xy.copy(), found.sigma.copy()
    coded[:, 1 - axis] = sigma[:, 1 - axis] = np.nan
    return Correspondences(found.camera_xy, coded, sigma, found.confidence, found.color)


def useful_pairs(make_pairs: Callable[..., tuple], rig: Rig, axis: int | None) -> tuple[Correspondences, np.ndarray]:
    """Pairs, and their depths, of points that one axis tells to 5 mm a px; None: either axis, sigmas as 3 to 1."""
    found, xyz = make_pairs(rig, 3, 150)
    step = 1e-3 * xyz
    slope = (
        np.abs(rig.to_projector(xyz + step) - rig.to_projector(xyz - step)) / np.linalg.norm(2 * step, axis=1)[:, None]
    )
    enough = slope.max(axis=1) if axis is None else slope[:, axis]
    keep = enough > 0.2
    if axis is not None:
        return only(found, axis).select(keep), xyz[keep]
    sigma = np.float32([0.3, 0.1]) * np.ones_like(found.sigma)
    found = Correspondences(found.camera_xy, found.projector_xy, sigma, found.confidence, found.color)
    return found.select(keep), xyz[keep]


@pytest.mark.parametrize(("which", "axis"), [*SOLE, *((w, None) for w in ("vertical", 0, 1, 2, 5))])
def test_every_derivative_is_the_numeric_one(make_pairs, rig, axis):
    """Points by one axis: the whole derivative and the share; by both with unequal sigmas: the share."""
    found, xyz = useful_pairs(make_pairs, rig, axis)
    assert len(found) > 20
    method, ray = two_rays if axis is None else ray_plane, xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    assert np.isnan(method(found, rig).sigma_cal_mm).all()
    for index, name in enumerate(RIG_NAMES):
        share = method(found, uncertain(rig, np.ones((1, 1)), (name,))).sigma_cal_mm
        step = MOVE_MM / max(float(share.max()), 1.0)
        ahead, behind = (method(found, moved(rig, name, s)).xyz.astype(float) for s in (step, -step))
        move = (ahead - behind) / 2
        limit = {"rtol": 2e-3, "atol": 2e-3 * MOVE_MM, "err_msg": name}
        np.testing.assert_allclose(step * share, np.abs((move * ray).sum(axis=1)), **limit)
        if axis is not None:
            analytic = point_jacobian(rig, found.camera_xy, xyz[:, 2], axis)[:, :, index]
            np.testing.assert_allclose(step * analytic, move, **limit)


@pytest.mark.parametrize(("which", "axis"), SOLE)
def test_the_share_is_the_covariance_along_the_viewing_ray(make_pairs, rig, axis):
    found, xyz = useful_pairs(make_pairs, rig, axis)
    known = uncertain(rig, some_covariance(axis))
    cloud, bare = ray_plane(found, known), ray_plane(found, rig)
    ray = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    whole = point_covariance(known, found.camera_xy, xyz[:, 2], axis)
    np.testing.assert_allclose(cloud.sigma_cal_mm, np.sqrt(np.einsum("ni,nij,nj->n", ray, whole, ray)), rtol=1e-4)
    np.testing.assert_array_equal(cloud.xyz, bare.xyz)
    np.testing.assert_allclose(cloud.sigma_mm, np.hypot(bare.sigma_mm, cloud.sigma_cal_mm), rtol=1e-6)
    np.testing.assert_allclose(cloud.sigma_decoding_mm, bare.sigma_mm, rtol=1e-3)


def test_with_both_axes_the_better_one_gives_the_share(make_rig, make_pairs):
    known = uncertain(make_rig(2), some_covariance(0))
    found, _ = make_pairs(known, 2)
    clouds = [ray_plane(f, known) for f in (found, only(found, 0), only(found, 1))]
    best = np.fmin(clouds[1].sigma_decoding_mm, clouds[2].sigma_decoding_mm) == clouds[2].sigma_decoding_mm
    assert 0 < best.sum() < len(best)
    np.testing.assert_array_equal(
        clouds[0].sigma_cal_mm, np.where(best, clouds[2].sigma_cal_mm, clouds[1].sigma_cal_mm)
    )


def test_each_row_of_a_scan_keeps_its_share(make_rig, make_pairs):
    known = uncertain(make_rig(2), some_covariance(0))
    found, _ = make_pairs(known, 2)
    coded = found.projector_xy.copy()
    coded[::2, 0] = np.nan
    mixed = Correspondences(found.camera_xy, coded, found.sigma, found.confidence, found.color)
    cloud = triangulate(mixed, known)
    one = ray_plane(mixed, known)
    np.testing.assert_array_equal(cloud.sigma_cal_mm[::2], one.sigma_cal_mm[::2])
    np.testing.assert_array_equal(cloud.sigma_cal_mm[1::2], two_rays(found, known).sigma_cal_mm[1::2])


def test_rows_without_a_point_have_no_share_and_unknown_sigmas_stay_unknown(make_rig, make_pairs):
    known = uncertain(make_rig(0), some_covariance(0))
    found, _ = make_pairs(known, 0, sigma=np.nan)
    coded = found.projector_xy.copy()
    coded[0] = [np.nan, np.nan]
    lost = Correspondences(found.camera_xy, coded, found.sigma, found.confidence, found.color)
    for method in (ray_plane, two_rays):
        cloud = method(lost, known)
        np.testing.assert_array_equal(np.isfinite(cloud.sigma_cal_mm), cloud.finite)
        assert not cloud.finite[0] and cloud.finite[1:].all()
        assert np.isnan(cloud.sigma_mm).all()


@pytest.mark.parametrize("name", ["camera.fx", "camera.cy", "projector.k1", "projector.p1", *RIG_NAMES[20:]])
@pytest.mark.parametrize("seed", [2, 5])
def test_the_map_of_one_uncertain_parameter_is_the_error_of_a_rig_that_errs_there(make_rig, name, seed):
    rig = make_rig(seed)
    axis = 1 if seed == 2 else 0
    share = uncertainty_map(uncertain(rig, np.ones((1, 1)), (name,)), DEPTHS_MM, axis=axis).rms_mm
    sigma = 0.3 / share
    known = uncertain(rig, np.full((1, 1), sigma**2), (name,))
    # Ahead and behind cancel what is not linear.
    errors = [volume_error(moved(rig, name, s), rig, ray_plane, DEPTHS_MM, 32, axis) for s in (sigma, -sigma)]
    as_is, aligned = (uncertainty_map(known, DEPTHS_MM, a, axis, 32.0).rms_mm for a in (False, True))
    assert np.mean([e.rms_mm for e in errors]) == pytest.approx(as_is, rel=0.01)
    assert np.mean([e.aligned_mm for e in errors]) == pytest.approx(aligned, rel=0.01, abs=1e-4)
    assert aligned < as_is


def test_the_map_has_the_points_that_both_devices_see(make_rig):
    rig = uncertain(vertical_rig(), some_covariance(0))
    found = uncertainty_map(rig, DEPTHS_MM)
    assert (
        found.value_mm.shape
        == (3, *found.camera_xy.shape[:2])
        == (
            3,
            18,
            24,
        )
    )
    rays = homogeneous(rig.camera.normalize(found.camera_xy))
    for depth, layer in zip(found.depths_mm, found.value_mm, strict=True):
        lit = rig.to_projector(depth * rays)
        inside = ((lit >= -0.5) & (lit <= [1023.5, 767.5])).all(axis=-1)
        np.testing.assert_array_equal(np.isfinite(layer), inside)
        assert 0 < inside.sum() < inside.size
    # Rows tell depth on this rig, columns do not: nobody said so.
    np.testing.assert_array_equal(found.value_mm, uncertainty_map(rig, DEPTHS_MM, axis=1).value_mm)
    covariance = point_covariance(rig, found.camera_xy[9], np.full(24, 900.0), 1)
    np.testing.assert_allclose(
        found.value_mm[1, 9] ** 2,
        np.where(np.isfinite(found.value_mm[1, 9]), np.trace(covariance, axis1=1, axis2=2), np.nan),
        rtol=1e-9,
    )


def test_points_that_cannot_be_have_no_covariance(make_rig):
    flat = Pinhole((800, 600), [[1000, 0, 400], [0, 1000, 300], [0, 0, 1]], np.zeros(5))
    rig = uncertain(Rig(flat, flat, Pose(np.eye(3), np.array([-200.0, 0, -50]))), some_covariance(0))
    # In front of both; behind the projector; behind the camera; rows are parallel to the rays' own epipolar lines.
    columns = point_covariance(rig, [[450, 300]] * 3, [900.0, 40.0, -900.0], 0)
    np.testing.assert_array_equal(np.isfinite(columns).all(axis=(1, 2)), [True, False, False])
    level = replace(rig, projector_from_camera=Pose(np.eye(3), np.array([-200.0, 0, 0])))
    assert np.isnan(point_covariance(level, [[450, 350]], [900.0], 1)).all()


def test_names_that_move_no_point_are_left_out_and_order_does_not_matter(make_rig):
    rig, covariance = make_rig(0), some_covariance(0)
    order = np.random.default_rng(0).permutation(26)
    shuffled = uncertain(rig, covariance[np.ix_(order, order)], tuple(np.array(RIG_NAMES)[order]))
    np.testing.assert_array_equal(rig_covariance(shuffled), covariance)
    part = np.diag([4.0, 1e6])
    known = rig_covariance(uncertain(rig, part, ("projector.cx", "board0.warp_x")))
    assert known[12, 12] == 4 and np.count_nonzero(known) == 1


def test_a_covariance_that_is_missing_is_unknown_and_a_broken_one_is_told(make_rig, make_pairs):
    rig = make_rig(0)
    found, _ = make_pairs(rig, 0)
    for unknown in (
        rig,
        uncertain(rig, np.full((1, 1), np.inf), ("camera.fx",)),
        uncertain(rig, np.ones((1, 1)), ("x",)),
    ):
        cloud = ray_plane(found, unknown)
        assert np.isnan(cloud.sigma_cal_mm).all() and np.isfinite(cloud.sigma_mm).all()
        with pytest.raises(InputError, match="has no covariance"):
            uncertainty_map(unknown, DEPTHS_MM)
    for broken in ({"parameters": ["camera.fx"], "matrix": np.eye(2)}, {"matrix": np.eye(2)}):
        with pytest.raises(InputError, match="`parameters` and a `matrix`"):
            ray_plane(found, replace(rig, covariance=broken))
    with pytest.raises(InputError, match="less than three points"):
        uncertainty_map(uncertain(rig, some_covariance(0)), [1.0])
