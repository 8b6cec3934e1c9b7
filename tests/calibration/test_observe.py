"""Board views from pictures, target by target: which rows there are, and what is said where there are none."""

import numpy as np
import pytest

from slkit import registry
from slkit.calibration._observe import observe_printed, observe_white
from slkit.calibration.planar import Planar
from slkit.data import Frames
from slkit.geometry import Pose
from slkit.simulation import Optics, SimulatedScanner, board, board_poses, boards_for
from slkit.targets import (
    AprilTags,
    BorderMarks,
    Charuco,
    Checkerboard,
    CircleGrid,
    ProjectedCharuco,
    ProjectedCheckerboard,
    TagMarks,
)

from .pictures import mapped, seen, tilted

PRINTED = [
    Checkerboard((7, 6), 30.0),
    Charuco((8, 7), 30.0, 21.0),
    AprilTags((4, 3), 60.0, 18.0),
    CircleGrid((6, 9), 30.0, 22.0, asymmetric=True),
]


@pytest.mark.parametrize("target", PRINTED, ids=lambda t: type(t).__name__)
def test_a_printed_board_gives_its_points(target, rng: np.random.Generator):
    homography = tilted(target, rng, 20.0)
    view = observe_printed("a", seen(target, homography, rng), target)
    assert view.problem is None and view.image_size == (900, 700)
    assert np.array_equal(view.board_xy, target.points())
    assert np.abs(view.camera_xy - mapped(homography, view.board_xy)).max() < 0.12
    assert not view.projected.any()


@pytest.mark.parametrize("target", PRINTED, ids=lambda t: type(t).__name__)
def test_a_board_that_is_not_there_is_named(target):
    view = observe_printed("a", np.full((300, 400), 90, np.uint8), target)
    assert view.problem is not None and len(view.camera_xy) == 0
    numbers = {Checkerboard: "7 x 6", Charuco: "7 x 6", AprilTags: "12 tags", CircleGrid: "6 x 9 circles"}
    assert numbers[type(target)] in view.problem


def test_a_part_of_a_charuco_board_gives_the_rows_it_has(rng: np.random.Generator):
    homography = tilted(PRINTED[1], rng, 10.0)
    view = observe_printed("a", seen(PRINTED[1], homography, rng)[:, :500].copy(), PRINTED[1])
    assert 10 < len(view.board_xy) < 40
    assert np.abs(view.camera_xy - mapped(homography, view.board_xy)).max() < 0.12


@pytest.fixture(scope="module")
def side_b(request: pytest.FixtureRequest):
    """A rig, a pose, and a function that gives the pictures of side B with its marks under white and a pattern."""
    from slkit.simulation import paper_rig

    rig = paper_rig()
    _, marks, projected = boards_for(rig)
    pose = board_poses(rig, marks.extent(), 1, np.random.default_rng(3), projected=projected, marks=marks)[0]

    def pictures(target, pattern, place=pose, sheet=None):
        size = rig.projector.size
        frames = Frames.of([np.full(size[::-1], 255, np.uint8), pattern.draw(size)], ["white", "pattern"])
        scene = board(target, place, sheet)
        return list(SimulatedScanner(scene, rig, Optics(), 0).capture(frames))

    return rig, pose, marks, pictures


def check_marks(rig, pose: Pose, view) -> None:
    flat = np.pad(view.board_xy[view.printed], ((0, 0), (0, 1)))
    away = view.camera_xy[view.printed] - rig.camera.project(pose.apply(flat))
    assert np.abs(away).max() < 0.15


def check_projected(rig, pose: Pose, view) -> None:
    """The projector pixel of each corner lights the place of the board where the camera saw it."""
    plane = rig.projector_from_camera @ pose
    normal = plane.rotation[:, 2]
    rays = np.pad(rig.projector.normalize(view.projector_xy[view.projected]), ((0, 0), (0, 1)), constant_values=1.0)
    there = rays * (normal @ plane.translation / (rays @ normal))[:, None]
    expected = rig.camera.project(rig.projector_from_camera.inverse().apply(there))
    assert np.abs(view.camera_xy[view.projected] - expected).max() < 0.2
    assert (view.sigma[view.projected] == 0).all()


