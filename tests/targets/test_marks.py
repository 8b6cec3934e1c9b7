import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, BorderMarks, CornerMarks


def test_marks_are_black_top_left_and_bottom_right():
    marks = CornerMarks(((-50, -30), (50, -30), (50, 30), (-50, 30)), 4.0)
    for center in marks.points():
        at = marks.reflectance(center + np.array([[-2, -2], [2, 2], [2, -2], [-2, 2], [5, 0]]), 0.01)
        np.testing.assert_allclose(at, [INK, INK, PAPER, PAPER, PAPER], atol=1e-3)
    x0, y0, x1, y1 = marks.extent()
    assert x0 < -54 and x1 > 54 and y0 < -34 and y1 > 34


def test_border_marks_begin_with_the_corners_and_stand_evenly_around():
    marks = BorderMarks((300.0, 180.0), 6.0)
    points = marks.points()
    assert points[:4].tolist() == [[-150, -90], [150, -90], [150, 90], [-150, 90]]
    assert len(np.unique(points, axis=0)) == 12
    on_rim = (np.abs(points[:, 0]) == 150) | (np.abs(points[:, 1]) == 90)
    assert on_rim.all()
    np.testing.assert_allclose(np.diff(np.unique(points[:, 0].round(9))), 100)
    np.testing.assert_allclose(np.diff(np.unique(points[:, 1].round(9))), 60)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CornerMarks(((0.0, 0.0),) * 3, 5.0), "four marks"),
        (lambda: CornerMarks(((0.0, 0.0),) * 4, -5.0), "cell_mm"),
        (lambda: BorderMarks((100.0, -80.0), 5.0), "size_mm"),
        (lambda: BorderMarks((100.0, 40.0), 5.0), "no white"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
