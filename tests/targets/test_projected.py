import cv2
import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import ProjectedCheckerboard

SIZES = [(1024, 768), (1280, 720), (1280, 800), (1920, 1080), (854, 480), (912, 1140)]


@pytest.mark.parametrize("size", SIZES)
def test_the_projected_pattern_has_its_corners_on_half_pixels_and_is_found_there(size):
    pattern = ProjectedCheckerboard.for_projector(size)
    picture = pattern.draw(size)
    assert picture.shape == size[::-1] and picture.dtype == np.uint8
    assert ((pattern.points() - 0.5) % 1 == 0).all()
    found, corners = cv2.findChessboardCorners(picture, pattern.corners)
    assert found
    corners = cv2.cornerSubPix(picture, corners, (5, 5), (-1, -1), (3, 50, 1e-3)).reshape(-1, 2)
    away = np.linalg.norm(corners[:, None] - pattern.points()[None], axis=2).min(axis=1)
    assert away.max() < 0.1


def test_origin_marks_break_all_eight_symmetries():
    pattern = ProjectedCheckerboard((8, 8), (31.5, 31.5), 16.0)
    picture = pattern.draw((180, 180))
    board = picture[16 : 16 + 144, 16 : 16 + 144].astype(int)
    turned = [np.rot90(b, k) for b in (board, board.T) for k in range(4)]
    for i in range(8):
        for j in range(i):
            assert np.abs(turned[i] - turned[j]).max() > 200


def test_colours_of_a_foreign_pattern_are_as_told():
    pattern = ProjectedCheckerboard((4, 3), (19.5, 19.5), 10.0, "white", ())
    picture = pattern.draw((80, 60))
    assert picture[15, 15] == 255 and picture[15, 25] == 0 and picture[25, 25] == 255
    assert pattern.square_color(0, 0) == 1 and pattern.square_color(1, 0) == 0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), -1.0), "step_px"),
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), 8.0, "black", ((9, 0),)), r"no square \(9, 0\)"),
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), 20.0).draw((64, 48)), "does not fit"),
        (lambda: ProjectedCheckerboard.for_projector((40, 30)), "too small"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
