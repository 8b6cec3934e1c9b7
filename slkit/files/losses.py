"""Tells of pictures that were compressed with loss."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from slkit.files.images import is_jpeg
from slkit.files.videos import VIDEO_ENDINGS, codec_with_loss

_HARM = "which changes grey levels and blurs edges"


def loss_notes(files: Iterable[Path], where: str) -> tuple[str, ...]:
    """Return a sentence about JPEG pictures among the files of a capture, and one a video that is not lossless.

    where: what to call the capture. Errors: FileError where a file cannot be read.
    """
    every = list(dict.fromkeys(files))
    videos = {file: codec_with_loss(file) for file in every if file.suffix.lower() in VIDEO_ENDINGS}
    jpegs = sum(is_jpeg(file) for file in every if file not in videos)
    told = [f"{where}: {jpegs} of {len(every)} pictures are JPEG, {_HARM}: save PNG pictures"] if jpegs else []
    return *told, *(
        f"{file} is compressed with loss ({codec}), {_HARM}: save PNG pictures, or a video in FFV1"
        for file, codec in videos.items()
        if codec
    )
