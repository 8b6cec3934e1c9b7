"""Pictures between disk and memory; the only place where OpenCV's BGR order exists."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Frames, Image, describe_image
from slkit.device import threads
from slkit.errors import FileError, InputError
from slkit.files.atomic import make_folder, write_bytes
from slkit.files.stacks import STACK_ENDINGS, read_only_picture

PICTURE_ENDINGS = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".jpg", ".jpeg")
Progress = Callable[[str, int, int], None]
"""Told what is being done, how many steps are done, and how many there are."""

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_JPEG_PADDING = 4096  # some cameras append a block behind the end
# Frames under way for each thread that reads, and how many threads are worth it: the disk is one.
_AHEAD, _MOST_READERS = 2, 8
_NUMBERED = re.compile(r"\d{3,}_.+\.png", re.IGNORECASE)


def read_image(path: str | Path) -> Image:
    """Return a picture as it is stored: (h, w) grey or (h, w, 3) RGB, uint8 or uint16; also that of a .npy file.

    An alpha channel is dropped; an EXIF orientation is not applied, for a turned picture belongs to another camera.
    Errors: FileError naming a file that is absent, damaged, truncated, or not a picture of 8 or 16 bits.
    """
    import cv2

    path = Path(path)
    if path.suffix.lower() in STACK_ENDINGS:
        return read_only_picture(path)
    data = read_bytes(path)
    if data.startswith(_PNG_SIGNATURE) and not _png_is_whole(data):
        raise FileError(f"{path} is a damaged or truncated PNG picture: copy or take it again")
    if data.startswith(_JPEG_START) and _JPEG_END not in data[-_JPEG_PADDING:]:
        raise FileError(f"{path} is a truncated JPEG picture: copy or take it again")
    try:
        # Decoded from memory: cv2.imread accepts truncated files and fails on paths that are not ASCII on some systems.
        image: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise FileError(f"{path} cannot be read as a picture: it is damaged, truncated, or not a picture at all")
    if image.dtype not in (np.uint8, np.uint16):
        raise FileError(f"{path} holds {image.dtype} values: save it with 8 or 16 bits a channel")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    if image.ndim == 2:
        return image
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)


def write_png(path: str | Path, image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> None:
    """Write a picture, (h, w) grey or (h, w, 3) RGB, uint8 or uint16, as PNG, atomically.

    Errors: FileError where it cannot be written.
    """
    import cv2

    stored = image[..., ::-1] if image.ndim == 3 else image
    ok, data = cv2.imencode(".png", np.ascontiguousarray(stored))
    if not ok:
        raise InputError(f"{path}: a picture of shape {image.shape} and type {image.dtype} cannot be stored as PNG")
    write_bytes(path, data.tobytes())


def read_frames(paths: Sequence[Path], names: Sequence[str]) -> Frames:
    """Return the pictures of `paths` as frames called `names`; each is read from disk when it is asked for.

    Errors, at that moment: FileError for a picture that cannot be read, or that differs from the first in size,
    channels or depth.
    """
    if len(paths) != len(names):
        raise InputError(f"{len(paths)} pictures need as many names, not {len(names)}")
    return alike([(str(path), partial(read_image, path)) for path in paths], names)


def alike(sources: Sequence[tuple[str, Callable[[], Image]]], names: Sequence[str], in_turn: bool = False) -> Frames:
    """Return frames called `names` of one picture each: what to call it in messages, and what reads it.

    in_turn: as of `Frames`. Errors, when one is asked for: as `read_frames`.
    """
    first: list[str] = []

    def load(index: int) -> Image:
        where, read = sources[index]
        image = read()
        if not first:
            first.append(describe_image(image if index == 0 else sources[0][1]()))
        if describe_image(image) != first[0]:
            raise FileError(f"{where} is {describe_image(image)}, but {sources[0][0]} is {first[0]}")
        return image

    return Frames(tuple(names), load, in_turn)


@contextmanager
def reading_ahead(frames: Frames) -> Generator[Frames]:
    """Give frames that are read a few at a time on all cores, or in turn, before they are asked for in their order.

    The first is kept, since more than one asks for it; any other one is read anew when it is asked for again. Errors
    come when the frame is asked for, as from `frames` itself.
    """
    # Where compiled loops are held to fewer threads, other processes have the rest of the cores.
    workers = 1 if frames.in_turn else min(threads(), _MOST_READERS)
    waiting: dict[int, Future[Image]] = {}
    given: set[int] = set()
    with ThreadPoolExecutor(workers) as pool:

        def load(index: int) -> Image:
            if 0 not in waiting:
                # The others are compared with it.
                waiting[0] = pool.submit(frames.load, 0)
                waiting[0].result()
            for later in range(index, min(index + _AHEAD * workers, len(frames))):
                if later not in waiting and (later == index or later not in given):
                    waiting[later] = pool.submit(frames.load, later)
            given.add(index)
            return (waiting.pop(index) if index else waiting[0]).result()

        try:
            yield Frames(frames.names, load, frames.in_turn)
        finally:
            for future in waiting.values():
                future.cancel()


def write_frames(folder: str | Path, frames: Frames, progress: Progress | None = None) -> list[Path]:
    """Write frames as 000_name.png, 001_name.png ... in display order and return the paths.

    Errors: FileError where the folder holds numbered pictures of another set, which would mix with these.
    """
    folder = make_folder(folder)
    paths = [folder / f"{i:03d}_{name}.png" for i, name in enumerate(frames.names)]
    mine = {path.name for path in paths}
    others = sorted(p.name for p in folder.iterdir() if _NUMBERED.fullmatch(p.name) and p.name not in mine)
    if others:
        raise FileError(f"{folder} already holds pictures of another set ({others[0]}): choose an empty folder")
    for index, path in enumerate(paths):
        write_png(path, frames[index])
        if progress is not None:
            progress(f"write {folder.name}", index + 1, len(paths))
    return paths


def read_bytes(path: str | Path) -> bytes:
    """Return a file's content. Errors: FileError naming a file that is absent or cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror or error}") from error


def is_jpeg(path: Path) -> bool:
    """Whether a file begins as JPEG does, whatever its name; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(_JPEG_START)) == _JPEG_START
    except OSError:
        return False


def _png_is_whole(data: bytes) -> bool:
    """Walk the chunks to the end mark; their check sums find damage that a decoder may paint over."""
    place = len(_PNG_SIGNATURE)
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        end = place + 8 + length
        if end + 4 > len(data) or zlib.crc32(data[place + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            return False
        if data[place + 4 : place + 8] == b"IEND":
            return True
        place = end + 4
    return False
