"""What a scene is made of: triangles and how they reflect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Floats, Pose, as_floats
from slkit.targets import Target

Doubles = npt.NDArray[np.float64]
NEUTRAL = (0.8, 0.8, 0.8)


@dataclass(frozen=True, eq=False)
class Print:
    """A target printed on a flat surface; camera_from_board places the target's frame (mm)."""

    target: Target
    camera_from_board: Pose


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in the camera frame. vertices (n, 3) mm; faces (k, 3) indices.

    albedo: one RGB triple 0 to 1, one a vertex (n, 3), or a Print. Normals are interpolated between vertices: give a
    crease its vertices twice. Errors: InputError where shapes, indices or albedo are out of range.
    """

    vertices: Floats
    faces: npt.NDArray[np.integer]
    albedo: npt.ArrayLike | Print = NEUTRAL

    def __post_init__(self) -> None:
        vertices = as_floats(self.vertices, (None, 3), "vertices")
        faces = np.array(self.faces, dtype=np.int64)
        if faces.ndim != 2 or faces.shape[1] != 3 or not faces.size:
            raise InputError(f"faces must have the shape n x 3 with n > 0, not {' x '.join(map(str, faces.shape))}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"faces name vertices outside 0 to {len(vertices) - 1}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        if not isinstance(self.albedo, Print):
            shape = (3,) if np.ndim(self.albedo) < 2 else (len(vertices), 3)
            albedo = as_floats(self.albedo, shape, "albedo")
            if albedo.min(initial=0) < 0 or albedo.max(initial=0) > 1:
                raise InputError("albedo must lie between 0 and 1")
            object.__setattr__(self, "albedo", albedo)

    @property
    def coloured(self) -> bool:
        """Whether any point reflects red, green and blue differently."""
        return not isinstance(self.albedo, Print) and bool(np.ptp(np.asarray(self.albedo), axis=-1).max() > 0)

    def reflectance(self, xyz: Floats, corners: npt.NDArray[np.integer], uv: Floats, footprint_mm: float) -> Doubles:
        """Return the albedo (m, 3) at points xyz (m, 3) mm of this surface.

        corners (m, 3): the vertices of each point's triangle; uv (m, 2): its coordinates towards the second
        and third; footprint_mm: the width over which a print is averaged.
        """
        if isinstance(self.albedo, Print):
            place = self.albedo.camera_from_board.inverse().apply(xyz)[:, :2]
            return np.repeat(self.albedo.target.reflectance(place, footprint_mm)[:, None], 3, axis=1)
        albedo = np.asarray(self.albedo, dtype=np.float64)
        if albedo.ndim == 1:
            return np.broadcast_to(albedo, (len(xyz), 3))
        first, second, third = (albedo[corners[:, k]] for k in range(3))
        return first + uv[:, :1] * (second - first) + uv[:, 1:] * (third - first)


@dataclass(frozen=True, eq=False)
class Scene:
    """Surfaces in the camera frame that may hide and shade each other. Errors: InputError where there is none."""

    surfaces: tuple[Surface, ...]

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise InputError("a scene needs at least one surface")

    def mesh(self) -> tuple[Doubles, npt.NDArray[np.int64]]:
        """Return all surfaces as one mesh: vertices (n, 3) in mm and faces (k, 3)."""
        starts = np.cumsum([0, *(len(s.vertices) for s in self.surfaces)])
        vertices = np.concatenate([np.asarray(s.vertices, dtype=np.float64) for s in self.surfaces])
        faces = np.concatenate([s.faces + start for s, start in zip(self.surfaces, starts[:-1], strict=True)])
        return vertices, faces.astype(np.int64)

    def moved(self, pose: Pose) -> Scene:
        """Return the scene after a rigid motion of the camera frame."""
        return Scene(tuple(_move(surface, pose) for surface in self.surfaces))


def _move(surface: Surface, pose: Pose) -> Surface:
    albedo = surface.albedo
    if isinstance(albedo, Print):
        albedo = Print(albedo.target, pose @ albedo.camera_from_board)
    return Surface(pose.apply(surface.vertices), surface.faces, albedo)


def net_faces(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return the triangles (k, 3) of a net of rows x columns vertices, numbered row by row."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    first = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    second = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return np.concatenate([first, second])
