"""Spheres, form, size, spacing and flatness, on points whose noise is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.report.measure import flatness, probing_error, sphere_fit, sphere_spacing

RADIUS = 20.0
CENTER = np.array([30.0, -40.0, 900.0])


def directions(rng: np.random.Generator, count: int, cap_deg: float = 180.0) -> np.ndarray:
    """Even over the part of the unit sphere that is nearer than cap_deg to the direction of -z."""
    z = rng.uniform(-1, -np.cos(np.radians(cap_deg)), count)
    turn, across = rng.uniform(0, 2 * np.pi, count), np.sqrt(1 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def ball(rng: np.random.Generator, count: int, sigma: float = 0.0, cap_deg: float = 60.0) -> np.ndarray:
    return CENTER + (RADIUS + rng.normal(0, sigma, count))[:, None] * directions(rng, count, cap_deg)


def mean_range(count: int) -> float:
    """The expected range of so many normal values of sigma 1. Source: Tippett (1925)."""
    from scipy.stats import norm

    x = np.linspace(-8, 8, 4001)
    return float(np.trapezoid(1 - norm.cdf(x) ** count - norm.sf(x) ** count, x))


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), cap_deg=st.floats(5, 180), size=st.floats(1e-3, 1e3), count=st.integers(4, 60))
def test_exact_points_give_their_sphere(seed, cap_deg, size, count):
    points = ball(np.random.default_rng(seed), count, 0.0, cap_deg)
    flat = np.linalg.svd(points - points.mean(axis=0))[1]
    if flat[2] < 1e-3 * flat[0]:
        return  # Four points may happen to lie nearly on one plane.
    for radius in (None, size * RADIUS):
        fit = sphere_fit(size * points, radius)
        assert fit.points == count
        np.testing.assert_allclose(fit.center, size * CENTER, atol=1e-5 * size * RADIUS)
        assert fit.radius_mm == pytest.approx(size * RADIUS, rel=1e-5)
        assert np.abs(fit.residuals_mm).max() < 1e-6 * size * RADIUS


def test_the_fit_is_the_least_squares_one():
    rng = np.random.default_rng(3)
    points = ball(rng, 300, 0.5)
    free, held = sphere_fit(points), sphere_fit(points, RADIUS + 0.1)
    for fit, move_radius in ((free, 1), (held, 0)):
        least = np.sum(fit.residuals_mm**2)
        for _ in range(30):
            center = fit.center + rng.normal(0, 0.01, 3)
            radius = fit.radius_mm + move_radius * rng.normal(0, 0.01)
            assert np.sum((np.linalg.norm(points - center, axis=1) - radius) ** 2) > least
    assert held.radius_mm == RADIUS + 0.1


def test_noise_across_the_surface_leaves_the_radius_and_noise_along_it_does_not():
    # A tangential error e moves a point e^2 / 2r outwards, and there are two of them.
    rng = np.random.default_rng(4)
    count, sigma = 200_000, 0.5
    error = 4 * sigma / np.sqrt(count)
    assert sphere_fit(ball(rng, count, sigma, 180.0)).radius_mm == pytest.approx(RADIUS, abs=error)
    everywhere = ball(rng, count, 0.0, 180.0) + rng.normal(0, sigma, (count, 3))
    assert sphere_fit(everywhere).radius_mm == pytest.approx(RADIUS + sigma**2 / RADIUS, abs=error)
    assert error < 0.5 * sigma**2 / RADIUS


def test_a_held_radius_keeps_the_surface_on_its_side():
    points = ball(np.random.default_rng(5), 2000, 0.02, 30.0)
    for radius in (15.0, 30.0):
        fit = sphere_fit(points, radius)
        pole = fit.center - [0, 0, radius]
        np.testing.assert_allclose(pole, CENTER - [0, 0, RADIUS], atol=2.0)


@pytest.mark.parametrize("radius", [None, 20.0])
def test_points_that_do_not_bend_are_refused(radius):
    rng = np.random.default_rng(6)
    flat = rng.uniform(-50, 50, (200, 3)) * [1, 1, 0] + [0, 0, 900]
    turned = Pose.from_rotation_vector([0.3, 0.5, 0.1], [1, 2, 3]).apply(flat)
    ring = ball(rng, 50) * [1, 1, 0]
    for points in (flat, turned, ring, np.outer(np.arange(9.0), [1, 2, 3]), np.ones((5, 3))):
        with pytest.raises(InputError, match="one plane"):
            sphere_fit(points, radius)
    with pytest.raises(InputError, match="four or more"):
        sphere_fit(ball(rng, 3), radius)
    gone = ball(rng, 9)
    gone[3:] = np.nan
    with pytest.raises(InputError, match="four or more"):
        sphere_fit(gone, radius)


def test_noise_on_a_plane_is_no_sphere():
    # Curvature counts from three sigma on: a plane's noise gets there three times in a thousand.
    rng = np.random.default_rng(7)
    refused = 0
    for _ in range(100):
        points = np.column_stack([rng.uniform(-50, 50, (300, 2)), rng.normal(900, 0.1, 300)])
        try:
            sphere_fit(points)
        except InputError as error:
            refused += "cover too little" in str(error)
    assert refused >= 97


def test_form_of_known_noise():
    rng = np.random.default_rng(8)
    count, sigma, runs = 2000, 0.05, 20
    found = [probing_error(ball(rng, count, sigma), 2 * RADIUS) for _ in range(runs)]
    # The range of so many normal values scatters by about 0.45 sigma.
    form = np.mean([f.form_mm for f in found])
    assert form == pytest.approx(mean_range(count) * sigma, abs=3 * 0.45 * sigma / np.sqrt(runs))
    assert np.mean([f.sigma_mm for f in found]) == pytest.approx(sigma, rel=4 / np.sqrt(2 * count * runs))
    # 95 % of normal values lie within 1.96 sigma; the smallest of many intervals is a little shorter.
    form95 = np.mean([f.form95_mm for f in found])
    assert 3.92 * sigma * 0.97 < form95 < 3.92 * sigma
    assert found[0].points == count
    assert found[0].discarded == 0
    assert np.mean([f.size_mm for f in found]) == pytest.approx(0, abs=0.01)


def test_few_points_lose_four_degrees_of_freedom():
    rng = np.random.default_rng(9)
    variances = [probing_error(ball(rng, 8, 0.05, 120.0)).sigma_mm ** 2 for _ in range(1000)]
    # Four degrees are left, so a variance scatters by 0.71 of itself.
    assert np.mean(variances) == pytest.approx(0.05**2, rel=4 * 0.71 / np.sqrt(1000))


def test_size_is_the_diameter():
    points = CENTER + 1.002 * (ball(np.random.default_rng(10), 500) - CENTER)
    assert probing_error(points, 2 * RADIUS).size_mm == pytest.approx(0.002 * 2 * RADIUS, abs=1e-6)
    assert np.isnan(probing_error(points).size_mm)


def test_three_of_a_thousand_may_be_discarded():
    rng = np.random.default_rng(11)
    good = ball(rng, 997, 0.02)
    strays = CENTER + np.array([[0, 0, -RADIUS - 9], [5, 0, -RADIUS - 7], [0, 6, -RADIUS + 8]])
    points = rng.permutation(np.concatenate([good, strays]))
    kept = probing_error(points, discard=0.003)
    assert (kept.points, kept.discarded) == (997, 3)
    assert kept.form_mm == pytest.approx(probing_error(good).form_mm, rel=1e-6)
    assert probing_error(points).form_mm > 15
    assert probing_error(points, discard=0.002).form_mm > 5
    for share in (0.0031, -0.001, np.nan):
        with pytest.raises(InputError, match="discard"):
            probing_error(points, discard=share)
    with pytest.raises(InputError, match="diameter_mm"):
        probing_error(points, -40.0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.floats(0.01, 100))
def test_motion_changes_nothing_and_scale_scales(seed, size):
    rng = np.random.default_rng(seed)
    points = ball(rng, 200, 0.1)
    points[7] = np.nan
    plate = rng.uniform(-50, 50, (200, 3)) * [1, 1, 0] + rng.normal(0, 0.1, (200, 3)) * [0, 0, 1]
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(0, 300, 3))
    a, b = probing_error(points, 40.0, 0.003), probing_error(size * pose.apply(points), size * 40.0, 0.003)
    assert a.points == b.points == 199
    for name in ("form_mm", "form95_mm", "sigma_mm", "size_mm"):
        assert getattr(b, name) == pytest.approx(size * getattr(a, name), rel=1e-4, abs=1e-6 * size)
    c, d = flatness(plate), flatness(size * pose.apply(plate))
    for name in ("form_mm", "form95_mm", "sigma_mm"):
        assert getattr(d, name) == pytest.approx(size * getattr(c, name), rel=1e-6)


def test_spacing_feels_scale_and_no_noise():
    rng = np.random.default_rng(12)
    apart = np.array([120.0, 0, 16])
    length = float(np.linalg.norm(apart))
    a, b = ball(rng, 400), ball(rng, 300) + apart
    exact = sphere_spacing(a, b, length)
    assert (exact.points_a, exact.points_b) == (400, 300)
    assert exact.error_mm == pytest.approx(0, abs=1e-6)
    scaled = sphere_spacing(1.01 * a, 1.01 * b, length)
    assert scaled.error_mm == pytest.approx(0.01 * length, abs=1e-5)
    assert scaled.distance_mm == pytest.approx(1.01 * length, abs=1e-5)
    with pytest.raises(InputError, match="distance_mm"):
        sphere_spacing(a, b, 0.0)


def test_a_calibrated_radius_makes_the_spacing_surer():
    # Along the view the free radius and the centre of a cap are nearly the same: held, the centre scatters far less.
    rng = np.random.default_rng(13)
    apart = np.array([0, 0, 150.0])
    pairs = [(ball(rng, 300, 0.05, 40.0), ball(rng, 300, 0.05, 40.0) + apart) for _ in range(40)]
    free = np.std([sphere_spacing(a, b, 150.0).error_mm for a, b in pairs])
    held = np.std([sphere_spacing(a, b, 150.0, (2 * RADIUS, 2 * RADIUS)).error_mm for a, b in pairs])
    # Held: the mean of the noise over the cosine of the normals, twice.
    expected = np.sqrt(2) * 0.05 / np.sqrt(300 * np.mean(directions(rng, 10_000, 40.0)[:, 2] ** 2))
    assert held == pytest.approx(expected, rel=0.4)
    assert free > 3 * held


def test_flatness_of_known_noise():
    rng = np.random.default_rng(14)
    count, sigma, runs = 2000, 0.1, 20
    plates = [np.column_stack([rng.uniform(-60, 60, (count, 2)), rng.normal(900, sigma, count)]) for _ in range(runs)]
    found = [flatness(p) for p in plates]
    assert found[0].points == count
    form = np.mean([f.form_mm for f in found])
    assert form == pytest.approx(mean_range(count) * sigma, abs=3 * 0.45 * sigma / np.sqrt(runs))
    assert 3.92 * sigma * 0.97 < np.mean([f.form95_mm for f in found]) < 3.92 * sigma
    assert np.mean([f.sigma_mm for f in found]) == pytest.approx(sigma, rel=4 / np.sqrt(2 * count * runs))
    small = [flatness(p[:5]).sigma_mm ** 2 for plate in plates for p in np.split(plate, 400)]
    # Two degrees are left of five points: the variance scatters by all of itself.
    assert np.mean(small) == pytest.approx(sigma**2, rel=4 / np.sqrt(len(small)))
    with pytest.raises(InputError, match="four or more"):
        flatness(plates[0][:3])


def test_95_of_100_is_what_the_interval_holds():
    x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    rest = 1e-3 * (-1.0) ** np.arange(100)
    rest[[0, 9, 90, 99, 44]] = [5, 5, 5, 5, -20]
    plate = np.column_stack([x.ravel(), y.ravel(), rest])
    found = flatness(plate)
    assert found.form_mm > 20
    # Five points are far off; the plane tilts a little.
    assert found.form95_mm < 0.5
    plate[55, 2] = 3
    assert flatness(plate).form95_mm > 2
