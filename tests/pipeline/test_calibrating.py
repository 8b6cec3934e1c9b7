import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit import pipeline, registry
from slkit.data import BoardView, Calibration, Capture, Verdict, ViewResult
from slkit.errors import CalibrationError, FileError, InputError, PluginError
from slkit.files import read_image, read_rig, write_png, write_rig
from slkit.simulation import Optics, paper_rig
from slkit.targets import Checkerboard

DATA = Path(os.environ.get("SLKIT_DATA", Path(__file__).parents[3] / "shared" / "data"))
TOML = Path(__file__).parent.parent / "data_toml"


@dataclass(frozen=True)
class Recorder:
    """A calibrator that only notes what reaches it."""

    projector: tuple[int, int]
    printed: Checkerboard
    offset: float = 0.0

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        empty = np.empty((0, 2))
        return [BoardView(c.name, (8, 6), empty, empty, empty, empty) for c in captures]

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        results = tuple(ViewResult(v.name, v.problem is None, v.problem or "") for v in views)
        covariance = {"parameters": ("offset",), "matrix": np.array([[self.offset]])}
        return Calibration(paper_rig(), "recorder", results, 0.1, 0.2, float("nan"), covariance, Verdict("good"))


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> None:
    load = registry.load
    monkeypatch.setattr(registry, "load", lambda group, name: Recorder if name == "recorder" else load(group, name))


def folder_of_pictures(folder: Path, *names: str) -> Path:
    for name in names:
        write_png(folder / name, np.full((6, 8), 99, np.uint8))
    (folder / "calibration.toml").write_text("""
        method = "recorder"
        projector = [64, 48]
        [printed]
        images = "a/*.png"
        corners = [4, 3]
        square_mm = 10
    """)
    return folder


@pytest.mark.usefixtures("recorder")
def test_parameters_reach_the_calibrator_and_unreadable_pictures_are_dropped(tmp_path: Path):
    folder = folder_of_pictures(tmp_path, "a/1.png", "a/2.png", "a/3.png", "a/4.png")
    (tmp_path / "a" / "2.png").write_text("no picture")
    task = pipeline.load_calibration(folder, parameters={"offset": 3, "printed": {"square_mm": 20.0}})
    assert task.calibrator == Recorder((64, 48), Checkerboard((4, 3), 20.0), 3.0)
    assert [c.name for c in task.captures] == ["a/1", "a/3", "a/4"]
    assert task.captures[0].printed is not None and task.captures[0].printed.shape == (6, 8)
    calibration = pipeline.calibrate(folder, parameters={"offset": 3})
    used = {v.name: (v.used, v.reason) for v in calibration.views}
    assert used["a/1"] == (True, "")
    assert not used["a/2"][0] and "2.png cannot be read as a picture" in used["a/2"][1]
    assert calibration.rig.covariance == calibration.covariance


@pytest.mark.usefixtures("recorder")
def test_too_few_views_say_what_is_missing(tmp_path: Path):
    folder = folder_of_pictures(tmp_path, "a/1.png", "a/2.png", "a/3.png")
    (tmp_path / "a" / "2.png").write_text("no picture")
    with pytest.raises(
        CalibrationError, match="2 of 3 printed views can be used, at least 3 are needed: .*a/2: .*2.png"
    ):
        pipeline.calibrate(folder)
    for name in ("1", "3"):
        (tmp_path / "a" / f"{name}.png").write_text("no picture")
    with pytest.raises(CalibrationError, match="0 of 3 printed views"):
        pipeline.calibrate(folder)


