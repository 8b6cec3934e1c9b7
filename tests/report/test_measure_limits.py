"""The physical limits, against estimators that attain them and rigs whose depth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from slkit.data import Correspondences
from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose, Rig
from slkit.report.measure import (
    Signal,
    color_line_limit_px,
    edge_crossing_px,
    edge_limit_px,
    efficiency,
    gray_limit_px,
    limit_mm,
    line_limit_px,
    phase_limit_px,
)
from slkit.simulation import paper_rig
from slkit.triangulation import ray_plane

SIGNAL = Signal(amplitude=100.0, noise=2.0, pitch=1.5, blur_px=1.2)
PIXELS = np.arange(-15, 16)


def scatter(profiles: list[Callable[[np.ndarray], np.ndarray]], signal: Signal, rng: np.random.Generator) -> float:
    """1 sigma in camera px of where least squares places profiles that share a height and differ by an offset each.

    The profiles are seen at random places between the pixels, and the places found by one step of Gauss-Newton.
    """
    errors: list[float] = []
    for place in rng.uniform(-0.5, 0.5, 2000):
        u = PIXELS - place
        clean = np.concatenate([p(u) for p in profiles])
        slope = np.concatenate([p(u - 1e-4) - p(u + 1e-4) for p in profiles]) / 2e-4
        offsets = np.kron(np.eye(len(profiles)), np.ones((len(u), 1)))
        columns = np.column_stack([signal.amplitude * slope, clean, offsets])
        errors.append(np.linalg.lstsq(columns, rng.normal(0, signal.noise, len(clean)))[0][0])
    return float(np.std(errors))


def line(width: float, blur: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda u: norm.cdf((u + width / 2) / blur) - norm.cdf((u - width / 2) / blur)


@pytest.mark.parametrize("width_px", [0.5, 1.0, 3.0])
def test_least_squares_attains_the_limit_of_a_line(width_px):
    profile = line(width_px * SIGNAL.pitch, SIGNAL.blur_px)
    found = scatter([profile], SIGNAL, np.random.default_rng(0)) / SIGNAL.pitch
    assert found == pytest.approx(line_limit_px(SIGNAL, width_px), rel=4 / np.sqrt(2 * 2000))


def test_least_squares_attains_the_limit_of_an_edge():
    def edge(u: np.ndarray) -> np.ndarray:
        return norm.cdf(u / SIGNAL.blur_px)

    found = scatter([edge, lambda u: -edge(u)], SIGNAL, np.random.default_rng(1)) / SIGNAL.pitch
    assert found == pytest.approx(edge_limit_px(SIGNAL), rel=4 / np.sqrt(2 * 2000))


def test_the_integral_in_closed_form():
    u = np.linspace(-40, 40, 400_001)
    for width, blur in ((0.3, 0.8), (2.0, 1.2), (9.0, 0.7)):
        slope = (norm.pdf((u + width / 2) / blur) - norm.pdf((u - width / 2) / blur)) / blur
        expected = 0.02 / np.sqrt(np.trapezoid(slope**2, u))
        assert line_limit_px(Signal(100.0, 2.0, 1.0, blur), width) == pytest.approx(expected, rel=1e-6)


def test_a_narrow_line_is_a_gaussian_and_a_wide_one_two_edges():
    # A Gaussian of height h: sqrt(2 / sqrt(pi)) sqrt(s) noise / h.
    width = 0.01
    height = 100 * width / (SIGNAL.blur_px * np.sqrt(2 * np.pi))
    narrow = line_limit_px(Signal(100.0, 2.0, 1.0, SIGNAL.blur_px), width)
    assert narrow == pytest.approx(np.sqrt(2 / np.sqrt(np.pi) * SIGNAL.blur_px) * 2 / height, rel=1e-4)
    assert line_limit_px(SIGNAL, 50.0) == pytest.approx(edge_limit_px(SIGNAL), rel=1e-9)


def test_an_edge_where_pattern_and_inverse_cross():
    # Straight between two pixels the noise of both counts by their share: 2 / 3 of its variance on average.
    rng = np.random.default_rng(2)
    signal = Signal(100.0, 0.5, 1.0, 3.0)
    place = rng.uniform(0, 1, 100_000)
    left, right = (
        100 * (2 * norm.cdf((u - place) / 3.0) - 1) + np.sqrt(2) * rng.normal(0, 0.5, len(place)) for u in (0, 1)
    )
    found = float(np.std(left / (left - right) - place))
    assert found == pytest.approx(np.sqrt(2 / 3) * edge_crossing_px(signal), rel=0.02)
    assert edge_crossing_px(Signal(100.0, 0.5, 2.0, 3.0)) == pytest.approx(edge_crossing_px(signal) / 2)
    # The bound weighs more than two pixels, the more the wider the edge.
    assert edge_limit_px(signal) < 0.8 * found


def test_channels_of_a_colour_add_up():
    weak, strong = Signal(30.0, 2.0), Signal(50.0, 2.0)
    assert color_line_limit_px([weak, weak, weak, weak]) == pytest.approx(line_limit_px(Signal(60.0, 2.0)))
    assert color_line_limit_px([strong]) == pytest.approx(2 * line_limit_px(Signal(100.0, 2.0)))
    assert color_line_limit_px([weak, strong]) < line_limit_px(strong)
    with pytest.raises(InputError, match="channels"):
        color_line_limit_px([])


@pytest.mark.parametrize("steps", [3, 4, 8])
@pytest.mark.parametrize("blur_px", [0.01, 4.0])
def test_phase_shift_attains_its_limit(steps, blur_px):
    rng = np.random.default_rng(3)
    signal, period = Signal(100.0, 0.5, 1.5, blur_px), 16.0
    shift = 2 * np.pi * np.arange(steps) / steps
    place = rng.uniform(0, period, 50_000)[:, None]
    seen = np.exp(-2 * (np.pi * blur_px / (1.5 * period)) ** 2)
    shots = 60 + 50 * seen * np.cos(2 * np.pi * place / period - shift) + rng.normal(0, 0.5, (50_000, steps))
    phase = np.angle(shots @ np.exp(1j * shift))
    error = (phase * period / (2 * np.pi) - place[:, 0] + period / 2) % period - period / 2
    assert np.std(error) == pytest.approx(phase_limit_px(signal, [period], steps), rel=0.02)


def test_periods_join_by_their_weight():
    signal = Signal(100.0, 2.0, blur_px=1e-3)
    one, other = (phase_limit_px(signal, [p], 4) for p in (16, 24))
    assert phase_limit_px(signal, [16, 24], 4) == pytest.approx(1 / np.sqrt(one**-2 + other**-2))
    assert phase_limit_px(signal, [16, 16], 4) == pytest.approx(phase_limit_px(signal, [16], 8))
    for periods, steps in (([], 4), ([16], 2), ([0], 4)):
        with pytest.raises(InputError, match="periods_px"):
            phase_limit_px(signal, periods, steps)


def test_a_cell_is_known_to_a_cell():
    rng = np.random.default_rng(4)
    place = rng.uniform(0, 100, 100_000)
    assert np.std(place - (np.floor(place / 4) * 4 + 2)) == pytest.approx(gray_limit_px(4.0), rel=0.01)


def test_signals_may_differ_from_place_to_place():
    amplitude = np.array([20.0, 50, 100])
    many = Signal(amplitude, 2.0, np.array([0.5, 1, 2]))
    for limit in (line_limit_px, edge_limit_px, edge_crossing_px, lambda s: phase_limit_px(s, [8, 32], 4)):
        singly = [limit(Signal(a, 2.0, p)) for a, p in zip((20.0, 50.0, 100.0), (0.5, 1.0, 2.0), strict=True)]
        np.testing.assert_allclose(limit(many), singly)
        # Half the noise, half the sigma.
        np.testing.assert_allclose(limit(Signal(2 * amplitude, 2.0, many.pitch)), np.array(singly) / 2)
    with pytest.raises(InputError, match="noise"):
        Signal(100.0, 0.0)
    with pytest.raises(InputError, match="amplitude"):
        Signal(np.array([1.0, np.nan]), 1.0)


LENS = Pinhole((800, 600), [[1000, 0, 400], [0, 1000, 300], [0, 0, 1]], np.zeros(5))
XYZ = np.array([[0.0, 0, 1000], [100, -50, 1200], [-80, 60, 900]])


def test_depth_of_parallel_devices():
    # x_p = f (X + b) / Z + cx along the ray X = m Z: d x_p / d Z = -f b / Z^2.
    rig = Rig(LENS, LENS, Pose(np.eye(3), [200.0, 0, 0]))
    np.testing.assert_allclose(limit_mm(rig, XYZ, 0.1), 0.1 * XYZ[:, 2] ** 2 / (1000 * 200), rtol=1e-6)
    each = np.array([0.1, 0.2, 0.4])
    np.testing.assert_allclose(limit_mm(rig, XYZ, each), each * XYZ[:, 2] ** 2 / (1000 * 200), rtol=1e-6)
    assert not np.isfinite(limit_mm(rig, XYZ[:1], 0.1, axis=1)).any()
    assert np.isnan(limit_mm(rig, [[np.nan, 0, 900], [0, 0, -900]], 0.1)).all()
    with pytest.raises(InputError, match="axis"):
        limit_mm(rig, XYZ, 0.1, axis=2)


@pytest.mark.parametrize("axis", [0, 1])
def test_depth_is_what_triangulation_makes_of_a_moved_position(axis):
    plain = paper_rig()
    lens = Pinhole(plain.projector.size, plain.projector.K, [-0.1, 0.05, 1e-3, -1e-3, 0])
    rig = Rig(plain.camera, lens, plain.projector_from_camera)
    sigma = 0.1
    projector_xy = rig.to_projector(XYZ)
    projector_xy[:, axis] += sigma
    projector_xy[:, 1 - axis] = np.nan
    rows = len(XYZ)
    moved = ray_plane(
        Correspondences(rig.camera.project(XYZ), projector_xy, np.ones((rows, 2)), np.ones(rows), np.zeros((rows, 3))),
        rig,
    )
    # Positions of single precision are good to 6e-5 px.
    np.testing.assert_allclose(np.abs(moved.xyz[:, 2] - XYZ[:, 2]), limit_mm(rig, XYZ, sigma, axis), rtol=5e-3)


def test_efficiency_is_one_at_the_limit():
    rng = np.random.default_rng(5)
    limits = rng.uniform(0.05, 0.2, 50_000)
    error = rng.normal(0, limits)
    assert efficiency(float(np.sqrt(np.mean(error**2))), limits) == pytest.approx(1, rel=0.02)
    assert efficiency(0.3, np.array([0.1, np.inf, 0.1, np.nan])) == pytest.approx(3)
    with pytest.raises(InputError, match="finite"):
        efficiency(0.3, [np.inf])
