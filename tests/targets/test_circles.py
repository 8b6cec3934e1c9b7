import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, CircleGrid


def test_discs_are_where_the_points_are():
    for grid in (CircleGrid((5, 4), 20.0, 10.0), CircleGrid((4, 5), 20.0, 22.0, asymmetric=True)):
        np.testing.assert_allclose(grid.reflectance(grid.points(), 0.1), INK)
        angles = np.linspace(0, 2 * np.pi, 17)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        around = grid.points()[:, None] + ring * grid.diameter_mm / 2
        np.testing.assert_allclose(grid.reflectance(around * 1.0, 0.1), (INK + PAPER) / 2, atol=1e-9)


def test_staggered_rows_are_opencvs():
    points = CircleGrid((3, 3), 10.0, 5.0, asymmetric=True).points()
    assert points.tolist() == [[0, 0], [20, 0], [40, 0], [10, 10], [30, 10], [50, 10], [0, 20], [20, 20], [40, 20]]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CircleGrid((2, 5), 10.0, 5.0), "3 x 3"),
        (lambda: CircleGrid((5, 5), 10.0, 9.5), "no white"),
        (lambda: CircleGrid((5, 5), 10.0, -1.0), "diameter_mm"),
        (lambda: CircleGrid((5, 5), 0.0, 1.0), "spacing_mm"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
