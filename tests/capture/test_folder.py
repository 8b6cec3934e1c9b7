from pathlib import Path

import numpy as np
import pytest

from slkit.capture import FolderScanner
from slkit.data import Frames
from slkit.errors import FileError
from slkit.files import write_png
from slkit.protocols import Scanner


def test_replays_pictures_in_display_order(tmp_path: Path):
    for i in (2, 10, 1):
        write_png(tmp_path / f"IMG_{i}.png", np.full((3, 4), i, np.uint8))
    scanner = FolderScanner(str(tmp_path))
    assert isinstance(scanner, Scanner)
    patterns = Frames.of([np.zeros((2, 2), np.uint8)] * 3, ["white", "black", "x_0"])
    seen = scanner.capture(patterns)
    assert seen.names == patterns.names
    assert [int(image[0, 0]) for image in seen] == [1, 2, 10]
    with pytest.raises(FileError, match="has 1 pictures, but the pattern set needs 3"):
        FolderScanner(str(tmp_path), "IMG_2*").capture(patterns)
