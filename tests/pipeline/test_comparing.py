import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.errors import FileError, InputError
from slkit.files import plain, write_rig
from slkit.geometry import Pose, Rig
from slkit.pipeline._comparing_limits import LIMITS
from slkit.registry import names
from slkit.report.comparison import Comparison
from slkit.simulation import Optics

NOISE = Optics(read_noise=1.0, shot_noise=0.0)
# A pixel of the small rig's camera is 5 mm wide on the object.
LIMITS_MM = (5.0, 10.0)


@pytest.fixture(scope="module")
def simulated(small_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Comparison]:
    """Two codecs on a tilted plane, with the rig that rendered it."""
    folder = tmp_path_factory.mktemp("simulated")
    codecs = ["gray", "phase-shift"]
    return folder, pipeline.compare_simulated(folder, "plane", codecs, small_rig, NOISE, 3, limits_mm=LIMITS_MM)


@pytest.fixture(scope="module")
def scans(simulated: tuple[Path, Comparison]) -> list[Path]:
    return [simulated[0] / "scans" / name for name in ("gray", "phase-shift")]


def test_the_true_rig_has_no_error_of_a_calibration(simulated: tuple[Path, Comparison], small_rig: Rig):
    _, found = simulated
    assert [m.name for m in found.methods] == ["gray", "phase-shift"]
    assert "renders and triangulates" in found.calibration and not found.verdict
    for method in found.methods:
        n = method.numbers
        assert n["capture_s"] == pytest.approx(n["patterns"] / 60)
        assert n["points"] == len(method.cloud) == len(method.away_mm)
        assert 0.9 < n["completeness_share"] <= 1 and n["outliers_share"] == 0
        # On a plane the error is noise alone: what is rough is what is wrong.
        assert n["roughness_mm"] == pytest.approx(n["rms_mm"], rel=0.35)
        assert n["median_mm"] <= n["rms_mm"] <= n["p95_mm"]
        assert not {"true_rig_rms_mm", "aligned_rms_mm", "sigma_cal_mm"} & set(n)
        assert np.sqrt(np.mean(method.away_mm**2)) == pytest.approx(n["rms_mm"], rel=1e-4)
    gray, phase = (m.numbers for m in found.methods)
    assert gray["patterns"] > phase["patterns"] and gray["rms_mm"] > 2 * phase["rms_mm"]
    # A cell of one column leaves 1 / sqrt(12), and a pixel that sees two of them tells a little more; the fringes have
    # no more noise than the pictures.
    assert 0.5 < gray["efficiency_ratio"] < 1.1
    assert 0.9 < phase["efficiency_ratio"] < 1.6


def test_every_limit_is_of_a_codec():
    assert set(LIMITS) <= set(names("slkit.codecs"))


def test_a_wrong_baseline_is_the_calibrations_error(small_rig: Rig, tmp_path: Path, simulated: tuple[Path, Comparison]):
    """Points of a baseline that is too long lie too far by the same share: the method's own error does not change."""
    folder, own = simulated
    work = tmp_path / "work"
    pose = small_rig.projector_from_camera
    wrong = replace(small_rig, projector_from_camera=Pose(pose.rotation, 1.004 * pose.translation))
    asked = {"optics": plain(vars(NOISE)), "seed": 3, "poses": 10}
    # A calibration made alike before is used again; this one was never made.
    told = {"comparison": asked, "method": "planar", "verdict": {"grade": "usable", "reasons": []}}
    write_rig(work / "rig.json", wrong, told)
    write_rig(work / "calibration" / "truth" / "rig.json", small_rig)
    found = pipeline.compare_simulated(
        work, "plane", ["phase-shift"], None, NOISE, 3, limits_mm=LIMITS_MM, true_rig=small_rig
    )
    n, true = found.methods[0].numbers, own.methods[1].numbers
    assert found.verdict["grade"] == "usable" and "planar" in found.calibration
    assert n["true_rig_rms_mm"] == pytest.approx(true["rms_mm"], rel=0.01)
    assert n["true_rig_roughness_mm"] == pytest.approx(n["roughness_mm"], rel=0.05)
    # At about 1.1 m, seen at less than 25 degrees.
    assert n["rms_mm"] == pytest.approx(0.004 * 1100, rel=0.2)
    # A plane that is farther away is a plane: a rigid motion takes all of it off.
    assert n["aligned_rms_mm"] == pytest.approx(true["rms_mm"], rel=0.05)


