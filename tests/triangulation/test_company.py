"""The compiled search for neighbours against a tree, which is the reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from slkit.triangulation.company import in_company


def twin(xyz: np.ndarray, isolated: float, remote: float) -> np.ndarray:
    distances, neighbors = KDTree(xyz).query(xyz, k=11)
    reach = distances[:, -1]
    angle = reach / np.linalg.norm(xyz, axis=1)
    near = reach <= isolated * np.median(reach[neighbors[:, 1:]], axis=1)
    return near & (angle <= remote * np.median(angle))


def surface(rng: np.random.Generator, side: int, strays: int) -> np.ndarray:
    """Points of a wavy surface with a step, seen pixel by pixel, and strays on viewing rays before and behind it."""
    u, v = np.meshgrid(np.linspace(-0.4, 0.3, side), np.linspace(-0.2, 0.3, side))
    z = 1000 + 50 * np.sin(9 * u) + rng.normal(0, 0.2, u.shape) - 120 * (u > 0)
    points = np.stack([u * z, v * z, z], axis=-1).reshape(-1, 3)
    away = points[rng.integers(0, len(points), strays)] * rng.uniform(0.7, 1.3, (strays, 1))
    return np.concatenate([points, away]).astype(np.float32)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), side=st.integers(4, 40), strays=st.integers(0, 30))
def test_the_same_points_have_company_as_by_a_tree(seed: int, side: int, strays: int) -> None:
    rng = np.random.default_rng(seed)
    xyz = rng.permutation(surface(rng, side, strays))
    isolated, remote = rng.uniform(1.2, 5), rng.uniform(1.5, 12)
    differ = in_company(xyz, isolated, remote) != twin(xyz, isolated, remote)
    # Float32 may decide otherwise where a distance is just at its limit.
    assert differ.sum() <= 1


@pytest.mark.parametrize("width", [1, 2, 3, 30])
@pytest.mark.parametrize("turn", [0.0, 0.8])
def test_strays_near_a_rod_are_found(width: int, turn: float) -> None:
    """Of what fills little of the picture, such as a rod across it, strays have no company either."""
    rng = np.random.default_rng(width)
    length = 9000 // width
    along, across = np.meshgrid(np.linspace(-0.4, 0.4, length), np.arange(width) * 0.8 / length)
    spacing, turned = 0.8 / length * 600, np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    rod = np.c_[np.stack([along, across], -1).reshape(-1, 2) @ turned * 600, np.full(length * width, 600.0)]
    rod += rng.normal(0, 0.05 * spacing, rod.shape)
    strays = rod[rng.choice(len(rod), 60, replace=False)]
    strays[:, 2] += spacing * rng.uniform(20, 80, 60)
    xyz = np.concatenate([rod, strays]).astype(np.float32)
    expected = twin(xyz, 4, 10)
    assert (~expected).sum() >= 30
    assert (in_company(xyz, 4, 10) != expected).sum() <= 1


def test_a_line_of_points_and_equal_points_are_no_trouble() -> None:
    line = np.stack([np.arange(500), np.zeros(500), np.full(500, 800)], axis=1).astype(np.float32)
    np.testing.assert_array_equal(in_company(line, 4, 10), twin(line, 4, 10))
    equal = np.tile(np.array([[1, 2, 900]], np.float32), (40, 1))
    assert in_company(equal, 4, 10).all()


@pytest.mark.parametrize("count", [0, 1, 10])
def test_few_points_all_have_company(count: int) -> None:
    assert in_company(np.ones((count, 3), np.float32), 4, 10).all()


def test_what_is_not_before_the_camera_has_no_company() -> None:
    xyz = surface(np.random.default_rng(0), 20, 0)
    behind = np.array([[1, 0, 0], [5, 5, -800]], np.float32)
    assert in_company(np.concatenate([behind, xyz]), 4, 10).tolist() == [False, False, *in_company(xyz, 4, 10).tolist()]
