"""Surfaces of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import FileError


def read_mesh(path: str | Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return vertices (n, 3), in the file's own unit, and faces (k, 3) of any mesh file that trimesh reads.

    Errors: FileError where the file is absent, unreadable, or holds no triangles.
    """
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise FileError(f"there is no mesh file {path}")
    try:
        mesh: Any = trimesh.load_mesh(str(path))
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's readers raise whatever their formats make them raise
        raise FileError(f"{path} cannot be read as a mesh: {error}") from error
    if not len(faces) or not np.isfinite(vertices).all():
        raise FileError(f"{path} holds no triangles, or vertices that are not finite")
    return vertices, faces