def test_another_seed_is_calibrated_anew(small_rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Asked(Exception):
        pass

    def render(folder, rig, poses, optics, seed, progress):
        raise Asked(folder, poses, seed)

    monkeypatch.setattr("slkit.pipeline._comparing_simulated.simulate_calibration", render)
    told = {"comparison": {"optics": plain(vars(NOISE)), "seed": 1, "poses": 10}}
    write_rig(tmp_path / "rig.json", small_rig, told)
    write_rig(tmp_path / "calibration" / "truth" / "rig.json", small_rig)
    with pytest.raises(Asked, match=r"calibration'\), 10, 2"):
        pipeline.compare_simulated(tmp_path, "plane", ["gray"], None, NOISE, 2, true_rig=small_rig)


def test_without_truth_no_accuracy_is_invented(scans: list[Path], small_rig: Rig):
    found = pipeline.compare(scans, small_rig)
    assert "no truth is known" in found.reference and "unknown origin" in found.calibration
    for method in found.methods:
        assert not {"rms_mm", "p95_mm", "outliers_share", "plane_rms_mm"} & set(method.numbers)
        assert not np.isfinite(method.away_mm).any()
        assert 0.8 < method.numbers["completeness_share"] <= 1
    assert found.error == "roughness_mm" and any("any method saw" in note for note in found.notes)


def test_completeness_without_truth_is_of_the_union(scans: list[Path], small_rig: Rig, tmp_path: Path):
    """A method that is given half of the depth is half complete, and its plane is fitted to that half."""
    both = pipeline.compare(scans, small_rig)
    whole = both.methods[0].cloud
    near = float(np.median(whole.xyz[:, 2]))
    from slkit.pipeline import _comparing

    def half(folder, rig, depth=None, progress=None):
        return pipeline.scan(folder, rig, depth=(100, near) if folder == scans[1] else None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_comparing, "scan", half)
        found = pipeline.compare(scans, small_rig, pipeline.Plate())
    full, part = (m.numbers for m in found.methods)
    assert full["completeness_share"] > 0.95
    assert part["completeness_share"] == pytest.approx(0.5, abs=0.06)
    # Both are fitted where both saw, and the first on all of its points too.
    assert part["common_plane_rms_mm"] == pytest.approx(part["plane_rms_mm"], rel=0.02)
    assert full["common_plane_form_mm"] < full["plane_form_mm"]


def test_a_plane_is_flat_and_a_ball_is_not(scans: list[Path], gray_scan: Path, small_rig: Rig):
    flat = pipeline.compare(scans, small_rig, pipeline.Plate())
    for method in flat.methods:
        n = method.numbers
        assert n["plane_rms_mm"] == pytest.approx(n["roughness_mm"], rel=0.35)
        assert n["plane_rms_mm"] < n["plane_form95_mm"] < n["plane_form_mm"]
        assert not method.notes
    (ball,) = pipeline.compare([gray_scan], small_rig, pipeline.Plate()).methods
    assert "no flat plate" in ball.notes[0]


def test_two_balls(small_rig: Rig, tmp_path: Path):
    from slkit.simulation import working_volume

    pipeline.simulate_scan(tmp_path, small_rig, "dumbbell", ["phase-shift"], optics=NOISE)
    radius = working_volume(small_rig)[1]
    balls = pipeline.Balls((0.64 * radius, 0.64 * radius), 1.2 * radius)
    (method,) = pipeline.compare([tmp_path], small_rig, balls).methods
    n = method.numbers
    # Pixels of 5 mm on balls of 140 mm across.
    assert abs(n["spacing_error_mm"]) < 1 and max(abs(n["size_1_mm"]), abs(n["size_2_mm"])) < 3
    assert 0 < n["form95_1_mm"] < n["form_1_mm"]
    assert 0.3 < np.isfinite(method.away_mm).mean() < 1


def truth_of(folder: Path, **options) -> pipeline.Truth:
    with np.load(folder / "truth" / "object_mesh.npz") as mesh:
        return pipeline.Truth(mesh["vertices_mm"], mesh["faces"], "the mesh", *LIMITS_MM, **options)


def test_a_mesh_that_stands_elsewhere_is_aligned_only_when_asked(gray_scan: Path, small_rig: Rig):
    here = truth_of(gray_scan)
    (at_home,) = pipeline.compare([gray_scan], small_rig, here).methods
    assert at_home.numbers["completeness_share"] > 0.9
    away = Pose.from_rotation_vector([0.0, 0.0, 0.1], [30.0, -20.0, 40.0])
    there = replace(here, vertices=away.apply(here.vertices))
    with pytest.raises(InputError, match="nothing could be compared.*in the camera frame.*--align"):
        pipeline.compare([gray_scan], small_rig, replace(there, vertices=there.vertices + [0, 0, 400]))
    (moved,) = pipeline.compare([gray_scan], small_rig, replace(there, align=True)).methods
    assert "turned by" in moved.notes[0] and "shifted by" in moved.notes[0]
    # A ball says nothing of how it was turned: only where its centre went.
    assert moved.numbers["rms_mm"] == pytest.approx(at_home.numbers["aligned_rms_mm"], rel=0.1)
    assert moved.numbers["completeness_share"] > 0.9
    assert "motion_mm" in moved.numbers and "motion_mm" not in at_home.numbers


def test_a_bad_folder_does_not_lose_the_others(
    scans: list[Path], small_rig: Rig, scaled: Callable[[Rig, float], Rig], tmp_path: Path
):
    other = tmp_path / "larger"
    pipeline.simulate_scan(other, scaled(small_rig, 1.5), "plane", ["gray"], optics=NOISE)
    found = pipeline.compare([tmp_path / "nowhere", scans[0], other], small_rig)
    assert [m.folder for m in found.methods] == [str(scans[0])]
    missing, larger = found.failed.values()
    assert missing == f"there is no folder {tmp_path / 'nowhere'}"
    assert "camera of 192 x 144 px" in larger and str(other) in larger
    with pytest.raises(InputError, match="nothing could be compared: there is no folder .*; the rig is for a camera"):
        pipeline.compare([tmp_path / "nowhere", other], small_rig)


def test_one_folder_twice_is_refused(scans: list[Path], small_rig: Rig):
    with pytest.raises(InputError, match="gray is given twice"):
        pipeline.compare([scans[0], scans[0].parent / "phase-shift" / ".." / "gray"], small_rig)


def test_folders_of_one_name_are_told_apart(scans: list[Path], small_rig: Rig, tmp_path: Path):
    shutil.copytree(scans[0], tmp_path / "gray")
    found = pipeline.compare([scans[0], tmp_path / "gray"], small_rig)
    assert [m.name for m in found.methods] == [str(scans[0]), str(tmp_path / "gray")]
    assert len({m.file_name for m in found.methods}) == 2


def test_what_is_written(simulated: tuple[Path, Comparison], tmp_path: Path):
    _, found = simulated
    page = pipeline.write_comparison(tmp_path, found, "two codes")
    written = {p.name for p in tmp_path.iterdir()}
    assert {"comparison.html", "comparison.json", "comparison.csv", "gray.ply", "phase-shift.ply"} <= written
    assert "two codes" in page.read_text(encoding="utf-8")
    table = json.loads((tmp_path / "comparison.json").read_text())
    for row, method in zip(table["methods"], found.methods, strict=True):
        assert row["rms_mm"] == pytest.approx(method.numbers["rms_mm"])
        assert (tmp_path / row["cloud"]).is_file()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FileError, match="file"):
        pipeline.write_comparison(tmp_path / "file", found)
    assert (tmp_path / "file").read_text() == "mine"
