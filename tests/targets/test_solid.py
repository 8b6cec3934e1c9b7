import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slkit.errors import InputError
from slkit.registry import create, parameters_of
from slkit.targets import Face, ProjectedCheckerboard, ProjectedFaces, SolidTarget


def corner_of(target: SolidTarget, face: int, xy: tuple[float, float]) -> np.ndarray:
    """Where a place of the sheet comes to lie on the object."""
    return target.faces[face].solid_from_face.apply([*xy, 0])


@given(angle=st.floats(20, 160), width=st.floats(100, 400), height=st.floats(100, 400))
def test_the_pages_of_a_book_meet_at_the_fold_under_the_angle(angle: float, width: float, height: float):
    book = SolidTarget.book((width, height), 20, angle)
    for y in (-height / 2, height / 2):
        assert np.abs(corner_of(book, 0, (0, y)) - corner_of(book, 1, (0, y))).max() < 1e-9
    left, right = corner_of(book, 0, (-width, 0)), corner_of(book, 1, (width, 0))
    assert np.degrees(np.arccos(left @ right / width**2)) == pytest.approx(angle, abs=1e-6)
    # The printed sides, which look at -z of their faces, look away from each other: the fold is nearest to the viewer.
    assert left[2] > 0 and right[2] > 0


def test_the_faces_of_a_cube_meet_in_its_edges_at_right_angles():
    cube = SolidTarget.cube_corner(100, 15)
    for first, second, ends in ((0, 1, [(0, 0), (0, -100)]), (0, 2, [(0, 0), (-100, 0)])):
        for end in ends:
            assert np.allclose(corner_of(cube, first, end), corner_of(cube, second, end), atol=1e-9)
    assert np.allclose(corner_of(cube, 1, (100, 0)), corner_of(cube, 2, (0, 100)), atol=1e-9)
    normals = np.array([face.solid_from_face.rotation[:, 2] for face in cube.faces])
    assert np.allclose(normals @ normals.T, np.eye(3), atol=1e-9)
    middle = np.mean(
        [corner_of(cube, i, tuple(face.outline().mean(axis=0))) for i, face in enumerate(cube.faces)], axis=0
    )
    # All printed sides look away from the inside of the cube.
    inside = 100 * np.array([-0.5, -0.5, 0.5])
    assert (normals @ (inside - middle) > 0).all()


def test_every_tag_lies_on_one_face():
    for target, per_face in ((SolidTarget.book((200, 150), 20), 16), (SolidTarget.cube_corner(120, 15), 16)):
        face = target.face_of(target.sheet.points())
        assert np.bincount(face).tolist() == [per_face] * len(target.faces)
    assert target.face_of([[1e4, 0.0]]).tolist() == [-1]


def test_a_table_gives_the_same_object():
    book = SolidTarget.book((200, 150), 20, 95)
    assert create(SolidTarget, parameters_of(book), "solid") == book


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"xy_mm": ((-30, 0), (-80, 0), (30, 0), (80, 0), (-2, 50))}, "tag 4 .* no face"),
        ({"xy_mm": ((-30, 0), (-80, 0), (30, 0))}, r"faces\[1\] carries 1 tags"),
        ({"faces": (Face((-100, -75, 0, 75)), Face((0, -75, 100, 75)))}, "at an angle"),
        ({"faces": (Face((-100, -75, 0, 75)), Face((-20, -75, 100, 75), (0, 40, 0)))}, "several faces"),
        ({"tag_mm": -1.0}, "tag_mm"),
    ],
)
def test_an_object_that_cannot_be_is_refused(changes: dict, words: str):
    tags = ((-10, 0), (-80, 0), (30, 0), (80, 0)) if "faces" in changes else ((-30, 0), (-80, 0), (30, 0), (80, 0))
    good = {"faces": (Face((-100, -75, 0, 75), (0, 40, 0)), Face((0, -75, 100, 75), (0, -40, 0))), "tag_mm": 15.0}
    if words == "at an angle":
        tags = ((-30, 0), (-80, 0), (30, 0), (80, 0))
    with pytest.raises(InputError, match=words):
        SolidTarget(**({"xy_mm": tags} | good | changes))


def test_an_empty_face_is_refused():
    with pytest.raises(InputError, match="extent_mm"):
        Face((0, 0, 0, 10))


def test_boards_on_faces_are_drawn_together_and_must_not_overlap():
    boards = [ProjectedCheckerboard((4, 3), (x, 19.5), 10.0, origin_marks=()) for x in (19.5, 79.5)]
    both = ProjectedFaces(tuple(boards))
    drawn = both.draw((140, 60))
    assert (drawn == np.minimum(boards[0].draw((140, 60)), boards[1].draw((140, 60)))).all()
    assert (both.points() == np.concatenate([b.points() for b in boards])).all()
    assert (drawn == 0).sum() == (boards[0].draw((140, 60)) == 0).sum() + (boards[1].draw((140, 60)) == 0).sum()
    near = ProjectedCheckerboard((4, 3), (65.5, 19.5), 10.0, origin_marks=())
    with pytest.raises(InputError, match=r"boards\[0\] and boards\[1\] overlap"):
        ProjectedFaces((boards[0], near))
