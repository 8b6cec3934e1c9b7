from pathlib import Path

import numpy as np
import pytest

from slkit.files import read_capture, read_image, read_rig, write_rig
from slkit.geometry import Rig


def test_scan(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    arguments = ("--rig", tmp_path / "rig.json", "--scene", "plane", "--noise", "0", "--set", "step=8")
    outcome = slkit("simulate", "scan", "--codec", "gray", *arguments, "-o", tmp_path / "s", "--json")
    assert outcome.json == {"folders": [str(tmp_path / "s")]}
    assert read_capture(tmp_path / "s").parameters["step"] == 8
    assert read_rig(tmp_path / "s" / "truth" / "rig.json").camera.size == small_rig.camera.size
    assert slkit("simulate", "scan", *arguments, "-o", tmp_path / "t").out == f"folder: {tmp_path / 't'}\n"


def test_optics_make_a_capture_realistic(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    arguments = ("--rig", tmp_path / "rig.json", "--scene", "plane", "--set", "step=64", "--noise", "0")
    for name, options in (
        ("plain", ()),
        ("lit", ("--optics", "ambient=0.3", "--optics", "bits=16")),
        ("color", ("--optics", "color=true", "--optics", "crosstalk=[[1,0,0],[0,0.5,0],[0,0,0.25]]")),
        ("noisy", ("--optics", "read_noise=3")),
    ):
        assert slkit("simulate", "scan", *arguments, *options, "-o", tmp_path / name).code == 0
    plain, lit, color, noisy = (
        read_image(tmp_path / name / "001_black.png").astype(float) for name in ("plain", "lit", "color", "noisy")
    )
    middle = (slice(60, 80), slice(90, 110))
    # An albedo of 0.8 under 0.12 or 0.3 of room light, above a black level of 0.015.
    assert plain[middle].mean() / 255 == pytest.approx(0.015 + 0.12 * 0.8, abs=0.002)
    assert lit[middle].mean() / 65535 == pytest.approx(0.015 + 0.3 * 0.8, abs=1e-5)
    np.testing.assert_allclose(color[middle].mean(axis=(0, 1)) / 255, [0.111, 0.063, 0.039], atol=0.002)
    assert np.std(noisy[middle]) == pytest.approx(3, rel=0.2) and np.std(plain[middle]) == 0


def test_color(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    arguments = ("--rig", tmp_path / "rig.json", "--noise", "1", "--optics", "crosstalk=0.1", "--set", "levels=[90]")
    outcome = slkit("simulate", "color", *arguments, "-o", tmp_path / "c", "--json")
    assert outcome.json == {"folders": [str(tmp_path / "c")]}
    names = {"white", "black", "red", "green", "blue", "red_090", "green_090", "blue_090"}
    assert {p.stem for p in (tmp_path / "c").glob("*.png")} == names
    outcome = slkit("rig", "color", tmp_path / "rig.json", tmp_path / "c")
    lines = outcome.out.splitlines()
    assert lines[0] == "color mixing, rows seen, columns projected, red green blue:"
    shown = np.array([line.split() for line in lines[1:4]], dtype=float)
    np.testing.assert_allclose(shown, 0.7 * np.eye(3) + 0.1, atol=2e-3)
    assert lines[4].startswith("ambient: 0.1") and lines[5].startswith("projector response, exponents: 1.0")
    assert lines[6].startswith("evidence: ") and lines[-1] == f"rig: {tmp_path / 'rig.json'}"
    assert slkit("rig", "show", tmp_path / "rig.json").out.splitlines()[-len(lines) + 1 :] == lines[:-1]
    told = slkit("rig", "color", tmp_path / "rig.json", tmp_path / "c", "-o", tmp_path / "b.json", "--json").json
    assert told["rig"] == str(tmp_path / "b.json")
    assert slkit("rig", "show", tmp_path / "b.json", "--json").json["photometry"] == told["photometry"]


def test_color_faults(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    before = (tmp_path / "rig.json").read_bytes()
    outcome = slkit("rig", "color", tmp_path / "rig.json", tmp_path / "c")
    assert (outcome.code, outcome.out) == (2, "") and "there is no folder" in outcome.err
    slkit("simulate", "color", "--rig", tmp_path / "rig.json", "--optics", "white_level=4", "-o", tmp_path / "c")
    outcome = slkit("rig", "color", tmp_path / "rig.json", tmp_path / "c")
    assert (outcome.code, outcome.out) == (2, "") and "saturated: shorten the exposure" in outcome.err
    assert (tmp_path / "rig.json").read_bytes() == before


def test_faults(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    target = tmp_path / "s"
    for arguments, words in (
        (("scan", "--scene", "cube"), "no scene called 'cube'"),
        (("scan", "--scene", "none.stl"), "no mesh file none.stl"),
        (("scan", "--codec", "grey"), "no codec called 'grey'"),
        (("scan", "--noise", "-1"), "read_noise"),
        (("scan", "--rig", "none.json"), "none.json"),
        (("calibration", "--poses", "0"), "poses must be at least 1"),
        (("calibration", "--codec", "gray", "--codec", "phase-shift"), "give --codec once"),
        (("calibration", "--set", "step=2"), "name one with --codec"),
        (("calibration", "--noise", "nan"), "read_noise"),
        (("calibration", "--fault", "gamma"), "cannot befall"),
        (("scan", "--optics", "crosstalk"), "--optics crosstalk: write it as key=value"),
        (("scan", "--optics", "a.b=1"), "--optics a.b=1: write it as key=value"),
        (("scan", "--optics", "blur=1"), "optics: 'blur' is no parameter; there are: white_level"),
        (("scan", "--optics", "bits=12"), "bits must be 8 or 16"),
        (("color", "--optics", "crosstalk=0.7"), "crosstalk must be a share"),
        (("color", "--set", "levels=[300]"), "levels must be from 1 to 254"),
    ):
        outcome = slkit("simulate", *arguments, "-o", target)
        assert (outcome.code, outcome.out) == (2, ""), arguments
        assert words in outcome.err, arguments
        assert not target.exists()
