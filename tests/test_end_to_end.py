"""The whole way over the command line: virtual rig, calibration, scan, picture."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.files import read_calibration, read_image, read_rig
from slkit.geometry import Pose
from slkit.report.measure import rigid_alignment
from slkit.targets import Checkerboard

POSES = 4


def slkit(*arguments: object) -> dict:
    command = [sys.executable, "-m", "slkit.cli", *map(str, arguments), "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration folder of the paper's rig, as `slkit simulate` leaves it."""
    folder = tmp_path_factory.mktemp("home")
    slkit("simulate", "calibration", "--poses", POSES, "--noise", 1, "--seed", 4, "-o", folder / "calib")
    return folder


def test_planar_folder(home: Path):
    found = read_calibration(home / "calib")
    assert found.method == "planar"
    assert {key: len(paths) for key, paths in found.images.items()} == dict.fromkeys(
        ("printed", "marks", "projected"), POSES
    )
    rig = read_rig(home / "calib" / "truth" / "rig.json")
    poses = json.loads((home / "calib" / "truth" / "poses.json").read_text())
    table = found.parameters["printed"]
    board = Checkerboard(tuple(table["corners"]), table["square_mm"])
    picture = read_image(home / "calib" / "side_a" / "001.png").astype(float)
    pose = Pose(poses["side_a/001"]["rotation"], poses["side_a/001"]["translation"])
    offsets = 0.4 * board.square_mm * np.array([[-1, -1], [1, 1], [1, -1], [-1, 1]])
    # The squares diagonal to a corner look alike and its neighbours do not: the picture has the pose of truth/.
    for corner in board.points():
        xy = rig.camera.project(pose.apply(np.c_[corner + offsets, np.zeros(4)]))
        one, two, three, four = picture[tuple(np.rint(xy).astype(int).T[::-1])]
        assert min(abs(one - three), abs(one - four)) > 3 * max(abs(one - two), abs(three - four), 1)


def test_simulate_calibrate_scan_view(home: Path):
    calibration = slkit("calibrate", home / "calib", "-o", home / "rig.json")
    assert set(calibration) == {"rms_px", "views", "verdict", "notes", "diagnosis", "rig"}
    assert set(calibration["rms_px"]) == {"camera", "projector_device", "joint"}
    assert len(calibration["views"]) == 2 * POSES and all(view["used"] for view in calibration["views"])
    assert set(calibration["views"][0]) == {"name", "used", "reason", "rms_px"}
    assert calibration["verdict"]["grade"] in ("good", "usable")
    assert calibration["rms_px"]["joint"] < 0.3

    arguments = ("--scene", "sphere", "--codec", "phase-shift", "--noise", 1, "--seed", 5, "-o", home / "scan")
    assert slkit("simulate", "scan", *arguments)["folders"] == [str(home / "scan")]
    scan = slkit("scan", home / "scan", "--rig", home / "rig.json", "-o", home / "cloud.ply")
    assert scan["points"] > 10_000
    slkit("view", home / "cloud.ply", "-o", home / "cloud.png")
    assert read_image(home / "cloud.png").std() > 5

    cloud, expected = matched(home)
    assert len(cloud) > 0.9 * scan["points"]
    # Four poses place the rig's frame only so well; the shape they must get right, down to the scan's own noise.
    aligned = rigid_alignment(cloud, expected).apply(cloud)
    assert np.median(np.linalg.norm(aligned - expected, axis=1)) < 2 * scan["sigma_decoding_mm"]["median"]
    assert np.median(np.linalg.norm(cloud - expected, axis=1)) < 5


def matched(home: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return scanned points (n, 3) and the true ones at the same camera pixels, mm."""
    cloud = pipeline.scan(home / "scan", read_rig(home / "rig.json")).cloud
    with np.load(home / "scan" / "truth" / "object.npz") as truth:
        known = {
            tuple(xy): xyz for xy, xyz in zip(truth["camera_xy"].astype(int).tolist(), truth["xyz_mm"], strict=True)
        }
    pixels = np.rint(cloud.camera_xy).astype(int).tolist()
    pairs = [(xyz, known[tuple(xy)]) for xyz, xy in zip(cloud.xyz, pixels, strict=True) if tuple(xy) in known]
    return np.array([a for a, _ in pairs], dtype=float), np.array([b for _, b in pairs])
