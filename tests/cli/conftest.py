import gc
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import pytest

from slkit.files import read_image


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one object on standard output."""
        return json.loads(self.out)


@pytest.fixture
def slkit(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Outcome]:
    """Return a function that runs the command line in this process, as `slkit ARGUMENTS` would."""
    from slkit.cli import main

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["slkit", *map(str, arguments)])
        monkeypatch.setenv("OPENCV_LOG_LEVEL", "OFF")
        monkeypatch.setattr(gc, "set_threshold", lambda *_: None)
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main()
        out, err = capsys.readouterr()
        return Outcome(int(left.value.code or 0), out, err)

    return run


@pytest.fixture
def to_jpeg() -> Callable[..., int]:
    """Return a function that makes JPEG of a capture's PNG pictures, `share` times as bright, and tells how many."""

    def turn(folder: Path, share: float = 1) -> int:
        frames = sorted(folder.glob("0*.png"))
        for frame in frames:
            cv2.imwrite(str(frame.with_suffix(".jpg")), share * read_image(frame))
            frame.unlink()
        file = folder / "capture.toml"
        file.write_text(file.read_text().replace(".png", ".jpg"))
        return len(frames)

    return turn
