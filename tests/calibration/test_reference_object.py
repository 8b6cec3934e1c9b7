"""The reference object: one view of a folded sheet gives camera and projector; more views make them surer."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline, registry
from slkit.calibration.model import Lens, Model
from slkit.calibration.reference_object import ReferenceObject
from slkit.data import BoardView, Capture, Frames
from slkit.errors import CalibrationError, InputError
from slkit.files import write_png, write_toml
from slkit.geometry import Pose, Rig, homogeneous
from slkit.report.measure import rigid_alignment, volume_error
from slkit.simulation import (
    Optics,
    SimulatedScanner,
    board,
    board_poses,
    boards_for,
    boards_on,
    facing,
    folded,
    paper_rig,
    solid_poses,
    working_volume,
)
from slkit.targets import ProjectedFaces, SolidTarget
from slkit.testing import check_calibrator
from slkit.triangulation import triangulate

from . import synthetic

RIG = paper_rig()
CENTER, RADIUS = working_volume(RIG)
OBJECTS = {
    "book": SolidTarget.book((RADIUS, 1.3 * RADIUS), 0.16 * RADIUS, 110),
    "cube": SolidTarget.cube_corner(1.2 * RADIUS, 0.16 * RADIUS),
}
PATTERNS = {name: boards_on(RIG, target) for name, target in OBJECTS.items()}
ONE_TERM = Model(Lens(("k1",)), Lens(("k1",)))


def method(name: str = "book", **options) -> ReferenceObject:
    return ReferenceObject((1024, 768), OBJECTS[name], PATTERNS[name], **options)


def view_of(rig: Rig, name: str, pose: Pose, rng: np.random.Generator, noise_px: float) -> BoardView:
    """The view of an object computed from its geometry, each coordinate with noise."""
    target, surface = OBJECTS[name], method(name).surface
    printed = target.sheet.points()
    face = target.face_of(printed)
    corners = PATTERNS[name].points()
    on = np.repeat(np.arange(len(target.faces)), [len(b.points()) for b in PATTERNS[name].boards])
    from_projector = (rig.projector_from_camera @ pose).inverse()
    rays = homogeneous(rig.projector.normalize(corners)) @ from_projector.rotation.T
    lit, _ = surface.intersect(np.tile(from_projector.translation, (len(rays), 1)), rays, on)
    camera_xy = rig.camera.project(pose.apply(np.concatenate([surface.place(printed, face), lit])))
    silent = np.full_like(printed, np.nan)
    return BoardView(
        "object",
        rig.camera.size,
        np.concatenate([printed, np.full_like(corners, np.nan)]),
        camera_xy + noise_px * rng.normal(size=camera_xy.shape),
        np.concatenate([silent, corners]),
        np.concatenate([silent, np.zeros_like(corners)]),
        face=np.concatenate([face, on]),
    )


def views_of(rig: Rig, name: str, count: int, seed: int, noise_px: float) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    poses = solid_poses(rig, OBJECTS[name], PATTERNS[name], count, rng)
    return [replace(view_of(rig, name, pose, rng, noise_px), name=f"o{i}") for i, pose in enumerate(poses)]


def error_mm(found: Rig, truth: Rig = RIG) -> float:
    """The 3D error after rigid alignment in the ball where the object stood, rms in mm."""
    rng = np.random.default_rng(0)
    inside = rng.uniform(-1, 1, (2000, 3))
    xyz = CENTER + 0.9 * RADIUS * inside[np.linalg.norm(inside, axis=1) < 1]
    rays = [homogeneous(found.camera.normalize(truth.camera.project(xyz)))]
    rays.append(homogeneous(found.projector.normalize(truth.to_projector(xyz))) @ found.projector_from_camera.rotation)
    away = np.cross(*rays)
    along = (np.cross(found.projector_center, rays[1]) * away).sum(axis=1) / (away**2).sum(axis=1)
    again = along[:, None] * rays[0]
    return float(np.sqrt(((rigid_alignment(again, xyz).apply(again) - xyz) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("refine", [True, False])
@pytest.mark.parametrize("name", OBJECTS)
def test_one_view_without_noise_gives_the_exact_rig(name: str, refine: bool):
    found = method(name, model=Model(refine=refine)).solve(views_of(RIG, name, 1, 3, 0.0))
    for device, true in ((found.rig.camera, RIG.camera), (found.rig.projector, RIG.projector)):
        assert np.abs(device.K - true.K).max() < 0.05
    assert np.abs(found.rig.projector_center - RIG.projector_center).max() < 0.05
    assert found.rms_joint < 1e-4 and error_mm(found.rig) < 1e-3


@pytest.mark.parametrize("name", ["book", "cube"])
@pytest.mark.parametrize("count", [1, 3])
def test_clean_views_of_an_object_are_a_good_calibration(name: str, count: int):
    verdict = method(name).solve(views_of(RIG, name, count, 5, 0.1)).verdict
    assert (verdict.grade, verdict.reasons) == ("good", ())


def test_more_views_and_side_a_make_it_surer():
    """Means over six seeds at 0.05 px of noise: one view, three views, one view and six of side A."""
    for label, model in (("default", Model()), ("k1 only", ONE_TERM)):
        rows: dict[str, list[tuple[float, float, float]]] = {"one view": [], "three views": [], "one and side A": []}
        for seed in range(6):
            views = views_of(RIG, "book", 3, seed, 0.05)
            side_a = synthetic.printed_views(RIG, np.random.default_rng(100 + seed), 6, 0.05)
            with_a = method(printed=synthetic.PRINTED, model=model)
            chosen = (method(model=model), views[:1]), (method(model=model), views), (with_a, [*side_a, views[0]])
            for name, (calibrator, given) in zip(rows, chosen, strict=True):
                rig = calibrator.solve(given).rig
                whole = volume_error(rig, RIG, triangulate, (1000.0, 1100.0, 1200.0))
                rows[name].append((error_mm(rig), whole.aligned_mm, whole.rms_mm))
        means = {name: np.mean(errors, axis=0) for name, errors in rows.items()}
        for name, (inside, volume, as_is) in means.items():
            print(f"{label}, {name}: around the object {inside:.2f}, whole volume {volume:.2f}, as is {as_is:.2f} mm")
        assert (means["three views"] < means["one view"]).all()
        assert means["one and side A"][2] < 0.8 * means["one view"][2]


def test_a_rotated_object_frame_gives_the_same_rig():
    """Where the object's frame lies on it is nobody's business."""
    views = views_of(RIG, "book", 2, 1, 0.05)
    book = OBJECTS["book"]
    motion = Pose.from_rotation_vector([0.3, -0.8, 0.2], [40, -70, 15])
    faces = []
    for face in book.faces:
        moved = motion @ face.solid_from_face
        turn, shift = np.degrees(moved.rotation_vector), moved.translation
        faces.append(replace(face, turn_deg=tuple(map(float, turn)), shift_mm=tuple(map(float, shift))))
    found = [m.solve(views).rig for m in (method(), replace(method(), solid=replace(book, faces=tuple(faces))))]
    assert np.abs(found[0].projector.K - found[1].projector.K).max() < 0.05
    assert np.abs(found[0].projector_center - found[1].projector_center).max() < 0.05


def test_one_face_alone_is_refused_and_so_is_a_board_too_few():
    view = views_of(RIG, "book", 1, 1, 0.0)[0]
    left = view.face == 0
    names = ("board_xy", "camera_xy", "projector_xy", "sigma", "face")
    half = replace(view, **{name: getattr(view, name)[left] for name in names})
    for views in ([half], []):
        with pytest.raises(CalibrationError, match="two faces"):
            method().solve(views)
    with pytest.raises(InputError, match="1 boards, but the object 2 faces"):
        ReferenceObject((1024, 768), OBJECTS["book"], ProjectedFaces(PATTERNS["book"].boards[:1]))


def pictures(name: str, poses: Sequence[Pose]) -> list[Capture]:
    white = np.full((768, 1024), 255, np.uint8)
    frames = Frames.of([white, PATTERNS[name].draw((1024, 768))], ["white", "pattern"])
    seen = [
        SimulatedScanner(folded(OBJECTS[name], p), RIG, Optics(), 7 + i).capture(frames) for i, p in enumerate(poses)
    ]
    return [Capture(f"o{i}", marks=both[0], projected=both[1]) for i, both in enumerate(seen)]


def test_pictures_of_one_pose_end_in_a_rig(tmp_path: Path):
    """One rendered pose, with and without side A, the conformance suite, and a folder with a calibration.toml."""
    calibrator = method(model=ONE_TERM)
    captures = pictures("book", [facing(RIG, OBJECTS["book"])])
    check_calibrator(calibrator, captures, surface=calibrator.surface, fewest=1)
    found = calibrator.solve(calibrator.observe(captures))
    print(f"one shot: joint {found.rms_joint:.3f} px, {error_mm(found.rig):.3f} mm")
    assert found.rms_joint < 0.15 and error_mm(found.rig) < 0.5

    side_a = boards_for(RIG)[0]
    poses = board_poses(RIG, side_a.extent(), 3, np.random.default_rng(2))
    flat = [
        Capture(f"a{i}", SimulatedScanner(board(side_a, p), RIG, Optics(), i).photograph()) for i, p in enumerate(poses)
    ]
    both = replace(calibrator, printed=side_a)
    check_calibrator(both, [*flat, *captures], surface=both.surface, fewest=1)

    write_png(tmp_path / "white" / "0.png", captures[0].marks)
    write_png(tmp_path / "pattern" / "0.png", captures[0].projected)
    table = {"method": "reference-object"} | registry.parameters_of(calibrator)
    table["solid"] = {"images": "white/*.png"} | table["solid"]
    table["projected"] = {"images": "pattern/*.png"} | table["projected"]
    write_toml(tmp_path / "calibration.toml", table)
    again = pipeline.calibrate(tmp_path)
    assert np.abs(again.rig.projector.K - found.rig.projector.K).max() < 0.01
    assert again.method == "reference-object"


def test_pictures_of_three_faces():
    view = method("cube").observe(pictures("cube", [facing(RIG, OBJECTS["cube"])]))[0]
    assert view.problem is None
    assert np.bincount(view.face[view.printed]).min() >= 8
    # A face that is seen at so low an angle that its squares are too small is named.
    lit = np.bincount(view.face[view.projected], minlength=3)
    assert (lit > 0).sum() >= 2
    assert all(any(f"face {k}: the projected checkerboard" in n for n in view.notes) for k in np.flatnonzero(lit == 0))


def test_pictures_that_cannot_be_used_say_why():
    calibrator = method()
    good = pictures("book", [facing(RIG, OBJECTS["book"])])[0]
    dark = np.zeros_like(good.marks)
    side_a = Capture("side", printed=good.marks)
    cases = {
        "none of the object's tags": replace(good, marks=dark),
        "no projected corner lies on a face": replace(good, projected=good.marks),
        "under white light and one of the pattern": replace(good, projected=None),
        r"no \[printed\]": side_a,
        "most are": replace(good, projected=dark[::2, ::2]),
    }
    for words, capture in cases.items():
        view = calibrator.observe([good, capture])[1]
        assert view.problem is not None and re.search(words, view.problem), view.problem
