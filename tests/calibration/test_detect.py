import cv2
import numpy as np
import pytest

from slkit.calibration.detect import find_checkerboard, find_projected, to_8bit
from slkit.targets import Checkerboard, ProjectedCheckerboard

SIZE = (640, 480)
OWN = ProjectedCheckerboard.for_projector(SIZE)
FOREIGN = ProjectedCheckerboard((9, 6), (119.5, 109.5), 48.0, origin_marks=())
BLACK_TO_BLACK = ProjectedCheckerboard((8, 6), (119.5, 109.5), 48.0, origin_marks=())
# Projector pixel -> camera pixel of a tilted board, with the aspect kept well away from a square.
TILT = np.array([[1.18, 0.12, 40.0], [-0.06, 1.1, 60.0], [1.5e-4, 1e-4, 1.0]])


def pictures(target, noise, turn=None, rng=None):
    """The pattern and the white picture that a camera sees, and the homography it sees them by."""
    homography = TILT if turn is None else turn @ TILT
    size = (1000, 800)
    shade = np.linspace(0.5, 1.0, size[0])[None].astype(np.float32)

    def seen(image):
        warped = cv2.warpPerspective(image, homography, size, flags=cv2.INTER_AREA | cv2.INTER_LINEAR)
        picture = 15 + 0.8 * shade * cv2.GaussianBlur(warped.astype(np.float32), (0, 0), 0.8)
        return np.clip(picture + noise * (rng or np.random.default_rng(0)).normal(size=picture.shape), 0, 255)

    white = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    return seen(target.draw(SIZE)).astype(np.uint8), seen(white).astype(np.uint8), homography


def about_center(matrix):
    shift = np.array([[1, 0, 500], [0, 1, 400], [0, 0, 1.0]])
    return shift @ matrix @ np.linalg.inv(shift)


def turned(angle_deg):
    a = np.radians(angle_deg)
    return about_center(np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) * [1, 1, 1])


@pytest.mark.parametrize("angle_deg", [0, 90, 180, 270, 37])
def test_origin_marks_give_every_corner_its_own_projector_pixel(angle_deg):
    scale = about_center(np.diag([0.75, 0.75, 1.0]))
    pattern, white, homography = pictures(OWN, 1.0, scale @ turned(angle_deg))
    found = find_projected(pattern, white, OWN)
    assert not isinstance(found, str), found
    corners, notes = found
    expected = cv2.perspectiveTransform(OWN.points()[None], homography)[0]
    error = np.linalg.norm(corners.reshape(-1, 2) - expected, axis=1)
    assert notes == ()
    assert np.nanmax(error) < 0.35
    assert np.sqrt(np.nanmean(error**2)) < 0.1


@pytest.mark.parametrize("mirror", [np.diag([-1.0, 1, 1]), np.diag([1.0, -1, 1])])
def test_a_mirrored_pattern_is_named(mirror):
    scale = about_center(np.diag([0.75, 0.75, 1.0]))
    pattern, white, _ = pictures(OWN, 1.0, scale @ about_center(mirror))
    assert "mirrored" in str(find_projected(pattern, white, OWN))


def test_a_pattern_of_another_layout_is_refused():
    pattern, white, _ = pictures(FOREIGN, 1.0)
    assert isinstance(find_projected(pattern, white, OWN), str)
    unmarked = ProjectedCheckerboard(OWN.corners, OWN.first_xy, OWN.step_px, origin_marks=())
    pattern, white, _ = pictures(unmarked, 1.0)
    assert "origin marks" in str(find_projected(pattern, white, OWN))


@pytest.mark.parametrize("target", [FOREIGN, BLACK_TO_BLACK])
def test_a_foreign_pattern_is_taken_upright_and_its_ambiguity_told(target):
    pattern, white, homography = pictures(target, 1.0)
    corners, notes = find_projected(pattern, white, target)
    expected = cv2.perspectiveTransform(target.points()[None], homography)[0]
    assert np.nanmax(np.abs(corners.reshape(-1, 2) - expected)) < 0.35
    assert len(notes) == 1
    assert "symmetries" in notes[0]


def printed(board, homography, noise, rng):
    """A picture (700, 900) of a printed board under a homography from mm to px."""
    xy = np.stack(np.meshgrid(np.arange(900), np.arange(700)), axis=-1).astype(np.float64)
    place = cv2.perspectiveTransform(xy.reshape(1, -1, 2), np.linalg.inv(homography)).reshape(700, 900, 2)
    shade = np.linspace(0.35, 1.0, 900)[None]
    light = 240 * shade * cv2.GaussianBlur(board.reflectance(place, 0.6), (0, 0), 0.9)
    return np.clip(light + noise * rng.normal(size=light.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_printed_corners_are_found_to_a_tenth_of_a_pixel(seed):
    rng = np.random.default_rng(seed)
    board = Checkerboard((9, 6), 20.0)
    homography = np.array([[2.4, 0.2, 150], [-0.3, 2.3, 160], [0, 0, 1.0]])
    homography[2, :2] = rng.uniform(-3e-4, 3e-4, 2)
    found = find_checkerboard(to_8bit(printed(board, homography, 3.0, rng)), board.corners)
    expected = cv2.perspectiveTransform(board.points()[None], homography)[0]
    assert found is not None
    points = found.reshape(-1, 2)
    error = min(np.abs(points - expected).max(), np.abs(points[::-1] - expected).max())
    assert error < 0.25


def test_no_board_gives_none():
    noise = np.random.default_rng(0).integers(0, 255, (400, 500)).astype(np.uint8)
    assert find_checkerboard(noise, (9, 6)) is None
    assert find_checkerboard(np.zeros((400, 500), np.uint8), (9, 6)) is None
