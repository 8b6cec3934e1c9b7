"""The corner board: its corrected form is exact, and its released form shows the defects that it is known for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline, registry
from slkit.calibration.corner_board import CornerBoard
from slkit.calibration.model import Model
from slkit.data import BoardView, Capture
from slkit.errors import CalibrationError, InputError
from slkit.files import write_png, write_toml
from slkit.geometry import Pose, Rig, homogeneous, intersect_plane
from slkit.report.measure import volume_error
from slkit.simulation import Optics, Print, Scene, SimulatedScanner, Surface, board, board_poses, boards_for, paper_rig
from slkit.simulation.session import planar_patterns
from slkit.targets import Checkerboard, ProjectedCheckerboard
from slkit.testing import check_calibrator
from slkit.triangulation import triangulate

from . import synthetic

DEPTHS_MM = (1000.0, 1075.0, 1150.0, 1225.0, 1300.0)
PATTERN = ProjectedCheckerboard.for_projector((1024, 768))
SMALL = Checkerboard((7, 6), 25.0)
RELEASED = {"undistort": False, "extrinsics": "first-view"}


def lit_points(rig: Rig, placed: Pose, pattern: ProjectedCheckerboard) -> np.ndarray:
    """Where the corners of a pattern fall on a board, (n, 3) mm in the camera frame."""
    in_projector = rig.projector_from_camera @ placed
    normal = in_projector.rotation[:, 2]
    rays = homogeneous(rig.projector.normalize(pattern.points()))
    xyz = intersect_plane(rays, normal, float(normal @ in_projector.translation))
    return rig.projector_from_camera.inverse().apply(xyz)


def views_of(rig: Rig, seed: int, noise_px: float, poses: int = 10) -> list[BoardView]:
    """Side A, and side B with the small board in the place of the marks."""
    rng = np.random.default_rng(seed)
    views = synthetic.printed_views(rig, rng, 12, noise_px)
    for i in range(poses):
        placed = synthetic.pose(rng, (1000, 1300), 30)
        lit = rig.camera.project(lit_points(rig, placed, PATTERN))
        small = rig.camera.project(placed.apply(np.pad(SMALL.points() + [-275, -175], ((0, 0), (0, 1)))))
        camera_xy = np.concatenate([small, lit])
        silent = np.full_like(small, np.nan)
        views.append(
            BoardView(
                f"b{i}",
                rig.camera.size,
                np.concatenate([SMALL.points(), np.full_like(lit, np.nan)]),
                camera_xy + noise_px * rng.normal(size=camera_xy.shape),
                np.concatenate([silent, PATTERN.points()]),
                np.concatenate([silent, np.zeros_like(lit)]),
            )
        )
    return views


def method(**options) -> CornerBoard:
    return CornerBoard((1024, 768), synthetic.PRINTED, SMALL, PATTERN, **options)


def aligned_mm(found: Rig, rig: Rig) -> float:
    return volume_error(found, rig, triangulate, DEPTHS_MM).aligned_mm


@pytest.mark.parametrize("model", [Model(), Model(refine=False)])
@pytest.mark.parametrize("extrinsics", ["shared", "first-view"])
def test_undistorted_it_is_exact_without_noise(model: Model, extrinsics: str):
    rig = synthetic.paper_rig(np.random.default_rng(3))
    found = method(model=model, extrinsics=extrinsics).solve(views_of(rig, 1, 0.0))
    assert found.rms_joint < 1e-3
    assert np.abs(found.rig.projector.K - rig.projector.K).max() < 0.05
    assert aligned_mm(found.rig, rig) < 1e-3


def test_each_defect_costs_what_it_is_known_for():
    """Means over four seeds; without noise the missing undistortion is there all the same."""
    rig = synthetic.paper_rig()
    forms = {"released": RELEASED, "undistorted": {"extrinsics": "first-view"}, "joint": {}}
    errors = {
        name: np.mean([aligned_mm(method(**form).solve(views_of(rig, seed, 0.1)).rig, rig) for seed in range(4)])
        for name, form in forms.items()
    }
    print({name: round(float(e), 3) for name, e in errors.items()})
    assert errors["released"] > 2.5 > errors["undistorted"] > 2 * errors["joint"]
    exact = method(**RELEASED).solve(views_of(rig, 0, 0.0))
    assert aligned_mm(exact.rig, rig) > 2.5
    straight = replace(rig, camera=replace(rig.camera, distortion=np.zeros(5)))
    assert aligned_mm(method(**RELEASED).solve(views_of(straight, 0, 0.0)).rig, straight) < 1e-2


def test_the_released_form_takes_the_first_view_and_claims_no_covariance():
    rig = synthetic.paper_rig()
    views = views_of(rig, 2, 0.1)
    found = method(extrinsics="first-view").solve(views)
    assert found.covariance is None and found.rig.covariance is None
    assert any("no joint refinement" in note for note in found.notes)
    reported = {v.name: v for v in found.views}
    # Its own residual is small in every view; under the one pose that it hands out only the first view is fitted.
    assert max(v.rms_projector for name, v in reported.items() if name.startswith("b")) < 0.4
    others = [v.rms_joint for name, v in reported.items() if name.startswith("b") and name != "b0"]
    assert reported["b0"].rms_joint < 0.4 < np.mean(others)
    again = method(extrinsics="first-view").solve([*views[:12], views[13], views[12], *views[14:]])
    assert np.allclose(again.rig.projector.K, found.rig.projector.K, atol=1e-2)
    assert np.abs(again.rig.projector_center - found.rig.projector_center).max() > 0.05


def test_released_options_are_not_refined_whatever_the_model_says():
    views = views_of(synthetic.paper_rig(), 4, 0.1, 5)
    joint = method().solve(views).rig.projector.K
    for options in ({"undistort": False}, {"extrinsics": "first-view"}):
        refined, plain = (method(model=Model(refine=r), **options).solve(views).rig.projector.K for r in (True, False))
        # OpenCV adds up in parallel, in any order: equal but for that.
        assert np.abs(refined - plain).max() < 0.05 < 1 < np.abs(refined - joint).max()


def test_too_few_views_and_wrong_fields_are_refused():
    views = views_of(synthetic.paper_rig(), 4, 0.1, 2)
    with pytest.raises(CalibrationError, match="side B"):
        method().solve(views[:13])
    with pytest.raises(InputError, match="projector"):
        CornerBoard((0, 768), synthetic.PRINTED, SMALL, PATTERN)
    table = registry.parameters_of(method()) | {"extrinsics": "second-view"}
    with pytest.raises(InputError, match="extrinsics must be one of 'shared', 'first-view'"):
        registry.create(CornerBoard, table, "calibration.toml")


def sheet(target: Checkerboard, pose: Pose, extent: tuple[float, float, float, float]) -> Scene:
    x0, y0, x1, y1 = extent
    corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    return Scene((Surface(pose.apply(corners), np.array([[0, 1, 2], [0, 2, 3]]), Print(target, pose)),))


def test_pictures_in_a_folder_end_in_a_rig(tmp_path: Path):
    """Rendered pictures, found and read by way of calibration.toml; the same captures pass the conformance suite."""
    rig, rng = paper_rig(), np.random.default_rng(5)
    side_a, small = boards_for(rig)[0], Checkerboard((6, 5), 20.0)
    extent = (-50.0, -50.0, 620.0, 440.0)
    pattern = ProjectedCheckerboard((9, 6), (287.5, 251.5), 56.0)

    def clear(pose: Pose) -> bool:
        outer = pose.inverse().apply(lit_points(rig, pose, pattern))
        x0, y0, x1, y1 = small.extent()
        corners = rig.to_projector(pose.apply([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]]))
        # The border of the projector's light must not cross the small board.
        lit = ((corners > 0) & (corners < np.array(rig.projector.size))).all()
        return bool(lit and ((outer[:, 0] > 140) | (outer[:, 1] > 120)).all())

    a = board_poses(rig, side_a.extent(), 3, rng)
    b = board_poses(rig, extent, 3, rng, projected=pattern, accept=clear)
    captures = []
    for i, pose in enumerate(a):
        captures.append(Capture(f"a{i}", SimulatedScanner(board(side_a, pose), rig, Optics(), i).photograph()))
        write_png(tmp_path / "side_a" / f"{i}.png", captures[-1].printed)
    for i, pose in enumerate(b):
        white, lit = SimulatedScanner(sheet(small, pose, extent), rig, Optics(), 9 + i).capture(
            planar_patterns(rig, pattern)
        )
        captures.append(Capture(f"b{i}", marks=white, projected=lit))
        write_png(tmp_path / "white" / f"{i}.png", white)
        write_png(tmp_path / "pattern" / f"{i}.png", lit)
    calibrator = CornerBoard(rig.projector.size, side_a, small, pattern)
    for options in ({}, RELEASED):
        check_calibrator(replace(calibrator, **options), captures)
    table = {"method": "corner-board", "projector": list(rig.projector.size)}
    for name, images in (("printed", "side_a"), ("corner_board", "white"), ("projected", "pattern")):
        table[name] = {"images": f"{images}/*.png"} | registry.parameters_of(getattr(calibrator, name))
    write_toml(tmp_path / "calibration.toml", table)
    found = pipeline.calibrate(tmp_path)
    assert found.method == "corner-board"
    assert all(v.used for v in found.views)
    assert found.rms_joint < 0.2
    assert aligned_mm(found.rig, rig) < 2.0
