"""What the filters take, and above all what they leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slkit.errors import InputError
from slkit.triangulation import Filters


def grid(spacing_x: float, spacing_y: float, tilt: float = 0.0, size: float = 60.0) -> np.ndarray:
    x, y = np.arange(-size, size, spacing_x), np.arange(-size, size, spacing_y)
    xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.column_stack([xy, 700 + tilt * xy[:, 0]])


@pytest.mark.parametrize("spacing", [(1, 1), (6, 1), (1, 6)])
@pytest.mark.parametrize("tilt", [0.0, 3.0])
def test_a_clean_surface_is_left_alone(make_cloud, spacing, tilt):
    xyz = grid(*spacing, tilt)
    xyz[:, 2] += np.random.default_rng(0).normal(0, 0.1, len(xyz))
    cloud, removed = Filters().apply(make_cloud(xyz))
    assert removed == {"depth": 0, "residual": 0, "sigma": 0, "isolated": 0}
    assert len(cloud) == len(xyz)


def test_a_wire_one_point_thick_stays(make_cloud):
    wire = np.column_stack([np.arange(-50, 50, 1.0), np.full(100, 3.3), np.full(100, 600.0)])
    cloud, removed = Filters().apply(make_cloud(np.concatenate([wire, grid(1, 1)])))
    assert removed["isolated"] == 0
    assert (cloud.xyz[:, 2] < 650).sum() == 100


def test_a_wire_across_the_lines_of_a_line_scan_stays(make_cloud):
    # Lines 6 mm apart meet a wire two rows thick: two points, then nothing for 6 mm.
    x, y = np.meshgrid(np.arange(-60, 60, 6.0), [3.0, 4.0])
    wire = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 600.0)])
    cloud, removed = Filters().apply(make_cloud(np.concatenate([wire, grid(6, 1)])))
    assert removed["isolated"] == 0
    assert (cloud.xyz[:, 2] < 650).sum() == x.size


@pytest.mark.parametrize("spacing", [(1, 1), (6, 1)])
def test_strays_go_alone_in_pairs_and_scattered(make_cloud, spacing):
    rng = np.random.default_rng(1)
    surface = grid(*spacing)
    single = np.column_stack([rng.uniform(-50, 50, (40, 2)), rng.uniform(300, 600, 40)])
    pair = np.array([[0, 0, 640.0], [0.5, 0, 640.5]])
    cloud, removed = Filters().apply(make_cloud(np.concatenate([surface, single, pair])))
    assert removed["isolated"] == 42
    np.testing.assert_array_equal(cloud.xyz, np.float32(surface))


def test_residual_is_judged_by_the_noise_of_the_cloud(make_cloud):
    xyz = grid(1, 1)
    rng = np.random.default_rng(2)
    for noise in (0.01, 1.0):
        residual = np.abs(rng.normal(0, noise, len(xyz)))
        residual[:7] = 20 * noise
        residual[7:20] = np.nan
        cloud, removed = Filters().apply(make_cloud(xyz, residual_px=residual))
        assert removed["residual"] == 7
        assert np.isnan(cloud.residual_px).sum() == 13


def test_sigma_is_judged_by_the_median(make_cloud):
    xyz = grid(1, 1)
    sigma = np.full(len(xyz), 0.2)
    sigma[:5], sigma[5:8], sigma[8:10] = 2.2, 1.8, np.nan
    _, removed = Filters().apply(make_cloud(xyz, sigma_mm=sigma))
    assert removed["sigma"] == 5
    _, removed = Filters(sigma_factor=4.0).apply(make_cloud(xyz, sigma_mm=sigma))
    assert removed["sigma"] == 8


def test_sigma_is_judged_without_the_calibrations_share(make_cloud):
    xyz = grid(1, 1)
    decoding = np.full(len(xyz), 0.2)
    decoding[:5] = 2.2
    for share in (np.full(len(xyz), 3.0), np.linspace(0.01, 50, len(xyz))):
        cloud = replace(make_cloud(xyz, sigma_mm=np.hypot(decoding, share)), sigma_cal_mm=np.float32(share))
        kept, removed = Filters().apply(cloud)
        assert removed["sigma"] == 5
        assert len(kept) == len(xyz) - 5


def test_exact_data_survive(make_cloud):
    residual = np.zeros(14_400)
    residual[::3] = 3e-5
    cloud, _ = Filters().apply(make_cloud(grid(1, 1), residual_px=residual, sigma_mm=0.0))
    assert len(cloud) == 14_400


def test_depth_range(make_cloud):
    xyz = grid(1, 1, tilt=1.0)
    cloud, removed = Filters().apply(make_cloud(xyz), (680, 720))
    assert removed["depth"] == ((xyz[:, 2] < 680) | (xyz[:, 2] > 720)).sum() > 0
    assert cloud.xyz[:, 2].min() >= 680
    assert cloud.xyz[:, 2].max() <= 720


@pytest.mark.parametrize("name", ["residual", "sigma", "depth", "isolated"])
def test_each_is_off_by_name_only(make_cloud, name):
    xyz = np.concatenate([grid(1, 1), [[0, 0, 300.0]], [[0.5, 0.5, 900.0]]])
    residual, sigma = np.full(len(xyz), 0.1), np.full(len(xyz), 0.1)
    residual[0] = sigma[1] = 50
    cloud = make_cloud(xyz, residual_px=residual, sigma_mm=sigma)
    _, everything = Filters().apply(cloud, (500, 899))
    assert all(count > 0 for filter_name, count in everything.items() if filter_name != "isolated")
    _, removed = Filters(**{name: False}).apply(cloud, (500, 899))
    assert list(removed) == [n for n in everything if n != name]
    nothing = Filters(residual=False, sigma=False, depth=False, isolated=False).apply(cloud, (500, 899))
    assert nothing[1] == {}
    assert len(nothing[0]) == len(cloud)


def test_points_that_are_nan_are_counted_apart(make_cloud):
    xyz = grid(1, 1)
    xyz[:4] = np.nan
    cloud, removed = Filters().apply(make_cloud(xyz))
    assert removed["no_point"] == 4
    assert len(cloud) == len(xyz) - 4


@pytest.mark.parametrize("count", [0, 1, 10])
def test_clouds_too_small_to_judge_are_left_alone(make_cloud, count):
    cloud, _ = Filters().apply(make_cloud(grid(1, 1)[:count]))
    assert len(cloud) == count


def test_mistakes_are_told(make_cloud):
    with pytest.raises(InputError, match="sigma_factor must be positive"):
        Filters(sigma_factor=0.0)
    with pytest.raises(InputError, match="from near to far"):
        Filters().apply(make_cloud(grid(1, 1)), (900, 500))
