from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.data import Calibration, Finding, ResidualClass, Verdict, ViewResult
from slkit.files import read_provenance, read_rig, write_png
from slkit.simulation import paper_rig

RESULT = Calibration(
    rig=paper_rig(),
    method="planar",
    views=(
        ViewResult("side_a/0", True, "", 0.125, float("nan"), 0.125),
        ViewResult("side_b/1", False, "the 4 corner marks were not found"),
    ),
    rms_camera=0.125,
    rms_projector=0.25,
    rms_joint=0.1875,
    covariance={"parameters": ("fx",), "matrix": np.eye(1)},
    verdict=Verdict("usable", (Finding("few views", "", "take more"), Finding("blurred", "side_b/1", "take it again"))),
    classes={"printed": ResidualClass(88, 2, 150.5, 0.125)},
    notes=("side_b/1: the 4 corner marks were not found", "the board was never near the left border"),
)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    made: list[tuple] = []

    def calibrate(folder, method, parameters, progress, *, select, report):
        made.append((folder, method, parameters, progress, select, report))
        return RESULT

    monkeypatch.setattr(pipeline, "calibrate", calibrate)
    return made


def test_text(slkit, calls, tmp_path: Path):
    outcome = slkit("calibrate", "calib", "-o", tmp_path / "rig.json", "--method", "planar", "--set", "window=0.5")
    assert outcome.code == 0 and outcome.err == ""
    assert calls == [(Path("calib"), "planar", {"window": 0.5}, None, False, None)]
    lines = outcome.out.splitlines()
    assert any("side_a/0" in x and "yes" in x and "0.125" in x and "-" in x for x in lines)
    assert any("side_b/1" in x and "no" in x and "marks were not found" in x for x in lines)
    assert "rms: camera 0.125 px, projector 0.250 px, joint 0.188 px (planar)" in lines
    assert "printed: 88 points, 2 rejected, 0.125 px a coordinate" in lines
    assert "verdict: usable" in lines and "  few views; take more" in lines
    assert "  side_b/1: blurred; take it again" in lines
    assert [x for x in lines if x.startswith("note: ")] == ["note: the board was never near the left border"]
    assert read_provenance(tmp_path / "rig.json")["rms_px"]["joint"] == 0.1875


def test_json(slkit, calls, tmp_path: Path):
    table = slkit("calibrate", "calib", "-o", tmp_path / "rig.json", "--json").json
    assert table == {
        "rms_px": {"camera": 0.125, "projector_device": 0.25, "joint": 0.1875},
        "views": [
            {
                "name": "side_a/0",
                "used": True,
                "reason": "",
                "rms_px": 0.125,
            },
            {
                "name": "side_b/1",
                "used": False,
                "reason": "the 4 corner marks were not found",
                "rms_px": None,
            },
        ],
        "verdict": {
            "grade": "usable",
            "reasons": [
                {"fault": "few views", "view": "", "remedy": "take more", "code": "", "limit": ""},
                {"fault": "blurred", "view": "side_b/1", "remedy": "take it again", "code": "", "limit": ""},
            ],
        },
        "notes": list(RESULT.notes),
        "diagnosis": {
            "residuals": {"printed": {"rows": 88, "rejected": 2, "dof": 150.5, "sigma_px": 0.125, "scale": 1.0}}
        },
        "rig": str(tmp_path / "rig.json"),
    }
    np.testing.assert_array_equal(read_rig(tmp_path / "rig.json").camera.K, paper_rig().camera.K)


def test_options_reach_the_pipeline(slkit, calls, tmp_path: Path):
    options = ("--no-refine", "--select", "--report", tmp_path / "page", "--set", "model.warp=true")
    outcome = slkit("calibrate", "calib", "-o", tmp_path / "rig.json", *options)
    assert outcome.code == 0
    assert calls == [(Path("calib"), None, {"model": {"warp": True, "refine": False}}, None, True, tmp_path / "page")]
    assert outcome.out.splitlines()[-1] == f"report: {tmp_path / 'page' / 'report.html'}"


def test_colors_go_into_the_rig(slkit, calls, tmp_path: Path, monkeypatch):
    photometry = {"mixing": np.eye(3).tolist(), "evidence": {"size": [768, 576], "pixels": 9, "neutral": 1.0}}
    photometry["evidence"] |= {"saturated": 0.0, "additivity": [0.0, -0.07, 0.01]}
    photometry["warnings"] = ["the camera is not linear"]
    monkeypatch.setattr(pipeline, "measure_photometry", lambda folder: photometry if folder == Path("c") else {})
    outcome = slkit("calibrate", "calib", "--color", "c", "-o", tmp_path / "rig.json")
    lines = outcome.out.splitlines()
    assert "warning: the camera is not linear" in lines and lines[-1] == f"rig: {tmp_path / 'rig.json'}"
    assert any("1.0000 0.0000 0.0000" in x for x in lines) and any("-7.0 %" in x for x in lines)
    rig = read_rig(tmp_path / "rig.json")
    assert rig.photometry is not None and read_provenance(tmp_path / "rig.json")["rms_px"]["joint"] == 0.1875
    np.testing.assert_array_equal(rig.photometry["mixing"], np.eye(3))
    assert (
        slkit("calibrate", "calib", "--color", "c", "-o", tmp_path / "b.json", "--json").json["photometry"]
        == photometry
    )
    photometry["evidence"]["size"] = [640, 480]
    outcome = slkit("calibrate", "calib", "--color", "c", "-o", tmp_path / "d.json")
    assert outcome.code == 2 and "640 x 480" in outcome.err and not (tmp_path / "d.json").exists()


def test_wrong_colors_are_told_before_the_calibration(slkit, calls, tmp_path: Path):
    outcome = slkit("calibrate", "calib", "--color", tmp_path / "none", "-o", tmp_path / "rig.json")
    assert outcome.code == 2 and "there is no folder" in outcome.err and calls == []


def test_faults_leave_no_file(slkit, tmp_path: Path):
    pipeline.projected_checkerboard((256, 192), tmp_path / "calib")
    command = ("calibrate", tmp_path / "calib", "-o", tmp_path / "rig.json")

    def refused(*words: str, extra: tuple[str, ...] = ()) -> None:
        outcome = slkit(*command, *extra)
        assert (outcome.code, outcome.out) == (2, "")
        assert outcome.err.startswith("slkit: ") and outcome.err.count("\n") == 1
        assert all(word in outcome.err for word in words), outcome.err
        assert not (tmp_path / "rig.json").exists()

    refused("calibration.toml", "printed.images", "no picture")
    for side in ("side_a", "side_b_white", "side_b_pattern"):
        for i in range(4):
            write_png(tmp_path / "calib" / side / f"{i}.png", np.full((60, 80), 90, np.uint8))
    refused("0 of 4 printed views", "at least 3", "side_a/0")
    (tmp_path / "calib" / "side_a" / "2.png").write_text("a text")
    refused("side_a/2.png cannot be read as a picture")
    refused("no calibrator called 'magic'", "planar", extra=("--method", "magic"))
    refused("'windoww' is no parameter", extra=("--set", "windoww=1"))
    refused("square_mm", "finite", extra=("--set", "printed.square_mm=nan"))
    refused("square_mm", "positive", extra=("--set", "printed.square_mm=-30"))
    file = tmp_path / "calib" / "calibration.toml"
    text = file.read_text()
    file.write_text(text.replace("projector = [256, 192]", "projector = [256, nan]"))
    refused("calibration.toml: projector")
    file.write_text(text.replace('method = "planar"', ""))
    refused("calibration.toml: 'method' is missing")
