from pathlib import Path

import pytest

from slkit.files import read_capture


def test_patterns(slkit, tmp_path: Path):
    outcome = slkit("patterns", "gray", "--projector", "64x48", "--set", "axes=both", "-o", tmp_path / "p", "--json")
    assert outcome.json == {"patterns": 2 + 2 * (6 + 6), "folder": str(tmp_path / "p")}
    assert read_capture(tmp_path / "p").parameters["axes"] == "both"
    assert (tmp_path / "p" / "slideshow.html").is_file()


def test_recipe(slkit, tmp_path: Path):
    (tmp_path / "r.toml").write_text('codec = "gray"\nprojector = [64, 48]\nparameters = {step = 2}')
    outcome = slkit("patterns", tmp_path / "r.toml", "--set", "inverse=false", "-o", tmp_path / "p")
    assert outcome.code == 0 and outcome.out.startswith("7 patterns in ")
    outcome = slkit("patterns", tmp_path / "r.toml", "--projector", "128x96", "-o", tmp_path / "q")
    assert read_capture(tmp_path / "q").projector == (128, 96)


@pytest.mark.parametrize(("name", "projector"), [("checkerboard", "256x192"), ("charuco", "480x320")])
def test_projected_boards(slkit, tmp_path: Path, name: str, projector: str):
    outcome = slkit("patterns", name, "--projector", projector, "-o", tmp_path / "p")
    assert outcome.code == 0 and outcome.out.startswith("2 patterns in ") and "calibration.toml" in outcome.out
    assert sorted(p.name for p in (tmp_path / "p").iterdir()) == [
        "calibration.toml",
        f"{name}.png",
        "slideshow.html",
        "white.png",
    ]


def test_colors(slkit, tmp_path: Path):
    outcome = slkit("patterns", "color", "--projector", "32x24", "-o", tmp_path / "p")
    assert outcome.code == 0 and outcome.out.startswith("5 patterns in ") and "named" in outcome.out
    files = ["black.png", "blue.png", "green.png", "red.png", "slideshow.html", "white.png"]
    assert sorted(p.name for p in (tmp_path / "p").iterdir()) == files
    outcome = slkit("patterns", "color", "--projector", "32x24", "--set", "levels=[64]", "-o", tmp_path / "q", "--json")
    assert outcome.json == {"patterns": 8, "folder": str(tmp_path / "q")}


def test_faults(slkit, tmp_path: Path):
    for arguments, words in (
        (("gray",), "--projector 1024x768"),
        (("gray", "--projector", "1024"), "--projector must be"),
        (("gray", "--projector", "64x48", "--set", "step=0"), "step"),
        (("grey", "--projector", "64x48"), "installed are: color-"),
        (("none.toml",), "none.toml"),
        (("checkerboard", "--projector", "9x9"), "too small"),
        (("checkerboard", "--projector", "256x192", "--set", "a=1"), "no parameters"),
        (("charuco", "--projector", "256x192"), "too small"),
        (("charuco", "--projector", "480x320", "--set", "a=1"), "no parameters"),
        (("charuco",), "--projector 1024x768"),
        (("color",), "--projector 1024x768"),
        (("color", "--projector", "64x48", "--set", "levels=[0]"), "levels must be from 1 to 254"),
    ):
        outcome = slkit("patterns", *arguments, "-o", tmp_path / "p" / "q")
        assert (outcome.code, outcome.out) == (2, "")
        assert words in outcome.err
        assert not list(tmp_path.rglob("*.*"))
    (tmp_path / "file").write_text("")
    outcome = slkit("patterns", "gray", "--projector", "64x48", "-o", tmp_path / "file")
    assert outcome.code == 2 and "cannot be made" in outcome.err
