"""Pictures of something that moves: a folder of them, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slkit.data import Image
from slkit.errors import FileError
from slkit.files.folders import CaptureFolder, read_capture
from slkit.files.images import read_image
from slkit.files.sources import find_files

VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v")
Load = Callable[[], Image]


@dataclass(frozen=True)
class PictureSequence:
    """capture: what was projected, and how. name, video: the source; files: the pictures, empty for a video."""

    capture: CaptureFolder
    name: str
    files: tuple[Path, ...]
    video: Path | None

    @property
    def count(self) -> int | None:
        """How many pictures there are; None for a video, whose header may be wrong."""
        return None if self.video is not None else len(self.files)

    def loads(self) -> Iterator[Load]:
        """Yield one function a picture that returns it, (h, w) or RGB (h, w, 3); those of a video hold it already.

        Errors: FileError where the video cannot be opened, or, from the function, the picture cannot be read.
        """
        if self.video is not None:
            for image in _frames(self.video):
                yield lambda image=image: image
            return
        for file in self.files:
            yield lambda file=file: read_image(file)


def read_sequence(path: str | Path) -> PictureSequence:
    """Return the sequence of a folder with a capture.toml, of such a file, or of a video with a capture.toml beside it.

    In a folder `frames` names the pictures, in display order, or one video. Errors: FileError naming file and key.
    """
    path = Path(path)
    given = path if path.suffix.lower() in VIDEO_ENDINGS else None
    if given is not None and not given.is_file():
        raise FileError(f"there is no video {given}")
    capture = read_capture(path if given is None else given.parent)
    if given is not None:
        return PictureSequence(capture, str(path), (), given)
    if "" not in capture.source.roles:
        raise FileError(
            f"{capture.file}: a sequence needs `frames` as one pattern or list in display order, not by role"
        )
    files = find_files(capture.source.folder, capture.source.roles[""], str(capture.file))
    if len(files) == 1 and files[0].suffix.lower() in VIDEO_ENDINGS:
        return PictureSequence(capture, str(path), (), files[0])
    if not files:
        raise FileError(f"{capture.file}: there are no pictures in {capture.source.folder}")
    return PictureSequence(capture, str(path), tuple(files), None)


def _frames(video: Path) -> Iterator[Image]:
    import cv2

    reader = cv2.VideoCapture(str(video))
    try:
        going, image = reader.read()
        if not going:
            raise FileError(f"{video} cannot be read as a video: it is damaged, empty, or of an unknown kind")
        while going:
            picture: Any = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
            yield picture
            going, image = reader.read()
    finally:
        reader.release()
