import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit.errors import FileError
from slkit.files import FrameSource, videos
from slkit.files.losses import loss_notes
from slkit.files.videos import open_video

RNG = np.random.default_rng(0)
GREY = RNG.integers(0, 256, (6, 50, 70), dtype=np.uint8)
COLOR = RNG.integers(0, 256, (6, 50, 70, 3), dtype=np.uint8)
DEEP = RNG.integers(0, 65536, (6, 50, 70), dtype=np.uint16)


def video_of(path: Path, stack: np.ndarray, code: str = "FFV1") -> Path:
    """Write pictures (n, h, w) or RGB (n, h, w, 3) as a video; code "raw": as they are."""
    fourcc = 0 if code == "raw" else cv2.VideoWriter.fourcc(*code)
    settings = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(stack.ndim == 4)]
    settings += [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U] if stack.dtype == np.uint16 else []
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, 25, (stack.shape[2], stack.shape[1]), settings)
    assert writer.isOpened()
    for picture in stack:
        writer.write(picture[..., ::-1] if picture.ndim == 3 else picture)
    writer.release()
    return path


@pytest.mark.parametrize("ending", ["avi", "mkv", "mov", "mp4"])
@pytest.mark.parametrize("stack", [GREY, COLOR, DEEP])
def test_frames_of_a_lossless_video_are_what_was_written(tmp_path: Path, ending: str, stack: np.ndarray):
    held = open_video(video_of(tmp_path / f"a.{ending}", stack), len(stack))
    assert held.count == 6 and held.in_turn
    for index in (0, 1, 2, 3, 4, 5, 0, 3, 3, 5):
        np.testing.assert_array_equal(held.load(index), stack[index])
        assert held.load(index).dtype == stack.dtype


def test_asked_in_their_order_frames_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    opened: list[Path] = []
    monkeypatch.setattr(videos, "_opened", lambda path, old=videos._opened: opened.append(path) or old(path))
    held = open_video(video_of(tmp_path / "a.avi", GREY), 6)
    opened.clear()
    for index in range(6):
        held.load(index)
    assert len(opened) == 1
    held.load(0)
    assert len(opened) == 2


def test_the_wrong_number_of_frames(tmp_path: Path):
    video_of(tmp_path / "a.avi", GREY)
    source = FrameSource.of(tmp_path, "a.avi", "x.toml")
    for names in ("abcde", "abcdefg"):
        with pytest.raises(
            FileError, match=rf"a\.avi has 6 pictures, but gray needs {len(names)}: needed are, in this"
        ):
            source.frames(list(names), "gray")
    assert len(source.frames(list("abcdef"), "gray")) == 6


def test_a_header_that_tells_too_few_frames(tmp_path: Path):
    """The number in the header of an AVI file is only believed where it is the one that is needed."""
    file = video_of(tmp_path / "a.avi", GREY)
    data = bytearray(file.read_bytes())
    # 28 bytes behind its name: the number of frames, in the main header and in that of the stream.
    assert data[data.index(b"avih") + 24] == 6
    data[data.index(b"avih") + 24] = 4
    data[data.index(b"strh") + 40] = 4
    file.write_bytes(data)
    assert cv2.VideoCapture(str(file)).get(cv2.CAP_PROP_FRAME_COUNT) == 4
    held = open_video(file, 6)
    assert held.count == 6
    np.testing.assert_array_equal(held.load(5), GREY[5])


def test_a_truncated_video(tmp_path: Path):
    file = video_of(tmp_path / "a.avi", GREY)
    file.write_bytes(file.read_bytes()[: os.path.getsize(file) // 2])
    held = open_video(file, 6)
    with pytest.raises(FileError, match=r"a\.avi ends after \d frames: it is truncated, or damaged there"):
        for index in range(6):
            held.load(index)


@pytest.mark.parametrize("content", [b"", b"this is no video"])
def test_what_is_no_video(tmp_path: Path, content: bytes):
    (tmp_path / "a.avi").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.avi cannot be read as a video"):
        open_video(tmp_path / "a.avi", 3)


@pytest.mark.parametrize(
    ("code", "stack", "codec"),
    [
        ("FFV1", GREY, ""),
        ("FFV1", COLOR, ""),
        ("HFYU", COLOR, ""),
        ("raw", GREY, ""),
        ("MJPG", GREY, "MJPG"),
        ("mp4v", GREY, "FMP4"),
    ],
)
def test_loss_is_told(tmp_path: Path, code: str, stack: np.ndarray, codec: str):
    file = video_of(tmp_path / "a.mkv", stack, code)
    notes = loss_notes([file, file], "scan")
    if codec:
        (note,) = notes
        assert note.startswith(f"{file} is compressed with loss ({codec}), which changes grey levels and blurs edges")
    else:
        assert notes == ()


def test_jpeg_is_told_once_whatever_its_name(tmp_path: Path):
    for name in ("a.jpg", "b.JPEG", "c.png"):
        (tmp_path / name).write_bytes(cv2.imencode(".png" if name == "b.JPEG" else ".jpg", GREY[0])[1].tobytes())
    (note,) = loss_notes([tmp_path / name for name in ("a.jpg", "b.JPEG", "c.png", "absent.jpg")], "scan")
    assert note == "scan: 2 of 4 pictures are JPEG, which changes grey levels and blurs edges: save PNG pictures"
    assert loss_notes([tmp_path / "b.JPEG"], "scan") == ()
