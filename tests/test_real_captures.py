"""The whole line on real captures, against the figures that their READMEs and the tools that recorded them give."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit import pipeline
from slkit.calibration.detect import find_checkerboard, spacing_of, sub_pixel, to_8bit
from slkit.data import Calibration, Capture
from slkit.export import read_ply
from slkit.files import read_rig
from slkit.geometry import Pinhole, homogeneous, intersect_plane
from slkit.report.measure import cloud_against_truth, plane_fit, rigid_alignment, volume_error
from slkit.triangulation import Filters, ray_plane, triangulate

TOML = Path(__file__).parent / "data_toml"


@pytest.fixture(autouse=True)
def data_root(captures, monkeypatch):
    """The TOML files find the pictures through SLKIT_DATA."""
    monkeypatch.setenv("SLKIT_DATA", str(captures("gray_board").parent))


def solved(name: str) -> tuple[Calibration, tuple[Capture, ...]]:
    task = pipeline.load_calibration(TOML / name)
    return task.calibrator.solve(task.calibrator.observe(task.captures)), task.captures


def board_scan(calibration: Calibration, capture: Capture, corners: tuple[int, int], window_px: float) -> dict:
    """Scan a printed board with a calibration: spacing and diagonals of its corners, flatness inside them.

    Flatness is given for all points that pass the default filters, and after clipping at three standard deviations
    with the share that is kept.
    """
    cloud, _ = Filters().apply(triangulate(capture.correspondences, calibration.rig))
    image = to_8bit(capture.lit)
    found = find_checkerboard(image, corners)
    assert found is not None
    # The place of the print at the corner itself; the detector's fit is the mean over squares of paper that bulges.
    half = int(0.3 * spacing_of(found).min())
    found = sub_pixel(image, found.reshape(-1, 2), min(half, 15)).reshape(found.shape)
    points = []
    for corner in found.reshape(-1, 2):
        near = (np.abs(cloud.camera_xy - corner) <= window_px).all(axis=1)
        normal, offset, _ = plane_fit(cloud.xyz[near])
        ray = homogeneous(calibration.rig.camera.normalize(corner))
        points.append(intersect_plane(ray, normal, offset))
    grid = np.reshape(points, (corners[1], corners[0], 3))
    sides = np.concatenate([np.linalg.norm(np.diff(grid, axis=k), axis=2).ravel() for k in (0, 1)])
    mask = np.zeros(capture.lit.shape[:2], np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(found.reshape(-1, 2)).astype(np.int32)), 1)
    cols, rows = np.rint(cloud.camera_xy).astype(int).T
    inside = mask[rows, cols] > 0
    normal, offset, rms = plane_fit(cloud.xyz[inside])
    away = cloud.xyz[inside] @ normal - offset
    kept = np.ones(len(away), bool)
    for _ in range(5):
        kept = np.abs(away) < 3 * away[kept].std()
    return {
        "side": float(sides.mean()),
        "diagonals": [np.linalg.norm(grid[0, 0] - grid[-1, -1]), np.linalg.norm(grid[0, -1] - grid[-1, 0])],
        "plane_rms": rms,
        "completeness": inside.sum() / mask.sum(),
        "clipped_rms": float(away[kept].std()),
        "kept": float(kept.mean()) * inside.sum() / mask.sum(),
    }


def test_gray_board():
    """Three poses of a printed board under Gray code; projector rows carry the depth there."""
    calibration, captured = solved("gray_board")
    print(f"rms {calibration.rms_camera:.3f} / {calibration.rms_projector:.3f} / {calibration.rms_joint:.3f} px")
    assert calibration.rms_camera <= 0.38
    assert calibration.rms_projector <= 0.24
    assert calibration.rms_joint <= 0.32
    assert all(v.used for v in calibration.views)
    for capture in captured:
        board = board_scan(calibration, capture, (9, 7), 25)
        print(capture.name, board)
        assert abs(board["side"] - 75.0) <= 0.1
        # One axis alone: rows place the board, columns cannot; given both, rows are chosen without being told.
        rig, found = calibration.rig, capture.correspondences
        rows, cols = (ray_plane(_only(found, axis), rig).sigma_decoding_mm for axis in (1, 0))
        chosen = ray_plane(found, rig).sigma_decoding_mm
        assert np.nanmedian(rows) < 0.5 * np.nanmedian(cols)
        assert np.mean(chosen == rows) > 0.95


def _only(correspondences, axis):
    silent = correspondences.projector_xy.copy()
    silent[:, 1 - axis] = np.nan
    return type(correspondences)(
        correspondences.camera_xy, silent, correspondences.sigma, correspondences.confidence, correspondences.color
    )


@pytest.fixture(scope="module")
def phase_boards(captures) -> tuple[Calibration, tuple[Capture, ...]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SLKIT_DATA", str(captures("phase_board_skull").parent))
        return solved("phase_board_skull")


def test_phase_boards(phase_boards):
    """Five poses of a printed board under phase shift: figures of the calibration, and the board scanned with it."""
    calibration, captured = phase_boards
    print(f"rms {calibration.rms_camera:.3f} / {calibration.rms_projector:.3f} / {calibration.rms_joint:.3f} px")
    assert calibration.rms_camera <= 0.35
    assert calibration.rms_projector <= 0.39
    assert calibration.rms_joint <= 0.39
    # The print itself has bumps of half a millimetre, which clipping takes for outliers and nothing else can remove.
    limits = {"pose0": 0.145, "pose2": 0.205}
    for capture in captured:
        board = board_scan(calibration, capture, (13, 9), 12)
        print(capture.name, board)
        assert abs(board["side"] - 10.0) <= 0.01
        assert np.abs(np.array(board["diagonals"]) - 144.222).max() <= 0.1
        if capture.name in limits:
            assert board["clipped_rms"] <= limits[capture.name]
            assert board["kept"] >= 0.96


def test_skull_against_the_reference_cloud(phase_boards, captures):
    """The skull with the fresh calibration, compared with the recorded cloud pixel by pixel after rigid alignment."""
    calibration, _ = phase_boards
    folder = captures("phase_board_skull") / "reference"
    cloud = pipeline.scan(TOML / "phase_board_skull", calibration.rig).cloud
    held = json.loads((folder / "calibration.json").read_text())["camera"]
    reference = read_ply((folder / "skull_gray_cloud.ply").read_bytes()).xyz.astype(np.float64)
    camera = Pinhole((held["width"], held["height"]), held["K"], held["dist"])
    pixels = np.rint(camera.project(reference)).astype(int)
    points = np.full((held["height"], held["width"], 3), np.nan)
    cols, rows = np.rint(cloud.camera_xy).astype(int).T
    points[rows, cols] = cloud.xyz
    mine = points[pixels[:, 1], pixels[:, 0]]
    common = np.isfinite(mine).all(axis=1)
    aligned = rigid_alignment(mine[common], reference[common]).apply(mine[common])
    away = np.linalg.norm(aligned - reference[common], axis=1)
    print(f"{len(cloud)} points, {common.sum()} common pixels, aligned median {np.median(away):.3f} mm")
    assert len(cloud) >= 380_000
    assert common.sum() >= 85_000
    assert np.median(away) <= 0.34


def test_planar_capture(captures):
    """The paper's capture by another renderer: 3D error over the volume, and the line-shift scan with that rig."""
    folder = captures("planar_capture")
    truth = read_rig(folder / "truth" / "rig.json")
    calibration, _ = solved("planar_capture")
    volume = volume_error(calibration.rig, truth, ray_plane, (612, 666, 720, 774, 828))
    print(volume)
    assert volume.points == 1289
    assert volume.missing == 0
    assert volume.aligned_mm <= 0.03
    assert volume.rms_mm <= 0.15
    mesh = np.load(folder / "truth" / "object_mesh.npz", allow_pickle=False)
    truly = np.load(folder / "truth" / "object.npz", allow_pickle=False)
    cloud = pipeline.scan(TOML / "planar_capture" / "capture_line_shift.toml", calibration.rig).cloud
    pixels = np.rint(truly["camera_xy"]).astype(np.int64)
    error = cloud_against_truth(cloud, mesh["vertices_mm"], mesh["faces"], pixels, truly["xyz_mm"])
    print(error)
    assert error.rms_mm <= 0.12
    assert error.median_mm <= 0.06
    assert error.outliers <= 0.0005
    assert error.completeness >= 0.97


def test_comparison_without_truth(phase_boards, tmp_path):
    """The skull without a truth: what its points say of their noise, and what the calibration adds."""
    calibration, _ = phase_boards
    provenance = pipeline.provenance(calibration)
    found = pipeline.compare([TOML / "phase_board_skull"], calibration.rig, provenance=provenance)
    (method,) = found.methods
    print({name: round(value, 4) for name, value in method.numbers.items()})
    assert found.verdict["grade"] == calibration.verdict.grade and "local-homography" in found.calibration
    numbers = method.numbers
    assert numbers["patterns"] == 12 and numbers["capture_s"] == pytest.approx(0.2)
    assert numbers["points"] >= 380_000 and not {"rms_mm", "p95_mm"} & set(numbers)
    # What the points say of their own noise, beside what their scatter shows: two estimates of one thing.
    assert numbers["roughness_mm"] == pytest.approx(numbers["sigma_decoding_mm"], rel=0.4)
    assert 0.5 < numbers["calibration_share"] < 0.95
    assert 0.5 < numbers["efficiency_ratio"] < 1.2
    page = pipeline.write_comparison(tmp_path, found)
    assert page.stat().st_size > 100_000
