import importlib.util
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from slkit.export import read_ply
from slkit.files import plain, read_image, read_provenance, read_rig, write_rig
from slkit.geometry import Pose, Rig
from slkit.simulation import Optics, one_to_one_rig, paper_rig

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def figure(text: str, pattern: str) -> float:
    """Return the number that a print-out holds in place of the group of a pattern."""
    found = re.search(pattern, text)
    assert found, f"{pattern!r} is not in {text!r}"
    return float(found.group(1))


def test_every_example_is_short_and_numbered():
    files = sorted(EXAMPLES.glob("*.py"))
    assert [f.name[:2] for f in files] == [f"{i:02d}" for i in range(len(files))]
    for file in files:
        assert len(file.read_text().splitlines()) < 100, file.name


@pytest.mark.parametrize("page", ["README.md", "patterns/README.md"])
def test_links_lead_somewhere(page: str):
    file = EXAMPLES.parent / page
    links = re.findall(r"\]\(([^)#]+)", file.read_text())
    assert all((file.parent / link).exists() for link in links if "://" not in link), links


def test_demo(tmp_path: Path, scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    truth = scaled(paper_rig(), 0.75)
    load("00_demo").main(tmp_path, truth, poses=4)
    told = capsys.readouterr().out
    assert read_rig(tmp_path / "rig.json").camera.size == (576, 432)
    assert read_provenance(tmp_path / "rig.json")["method"] == "planar"
    assert figure(told, r"([\d.]+) mm after the best rigid fit") < 1.0
    for name in ("line-shift", "phase-shift"):
        cloud = read_ply((tmp_path / f"{name}.ply").read_bytes())
        assert len(cloud) > 5000
        assert read_image(tmp_path / f"{name}.png").std() > 5
        calibrated, true = rows(told, name)
        assert calibrated[0] == len(cloud)
        assert all(rms > median for _, rms, median, _, _ in (calibrated, true))
        # Four small pictures place the rig's frame a millimetre off, which is all that "complete" allows a point;
        # with the true rig the decoding alone is left.
        assert true[2] < 0.3 and true[3] < 1 and true[4] > 75
    for name in ("seen_board.png", "seen_object.png"):
        assert read_image(tmp_path / name).shape == (432, 576)


def rows(told: str, codec: str) -> list[list[float]]:
    """Return points, rms, median, outliers in % and completeness in % of a codec: calibrated rig, true rig."""
    lines = told.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(f"{codec} "))
    return [[float(n) for n in re.findall(r"[\d.]+", line)] for line in lines[first : first + 2]]


