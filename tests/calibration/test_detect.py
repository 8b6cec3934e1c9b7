import cv2
import numpy as np
import pytest

from slkit.calibration.detect import find_checkerboard, to_8bit
from slkit.targets import Checkerboard

from .pictures import mapped, seen, tilted


def printed(board, homography, noise, rng):
    """A picture (700, 900) of a printed board under a homography from mm to px."""
    xy = np.stack(np.meshgrid(np.arange(900), np.arange(700)), axis=-1).astype(np.float64)
    place = cv2.perspectiveTransform(xy.reshape(1, -1, 2), np.linalg.inv(homography)).reshape(700, 900, 2)
    shade = np.linspace(0.35, 1.0, 900)[None]
    light = 240 * shade * cv2.GaussianBlur(board.reflectance(place, 0.6), (0, 0), 0.9)
    return np.clip(light + noise * rng.normal(size=light.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_printed_corners_are_found_to_some_hundredths_of_a_pixel(seed):
    rng = np.random.default_rng(seed)
    board = Checkerboard((9, 6), 20.0)
    homography = np.array([[2.4, 0.2, 150], [-0.3, 2.3, 160], [0, 0, 1.0]])
    homography[2, :2] = rng.uniform(-3e-4, 3e-4, 2)
    found = find_checkerboard(to_8bit(printed(board, homography, 3.0, rng)), board.corners)
    expected = cv2.perspectiveTransform(board.points()[None], homography)[0]
    assert found is not None
    points = found.reshape(-1, 2)
    error = np.abs(points - expected).max()
    assert error < 0.05


def test_no_board_gives_none():
    noise = np.random.default_rng(0).integers(0, 255, (400, 500)).astype(np.uint8)
    assert find_checkerboard(noise, (9, 6)) is None
    assert find_checkerboard(np.zeros((400, 500), np.uint8), (9, 6)) is None


@pytest.mark.parametrize("corners", [(7, 6), (7, 5), (6, 6)])
@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_corners_come_in_the_boards_own_order(corners, turns):
    """The first square is black; a board that looks the same when it is turned is taken upright."""
    rng = np.random.default_rng(4)
    board = Checkerboard(corners, 20.0)
    homography = tilted(board, rng, 15.0)
    picture = np.ascontiguousarray(np.rot90(seen(board, homography, rng), turns))
    found = find_checkerboard(picture, corners)
    assert found is not None and found.shape == (corners[1], corners[0], 2)
    expected = mapped(homography, board.points())
    for _ in range(turns):
        # np.rot90 turns anticlockwise: x becomes the height above.
        height = 900 if _ % 2 == 0 else 700
        expected = np.stack([expected[:, 1], height - 1 - expected[:, 0]], axis=1)
    away = [np.abs(found.reshape(-1, 2) - e).max() for e in (expected, expected[::-1])]
    if sum(corners) % 2:
        assert away[0] < 0.1
    elif corners[0] != corners[1]:
        assert min(away) < 0.1
        assert found[-1, -1] @ [1, 1] > found[0, 0] @ [1, 1] or turns % 2
    else:
        assert found[0, 0] @ [1, 1] < found[-1, -1] @ [1, 1]
        assert found[0, -1] @ [1, -1] > found[-1, 0] @ [1, -1]


def test_sharp_and_blurred_corners_are_where_they_are():
    board = Checkerboard((7, 6), 20.0)
    for blur in (0.3, 3.0):
        rng = np.random.default_rng(6)
        homography = tilted(board, rng, 30.0)
        found = find_checkerboard(seen(board, homography, rng, noise=0.5, blur=blur), board.corners)
        assert found is not None
        away = np.linalg.norm(found.reshape(-1, 2) - mapped(homography, board.points()), axis=1)
        assert np.sqrt((away**2).mean()) < 0.02


def test_little_ink_in_the_dark_keeps_its_contrast():
    picture = np.full((400, 500), 200, np.uint16)
    picture[100:, 100:] = 1800
    picture[20:30, 20:50] = 40
    stretched = to_8bit(picture)
    assert stretched[50, 50] - stretched[25, 30] > 15
    assert stretched[300, 300] == 255
    color = np.repeat(picture[..., None], 3, axis=2)
    assert np.array_equal(to_8bit(color), stretched)
    assert np.array_equal(to_8bit(np.full((9, 9), 7, np.uint8)), np.zeros((9, 9), np.uint8))