def test_marks_and_projected_corners_share_a_view(side_b):
    rig, pose, four, pictures = side_b
    x, y = four.points().max(axis=0)
    corners = tuple((float(u), float(v)) for u, v in four.points())
    checkered, charuco = boards_for(rig)[2], ProjectedCharuco.for_projector(rig.projector.size)
    border, tags = BorderMarks((2 * x, 2 * y), four.cell_mm), TagMarks(corners, 4 * four.cell_mm)
    for marks, pattern in ((four, charuco), (border, checkered), (tags, charuco)):
        view = observe_white("b", *pictures(marks, pattern), marks, pattern)
        assert view.problem is None, view.problem
        assert {tuple(p) for p in view.board_xy[view.printed]} <= {tuple(p) for p in marks.points()}
        # A tag may touch the border of the projector's light, which hides its outline.
        assert view.printed.sum() >= (12 if isinstance(marks, TagMarks) else len(marks.points()))
        assert view.projected.sum() > 20
        check_marks(rig, pose, view)
        check_projected(rig, pose, view)


def test_a_checkerboard_in_a_corner_serves_as_marks(side_b):
    rig, pose, four, pictures = side_b
    small, pattern = Checkerboard((4, 3), 18.0), boards_for(rig)[2]
    x, y = four.points()[0]
    corner = pose @ Pose(np.eye(3), np.array([x - 20, y - 10, 0.0]))
    white, lit = pictures(small, pattern, corner, (-800.0, -800.0, 900.0, 900.0))
    view = observe_white("b", white, lit, small, pattern)
    assert view.problem is None, view.problem
    assert np.array_equal(view.board_xy[view.printed], small.points())
    check_marks(rig, corner, view)
    check_projected(rig, corner, view)
    view = observe_white("b", white, white, small, pattern)
    assert view.problem is not None and "projected checkerboard" in view.problem
    view = observe_white("b", np.full_like(white, 90), lit, small, pattern)
    assert view.problem == "the picture of the white side does not show the checkerboard with 4 x 3 inner corners"


def test_a_tag_that_is_hidden_is_told(side_b):
    rig, _, four, pictures = side_b
    marks = TagMarks(tuple((float(u), float(v)) for u, v in four.points()), 4 * four.cell_mm)
    pattern = boards_for(rig)[2]
    white, lit = pictures(marks, pattern)
    more = TagMarks((*marks.xy_mm, (0.0, 5e3)), marks.tag_mm)
    view = observe_white("b", white, lit, more, pattern)
    seen_tags = view.printed.sum() // 4
    assert view.problem is None and 2 < seen_tags < 5
    assert view.notes == (f"{seen_tags} of 5 tags were seen",)


@pytest.mark.parametrize(
    "tables",
    [
        {"printed": {"kind": "charuco", "squares": [8, 6], "square_mm": 30, "marker_mm": 22}},
        {"printed": {"kind": "april-tags", "tags": [4, 3], "tag_mm": 60, "gap_mm": 18}},
        {"printed": {"kind": "circles", "circles": [4, 11], "spacing_mm": 20, "diameter_mm": 14, "asymmetric": True}},
        {"marks": {"kind": "border", "size_mm": [300, 200], "cell_mm": 9}},
        {"marks": {"kind": "tags", "xy_mm": [[0, 0], [200, 0], [200, 150]], "tag_mm": 40}},
        {"projected": {"kind": "charuco", "squares": [8, 6], "first_xy": [79.5, 59.5], "step_px": 60, "marker_px": 42}},
    ],
)
def test_calibration_toml_names_targets_by_kind(tables: dict):
    pattern = registry.parameters_of(ProjectedCheckerboard.for_projector((640, 480)))
    plain = {
        "projector": [640, 480],
        "printed": {"corners": [7, 6], "square_mm": 30},
        "marks": {"xy_mm": [[0, 0], [200, 0], [200, 150], [0, 150]], "cell_mm": 9},
        "projected": pattern,
    }
    ((side, table),) = tables.items()
    made = registry.create(Planar, plain | tables, "calibration.toml")
    assert registry.parameters_of(getattr(made, side)) == registry.parameters_of(
        registry.create(type(getattr(made, side)), table, "table")
    )
    assert getattr(made, side).kind == table["kind"]
