import cv2
import numpy as np
import pytest

from slkit.calibration.projected import find_projected
from slkit.targets import ProjectedCharuco, ProjectedCheckerboard

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
    assert np.nanmax(error) < 0.1
    assert np.sqrt(np.nanmean(error**2)) < 0.03


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


def test_origin_marks_that_leave_doubt_are_told():
    # Marks that lie symmetrically to the middle column and row of squares.
    doubtful = ProjectedCheckerboard((8, 6), (119.5, 109.5), 48.0, origin_marks=((2, 2), (6, 4)))
    pattern, white, homography = pictures(doubtful, 1.0)
    corners, notes = find_projected(pattern, white, doubtful)
    expected = cv2.perspectiveTransform(doubtful.points()[None], homography)[0]
    assert np.nanmax(np.abs(corners.reshape(-1, 2) - expected)) < 0.1
    assert notes == ("the origin marks of the pattern leave doubt: 2 of its symmetries fit, the upright one was taken",)


CHARUCO = ProjectedCharuco.for_projector(SIZE)


@pytest.mark.parametrize("angle_deg", [0, 90, 180, 37])
def test_a_charuco_pattern_names_its_corners(angle_deg):
    scale = about_center(np.diag([0.75, 0.75, 1.0]))
    pattern, white, homography = pictures(CHARUCO, 1.0, scale @ turned(angle_deg))
    corners, notes = find_projected(pattern, white, CHARUCO)
    assert corners.shape == (*CHARUCO.corners[::-1], 2) and notes == ()
    error = np.linalg.norm(
        corners.reshape(-1, 2) - cv2.perspectiveTransform(CHARUCO.points()[None], homography)[0], axis=1
    )
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmax(error) < 0.25 and np.sqrt(np.nanmean(error**2)) < 0.06


def test_a_part_of_a_charuco_pattern_suffices():
    pattern, white, homography = pictures(CHARUCO, 1.0)
    # The board ends here: what falls beside it is lost in the dark.
    pattern[:, 620:], white[:, 620:] = 16, 16
    corners, _ = find_projected(pattern, white, CHARUCO)
    error = np.linalg.norm(
        corners.reshape(-1, 2) - cv2.perspectiveTransform(CHARUCO.points()[None], homography)[0], axis=1
    )
    assert 0.3 < np.isfinite(error).mean() < 0.8
    assert np.nanmax(error) < 0.25


def test_a_mirrored_or_absent_charuco_pattern_is_told():
    scale = about_center(np.diag([0.75, 0.75, 1.0]))
    pattern, white, _ = pictures(CHARUCO, 1.0, scale @ about_center(np.diag([-1.0, 1, 1])))
    assert "mirrored" in str(find_projected(pattern, white, CHARUCO))
    assert "was not found" in str(find_projected(white, white, CHARUCO))