@pytest.mark.usefixtures("recorder")
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("square_mm = 10", "square_mm = nan", r"calibration\.toml: printed: square_mm must be a finite number"),
        ("square_mm = 10", "square_mm = -3", r"calibration\.toml: printed: square_mm must be a positive length"),
        ("square_mm = 10", "", r"calibration\.toml: printed: 'square_mm' is missing"),
        ("[4, 3]", "[4, nan]", r"calibration\.toml: printed: corners"),
        ("[4, 3]", "[-4, 3]", r"calibration\.toml: printed: corners"),
        ("[printed]", "offsett = 3\n[printed]", r"calibration\.toml: 'offsett' is no parameter"),
    ],
)
def test_faults_name_file_and_key(tmp_path: Path, old: str, new: str, message: str):
    file = folder_of_pictures(tmp_path, "a/1.png") / "calibration.toml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        pipeline.calibrate(tmp_path)


@pytest.mark.usefixtures("recorder")
def test_unknown_method(tmp_path: Path):
    with pytest.raises(
        PluginError, match="no calibrator called 'magic'; installed are: corner-board, local-homography, planar, ref"
    ):
        pipeline.calibrate(folder_of_pictures(tmp_path, "a/1.png"), "magic")


@pytest.mark.usefixtures("recorder")
def test_provenance_can_be_stored(tmp_path: Path):
    folder = folder_of_pictures(tmp_path, "a/1.png", "a/2.png", "a/3.png")
    calibration = pipeline.calibrate(folder)
    evidence = pipeline.provenance(calibration)
    assert evidence["rms_px"] == {"camera": 0.1, "projector_device": 0.2, "joint": None}
    assert [v["name"] for v in evidence["views"]] == ["a/1", "a/2", "a/3"]
    write_rig(tmp_path / "rig.json", calibration.rig, evidence)
    assert read_rig(tmp_path / "rig.json").covariance is not None


def test_sides_must_pair_up(tmp_path: Path):
    pipeline.projected_checkerboard((256, 192), tmp_path)
    for name in ("side_a/1", "side_b_white/1", "side_b_white/2", "side_b_pattern/1"):
        write_png(tmp_path / f"{name}.png", np.zeros((6, 8), np.uint8))
    with pytest.raises(FileError, match=r"2 of \[marks\] and 1 of \[projected\]"):
        pipeline.calibrate(tmp_path)


@pytest.fixture(scope="module")
def coded(tmp_path_factory: pytest.TempPathFactory, scaled) -> Path:
    folder = tmp_path_factory.mktemp("coded")
    fringes = {"periods": [16, 1], "steps": 3}
    optics = Optics(read_noise=0.5, shot_noise=0.0)
    parameters = {"x": fringes, "y": fringes}
    pipeline.simulate_calibration(folder, scaled(paper_rig(), 0.5), 4, "phase-shift", parameters, optics, seed=5)
    file = folder / "calibration.toml"
    # The squares are a dozen pixels wide here.
    file.write_text("window = 0.9\n" + file.read_text())
    return folder


def test_coded_light_is_decoded_before_the_calibrator_sees_it(coded: Path):
    task = pipeline.load_calibration(coded)
    assert [c.name for c in task.captures] == ["pose0", "pose1", "pose2", "pose3"]
    for capture in task.captures:
        assert capture.printed is None and capture.lit is not None and capture.correspondences is not None
        both = np.isfinite(capture.correspondences.projector_xy).all(axis=1)
        assert both.sum() > 5000


def test_a_pose_with_a_frame_too_few_is_dropped_and_named(coded: Path, tmp_path: Path):
    folder = shutil.copytree(coded, tmp_path / "calib")
    sorted((folder / "pose1").glob("*.png"))[2].unlink()
    told: list[tuple[str, int, int]] = []
    calibration = pipeline.calibrate(folder, progress=lambda *step: told.append(step))
    reasons = {v.name: v.reason for v in calibration.views if not v.used}
    assert list(reasons) == ["pose1"] and "missing 002_" in reasons["pose1"]
    assert ("solve", 1, 1) in told
    for pose in ("pose2", "pose3"):
        sorted((folder / pose).glob("*.png"))[0].unlink()
    with pytest.raises(CalibrationError, match="1 of 4 coded views can be used.*pose1: .*pose2: .*pose3: "):
        pipeline.calibrate(folder)


