from pathlib import Path

import pytest

from slkit.errors import FileError
from slkit.files import FrameSource
from slkit.files.sources import find_files, find_folders, natural_key

NAMES = ("white", "black", "x_bit1", "x_bit0", "y_bit0")


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    return folder


def found(folder: Path, frames, names=NAMES) -> list[str]:
    return [p.name for p in FrameSource.of(folder, frames, "x.toml").paths(names, "gray")]


def test_natural_order():
    names = ["b10", "b9", "a", "b9a", "²", "10", "9"]
    assert sorted(names, key=natural_key) == ["9", "10", "a", "b9", "b9a", "b10", "²"]


def test_any_camera_s_pictures_are_taken_as_they_are(tmp_path: Path):
    touch(tmp_path, "IMG_8.JPG", "IMG_9.JPG", "IMG_10.JPG", "IMG_11.JPG", "IMG_100.JPG", "capture.toml", "._IMG_8.JPG")
    assert found(tmp_path, None) == ["IMG_8.JPG", "IMG_9.JPG", "IMG_10.JPG", "IMG_11.JPG", "IMG_100.JPG"]


def test_glob_and_list(tmp_path: Path):
    touch(tmp_path, "1.png", "2.png", "3.png", "4.png", "5.png", "notes.txt", "sub/6.png")
    assert found(tmp_path, "*.png") == ["1.png", "2.png", "3.png", "4.png", "5.png"]
    listed = ["5.png", "1.png", "sub/6.png", "2.png", "3.png"]
    assert found(tmp_path, listed) == ["5.png", "1.png", "6.png", "2.png", "3.png"]
    assert [p.name for p in find_files(tmp_path, "*", "x")] == ["1.png", "2.png", "3.png", "4.png", "5.png"]
    with pytest.raises(FileError, match="there is no file .*7.png"):
        found(tmp_path, ["7.png"])


def test_roles_take_their_files_in_order(tmp_path: Path):
    touch(tmp_path, "00_col_1.png", "01_col_0.png", "02_row_0.png", "40_on.png", "41_off.png")
    roles = {"x": "*_col_*.png", "y": "*_row_*.png", "white": "40_*.png", "black": ["41_off.png"], "unused": "zz*"}
    assert found(tmp_path, roles) == ["40_on.png", "41_off.png", "00_col_1.png", "01_col_0.png", "02_row_0.png"]
    with pytest.raises(FileError, match="no entry 'white', which gray needs"):
        found(tmp_path, {"x": "*", "y": "*"})
    with pytest.raises(FileError, match="has 1 x pictures, but gray needs 2"):
        found(tmp_path, roles | {"x": "00_*"})


def test_missing_frames_are_named_by_number(tmp_path: Path):
    touch(tmp_path, "000_white.png", "001_black.png", "003_x_bit0.png", "004_y_bit0.png")
    with pytest.raises(FileError, match=r"has 4 pictures, but gray needs 5: missing 002_x_bit1"):
        found(tmp_path, "*.png")


def test_spare_frames_are_named_by_number(tmp_path: Path):
    touch(tmp_path, *(f"{i:03d}.png" for i in range(6)))
    with pytest.raises(FileError, match=r"has 6 pictures, but gray needs 5: too many are 005\.png"):
        found(tmp_path, "*.png")


def test_without_numbers_the_needed_frames_are_listed(tmp_path: Path):
    touch(tmp_path, "a.png", "b.png")
    with pytest.raises(FileError, match="needed are, in this order, white, black, x_bit1"):
        found(tmp_path, None)


def test_a_folder_without_pictures(tmp_path: Path):
    touch(tmp_path, "readme.txt")
    with pytest.raises(FileError, match="has 0 pictures, but gray needs 5: is this the right folder"):
        found(tmp_path, None)
    with pytest.raises(FileError, match="there is no folder"):
        found(tmp_path / "absent", None)


@pytest.mark.parametrize("frames", [3, "", [], ["a", 1], {"x": 1}, "/abs/*.png"])
def test_what_is_no_pattern(tmp_path: Path, frames):
    with pytest.raises(FileError, match=r"x\.toml"):
        found(tmp_path, frames, ("x_0",))


def test_folders(tmp_path: Path):
    touch(tmp_path, "pose10/a", "pose9/a", "other/a", "pose1.txt")
    assert [p.name for p in find_folders(tmp_path, "pose*", "x")] == ["pose9", "pose10"]
    assert [p.name for p in find_folders(tmp_path, ["other", "pose9"], "x")] == ["other", "pose9"]
    with pytest.raises(FileError, match="x must be"):
        find_folders(tmp_path, 4, "x")


def test_a_stack_hidden_by_a_picture_is_named(tmp_path: Path):
    touch(tmp_path, "preview.png", "stack.npy")
    with pytest.raises(FileError, match=r"there is stack\.npy, too: name it as frames in "):
        found(tmp_path, None)
