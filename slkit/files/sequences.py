"""Pictures of something that moves: a folder of them, a stack, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from slkit.data import Image
from slkit.errors import FileError
from slkit.files.folders import CaptureFolder, read_capture
from slkit.files.losses import loss_notes
from slkit.files.sources import find_frames, open_pictures
from slkit.files.videos import VIDEO_ENDINGS, video_frames

Load = Callable[[], Image]


@dataclass(frozen=True)
class PictureSequence:
    """capture: what was projected, and how. name: the source; files: its pictures, stacks and videos, in order.

    count: how many pictures there are; None where a video is among them, whose header may be wrong.
    """

    capture: CaptureFolder
    name: str
    files: tuple[Path, ...]
    count: int | None

    def loads(self) -> Iterator[Load]:
        """Yield one function a picture that returns it, (h, w) or RGB (h, w, 3); those of a video hold it already.

        Errors: FileError where a video cannot be opened, or, from the function, the picture cannot be read.
        """
        for file in self.files:
            if file.suffix.lower() in VIDEO_ENDINGS:
                yield from (lambda image=image: image for image in video_frames(file))
                continue
            held = open_pictures(file)
            for index in range(held.count):
                image = held.load(index) if held.in_turn else None
                yield partial(held.load, index) if image is None else lambda image=image: image

    def notes(self) -> tuple[str, ...]:
        """Return a sentence for each way in which the pictures were stored with loss."""
        return loss_notes(self.files, self.name)


def read_sequence(path: str | Path) -> PictureSequence:
    """Return the sequence of a folder with a capture.toml, of such a file, or of a video or stack with one beside it.

    In a folder `frames` names the pictures, in display order, or videos or stacks. Errors: FileError naming file and
    key.
    """
    capture = read_capture(path)
    if "" not in capture.source.roles:
        raise FileError(
            f"{capture.file}: a sequence needs `frames` as one pattern or list in display order, not by role"
        )
    files = find_frames(capture.source.folder, capture.source.roles[""], str(capture.file))
    if not files:
        raise FileError(f"{capture.file}: there are no pictures in {capture.source.folder}")
    known = all(file.suffix.lower() not in VIDEO_ENDINGS for file in files)
    count = sum(open_pictures(file).count for file in files) if known else None
    return PictureSequence(capture, str(path), tuple(files), count)
