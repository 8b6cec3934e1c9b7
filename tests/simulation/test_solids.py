import numpy as np
import pytest

from slkit.errors import InputError
from slkit.geometry import Pose, Rig
from slkit.simulation import Optics, SimulatedScanner, boards_on, facing, folded, paper_rig, solid_poses, working_volume
from slkit.simulation.rig import in_view
from slkit.targets import INK, PAPER, SolidTarget


@pytest.fixture(scope="module")
def rig() -> Rig:
    return paper_rig()


@pytest.fixture(scope="module", params=["book", "cube"])
def target(request: pytest.FixtureRequest, rig: Rig) -> SolidTarget:
    radius = working_volume(rig)[1]
    if request.param == "book":
        return SolidTarget.book((radius, 1.3 * radius), 0.16 * radius, 110)
    return SolidTarget.cube_corner(1.2 * radius, 0.16 * radius)


def test_tags_appear_where_the_object_puts_them(small_rig: Rig):
    book = SolidTarget.book((220, 280), 60, 110)
    pose = facing(small_rig, book)
    optics = Optics(read_noise=0, shot_noise=0, camera_blur_px=0, white_level=1.0, ambient=0.0, black_level=0.0)
    picture = SimulatedScanner(folded(book, pose), small_rig, optics).photograph().astype(float) / 255
    # In each tag, two cells of the border beside a corner are black, and paper begins two cells outside.
    for number, center in enumerate(book.sheet.centers()):
        face = book.faces[int(book.face_of([center])[0])]
        cell = book.tag_mm / 7
        for away, level in ((3.0, INK), (4.3, PAPER)):
            place = [center[0], center[1] - away * cell, 0]
            x, y = small_rig.camera.project((pose @ face.solid_from_face).apply(place))
            assert picture[round(y), round(x)] == pytest.approx(level, abs=0.25), number


def test_a_checkerboard_falls_on_each_face_at_every_pose(rig: Rig, target: SolidTarget):
    projected = boards_on(rig, target)
    assert len(projected.boards) == len(target.faces)
    projected.draw(rig.projector.size)
    for pose in (facing(rig, target), *solid_poses(rig, target, projected, 3, np.random.default_rng(4))):
        for face, board in zip(target.faces, projected.boards, strict=True):
            # Odd sums tell a board from itself turned.
            assert sum(board.corners) % 2 == 1
            placed = rig.projector_from_camera @ pose @ face.solid_from_face
            rays = np.column_stack([rig.projector.normalize(board.points()), np.ones(len(board.points()))])
            normal = placed.rotation[:, 2]
            depth = (normal @ placed.translation) / (rays @ normal)
            places = placed.inverse().apply(rays * depth[:, None])
            assert (depth > 0).all() and np.abs(places[:, 2]).max() < 1e-6
            assert face.holds(places[:, :2]).all()
            assert np.abs(places[:, None, :2] - target.sheet.centers()).max(axis=2).min() > target.tag_mm / 2
        outlines = [(pose @ f.solid_from_face).apply(np.pad(f.outline(), ((0, 0), (0, 1)))) for f in target.faces]
        assert in_view(rig, np.concatenate(outlines)).all()


def test_an_object_that_is_too_large_is_refused(rig: Rig):
    huge = SolidTarget.book((3000, 3000), 300)
    with pytest.raises(InputError, match="too large"):
        solid_poses(rig, huge, boards_on(rig, SolidTarget.book((220, 280), 35)), 1, np.random.default_rng(0))


def test_faces_look_at_both_devices(rig: Rig, target: SolidTarget):
    pose = facing(rig, target)
    assert isinstance(pose, Pose)
    for face in target.faces:
        placed = pose @ face.solid_from_face
        center = placed.apply(np.append(face.outline().mean(axis=0), 0))
        for eye in (np.zeros(3), rig.projector_center):
            assert placed.rotation[:, 2] @ (center - eye) > 0
