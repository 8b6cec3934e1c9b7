import csv
import json
import shutil
from pathlib import Path

import pytest

from slkit.files import write_rig
from slkit.geometry import Rig


@pytest.fixture
def rig_file(small_rig: Rig, tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", small_rig)
    return tmp_path / "rig.json"


@pytest.fixture(scope="module")
def copies(gray_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The same scan in two folders."""
    parent = tmp_path_factory.mktemp("copies")
    return [shutil.copytree(gray_scan, parent / name) for name in ("one", "two")]


def refused(slkit, *arguments: object) -> str:
    outcome = slkit("compare", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith("slkit: ") and outcome.err.count("\n") == 1
    return outcome.err


def test_scans(slkit, copies: list[Path], rig_file: Path, tmp_path: Path):
    out = tmp_path / "out"
    told = slkit("compare", *copies, tmp_path / "nowhere", "--rig", rig_file, "-o", out)
    assert told.code == 0 and told.err == ""
    for text in ("verdict: none", "no truth is known", "│ one", "not compared: there is no folder", f"page: {out}"):
        assert text in told.out, text
    table = json.loads((out / "comparison.json").read_text())
    one, two = table["methods"]
    assert one["points"] == two["points"] and one["completeness_share"] == 1
    assert "rms_mm" not in one and [f["folder"] for f in table["failed"]] == [str(tmp_path / "nowhere")]
    lines = list(csv.DictReader((out / "comparison.csv").read_text().splitlines()))
    assert [line["method"] for line in lines] == ["one", "two"]
    assert (out / "comparison.html").read_text(encoding="utf-8").count("data:image/png") == 9


def test_json_and_a_true_mesh(slkit, copies: list[Path], rig_file: Path, tmp_path: Path):
    import numpy as np
    import trimesh

    with np.load(copies[0] / "truth" / "object_mesh.npz") as mesh:
        trimesh.Trimesh(mesh["vertices_mm"], mesh["faces"], process=False).export(tmp_path / "ball.ply")
    common = (copies[0], "--rig", rig_file, "-o", tmp_path / "out", "--near", 6, "--outlier", 12, "--json")
    table = slkit("compare", *common, "--truth", tmp_path / "ball.ply").json
    (row,) = table["methods"]
    assert table["page"] == str(tmp_path / "out" / "comparison.html")
    assert "ball.ply" in table["reference"] and row["completeness_share"] > 0.9
    assert 0 < row["median_mm"] < row["rms_mm"] < row["p95_mm"]
    assert row["aligned_rms_mm"] <= row["rms_mm"] * 1.001
    moved = slkit("compare", *common, "--truth", tmp_path / "ball.ply", "--align").json
    assert moved["methods"][0]["rms_mm"] == pytest.approx(row["aligned_rms_mm"], rel=0.01)
    assert "moved onto" in moved["methods"][0]["notes"][0]


def test_a_simulation_with_a_given_rig(slkit, rig_file: Path, tmp_path: Path):
    out = tmp_path / "out"
    command = ["--simulate", "plane", "--codec", "gray", "--codec", "phase-shift", "--rig", rig_file, "-o", out]
    table = slkit("compare", *command, "--noise", 1, "--near", 5, "--outlier", 10, "--json").json
    assert [m["name"] for m in table["methods"]] == ["gray", "phase-shift"]
    assert "renders and triangulates" in table["calibration"] and table["verdict"] is None
    assert all(m["rms_mm"] > 0 for m in table["methods"])
    assert (out / "scans" / "gray" / "capture.toml").is_file()


def test_mistakes(slkit, copies: list[Path], rig_file: Path, small_rig: Rig, tmp_path: Path):
    scan, out = copies[0], ("-o", tmp_path / "out")
    common = (scan, "--rig", rig_file, *out)
    assert "nothing to compare" in refused(slkit, *out)
    assert "--rig is missing" in refused(slkit, scan, *out)
    assert "--plane and --spheres exclude" in refused(slkit, *common, "--plane", "--spheres", 1, 1, 3)
    assert "--truth" in refused(slkit, *common, "--align")
    assert "--codec is of a simulation" in refused(slkit, *common, "--codec", "gray")
    assert "leave the folders away" in refused(slkit, *common, "--simulate", "plane", "--codec", "gray")
    assert "needs codecs" in refused(slkit, "--simulate", "plane", *out)
    assert "leave --plane away" in refused(slkit, "--simulate", "plane", "--codec", "gray", "--plane", *out)
    assert "--spheres must be a positive length" in refused(slkit, *common, "--spheres", 10, 10, -1)
    assert "--radius must be a positive" in refused(slkit, *common, "--radius", 0)
    assert "no mesh file" in refused(slkit, *common, "--truth", tmp_path / "none.ply")
    assert "given twice" in refused(slkit, scan, scan, "--rig", rig_file, *out)
    assert "no ball of diameter" in refused(slkit, *common, "--spheres", 7, 7, 30)
    (tmp_path / "file").write_text("mine")
    assert "is no folder" in refused(slkit, scan, "--rig", rig_file, "-o", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_rig_that_does_not_fit(slkit, copies: list[Path], tmp_path: Path):
    from slkit.simulation import paper_rig

    write_rig(tmp_path / "other.json", paper_rig())
    told = refused(slkit, *copies, "--rig", tmp_path / "other.json", "-o", tmp_path / "out")
    assert "nothing could be compared" in told and "camera of 768 x 576 px" in told
    assert not (tmp_path / "out").exists()
