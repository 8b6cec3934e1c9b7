"""Poses of a calibration: as pictures, and as points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data.clouds import Correspondences
from slkit.data.frames import Image


@dataclass(frozen=True, eq=False)
class Capture:
    """One pose of a calibration, as pictures or as coded light that is decoded already.

    printed, marks, projected: pictures (h, w) or (h, w, 3), None where the method has none. lit (h, w): the fully lit
    picture that belongs to `correspondences`.
    """

    name: str
    printed: Image | None = None
    marks: Image | None = None
    projected: Image | None = None
    lit: Image | None = None
    correspondences: Correspondences | None = None


@dataclass(frozen=True, eq=False)
class BoardView:
    """What one pose of a board says, one row a point; every capture protocol ends in these.

    board_xy (n, 2) mm in the board's plane, NaN for a projected point that is not printed on it;
    camera_xy (n, 2) px; projector_xy (n, 2) px, NaN for a point whose projector pixel is not known;
    sigma (n, 2): 1 sigma of projector_xy in projector px, 0 where it is exact by construction, NaN where unknown.
    face (n,): on which flat face of a solid target the row lies, None for a board, which has one.
    image_size (width, height) px of the camera. problem: why the view cannot be used, or None (then it has no rows).
    notes: what a person should know of a view that is used.
    """

    name: str
    image_size: tuple[int, int]
    board_xy: npt.NDArray[np.floating[Any]]
    camera_xy: npt.NDArray[np.floating[Any]]
    projector_xy: npt.NDArray[np.floating[Any]]
    sigma: npt.NDArray[np.floating[Any]]
    problem: str | None = None
    notes: tuple[str, ...] = ()
    face: npt.NDArray[np.intp] | None = None

    @classmethod
    def unusable(cls, name: str, image_size: tuple[int, int], problem: str) -> BoardView:
        """Return a view without rows that says why."""
        empty = np.empty((0, 2))
        return cls(name, image_size, empty, empty, empty, empty, problem)

    def select(self, keep: npt.NDArray[Any]) -> BoardView:
        """Return the view with the rows named by a mask (n,) or by indices."""
        columns = {name: getattr(self, name)[keep] for name in ("board_xy", "camera_xy", "projector_xy", "sigma")}
        return replace(self, **columns, face=None if self.face is None else self.face[keep])

    @property
    def faces(self) -> npt.NDArray[np.intp]:
        """The face (n,) of each row, 0 on a board."""
        return np.zeros(len(self.camera_xy), dtype=np.intp) if self.face is None else self.face

    @property
    def printed(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of the rows whose place on the board is known."""
        return np.asarray(np.isfinite(self.board_xy).all(axis=1))

    @property
    def projected(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of the rows whose projector pixel is known."""
        return np.asarray(np.isfinite(self.projector_xy).all(axis=1))
