import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, Checkerboard


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


@pytest.mark.parametrize(
    ("make", "words"),
    [(lambda: Checkerboard((2, 5), 10.0), "3 x 3"), (lambda: Checkerboard((5, 5), 0.0), "square_mm")],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
