import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, AprilTags, TagMarks, dictionary


def test_tags_are_opencvs_by_number():
    board = AprilTags((3, 2), 40.0, 10.0)
    held = dictionary("apriltag_36h11")
    for number, center in enumerate(board.centers()):
        cells = (np.arange(8) + 0.5) * 5 - 20
        seen = board.reflectance(np.stack(np.meshgrid(cells, cells), axis=-1) + center, 0.01)
        np.testing.assert_allclose(seen, np.where(held.generateImageMarker(number, 8) > 0, PAPER, INK), atol=1e-3)
    assert board.points()[4:8].tolist() == [[50, 0], [90, 0], [90, 40], [50, 40]]


def test_a_grid_of_tags_is_its_tags_one_by_one(rng: np.random.Generator):
    board = AprilTags((2, 2), 20.0, 5.0, "4x4_50")
    marks = TagMarks(((10.0, 10.0), (35.0, 10.0), (10.0, 35.0), (35.0, 35.0)), 20.0, "4x4_50")
    at = rng.uniform(-10, 60, (5000, 2))
    np.testing.assert_allclose(board.reflectance(at, 0.5), marks.reflectance(at, 0.5), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: AprilTags((0, 2), 20.0, 5.0), "tags"),
        (lambda: AprilTags((3, 2), 20.0, -5.0), "gap_mm"),
        (lambda: AprilTags((3, 2), 20.0, 0.5), "too close"),
        (lambda: TagMarks((), 20.0), "xy_mm"),
        (lambda: TagMarks(((0.0, 0.0), (5.0, 0.0)), 20.0), "too close"),
        (lambda: TagMarks(((0.0, 0.0),), 20.0, "apriltag"), "dictionary must be one of .*apriltag_36h11"),
        (lambda: AprilTags((9, 9), 20.0, 5.0, "4x4_50"), "holds 50 markers, but the board needs 81"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
