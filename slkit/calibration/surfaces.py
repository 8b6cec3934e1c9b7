"""What a target looks like in space: flat or slightly bent sheets, and solids with flat faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slkit.calibration._parameters import Array
from slkit.geometry import Pose

Faces = npt.NDArray[np.intp]
_STEPS = 8


@runtime_checkable
class Surface(Protocol):
    """A surface in its own frame, on which printed points lie and projected light falls."""

    def place(self, board_xy: Array, face: Faces) -> Array:
        """Return the points (n, 3) mm of places (n, 2) mm on the faces (n,)."""
        ...

    def intersect(self, origin: Array, direction: Array, face: Faces) -> tuple[Array, Array]:
        """Return where rays meet the faces (n,): points (n, 3) mm and normals (n, 3) of any length.

        origin (n, 3) mm; direction (n, 3) of any length. A ray that misses gives what is not finite.
        """
        ...


@dataclass(frozen=True, eq=False)
class Sheet:
    """A board, flat or bent: z = wx (1 - x^2) + wy (1 - y^2) with x, y from -1 to 1 over its printed points.

    warp (2,): wx and wy in mm; center, half (2,): middle and half extent of the printed points in mm.
    Source: the board warp of mrcal.
    """

    warp: Array
    center: Array
    half: Array

    @classmethod
    def flat(cls, board_xy: Array) -> Sheet:
        """Return the flat sheet with those printed points (n, 2) mm."""
        low, high = board_xy.min(axis=0), board_xy.max(axis=0)
        return cls(np.zeros(2), (low + high) / 2, np.maximum((high - low) / 2, 1e-9))

    def profile(self, xy: Array) -> Array:
        """Return how much each of the two numbers of the warp raises places (n, 2) mm, (n, 2)."""
        return 1 - ((xy - self.center) / self.half) ** 2

    def place(self, board_xy: Array, face: Faces) -> Array:
        """Return the points (n, 3) mm; a sheet has one face."""
        return np.column_stack([board_xy, self.profile(board_xy) @ self.warp])

    def intersect(self, origin: Array, direction: Array, face: Faces) -> tuple[Array, Array]:
        """Return where rays meet the sheet, by Newton's method from the flat one."""
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -origin[:, 2] / direction[:, 2]
            points = origin + along[:, None] * direction
            normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
            for _ in range(_STEPS if self.warp.any() else 0):
                places = (points[:, :2] - self.center) / self.half
                normals[:, :2] = 2 * self.warp * places / self.half
                above = points[:, 2] - self.profile(points[:, :2]) @ self.warp
                step = above / (normals * direction).sum(axis=1)
                points = points - step[:, None] * direction
                if not np.nanmax(np.abs(above), initial=0) > 1e-10:
                    break
        return points, normals


@dataclass(frozen=True, eq=False)
class Solid:
    """An object with flat faces at known places. solid_from_face: one pose a face."""

    solid_from_face: Sequence[Pose]

    def place(self, board_xy: Array, face: Faces) -> Array:
        """Return the points (n, 3) mm, in the solid's frame, of places on its faces."""
        turns, shifts = self._faces(face)
        return np.einsum("nij,nj->ni", turns[:, :, :2], board_xy) + shifts

    def intersect(self, origin: Array, direction: Array, face: Faces) -> tuple[Array, Array]:
        """Return where rays meet the planes of the faces."""
        turns, shifts = self._faces(face)
        normals = turns[:, :, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((shifts - origin) * normals).sum(axis=1) / (direction * normals).sum(axis=1)
            return origin + along[:, None] * direction, normals

    def _faces(self, face: Faces) -> tuple[Array, Array]:
        turns = np.array([p.rotation for p in self.solid_from_face])
        shifts = np.array([p.translation for p in self.solid_from_face])
        return turns[face], shifts[face]


@dataclass(frozen=True, eq=False)
class PointSet:
    """Points without a surface: `face` numbers them. xyz (k, 3) mm."""

    xyz: Array

    def place(self, board_xy: Array, face: Faces) -> Array:
        """Return the points that the faces name."""
        return self.xyz[face]

    def intersect(self, origin: Array, direction: Array, face: Faces) -> tuple[Array, Array]:
        """Return NaN: a ray meets no point."""
        nowhere = np.full(origin.shape, np.nan)
        return nowhere, nowhere
