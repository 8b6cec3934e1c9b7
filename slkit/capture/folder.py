"""A scanner that replays the pictures of a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from slkit.data import Frames
from slkit.files import FrameSource


@dataclass(frozen=True)
class FolderScanner:
    """Replays pictures that any camera program has taken.

    folder: where they lie. pattern: a glob; natural order is display order; "" takes every picture.
    """

    folder: str
    pattern: str = ""

    def capture(self, patterns: Frames) -> Frames:
        """Return the folder's pictures under the names of the patterns; each is read when asked for.

        Errors: FileError where their number differs from the number of patterns.
        """
        source = FrameSource.of(Path(self.folder), self.pattern or None, self.folder)
        return source.frames(patterns.names, "the pattern set")
