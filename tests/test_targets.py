import cv2
import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, Checkerboard, CornerMarks, ProjectedCheckerboard

SIZES = [(1024, 768), (1280, 720), (1280, 800), (1920, 1080), (854, 480), (912, 1140)]


def test_a_printed_board_is_black_and_white_where_it_says():
    board = Checkerboard((5, 4), 10.0)
    at = board.reflectance([[-5, -5], [5, -5], [5, 5], [-15, -5], [45, 35], [0, 0]], 0.01)
    np.testing.assert_allclose(at, [INK, PAPER, INK, PAPER, PAPER, (INK + PAPER) / 2], atol=1e-3)
    assert len(board.points()) == 20 and board.points()[1].tolist() == [10, 0]


def test_reflectance_is_the_mean_over_its_footprint():
    board = Checkerboard((5, 4), 10.0)
    x = np.linspace(-20, 50, 7001)
    fine = board.reflectance(np.stack([x, np.full_like(x, 5.0)], axis=-1), 1e-6)
    coarse = board.reflectance(np.stack([x, np.full_like(x, 5.0)], axis=-1), 2.0)
    box = np.convolve(fine, np.full(200, 1 / 200), mode="same")
    assert np.abs(coarse - box)[300:-300].max() < 0.01


def test_marks_are_black_top_left_and_bottom_right():
    marks = CornerMarks(((-50, -30), (50, -30), (50, 30), (-50, 30)), 4.0)
    for center in marks.points():
        at = marks.reflectance(center + np.array([[-2, -2], [2, 2], [2, -2], [-2, 2], [5, 0]]), 0.01)
        np.testing.assert_allclose(at, [INK, INK, PAPER, PAPER, PAPER], atol=1e-3)
    x0, y0, x1, y1 = marks.extent()
    assert x0 < -54 and x1 > 54 and y0 < -34 and y1 > 34


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
        (lambda: Checkerboard((2, 5), 10.0), "3 x 3"),
        (lambda: Checkerboard((5, 5), 0.0), "square_mm"),
        (lambda: CornerMarks(((0.0, 0.0),) * 3, 5.0), "four marks"),
        (lambda: CornerMarks(((0.0, 0.0),) * 4, -5.0), "cell_mm"),
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), -1.0), "step_px"),
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), 8.0, "black", ((9, 0),)), r"no square \(9, 0\)"),
        (lambda: ProjectedCheckerboard((5, 5), (9.5, 9.5), 20.0).draw((64, 48)), "does not fit"),
        (lambda: ProjectedCheckerboard.for_projector((40, 30)), "too small"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
