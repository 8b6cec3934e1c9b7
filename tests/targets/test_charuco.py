import cv2
import numpy as np
import pytest

from slkit.errors import InputError
from slkit.targets import INK, PAPER, Charuco, ProjectedCharuco, dictionary


@pytest.mark.parametrize("squares", [(5, 4), (4, 5), (6, 4), (5, 5)])
def test_the_board_is_opencvs(squares: tuple[int, int]):
    board = Charuco(squares, 24.0, 18.0, "4x4_50")
    x, y = ((np.arange(n * 96) + 0.5) / 4 - 24.0 for n in squares)
    ours = board.reflectance(np.stack(np.meshgrid(x, y), axis=-1), 0.01)
    theirs = cv2.aruco.CharucoBoard(squares, 24.0, 18.0, dictionary("4x4_50"))
    drawn = theirs.generateImage((squares[0] * 96, squares[1] * 96))
    np.testing.assert_allclose(ours, np.where(drawn > 127, PAPER, INK), atol=0.01)
    corners = np.asarray(theirs.getChessboardCorners())[:, :2]
    np.testing.assert_allclose(board.points(), corners - 24.0, atol=1e-4)


@pytest.mark.parametrize("size", [(1024, 768), (1280, 720), (1920, 1080), (912, 1140), (3840, 2160)])
def test_the_projected_pattern_has_its_edges_between_pixels(size: tuple[int, int]):
    pattern = ProjectedCharuco.for_projector(size)
    picture = pattern.draw(size)
    assert picture.shape == size[::-1]
    assert set(np.unique(picture)) == {0, 255}
    assert ((pattern.points() - 0.5) % 1 == 0).all()
    for x, y in pattern.points().astype(int):
        block = picture[y : y + 2, x : x + 2].astype(int)
        assert block[0, 0] == block[1, 1] and block[0, 1] == block[1, 0] and block[0, 0] != block[0, 1]
    rim = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (rim == 255).mean() > 0.5


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Charuco((2, 5), 10.0, 7.0), "3 x 3"),
        (lambda: Charuco((5, 5), 10.0, 10.0), "does not fit into a square"),
        (lambda: Charuco((5, 5), 10.0, 0.0), "marker_mm"),
        (lambda: Charuco((5, 5), 10.0, 7.0, "9x9_50"), "dictionary must be one of .*4x4_50.*not '9x9_50'"),
        (lambda: Charuco((12, 9), 10.0, 7.0, "4x4_50"), "holds 50 markers, but the board needs 54"),
        (lambda: ProjectedCharuco((5, 4), (10.5, 10.5), 20.0, 15.0).draw((64, 48)), "does not fit"),
        (lambda: ProjectedCharuco.for_projector((60, 40)), "too small"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
