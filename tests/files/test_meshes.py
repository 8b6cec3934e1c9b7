from pathlib import Path

import numpy as np
import pytest

from slkit.errors import FileError
from slkit.files import read_mesh


def test_reads_a_mesh(tmp_path: Path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    vertices, faces = read_mesh(tmp_path / "a.obj")
    assert sorted(vertices.tolist()) == [[0, 0, 0], [0, 2, 0], [1, 0, 0]]
    assert np.asarray(faces).shape == (1, 3)


@pytest.mark.parametrize(("name", "content"), [("a.obj", "v 0 0 0\n"), ("a.ply", "nonsense"), ("a.xyzzy", "")])
def test_names_what_is_no_mesh(tmp_path: Path, name: str, content: str):
    (tmp_path / name).write_text(content)
    with pytest.raises(FileError, match=name):
        read_mesh(tmp_path / name)


def test_absent(tmp_path: Path):
    with pytest.raises(FileError, match="no mesh file"):
        read_mesh(tmp_path / "none.stl")
