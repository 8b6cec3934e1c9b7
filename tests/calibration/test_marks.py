import cv2
import numpy as np
import pytest

from slkit.calibration.marks import find_marks
from slkit.targets import BorderMarks, CornerMarks

from .pictures import mapped, seen, tilted

BOARD = CornerMarks(((-180, -120), (180, -120), (180, 120), (-180, 120)), 11.0)
SIZE = (900, 700)


def picture(homography, rng, noise=1.5, light=1.0, clutter=False, target=BOARD):
    """A board on a dark ground, brighter to the right, seen through a homography from mm to px."""
    xy = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(np.float64)
    place = cv2.perspectiveTransform(xy.reshape(1, -1, 2), np.linalg.inv(homography)).reshape(*SIZE[::-1], 2)
    x0, y0, x1, y1 = target.extent()
    on_board = (place[..., 0] > x0) & (place[..., 0] < x1) & (place[..., 1] > y0) & (place[..., 1] < y1)
    shade = np.where(on_board, target.reflectance(place, 0.6), 0.04) * np.linspace(0.4, 1.0, SIZE[0])[None]
    if clutter:
        # Dust, a pen line and a scrap of another checkerboard beside the board.
        for _ in range(40):
            cv2.circle(shade, tuple(int(v) for v in rng.uniform(0, 650, 2)), 2, 0.3, -1)
        cv2.line(shade, (300, 300), (600, 420), 0.2, 2)
        scrap = np.kron(np.indices((6, 6)).sum(axis=0) % 2, np.ones((14, 14)))
        shade[600:684, 20:104] = 0.1 + 0.7 * scrap
    seen = cv2.GaussianBlur(240 * light * shade, (0, 0), 0.8) + 6
    return np.clip(seen + noise * rng.normal(size=seen.shape), 0, 255).astype(np.uint8)


def view(rng):
    """A random homography that keeps the board in the picture."""
    angle = rng.uniform(-0.35, 0.35)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    stretch = np.diag(rng.uniform(1.2, 1.55, 2))
    homography = np.eye(3)
    homography[:2, :2] = stretch @ turn
    homography[:2, 2] = [450, 350]
    homography[2, :2] = rng.uniform(-4e-4, 4e-4, 2)
    return homography


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("clutter", [False, True])
def test_marks_are_found_in_their_order(seed, clutter):
    rng = np.random.default_rng(seed)
    homography = view(rng)
    found = find_marks(picture(homography, rng, clutter=clutter), BOARD)
    expected = cv2.perspectiveTransform(BOARD.points()[None], homography)[0]
    assert found is not None
    assert np.abs(found - expected).max() < 0.05


def test_marks_outside_the_projected_light_are_found():
    rng = np.random.default_rng(1)
    homography = view(rng)
    bright = picture(homography, rng)
    dim = picture(homography, rng, light=0.15)
    bright[:, :330] = dim[:, :330]
    found = find_marks(bright, BOARD)
    expected = cv2.perspectiveTransform(BOARD.points()[None], homography)[0]
    assert found is not None
    assert np.abs(found - expected).max() < 0.1


def test_more_than_four_marks_follow_the_first_four():
    target = CornerMarks((*BOARD.xy_mm, (0, -120), (0, 120)), 11.0)
    rng = np.random.default_rng(3)
    homography = view(rng)
    found = find_marks(picture(homography, rng, target=target), target)
    expected = cv2.perspectiveTransform(target.points()[None], homography)[0]
    assert found is not None
    assert np.abs(found - expected).max() < 0.05


def test_a_hidden_mark_or_a_mirrored_picture_is_not_taken():
    rng = np.random.default_rng(2)
    homography = view(rng)
    seen = picture(homography, rng)
    x, y = cv2.perspectiveTransform(BOARD.points()[None, :1], homography)[0, 0].astype(int)
    hidden = seen.copy()
    hidden[y - 30 : y + 30, x - 30 : x + 30] = 150
    assert find_marks(hidden, BOARD) is None
    assert find_marks(np.ascontiguousarray(seen[:, ::-1]), BOARD) is None
    assert find_marks(np.zeros((300, 400), np.uint8), BOARD) is None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("target", [BOARD, BorderMarks((370.0, 250.0), 9.0)], ids=["corners", "border"])
def test_marks_are_found_on_a_board_tilted_by_40_degrees(target, seed):
    rng = np.random.default_rng(seed)
    homography = tilted(target, rng, 40.0)
    found = find_marks(seen(target, homography, rng), target)
    assert found is not None
    away = np.linalg.norm(found - mapped(homography, target.points()), axis=1)
    assert np.sqrt((away**2).mean()) < 0.02


def test_a_hidden_border_mark_is_not_made_up():
    target = BorderMarks((370.0, 250.0), 9.0)
    rng = np.random.default_rng(1)
    homography = tilted(target, rng, 20.0)
    picture_ = seen(target, homography, rng)
    x, y = mapped(homography, target.points())[5].astype(int)
    picture_[y - 30 : y + 30, x - 30 : x + 30] = 150
    assert find_marks(picture_, target) is None
