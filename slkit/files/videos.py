"""Videos: their frames in order, one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import Any

from slkit.data import Image
from slkit.errors import FileError
from slkit.files.stacks import Pictures

VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v")

# What OpenCV calls pixels of one channel: 8 bits under two names, 16 bits.
_GREY = (b"Y800", b"GREY", b"Y1\x00\x10")
_LOSSLESS = (b"FFV1", b"HFYU", b"FFVH", b"MPNG", b"ULRG", b"ULY0", b"ULY2", b"ULY4", b"LAGS", b"MAGY")
_RAW = (b"\0\0\0\0", b"I420", b"IYUV", b"YV12", b"YUY2", b"UYVY", b"Y800", b"GREY", b"Y16 ", b"DIB ", b"RAW ")


def video_frames(path: Path) -> Iterator[Image]:
    """Yield the frames of a video, (h, w) where it is stored as grey, else RGB (h, w, 3).

    Errors: FileError where it cannot be read.
    """
    reader = _opened(path)
    image = _next(reader)
    if image is None:
        raise _unreadable(path)
    while image is not None:
        yield image
        image = _next(reader)


def open_video(path: Path, needed: int) -> Pictures:
    """Return the frames of a video as pictures; they are counted, unless its header tells the number that is needed.

    Errors: FileError where it cannot be read, or, from `load`, where it ends before the frame.
    """
    import cv2

    reader = _opened(path)
    count = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
    if count != needed:
        # The header may be wrong: some containers hold no number, and it is worked out from the duration.
        count = 0
        while reader.grab():
            count += 1
    return Pictures(count, _Player(path).load, in_turn=True)


def codec_with_loss(path: Path) -> str:
    """Return the name of a video's codec, "" where it is one that keeps every value. Errors: FileError."""
    import cv2

    code = int(_opened(path).get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little")
    kept = code.upper() in (*_LOSSLESS, *_RAW)
    return "" if kept else code.decode("ascii", "replace").strip()


class _Player:
    """Reads a video forwards; an earlier frame is found from the start again, because seeking is not exact."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, Lock()
        self._reader: Any = None
        self._at = 0

    def load(self, index: int) -> Image:
        with self._lock:
            if self._reader is None or index < self._at:
                self._reader, self._at = _opened(self._path), 0
            while self._at < index and self._reader.grab():
                self._at += 1
            image = _next(self._reader) if self._at == index else None
            if image is None:
                self._reader = None
                raise FileError(f"{self._path} ends after {self._at} frames: it is truncated, or damaged there")
            self._at += 1
            return image


def _opened(path: Path) -> Any:
    import cv2

    reader = cv2.VideoCapture(str(path))
    if not reader.isOpened():
        raise _unreadable(path)
    if int(reader.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)).to_bytes(4, "little", signed=True) in _GREY:
        # As it is stored; else it would become colour, of 8 bits.
        reader.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return reader


def _next(reader: Any) -> Image | None:
    import cv2

    going, image = reader.read()
    if not going:
        return None
    picture: Any = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return picture


def _unreadable(path: Path) -> FileError:
    return FileError(f"{path} cannot be read as a video: it is damaged, empty, or of an unknown kind")
