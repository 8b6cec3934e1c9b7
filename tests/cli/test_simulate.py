from pathlib import Path

from slkit.files import read_capture, read_rig, write_rig
from slkit.geometry import Rig


def test_scan(slkit, small_rig: Rig, tmp_path: Path):
    write_rig(tmp_path / "rig.json", small_rig)
    arguments = ("--rig", tmp_path / "rig.json", "--scene", "plane", "--noise", "0", "--set", "step=8")
    outcome = slkit("simulate", "scan", "--codec", "gray", *arguments, "-o", tmp_path / "s", "--json")
    assert outcome.json == {"folders": [str(tmp_path / "s")]}
    assert read_capture(tmp_path / "s").parameters["step"] == 8
    assert read_rig(tmp_path / "s" / "truth" / "rig.json").camera.size == small_rig.camera.size
    assert slkit("simulate", "scan", *arguments, "-o", tmp_path / "t").out == f"folder: {tmp_path / 't'}\n"


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
    ):
        outcome = slkit("simulate", *arguments, "-o", target)
        assert (outcome.code, outcome.out) == (2, ""), arguments
        assert words in outcome.err, arguments
        assert not target.exists()
