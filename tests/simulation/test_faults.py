from collections.abc import Callable

import numpy as np
import pytest

from slkit.data import Frames
from slkit.data.faults import FAULT_CODES
from slkit.errors import InputError
from slkit.geometry import Rig
from slkit.simulation import (
    FAULTS,
    Session,
    SimulatedScanner,
    board,
    board_views,
    coded_session,
    paper_rig,
    planar_session,
    told_targets,
    views_with_fault,
    with_fault,
)
from slkit.simulation.scene import bent_mm

GEOMETRIC = [(m, n) for n, f in FAULTS.items() if not f.pictures for m in f.methods]


@pytest.fixture(scope="module")
def planar() -> Session:
    return planar_session(paper_rig(), 6, np.random.default_rng(0))


def faulty(session: Session, name: str, strength: str = "mild", seed: int = 0) -> Session:
    return with_fault(session, name, strength, np.random.default_rng(seed))


def test_every_fault_has_one_meaning():
    assert list(FAULTS) == [code for code in FAULT_CODES if code != "camera-skew"]


def test_unknown_names_are_refused(planar: Session):
    coded = coded_session(paper_rig(), 3, Frames.of([]), np.random.default_rng(0))
    for session, name, strength, words in (
        (planar, "rain", "mild", "no fault called 'rain'; there are: swapped-pictures"),
        (planar, "keystone", "weak", "mild or strong, not 'weak'"),
        (planar, "gamma", "mild", "cannot befall a calibration by the planar method"),
        (coded, "wrong-marks", "mild", "cannot befall a calibration by coded light"),
    ):
        with pytest.raises(InputError, match=words):
            faulty(session, name, strength)
    with pytest.raises(InputError, match="shows in pictures only"):
        views_with_fault("blurred", "mild", paper_rig(), np.random.default_rng(0))


@pytest.mark.parametrize("method", ["planar", "coded"])
def test_computed_views_are_exact_without_noise(method: str):
    rig = paper_rig()
    _, views = views_with_fault(None, "mild", rig, np.random.default_rng(3), method, 3, 0.0)
    session = (
        planar_session(rig, 3, np.random.default_rng(3))
        if method == "planar"
        else coded_session(rig, 3, Frames.of([]), np.random.default_rng(3))
    )
    poses = {shot.name: shot.pose for shot in session.shots}
    for view in views:
        pose, lit, printed = poses[view.name], view.projected, view.printed
        flat = np.pad(view.board_xy[printed], ((0, 0), (0, 1)))
        np.testing.assert_allclose(rig.camera.project(pose.apply(flat)), view.camera_xy[printed], atol=1e-9)
        if lit.any():
            rays = np.pad(rig.camera.normalize(view.camera_xy[lit]), ((0, 0), (0, 1)), constant_values=1)
            normal = pose.rotation[:, 2]
            xyz = rays * (normal @ pose.translation / (rays @ normal))[:, None]
            np.testing.assert_allclose(rig.to_projector(xyz), view.projector_xy[lit], atol=1e-6)


@pytest.mark.parametrize(("method", "name"), GEOMETRIC)
def test_a_strong_fault_changes_more_than_the_noise(method: str, name: str):
    clean, wrong = (
        views_with_fault(n, "strong", paper_rig(), np.random.default_rng(1), method, 4, 0.0) for n in (None, name)
    )
    moved = [np.abs(a.camera_xy - b.camera_xy).max() for a, b in zip(clean[1], wrong[1], strict=True)]
    relabelled = [
        np.nanmax(np.abs(a.projector_xy - b.projector_xy), initial=0) for a, b in zip(clean[1], wrong[1], strict=True)
    ]
    assert max(*moved, *relabelled) > 1 or clean[0] != wrong[0]


def test_pictures_and_computed_views_agree_on_a_bent_board(planar: Session):
    session = faulty(planar, "bent-board", "strong")
    shot = next(s for s in session.shots if s.role == "projected")
    assert abs(shot.bend[0]) == 5
    target = session.target(shot)
    truth = SimulatedScanner(board(target, shot.pose, bend=shot.bend), session.rig).truth()
    local = shot.pose.inverse().apply(truth.xyz_mm)
    np.testing.assert_allclose(local[:, 2], bent_mm(local[:, :2], target.extent(), shot.bend), atol=0.01)
    assert np.ptp(local[:, 2]) > 2
    view = next(v for v in board_views(session, np.random.default_rng(0), 0.0) if v.projected.any())
    lit = view.projected
    for camera_xy, projector_xy in list(zip(view.camera_xy[lit], view.projector_xy[lit], strict=True))[::20]:
        near = np.linalg.norm(truth.camera_xy - camera_xy, axis=1).argsort()[:12]
        terms = np.column_stack([truth.camera_xy[near] - camera_xy, np.ones(12)])
        np.testing.assert_allclose(np.linalg.lstsq(terms, truth.projector_xy[near])[0][2], projector_xy, atol=0.02)


