from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit.errors import FileError
from slkit.files import read_sequence, write_png, write_toml

SIZE = (48, 64)


def folder_of(path: Path, frames: object = None) -> Path:
    table = {"codec": "color-stripes", "projector": [64, 48], "parameters": {}}
    write_toml(path / "capture.toml", table | ({} if frames is None else {"frames": frames}), "")
    return path


def picture(level: int) -> np.ndarray:
    image = np.zeros((*SIZE, 3), np.uint8)
    image[:, :, 0] = level
    return image


def video_of(path: Path, levels: list[int]) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (SIZE[1], SIZE[0]))
    for level in levels:
        writer.write(picture(level)[..., ::-1])
    writer.release()
    return path


def test_pictures_come_in_natural_order(tmp_path: Path):
    for number in (10, 2, 1):
        write_png(tmp_path / f"{number}.png", picture(number))
    found = read_sequence(folder_of(tmp_path))
    assert found.count == 3
    assert [int(load()[0, 0, 0]) for load in found.loads()] == [1, 2, 10]


@pytest.mark.parametrize("named", ["the video", "the folder"])
def test_a_video_is_read_as_rgb(tmp_path: Path, named: str):
    video = video_of(tmp_path / "clip.avi", [40, 120, 200])
    source = folder_of(tmp_path, "clip.avi" if named == "the folder" else None)
    found = read_sequence(video if named == "the video" else source)
    assert found.count is None
    images = [load() for load in found.loads()]
    assert [i.shape for i in images] == [(*SIZE, 3)] * 3
    np.testing.assert_allclose([i[..., 0].mean() for i in images], [40, 120, 200], atol=4)
    assert max(i[..., 1:].mean() for i in images) < 6


def test_what_is_no_sequence(tmp_path: Path):
    with pytest.raises(FileError, match=r"no video .*missing\.mp4"):
        read_sequence(tmp_path / "missing.mp4")
    with pytest.raises(FileError, match="no pictures"):
        read_sequence(folder_of(tmp_path / "empty"))
    with pytest.raises(FileError, match="not by role"):
        read_sequence(folder_of(tmp_path / "roles", {"x": "*.png"}))
    broken = tmp_path / "broken.avi"
    broken.write_bytes(b"no video at all")
    folder_of(tmp_path)
    with pytest.raises(FileError, match=r"broken\.avi cannot be read as a video"):
        next(read_sequence(broken).loads())
