import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.export import read_ply
from slkit.files import read_image, write_png, write_rig
from slkit.geometry import Rig
from slkit.registry import names
from slkit.simulation import Optics, paper_rig


@pytest.fixture
def folder(gray_scan: Path, tmp_path: Path) -> Path:
    return shutil.copytree(gray_scan, tmp_path / "scan")


@pytest.fixture
def rig_file(small_rig: Rig, tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", small_rig)
    return tmp_path / "rig.json"


def refused(slkit, tmp_path: Path, *arguments: object) -> str:
    """Run a command that must fail: one sentence, exit code 2, no file written."""
    before = sorted(tmp_path.rglob("*"))
    outcome = slkit(*arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith("slkit: ") and outcome.err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
    return outcome.err


def test_json(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    cloud = tmp_path / "cloud.ply"
    table = slkit("scan", folder, "--rig", rig_file, "-o", cloud, "--json").json
    assert set(table) == {"points", "seconds", "sigma_mm", "sigma_decoding_mm", "sigma_cal_mm", "notes", "cloud"}
    assert table["notes"] == []
    assert set(table["seconds"]) == {"read", "decode", "triangulate", "write"}
    assert 0 < table["sigma_mm"]["median"] <= table["sigma_mm"]["p95"]
    assert table["sigma_decoding_mm"] == table["sigma_mm"]
    assert table["sigma_cal_mm"] == {"median": None, "p95": None}
    assert table["cloud"] == str(cloud)
    assert f"element vertex {table['points']}\n".encode() in cloud.read_bytes()[:400]


def test_loss_is_told(slkit, folder: Path, rig_file: Path, tmp_path: Path, to_jpeg):
    count = to_jpeg(folder)
    note = f"{folder}: {count} of {count} pictures are JPEG, which changes grey levels and blurs edges"
    command = ("scan", folder, "--rig", rig_file, "-o", tmp_path / "c.ply")
    outcome = slkit(*command)
    assert outcome.code == 0 and outcome.err == "" and outcome.out.count(f"note: {note}") == outcome.out.count("JPEG")
    assert [n[: len(note)] for n in slkit(*command, "--json").json["notes"]] == [note]
    sequence = (*command[:4], "--sequence", "-o")
    assert f"note: {note}" in slkit(*sequence, tmp_path / "one").out
    assert [n[: len(note)] for n in slkit(*sequence, tmp_path / "two", "--json").json["notes"]] == [note]


def test_bad_stacks(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    frames = sorted(folder.glob("0*.png"))
    stack = np.stack([read_image(frame) for frame in frames])
    command = ("scan", folder, "--rig", rig_file, "-o", tmp_path / "c.ply")
    for frame in frames:
        frame.unlink()
    file = folder / "capture.toml"
    lines = [line for line in file.read_text().splitlines() if not line.startswith("frames")]
    file.write_text("\n".join(['frames = "stack.npy"', *lines]))
    assert "has 0 pictures" in refused(slkit, tmp_path, *command)
    for wrong, words in (
        (stack[:-1], f"stack.npy has {len(stack) - 1} pictures, but gray needs {len(stack)}"),
        (stack / 255, "stack.npy holds float64 values: save pictures as uint8 or uint16"),
        (np.array([None]), "stack.npy holds object values"),
        (stack[:, :100], "192 x 100 px"),
    ):
        np.save(folder / "stack.npy", wrong)
        assert words in refused(slkit, tmp_path, *command)
    assert "no stack" in refused(slkit, tmp_path, "scan", folder / "absent.npz", *command[2:])
    np.save(folder / "stack.npy", stack)
    assert slkit(*command, "--json").json["points"] > 500


def test_the_calibrations_share(slkit, folder: Path, small_rig: Rig, tmp_path: Path):
    covariance = {"parameters": ["projector_from_camera.tx", "camera.fx"], "matrix": np.diag([1.0, 0.01])}
    write_rig(tmp_path / "rig.json", replace(small_rig, covariance=covariance))
    command = ("scan", folder, "--rig", tmp_path / "rig.json", "-o", tmp_path / "c.ply")
    table = slkit(*command, "--json").json
    cloud = read_ply((tmp_path / "c.ply").read_bytes())
    whole, decoding, share = (np.median(v) for v in (cloud.sigma_mm, cloud.sigma_decoding_mm, cloud.sigma_cal_mm))
    medians = [table[n]["median"] for n in ("sigma_mm", "sigma_decoding_mm", "sigma_cal_mm")]
    np.testing.assert_allclose(medians, [whole, decoding, share], rtol=1e-3)
    assert 0 < share < whole and 0 < decoding < whole
    assert f"from decoding: median {decoding:.3f} mm, from calibration: median {share:.3f} mm" in slkit(*command).out


def test_text_and_options(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    options = ["--normals", "--no-filter", "sigma", "--no-filter", "isolated", "--depth", "100", "5000"]
    outcome = slkit("scan", folder, "--rig", rig_file, "-o", tmp_path / "c.ply", "--set", "robust=true", *options)
    assert outcome.code == 0 and outcome.err == ""
    for word in (
        "points: ",
        "removed by filter: ",
        "residual 0",
        "sigma along the ray: median",
        "not known",
        "seconds: read",
    ):
        assert word in outcome.out
    assert "isolated" not in outcome.out
    assert b"property float nx" in (tmp_path / "c.ply").read_bytes()[:600]
    picture = slkit("view", tmp_path / "c.ply", "-o", tmp_path / "c.png")
    assert picture.code == 0
    assert read_image(tmp_path / "c.png").std() > 5


def test_bad_pictures(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    frames = sorted(folder.glob("0*.png"))
    command = ("scan", folder, "--rig", rig_file, "-o", tmp_path / "c.ply")
    good = frames[6].read_bytes()
    frames[6].write_bytes(good[: len(good) // 2])
    assert frames[6].name in refused(slkit, tmp_path, *command)
    frames[6].write_text("this is a text")
    assert frames[6].name in refused(slkit, tmp_path, *command, "--json")
    frames[6].unlink()
    assert f"missing {frames[6].stem}" in refused(slkit, tmp_path, *command)
    write_png(frames[6], np.zeros((100, 100), np.uint8))
    message = refused(slkit, tmp_path, *command)
    assert frames[6].name in message and "100 x 100" in message and "192 x 144" in message
    for frame in frames:
        frame.unlink()
    assert "has 0 pictures" in refused(slkit, tmp_path, *command)


@pytest.mark.parametrize("codec", names("slkit.codecs"))
@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_captures(slkit, tmp_path: Path, small_rig: Rig, rig_file: Path, codec: str, level: int):
    built = pipeline.load_codec(codec, small_rig.projector.size)
    pipeline.patterns(codec, built, tmp_path / "scan")
    for frame in (tmp_path / "scan").glob("0*.png"):
        write_png(frame, np.full((144, 192), level, np.uint8))
    refused(slkit, tmp_path, "scan", tmp_path / "scan", "--rig", rig_file, "-o", tmp_path / "c.ply")


def test_bad_toml(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    file = folder / "capture.toml"
    text = file.read_text()
    command = ("scan", folder, "--rig", rig_file, "-o", tmp_path / "c.ply")
    for old, new, words in (
        ("[256, 192]", "[256, nan]", ("capture.toml", "projector")),
        ("[256, 192]", "[256, -192]", ("capture.toml", "projector")),
        ("step = 2", "step = nan", ("capture.toml", "step")),
        ("step = 2", "step = -2", ("capture.toml", "step")),
        ("step = 2", "stepp = 2", ("capture.toml", "stepp")),
        ('codec = "gray"', 'codec = "grey"', ("grey", "installed are: ", "gray")),
        ('codec = "gray"', "codec = ", ("capture.toml", "TOML", "line")),
    ):
        assert old in text
        file.write_text(text.replace(old, new))
        message = refused(slkit, tmp_path, *command)
        assert all(word in message for word in words)


def test_bad_arguments(slkit, folder: Path, rig_file: Path, tmp_path: Path, small_rig: Rig):
    command = ("scan", folder, "--rig", rig_file)
    write_rig(tmp_path / "big.json", replace(small_rig, camera=paper_rig().camera))
    message = refused(slkit, tmp_path, "scan", folder, "--rig", tmp_path / "big.json", "-o", tmp_path / "c.ply")
    assert "768 x 576" in message and "192 x 144" in message
    assert "installed are: ply, xyz" in refused(slkit, tmp_path, *command, "-o", tmp_path / "c.stl")
    assert "no filter called 'x'" in refused(slkit, tmp_path, *command, "-o", tmp_path / "c.ply", "--no-filter", "x")
    assert "key=value" in refused(slkit, tmp_path, *command, "-o", tmp_path / "c.ply", "--set", "x")
    assert "depth" in refused(slkit, tmp_path, *command, "-o", tmp_path / "c.ply", "--depth", "5", "3")
    assert "cannot be" in refused(slkit, tmp_path, *command, "-o", rig_file / "c.ply")
    assert "none.json" in refused(slkit, tmp_path, "scan", folder, "--rig", "none.json", "-o", tmp_path / "c.ply")
    assert "capture.toml" in refused(slkit, tmp_path, "scan", tmp_path, "--rig", rig_file, "-o", tmp_path / "c.ply")
    assert "c.ply" in refused(slkit, tmp_path, "view", tmp_path / "c.ply", "-o", tmp_path / "c.png")


def test_noise_free_scan_of_a_slideshow(slkit, small_rig: Rig, rig_file: Path, tmp_path: Path):
    """Pictures by any camera program, in the folder that `slkit patterns` has prepared."""
    assert slkit("patterns", "gray", "--projector", "256x192", "-o", tmp_path / "p").code == 0
    optics = Optics(read_noise=0.3, shot_noise=0.0)
    pipeline.simulate_scan(tmp_path / "s", small_rig, "plane", optics=optics)
    mine = tmp_path / "mine"
    mine.mkdir()
    shutil.copy(tmp_path / "p" / "capture.toml", mine)
    for i, frame in enumerate(sorted((tmp_path / "s").glob("0*.png"))):
        shutil.copy(frame, mine / f"IMG_{i + 95}.png")
    outcome = slkit("scan", mine, "--rig", rig_file, "-o", tmp_path / "c.xyz", "--json")
    assert outcome.json["points"] > 1000


def test_a_sequence(slkit, folder: Path, rig_file: Path, tmp_path: Path):
    command = ("scan", folder, "--rig", rig_file, "--sequence", "-o")
    outcome = slkit(*command, tmp_path / "clouds")
    assert outcome.code == 0 and outcome.out.startswith("clouds: 1 of 1 scans in ")
    assert [f.name for f in (tmp_path / "clouds").iterdir()] == ["000000.ply"]
    table = slkit(*command, tmp_path / "again", "--json").json
    assert set(table) == {
        *("scans", "clouds", "points", "seconds", "first_failure", "notes", "scans_per_second", "folder")
    }
    assert len(read_ply((tmp_path / "again" / "000000.ply").read_bytes())) == table["points"]
    assert "--normals" in refused(slkit, tmp_path, *command, tmp_path / "n", "--normals")
    assert "no video" in refused(slkit, tmp_path, "scan", tmp_path / "a.mp4", *command[2:], tmp_path / "n")