@pytest.mark.parametrize("name", ["not-native", "keystone", "mirrored", "turned"])
@pytest.mark.parametrize("strength", ["mild", "strong"])
def test_a_warped_image_stays_on_the_panel(planar: Session, name: str, strength: str):
    for seed in range(5):
        warp = faulty(planar, name, strength, seed).warp
        assert warp is not None
        width, height = planar.rig.projector.size
        rim = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) - [0.5, 0.5, 0]
        x, y, w = (rim @ warp.T).T
        assert (x / w >= -0.501).all() and (x / w <= width - 0.499).all()
        assert (y / w >= -0.501).all() and (y / w <= height - 0.499).all()
        assert (np.linalg.det(warp) < 0) == (name == "mirrored")


def test_weak_poses(planar: Session):
    def poses(session: Session, role: str):
        return [s.pose for s in session.shots if s.role == role]

    for strength, parallel_deg, depth in (("mild", 5.3, 0.035), ("strong", 1e-3, 0.0015)):
        found = faulty(planar, "parallel-poses", strength)
        for role in ("printed", "marks"):
            first, *others = poses(found, role)
            assert max((first.inverse() @ p).angle_deg for p in others) < parallel_deg
        found = faulty(planar, "one-depth", strength)
        x0, y0, x1, y1 = found.printed.extent()
        z = [p.apply([(x0 + x1) / 2, (y0 + y1) / 2, 0])[2] for p in poses(found, "printed")]
        assert max(z) / min(z) - 1 < depth
        found = faulty(planar, "one-corner", strength)
        pixels = [v.camera_xy for v in board_views(found, np.random.default_rng(0)) if not v.projected.any()]
        reach = np.ptp(np.concatenate(pixels), axis=0) / found.rig.camera.size
        assert (reach < 0.6).all()
        assert found.projected is not None and found.projected.step_px <= 32


def test_the_board_moves_between_two_pictures_only(planar: Session):
    found = faulty(planar, "moved-board", "strong")
    changed = [
        (a, b) for a, b in zip(planar.shots, found.shots, strict=True) if np.any(a.pose.rotation != b.pose.rotation)
    ]
    assert len(changed) == 3
    for before, after in changed:
        assert after.role == "projected"
        motion = before.pose.inverse() @ after.pose
        assert np.linalg.norm(motion.translation) == pytest.approx(20)
        assert motion.angle_deg == pytest.approx(4)


def test_numbers_that_are_told(planar: Session):
    assert planar.marks is not None
    for seed in range(6):
        corners = told_targets(faulty(planar, "wrong-corners", "mild", seed))["printed"].corners
        assert abs(corners[0] - 10) + abs(corners[1] - 7) == 1
        ratio = told_targets(faulty(planar, "wrong-square", "strong", seed))["printed"].square_mm
        assert ratio / planar.printed.square_mm == pytest.approx(2.54) or ratio * 2.54 == pytest.approx(
            planar.printed.square_mm
        )
        marks = told_targets(faulty(planar, "wrong-marks", "mild", seed))["marks"]
        assert np.abs(marks.points() / planar.marks.points() - 1).max() == pytest.approx(0.1, abs=0.01)
        assert marks.cell_mm == planar.marks.cell_mm


@pytest.mark.parametrize("strength", ["mild", "strong"])
def test_faults_of_pictures_name_the_pictures_they_change(planar: Session, strength: str):
    changes: dict[str, Callable] = {
        "swapped-pictures": lambda s: s.shown,
        "stale-frame": lambda s: s.shown,
        "saturated": lambda s: s.optics.white_level,
        "under-exposed": lambda s: s.optics.white_level,
        "blurred": lambda s: s.optics.camera_blur_px,
        "exif-rotated": lambda s: s.turns,
        "other-size": lambda s: s.scale,
    }
    for name, read in changes.items():
        found = faulty(planar, name, strength)
        views = {a.index for a, b in zip(planar.shots, found.shots, strict=True) if read(a) != read(b)}
        assert 1 <= len(views) <= 2 if strength == "mild" else len(views) >= 2, name
        same = [a is b for a, b in zip(planar.shots, found.shots, strict=True) if a.index not in views]
        assert all(same), name


def test_a_late_frame_of_coded_light(small_rig: Rig):
    patterns = Frames.of([np.full((192, 256), 10 * i, np.uint8) for i in range(12)])
    clean = coded_session(small_rig, 4, patterns, np.random.default_rng(0))
    for strength, frames in (("mild", 1), ("strong", None)):
        found = faulty(clean, "stale-frame", strength)
        late = [s for s in found.shots if s.shown != tuple(range(12))]
        assert len(late) == (1 if strength == "mild" else 2)
        for shot in late:
            wrong = [i for i, place in enumerate(shot.shown) if place != i]
            assert wrong[0] >= 3 and [shot.shown[i] for i in wrong] == [i - 1 for i in wrong]
            assert len(wrong) == (frames or 12 - wrong[0])