def test_coded_light_from_stacks_is_that_of_the_pictures(coded: Path, tmp_path: Path):
    folder = shutil.copytree(coded, tmp_path / "calib")
    for number, pose in enumerate(sorted(folder.glob("pose*"))):
        files = sorted(pose.glob("*.png"))
        pictures = [read_image(file) for file in files]
        np.save(pose / "a.npy", np.stack(pictures)) if number % 2 else np.savez(pose / "a.npz", np.stack(pictures))
        for file in files:
            file.unlink()
    file = folder / "calibration.toml"
    file.write_text("\n".join(line for line in file.read_text().splitlines() if not line.startswith("frames")))
    task, expected = pipeline.load_calibration(folder), pipeline.load_calibration(coded)
    assert not task.dropped and not task.notes
    for mine, theirs in zip(task.captures, expected.captures, strict=True):
        assert mine.name == theirs.name
        np.testing.assert_array_equal(mine.lit, theirs.lit)
        np.testing.assert_array_equal(mine.correspondences.projector_xy, theirs.correspondences.projector_xy)


@pytest.mark.usefixtures("recorder")
def test_arrays_as_single_pictures_and_stacks_that_are_none(tmp_path: Path):
    folder = folder_of_pictures(tmp_path)
    (folder / "a").mkdir()
    file = folder / "calibration.toml"
    file.write_text(file.read_text().replace("a/*.png", "a/*.npy"))
    for name, shape in (("0", (6, 8)), ("1", (6, 8, 3)), ("2", (2, 6, 8)), ("3", (1, 6, 8))):
        np.save(folder / "a" / f"{name}.npy", np.full(shape, 99, np.uint8))
    task = pipeline.load_calibration(folder)
    assert [c.name for c in task.captures] == ["a/0", "a/1", "a/3"]
    ((name, reason),) = task.dropped
    assert name == "a/2" and "2.npy is a stack of 2 pictures, but one picture is needed here" in reason


def test_loss_in_some_pictures_is_told_once(coded: Path, tmp_path: Path):
    folder = shutil.copytree(coded, tmp_path / "calib")
    files = sorted(folder.glob("pose[12]/*.png"))
    for file in files:
        file.write_bytes(cv2.imencode(".jpg", read_image(file))[1].tobytes())
    count = len(sorted(folder.glob("pose*/*.png")))
    calibration = pipeline.calibrate(folder, select=True)
    told = [note for note in calibration.notes if "JPEG" in note]
    assert told == [
        f"{folder}: {len(files)} of {count} pictures are JPEG, which changes grey levels and blurs edges: "
        "save PNG pictures"
    ]
    assert pipeline.provenance(calibration)["notes"].count(told[0]) == 1


def test_what_the_pictures_told_is_kept_when_the_lens_model_is_selected(coded: Path, tmp_path: Path):
    folder = shutil.copytree(coded, tmp_path / "calib")
    for file in (folder / "pose1").glob("*.png"):
        write_png(file, np.clip(3.0 * read_image(file), 0, 255).astype(np.uint8))
    told, notes = {}, {}
    for select in (False, True):
        calibration = pipeline.calibrate(folder, select=select)
        told[select] = [(f.code, f.view) for f in calibration.verdict.reasons if f.code]
        notes[select] = [n for n in calibration.notes if "distortion is" in n]
    assert told[True] == told[False] and ("saturated", "pose1") in told[True]
    assert len(notes[True]) == 2 and not notes[False]


def test_real_planar_capture():
    if not (DATA / "planar_capture").is_dir():
        pytest.skip(f"planar_capture is not in {DATA} (SLKIT_DATA)")
    task = pipeline.load_calibration(TOML / "planar_capture")
    assert [c.name for c in task.captures][::12] == ["side_a/00", "side_b_white/00"]
    assert len(task.captures) == 24 and not task.dropped
    assert all(c.marks is not None and c.projected is not None for c in task.captures[12:])
