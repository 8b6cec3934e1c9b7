import cv2
import numpy as np
import pytest

from slkit.errors import InputError
from slkit.geometry import Pose, Rig
from slkit.simulation import (
    board_poses,
    boards_for,
    in_view,
    one_to_one_rig,
    paper_rig,
    projected_outline,
    random_rig,
    seen_by,
)
from slkit.targets import ProjectedCheckerboard

RIGS = {
    "paper": paper_rig(),
    "one-to-one": one_to_one_rig(),
    **{f"random {seed}": random_rig(np.random.default_rng(seed)) for seed in range(3)},
}


def on_sheet(pose: Pose, extent: tuple[float, float, float, float], count: int = 9) -> np.ndarray:
    x, y = np.linspace(extent[0], extent[2], count), np.linspace(extent[1], extent[3], count)
    return pose.apply(np.stack([*np.meshgrid(x, y), np.zeros((count, count))], axis=-1))


def border_in_projector(rig: Rig, pose: Pose, extent: tuple[float, float, float, float]) -> np.ndarray:
    sheet = on_sheet(pose, extent, 25)
    ring = np.concatenate([sheet[0], sheet[1:, -1], sheet[-1, -2::-1], sheet[-2:0:-1, 0]])
    return rig.to_projector(ring).astype(np.float32)


def test_the_paper_rig_gets_the_projector_s_own_pattern() -> None:
    rig = paper_rig()
    assert boards_for(rig)[2] == ProjectedCheckerboard.for_projector(rig.projector.size)


@pytest.mark.parametrize("name", RIGS)
def test_side_a_is_seen_whole_and_tilted(name: str) -> None:
    rig = RIGS[name]
    side_a = boards_for(rig)[0]
    poses = board_poses(rig, side_a.extent(), 8, np.random.default_rng(1))
    tilts = [np.degrees(np.arccos(pose.rotation[2, 2])) for pose in poses]
    assert len(poses) == 8
    assert all(seen_by(rig.camera, on_sheet(pose, side_a.extent()), 7.5).all() for pose in poses)
    assert 5 <= min(tilts) and 15 < max(tilts) <= 38.001
    depths = [pose.translation[2] for pose in poses]
    assert max(depths) > 1.1 * min(depths)


@pytest.mark.parametrize("name", RIGS)
def test_the_projected_pattern_falls_on_side_b_clear_of_the_marks(name: str) -> None:
    rig = RIGS[name]
    _, marks, pattern = boards_for(rig)
    poses = board_poses(rig, marks.extent(), 5, np.random.default_rng(2), projected=pattern, marks=marks)
    assert max(np.degrees(np.arccos(pose.rotation[2, 2])) for pose in poses) > 15
    for pose in poses:
        assert seen_by(rig.camera, on_sheet(pose, marks.extent()), 7.5).all()
        border = border_in_projector(rig, pose, marks.extent())
        for x, y in projected_outline(pattern).astype(np.float32):
            assert cv2.pointPolygonTest(border, (float(x), float(y)), measureDist=True) > -1
        at_marks = rig.to_projector(pose.apply(np.column_stack([marks.points(), np.zeros(len(marks.points()))])))
        nearest = np.linalg.norm(at_marks[:, None] - pattern.points(), axis=-1).min()
        assert nearest > 0.2 * pattern.step_px


@pytest.mark.parametrize("name", RIGS)
def test_a_lit_side_a_lies_in_both_images(name: str) -> None:
    rig = RIGS[name]
    extent = boards_for(rig, lit=True)[0].extent()
    poses = board_poses(rig, extent, 6, np.random.default_rng(3), lit=True)
    assert all(in_view(rig, on_sheet(pose, extent), 7.5).all() for pose in poses)
    assert max(np.degrees(np.arccos(pose.rotation[2, 2])) for pose in poses) > 15


def test_equal_generators_draw_equal_poses() -> None:
    rig = paper_rig()
    a, b = (board_poses(rig, (-100, -80, 100, 80), 2, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(a[1].rotation, b[1].rotation)
    assert not np.allclose(a[0].rotation, a[1].rotation)


def test_a_board_that_cannot_be_seen_is_an_error_with_its_size() -> None:
    with pytest.raises(InputError, match="9000 x 6000 mm"):
        board_poses(paper_rig(), (-4500, -3000, 4500, 3000), 1, np.random.default_rng(0))
