"""What the joint adjustment reaches on real captures and on an independent renderer's; `-s` prints the figures."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit import pipeline
from slkit.calibration.bundle import adjust
from slkit.calibration.diagnose import repeating
from slkit.calibration.left_out import jointly, left_out, predicted
from slkit.calibration.model import Lens, Model
from slkit.calibration.select import select_distortion
from slkit.calibration.solve import calibrate_camera, solve_projector
from slkit.data import BoardView, ViewResult
from slkit.files import read_rig
from slkit.geometry import Pinhole, Pose, Rig
from slkit.report.measure import volume_error
from slkit.triangulation import triangulate

TOML = Path(__file__).parent / "data_toml"
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)


@pytest.fixture(autouse=True)
def data_root(captures, monkeypatch):
    """The TOML files find the pictures through SLKIT_DATA."""
    monkeypatch.setenv("SLKIT_DATA", str(captures("gray_board").parent))


def views_of(name: str):
    task = pipeline.load_calibration(TOML / name)
    return task.calibrator, list(task.calibrator.observe(task.captures))


def rms(errors) -> float:
    return float(np.sqrt((np.concatenate(list(errors)) ** 2).sum(axis=1).mean()))


def opencv_rig(views: list[BoardView], projector: tuple[int, int]) -> tuple[Rig, float]:
    """The rig of cv2.calibrateCamera for each device and cv2.stereoCalibrate of all, k3 fixed at 0, and its rms."""
    objects = [np.pad(v.board_xy, ((0, 0), (0, 1))).astype(np.float32) for v in views]
    camera_xy, projector_xy = ([getattr(v, n).astype(np.float32) for v in views] for n in ("camera_xy", "projector_xy"))
    size, flags = views[0].image_size, cv2.CALIB_FIX_K3
    camera = cv2.calibrateCamera(objects, camera_xy, size, None, None, flags=flags, criteria=CRITERIA)
    light = cv2.calibrateCamera(objects, projector_xy, projector, None, None, flags=flags, criteria=CRITERIA)
    both = flags | cv2.CALIB_USE_INTRINSIC_GUESS
    found = cv2.stereoCalibrate(
        objects, camera_xy, projector_xy, *camera[1:3], *light[1:3], size, flags=both, criteria=CRITERIA
    )
    error, *lenses, turn, shift = (np.asarray(f) for f in found[:7])
    devices = [
        Pinhole(s, k, d.ravel()[:5]) for s, (k, d) in zip((size, projector), (lenses[:2], lenses[2:]), strict=True)
    ]
    return Rig(*devices, Pose(turn, shift.ravel())), float(error)


@pytest.mark.parametrize(("name", "asked"), [("gray_board", 0.305), ("phase_board_skull", 0.37)])
def test_joint_adjustment_of_real_boards(captures, name, asked):
    """rms_joint with all corners and with those kept, and leave-one-pose-out against OpenCV on the same corners."""
    captures(name)
    calibrator, views = views_of(name)
    found = calibrator.solve(views)
    kept = sum(int(v.kept.sum()) for v in found.views)
    total = sum(len(v.kept) for v in found.views)
    bent = replace(calibrator, model=Model(warp=True, loss="squares")).solve(views)
    everything = replace(calibrator, model=Model(loss="squares")).solve(views)
    of_opencv, opencv_rms = opencv_rig(views, calibrator.projector)
    ours = rms(left_out(everything, jointly(everything, calibrator.model)).values())
    theirs = rms(
        predicted(opencv_rig([v for v in views if v is not view], calibrator.projector)[0], view) for view in views
    )
    robust = rms(left_out(found, jointly(found, calibrator.model)).values())
    print(
        f"{name}: rms_joint {found.rms_joint:.4f} px with {kept} of {total} corners, "
        f"{everything.rms_joint:.4f} with all, {bent.rms_joint:.4f} with all and the board's warp, "
        f"OpenCV {opencv_rms:.4f}; "
        f"leave-one-pose-out {ours:.3f} px with all, OpenCV {theirs:.3f}, {robust:.3f} with the corners kept"
    )
    assert everything.rms_joint <= asked
    assert bent.rms_joint < everything.rms_joint
    assert found.rms_joint <= asked
    assert ours <= theirs


def test_joint_adjustment_of_planar_capture(captures):
    truth = read_rig(captures("planar_capture") / "truth" / "rig.json")
    calibrator, views = views_of("planar_capture")
    found = calibrator.solve(views)
    error = volume_error(found.rig, truth, triangulate, (612.0, 666.0, 720.0, 774.0, 828.0))
    rejected = sum(c.rejected for c in found.classes.values())
    print(
        f"planar_capture: 3D error {error.aligned_mm:.4f} mm aligned, {error.rms_mm:.4f} as is, "
        f"{rejected} of {sum(c.rows for c in found.classes.values())} points rejected, "
        f"rms_joint {found.rms_joint:.4f} px"
    )
    assert error.missing == 0
    assert error.aligned_mm <= 0.015
    assert error.rms_mm <= 0.10
    assert found.verdict.grade == "good"
    model, candidates = select_distortion(found, calibrator.model, lambda model: jointly(found, model))
    print("\n".join(f"{c.device} {' '.join(c.distortion) or 'none'}: {c.left_out_px:.4f} px" for c in candidates))
    assert model.camera.distortion == model.projector.distortion == ("k1", "k2", "p1", "p2")


def test_planar_correspondences_leave_one_pose_out(captures):
    held = np.load(captures("planar_correspondences") / "projected_corners.npz", allow_pickle=False)
    xyz, pixels = held["camera_xyz_mm"], held["projector_xy"]
    errors = []
    for i in range(len(xyz)):
        others = np.arange(len(xyz)) != i
        fit = solve_projector(xyz[others], pixels[others], (1024, 768), lens=Lens())
        errors.append(fit.projector.project(fit.projector_from_camera.apply(xyz[i])) - pixels[i])
    print(f"planar_correspondences: leave-one-pose-out {rms(errors):.4f} px with k1 k2 p1 p2")
    assert rms(errors) <= 0.605


def test_a_badly_printed_board_is_released(captures):
    """Methods of the board's own: the residual of each corner repeats over the views, and goes when it is released."""
    table = json.loads((captures("planar_correspondences") / "printed_corners.json").read_text())
    views = printed_views(table)
    camera, poses = calibrate_camera(views, views[0].image_size)
    both = Rig(camera, camera, Pose.identity())
    held = adjust(both, poses, views, Model(loss="squares"))
    free = adjust(both, poses, views, Model(loss="squares", release_mm=1.0))
    before, after = (rms([f.problem.blocks(f.state)["printed"].error]) for f in (held, free))
    moved = np.linalg.norm(free.state.released[0], axis=1)
    print(f"printed_corners: {before:.3f} px as printed, {after:.3f} px released, by {moved.max():.2f} mm at most")
    assert after <= 0.72 < 1.1 < before
    assert moved.max() < 4


def printed_views(table: dict) -> list[BoardView]:
    size = tuple(table["camera_size"])
    views = []
    for i, view in enumerate(table["views"]):
        seen = np.array(view["camera_xy"], dtype=np.float64)
        board = np.array(view["board_xy_mm"], dtype=np.float64)
        silent = np.full_like(seen, np.nan)
        views.append(BoardView(f"a{i}", size, board, seen, silent, silent))
    return views


def test_repeating_residuals_tell_of_the_print(captures):
    table = json.loads((captures("planar_correspondences") / "printed_corners.json").read_text())
    views = printed_views(table)
    camera, poses = calibrate_camera(views, views[0].image_size)
    used = [
        ViewResult(
            v.name,
            True,
            view=v,
            pose=p,
            camera_xy_error=camera.project(p.apply(np.pad(v.board_xy, ((0, 0), (0, 1))))) - v.camera_xy,
            kept=np.ones(len(v.camera_xy), dtype=bool),
        )
        for v, p in zip(views, poses, strict=True)
    ]
    _, means, sigma = repeating(used)["printed"]
    # A mean residual of a corner is many times what noise would leave: the board is printed wrong.
    assert np.median(np.linalg.norm(means, axis=1) / sigma) > 3