def test_compare(tmp_path: Path, scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    truth = scaled(paper_rig(), 0.5)
    # Calibrated before, with a baseline a thousandth too long: the demo shows that calibrating works.
    pose = truth.projector_from_camera
    wrong = replace(truth, projector_from_camera=Pose(pose.rotation, 1.001 * pose.translation))
    asked = {"optics": plain(vars(Optics())), "seed": 1, "poses": 10}
    write_rig(tmp_path / "rig.json", wrong, {"comparison": asked, "verdict": {"grade": "usable", "reasons": []}})
    write_rig(tmp_path / "calibration" / "truth" / "rig.json", truth)
    found = load("06_compare").main(tmp_path, truth)
    told = capsys.readouterr().out
    stripes, lines = found.methods
    assert (stripes.numbers["patterns"], lines.codec) == (1, "line-shift")
    assert stripes.numbers["points"] < 0.3 * lines.numbers["points"]
    assert stripes.numbers["completeness_share"] < lines.numbers["completeness_share"]
    # What is rough is the method; what is left is that other points pass the filters of a few thousand.
    assert figure(told, r"changes the roughness by ([\d.]+) %") < 15
    for method in found.methods:
        n = method.numbers
        assert n["rms_mm"] > 1.1 * n["true_rig_rms_mm"] == pytest.approx(n["aligned_rms_mm"], rel=0.15)
    assert {"comparison.html", "comparison.csv", "comparison.json"} <= {f.name for f in tmp_path.iterdir()}


def test_batch(tmp_path: Path, scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    load("07_batch").main(tmp_path, scaled(paper_rig(), 0.25))
    told = capsys.readouterr().out
    assert told.count("\n") == 3, told
    first, why, second = told.splitlines()
    assert first.startswith("5 captures: 4 scanned, 0 unchanged, 1 failed, ")
    assert why.startswith("  sphere: ") and "missing 005_" in why
    assert second.startswith("5 captures: 1 scanned, 4 unchanged, 0 failed, ")
    clouds = sorted((tmp_path / "clouds").glob("*.ply"))
    assert [f.stem for f in clouds] == sorted(f.name for f in (tmp_path / "captures").iterdir())
    assert all(len(read_ply(f.read_bytes())) > 500 for f in clouds)


def test_simulated_scan(scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    load("01_simulated_scan").main(scaled(one_to_one_rig(), 0.5))
    told = capsys.readouterr().out
    assert figure(told, r"(\d+) points left") > 5000
    assert figure(told, r"median ([\d.]+) mm, 95 %") < 0.5
    assert 0.7 < figure(told, r"robust standard deviation ([\d.]+)") < 1.4


def test_calibrate_real_captures(
    captures: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setenv("SLKIT_DATA", str(captures("gray_board").parent))
    load("02_calibrate_real_captures").main(tmp_path / "calib")
    assert figure(capsys.readouterr().out, r"joint ([\d.]+) px") < 0.35
    # The data set's own reference: a distance of 673 from camera to projector.
    center = read_rig(tmp_path / "calib" / "rig.json").projector_center
    assert np.linalg.norm(center) == pytest.approx(673, abs=15)


def test_calibrate_real_captures_without_data(tmp_path: Path):
    command = [sys.executable, EXAMPLES / "02_calibrate_real_captures.py", tmp_path / "calib"]
    environment = {"SLKIT_DATA": str(tmp_path / "nowhere"), "PATH": ""}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "set SLKIT_DATA" in done.stdout and str(tmp_path / "nowhere") in done.stdout
    assert not (tmp_path / "calib").exists()


def test_own_codec(scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    load("03_own_codec").main(scaled(one_to_one_rig(), 0.5))
    told = capsys.readouterr().out
    assert "every promise kept" in told
    # Both codecs have cells of the same size, so one is as good as the other where it is right.
    own, gray = (figure(told, rf"{name}: .* median error ([\d.]+) mm") for name in ("Levels", "Gray"))
    assert own < 2 * gray


def test_own_calibration_target(scaled: Callable[[Rig, float], Rig], capsys: pytest.CaptureFixture[str]):
    load("04_own_calibration_target").main(scaled(paper_rig(), 0.6), poses=4)
    told = capsys.readouterr().out
    assert "every promise kept" in told and "4 of 4 views used" in told
    assert figure(told, r"joint ([\d.]+) px") < 0.1
    assert figure(told, r"([\d.]+) mm after the best rigid fit") < 1.0


def test_ablation(capsys: pytest.CaptureFixture[str]):
    table = load("05_ablation").main(seeds=4)
    told = capsys.readouterr().out
    error = {name[0]: row["aligned_mm"] for name, row in table.items()}
    assert figure(told, r"G joint adjustment +([\d.]+)") == pytest.approx(error["G"], abs=1e-3)
    assert error["A"] > 2.5
    # C and D differ by less than their scatter over so few seeds.
    assert error["A"] > error["F"] > error["B"] > max(error["C"], error["D"])
    assert min(error["C"], error["D"]) > error["E"] > error["G"]
    assert error["E"] < 0.2 and error["G"] < 0.11


def test_ablation_of_boards_that_hardly_tilt():
    table = load("05_ablation").main(seeds=2, tilt_deg=3.0)
    error = {name[0]: row["aligned_mm"] for name, row in table.items()}
    assert error["G"] <= 0.25 < error["B"]
