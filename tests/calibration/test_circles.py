import cv2
import numpy as np
import pytest

from slkit.calibration.circles import ellipse_offset, find_circles
from slkit.targets import CircleGrid

from .pictures import mapped, seen, tilted

GRIDS = [CircleGrid((9, 7), 30.0, 18.0), CircleGrid((5, 9), 30.0, 24.0, asymmetric=True)]


@pytest.mark.parametrize("grid", GRIDS, ids=["straight", "staggered"])
@pytest.mark.parametrize("tilt_deg", [5.0, 25.0, 40.0])
def test_centres_are_those_of_the_discs(grid: CircleGrid, tilt_deg: float, rng: np.random.Generator):
    homography = tilted(grid, rng, tilt_deg)
    found = find_circles(seen(grid, homography, rng), grid)
    assert found is not None
    away = np.linalg.norm(found - mapped(homography, grid.points()), axis=1)
    assert np.sqrt((away**2).mean()) < 0.02


def test_perspective_would_move_the_centres_without_the_correction(rng: np.random.Generator):
    grid = CircleGrid((4, 3), 60.0, 50.0)
    homography = tilted(grid, rng, 40.0)
    offset = np.linalg.norm(ellipse_offset(homography, grid.points(), 25.0), axis=1)
    found = find_circles(seen(grid, homography, rng), grid)
    assert found is not None
    away = np.linalg.norm(found - mapped(homography, grid.points()), axis=1)
    print(f"ellipse centres lie up to {offset.max():.2f} px off; after the correction {away.max():.3f} px")
    assert offset.max() > 0.5
    assert away.max() < 0.05 * offset.max()


def test_the_offset_is_that_of_a_drawn_ellipse(rng: np.random.Generator):
    homography = tilted(CircleGrid((9, 7), 30.0, 18.0), rng, 40.0)
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    for center in ([0.0, 0.0], [150.0, 60.0]):
        rim = mapped(homography, np.array(center) + 9.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        middle = np.array(cv2.fitEllipseDirect(rim.astype(np.float32))[0])
        expected = middle - mapped(homography, np.array([center]))[0]
        found = ellipse_offset(homography, np.array([center]), 9.0)[0]
        np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("turns", [1, 2])
def test_a_turned_grid_keeps_its_order_where_it_can_be_told(turns: int, rng: np.random.Generator):
    grid = GRIDS[1]
    homography = tilted(grid, rng, 15.0)
    found = find_circles(np.ascontiguousarray(np.rot90(seen(grid, homography, rng), turns)), grid)
    assert found is not None
    expected = mapped(homography, grid.points())
    for height in (900, 700)[:turns]:
        expected = np.stack([expected[:, 1], height - 1 - expected[:, 0]], axis=1)
    assert np.abs(found - expected).max() < 0.1


def test_a_missing_disc_or_another_grid_is_refused(rng: np.random.Generator):
    grid = GRIDS[0]
    homography = tilted(grid, rng, 10.0)
    picture = seen(grid, homography, rng)
    assert find_circles(picture, CircleGrid((9, 8), 30.0, 18.0)) is None
    x, y = mapped(homography, grid.points())[30].astype(int)
    picture[y - 25 : y + 25, x - 25 : x + 25] = picture[y, x + 25]
    assert find_circles(picture, grid) is None
    assert find_circles(np.zeros((200, 300), np.uint8), grid) is None
