import os
from pathlib import Path

import pytest

from slkit.errors import FileError
from slkit.files import read_calibration, read_capture

TOML = Path(__file__).parent.parent / "data_toml"
DATA = Path(os.environ.get("SLKIT_DATA", Path(__file__).parents[3] / "shared" / "data"))

CAPTURE = """
codec = "gray"
projector = [1024, 768]
parameters = {axes = "x"}
frames = "*.png"
"""
CALIBRATION = """
method = "planar"
projector = [1280, 800]
[printed]
images = "side_a/*.png"
corners = [11, 8]
square_mm = 30.0
[own-table]
anything = 3
"""


def written(folder: Path, name: str, text: str, *pictures: str) -> Path:
    (folder / name).write_text(text)
    for picture in pictures:
        (folder / picture).parent.mkdir(parents=True, exist_ok=True)
        (folder / picture).write_bytes(b"")
    return folder


def test_capture(tmp_path: Path):
    found = read_capture(written(tmp_path, "capture.toml", CAPTURE, "1.png", "2.png"))
    assert (found.codec, found.projector, found.parameters) == ("gray", (1024, 768), {"axes": "x"})
    assert found.frames(["white", "black"]).names == ("white", "black")
    assert read_capture(tmp_path / "capture.toml") == found


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[1024, 768]", "[1024, nan]", "capture.toml: projector .* not 1024 x nan"),
        ("[1024, 768]", "[-1024, 768]", "capture.toml: projector .* not -1024 x 768"),
        ("[1024, 768]", "[1024.5, 768]", "capture.toml: projector"),
        ("[1024, 768]", "[1024]", "capture.toml: projector must be two whole numbers"),
        ("[1024, 768]", "[true, 768]", "capture.toml: projector"),
        ("[1024, 768]", '"1024x768"', "capture.toml: projector must be a list"),
        ("projector = [1024, 768]", "", "capture.toml: 'projector' is missing"),
        ('codec = "gray"', "", "capture.toml: 'codec' is missing"),
        ('codec = "gray"', "codec = 3", "capture.toml: codec must be a text"),
        ('{axes = "x"}', '"x"', "capture.toml: parameters must be a table"),
        ('frames = "*.png"', "frames = 3", "capture.toml: frames must be a pattern"),
        ("frames =", "frame =", "capture.toml: 'frame' is no key of a capture"),
        ('frames = "*.png"', 'root = "nowhere"', "there is no folder .*nowhere"),
    ],
)
def test_faults_of_a_capture(tmp_path: Path, old: str, new: str, message: str):
    assert old in CAPTURE
    with pytest.raises(FileError, match=message):
        read_capture(written(tmp_path, "capture.toml", CAPTURE.replace(old, new)))


def test_absent(tmp_path: Path):
    with pytest.raises(FileError, match="has no capture.toml: .*slkit patterns"):
        read_capture(tmp_path)
    with pytest.raises(FileError, match="there is no folder"):
        read_calibration(tmp_path / "none")
    with pytest.raises(FileError, match="has no calibration.toml"):
        read_calibration(tmp_path)


def test_calibration_keeps_tables_it_does_not_know(tmp_path: Path):
    found = read_calibration(written(tmp_path, "calibration.toml", CALIBRATION, "side_a/2.png", "side_a/10.png"))
    assert found.method == "planar"
    assert found.parameters == {
        "projector": [1280, 800],
        "printed": {"corners": [11, 8], "square_mm": 30.0},
        "own-table": {"anything": 3},
    }
    assert [p.name for p in found.images["printed"]] == ["2.png", "10.png"]
    assert found.coded == ()


def test_coded_poses(tmp_path: Path):
    text = """
    method = "local-homography"
    projector = [64, 48]
    printed = {corners = [5, 4], square_mm = 10}
    coded = {poses = "pose*", codec = "gray", parameters = {axes = "both"}, frames = {x = "x*", white = "w*"}}
    """
    found = read_calibration(written(tmp_path, "calibration.toml", text, "pose2/w.png", "pose10/w.png"))
    assert [name for name, _ in found.coded] == ["pose2", "pose10"]
    assert found.coded[0][1].codec == "gray"
    assert found.coded[0][1].frames(["white"]).names == ("white",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('method = "planar"', "", "'method' is missing"),
        ("[1280, 800]", "[1280, -800]", "projector"),
        ('images = "side_a/*.png"', "", "names no pictures"),
        ("side_a/*.png", "elsewhere/*.png", "printed.images: no picture in"),
        (
            "[own-table]",
            '[own-table]\nimages = "*.png"',
            "only printed, marks, corner_board, solid, projected can have images",
        ),
        ('images = "side_a/*.png"', "images = {x = 'a'}", "printed.images must be a pattern"),
        ("[own-table]", '[coded]\nposes = "p*"\ncodec = "gray"', "'anything' is no key"),
        ("[own-table]\nanything = 3", '[coded]\nposes = "p*"\ncodec = "gray"', "no folder in .* matches 'p\\*'"),
    ],
)
def test_faults_of_a_calibration(tmp_path: Path, old: str, new: str, message: str):
    assert old in CALIBRATION
    text = CALIBRATION.replace(old, new)
    with pytest.raises(FileError, match=message):
        read_calibration(written(tmp_path, "calibration.toml", text, "side_a/0.png"))


REAL = {
    "gray_board": ("local-homography", 0, 3),
    "phase_board_skull": ("local-homography", 0, 5),
    "planar_capture": ("planar", 36, 0),
}


@pytest.mark.parametrize("name", REAL)
def test_real_calibrations_are_found(name: str):
    if not (DATA / name).is_dir():
        pytest.skip(f"the real captures of {name} are not in {DATA} (SLKIT_DATA)")
    found = read_calibration(TOML / name)
    assert (found.method, sum(map(len, found.images.values())), len(found.coded)) == REAL[name]


@pytest.mark.parametrize(("file", "count"), [("gray_board/pose1", 42), ("phase_board_skull/capture", 12)])
def test_real_scans_are_found(file: str, count: int):
    if not (DATA / file.split("/")[0]).is_dir():
        pytest.skip(f"the real captures of {file} are not in {DATA} (SLKIT_DATA)")
    from slkit.pipeline import load_codec

    found = read_capture(TOML / f"{file}.toml")
    names = load_codec(found.codec, found.projector, found.parameters).encode().names
    paths = found.source.paths(names, found.codec)
    assert len(paths) == count == len(set(paths))
    assert "white" in paths[0].name and "black" in paths[1].name
