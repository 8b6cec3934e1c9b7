"""Things to scan: shapes generated in code, boards, and the catalogue that fits them to a rig."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Floats, Pose, Rig
from slkit.simulation.rig import working_volume
from slkit.simulation.sculpture import sculpture
from slkit.simulation.surface import NEUTRAL, Print, Scene, Surface, net_faces
from slkit.targets import Target

__all__ = [
    "SCENES",
    "Print",
    "Scene",
    "Surface",
    "board",
    "build",
    "dumbbell",
    "fitted_mesh",
    "free_form",
    "from_mesh",
    "plane",
    "sphere",
    "step_wedge",
]


def plane(
    distance_mm: float,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    size_mm: tuple[float, float] = (600.0, 450.0),
    center_xy_mm: tuple[float, float] = (0.0, 0.0),
    albedo: npt.ArrayLike = NEUTRAL,
) -> Scene:
    """Return a rectangle at a depth in mm, turned about its x and then its y axis by two angles in degrees."""
    pose = Pose.from_rotation_vector([0, np.radians(tilt_deg[1]), 0], [*center_xy_mm, distance_mm])
    pose = pose @ Pose.from_rotation_vector([np.radians(tilt_deg[0]), 0, 0], np.zeros(3))
    half_x, half_y = size_mm[0] / 2, size_mm[1] / 2
    return Scene((Surface(*_rectangle(pose, (-half_x, -half_y, half_x, half_y)), albedo),))


def sphere(center_xyz: npt.ArrayLike, radius_mm: float, albedo: npt.ArrayLike = NEUTRAL) -> Scene:
    """Return a ball; its triangles stay within radius / 20 000 of the true sphere."""
    return Scene((_ball(center_xyz, radius_mm, albedo),))


def dumbbell(
    center_xyz: npt.ArrayLike,
    radius_mm: float,
    spacing_mm: float,
    direction: npt.ArrayLike = (1.0, 0.0, 0.0),
    bar_radius_mm: float = 0.0,
    albedo: npt.ArrayLike = NEUTRAL,
) -> Scene:
    """Return two balls whose centres lie spacing_mm apart along a direction (3,); bar_radius_mm > 0 joins them."""
    along = np.asarray(direction, dtype=np.float64)
    half = along / np.linalg.norm(along) * spacing_mm / 2
    center = np.asarray(center_xyz, dtype=np.float64)
    surfaces = [_ball(center - half, radius_mm, albedo), _ball(center + half, radius_mm, albedo)]
    if bar_radius_mm > 0:
        surfaces.append(_bar(center - half, center + half, bar_radius_mm, albedo))
    return Scene(tuple(surfaces))


def step_wedge(
    center_xyz: npt.ArrayLike,
    step_mm: float,
    steps: int = 5,
    size_mm: tuple[float, float] = (300.0, 200.0),
    albedo: npt.ArrayLike = NEUTRAL,
) -> Scene:
    """Return a staircase across x whose treads face the camera, each step_mm nearer than the last, risers included."""
    if steps < 1:
        raise InputError(f"a step wedge needs at least one step, not {steps}")
    x = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, steps + 1)
    z = -step_mm * (np.arange(steps) - (steps - 1) / 2)
    outline = np.stack([np.repeat(x, 2)[1:-1], np.repeat(z, 2)], axis=1)
    surfaces: list[Surface] = []
    for (x0, z0), (x1, z1) in zip(outline[:-1], outline[1:], strict=True):
        y = size_mm[1] / 2
        corners = np.array([[x0, -y, z0], [x1, -y, z1], [x1, y, z1], [x0, y, z0]]) + np.asarray(center_xyz)
        if not np.allclose(corners[0], corners[1]):
            surfaces.append(Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), albedo))
    return Scene(tuple(surfaces))


def free_form(center_xyz: npt.ArrayLike, scale: float = 1.0, coloured: bool = False) -> Scene:
    """Return a sculpted head on a collar: smooth forms, fine relief, occlusions; 308 mm across at scale 1."""
    return Scene(sculpture(np.asarray(center_xyz, dtype=np.float64), scale, coloured))


def from_mesh(
    vertices: Floats,
    faces: npt.NDArray[np.integer],
    camera_from_object: Pose | None = None,
    albedo: npt.ArrayLike = NEUTRAL,
) -> Scene:
    """Return a mesh in mm, placed by camera_from_object or as it stands. Errors: InputError for a broken mesh."""
    surface = Surface(vertices, faces, albedo)
    return Scene((surface,)).moved(camera_from_object or Pose.identity())


def fitted_mesh(rig: Rig, vertices: Floats, faces: npt.NDArray[np.integer]) -> Scene:
    """Return a mesh of any unit, scaled and shifted into the volume that the rig measures, its axes kept."""
    scene = from_mesh(vertices, faces)
    points = scene.mesh()[0]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.linalg.norm(points - middle, axis=1).max()
    if not size > 0:
        raise InputError("the mesh has no extent: all its vertices coincide")
    center, radius = working_volume(rig)
    return from_mesh((points - middle) * (radius / size) + center, faces)


Extent = tuple[float, float, float, float]
Bend = tuple[float, float]
"""How far a sheet is from flat: sagitta in mm, towards the camera where negative, and the direction across the bend in
degrees from the board's x."""

_FACETS = 48


def board(target: Target, camera_from_board: Pose, sheet: Extent | None = None, bend: Bend = (0.0, 0.0)) -> Scene:
    """Return a sheet with a printed target: side A (Checkerboard) or side B (CornerMarks).

    sheet: x min, y min, x max, y max in mm of the paper, blank beyond the print; None for target.extent().
    """
    corners = sheet or target.extent()
    printed = Print(target, camera_from_board)
    if bend[0] == 0:
        return Scene((Surface(*_rectangle(camera_from_board, corners), printed),))
    axes = (np.linspace(low, high, _FACETS + 1) for low, high in zip(corners[:2], corners[2:], strict=True))
    xy = np.stack(np.meshgrid(*axes), axis=-1)
    xyz = np.concatenate([xy, bent_mm(xy, target.extent(), bend)[..., None]], axis=-1)
    return Scene((_net(camera_from_board.apply(xyz), printed),))


def bent_mm(board_xy: Floats, extent: Extent, bend: Bend) -> Floats:
    """Return the board's z (...) in mm at places (..., 2) mm of a sheet bent to a parabolic cylinder.

    extent: x min, y min, x max, y max of the sheet. z is 0 along the middle and the sagitta at the sheet's edges.
    """
    angle = np.radians(bend[1])
    across = np.array([np.cos(angle), np.sin(angle)])
    half = np.abs(across) @ [(extent[2] - extent[0]) / 2, (extent[3] - extent[1]) / 2]
    middle = [(extent[0] + extent[2]) / 2, (extent[1] + extent[3]) / 2]
    return bend[0] * ((board_xy - middle) @ across / half) ** 2


_ROD_SLANT_DEG = -20.0
_ROD_RADIUS = 2.5 / 219.4
"""In radii of the working volume: a rod 5 mm thick on the paper's rig."""


def _plane_for(rig: Rig) -> Scene:
    center, radius = working_volume(rig)
    return plane(float(center[2]), (12.0, -15.0), (1.6 * radius, 1.2 * radius), (float(center[0]), float(center[1])))


def _sphere_for(rig: Rig) -> Scene:
    center, radius = working_volume(rig)
    return sphere(center, 0.6 * radius)


def _dumbbell_for(rig: Rig) -> Scene:
    center, radius = working_volume(rig)
    return dumbbell(center, 0.32 * radius, 1.2 * radius, (1.0, 0.15, 0.2), 0.06 * radius)


def _wedge_for(rig: Rig) -> Scene:
    center, radius = working_volume(rig)
    return step_wedge(center, 0.1 * radius, 5, (1.5 * radius, radius))


def _rod_for(rig: Rig) -> Scene:
    """Return a plane with a thin rod that stands free before it, slanted across the baseline.

    Along a row come plane, rod and plane, and the rod's projector column belongs between others of the plane.
    """
    center, radius = working_volume(rig)
    x, y, z = (float(v) for v in center)
    behind = plane(z + 0.15 * radius, (4.0, -6.0), (1.5 * radius, 1.1 * radius), (x, y))
    angle = np.arctan2(*rig.projector_center[1::-1]) + np.radians(90 + _ROD_SLANT_DEG)
    half = 0.5 * radius * np.array([np.cos(angle), np.sin(angle), 0.15])
    middle = center - [0, 0, 0.2 * radius]
    return Scene((*behind.surfaces, _bar(middle - half, middle + half, _ROD_RADIUS * radius, NEUTRAL)))


def _free_form_for(rig: Rig, coloured: bool = False) -> Scene:
    center, radius = working_volume(rig)
    return free_form(center, radius / 178, coloured)


SCENES: dict[str, Callable[[Rig], Scene]] = {
    "plane": _plane_for,
    "sphere": _sphere_for,
    "dumbbell": _dumbbell_for,
    "step-wedge": _wedge_for,
    "rod": _rod_for,
    "free-form": _free_form_for,
    "color-free-form": lambda rig: _free_form_for(rig, coloured=True),
}
"""Builders by name; each puts its object into the volume that camera and projector of a rig share."""


def build(name: str, rig: Rig) -> Scene:
    """Return the catalogue's scene of that name for a rig. Errors: InputError listing the names."""
    if name not in SCENES:
        raise InputError(f"there is no scene called {name!r}; there are: {', '.join(SCENES)}")
    return SCENES[name](rig)


def _rectangle(pose: Pose, corners: tuple[float, float, float, float]) -> tuple[Floats, npt.NDArray[np.int64]]:
    x0, y0, x1, y1 = corners
    flat = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    return pose.apply(flat), np.array([[0, 1, 2], [0, 2, 3]])


def _ball(center_xyz: npt.ArrayLike, radius_mm: float, albedo: npt.ArrayLike) -> Surface:
    if not 0 < radius_mm < np.inf:
        raise InputError(f"radius_mm must be a positive length, not {radius_mm}")
    polar, around = np.meshgrid(np.linspace(0, np.pi, 241), np.linspace(0, 2 * np.pi, 481), indexing="ij")
    unit = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=-1)
    return _net(np.asarray(center_xyz) + radius_mm * unit, albedo)


def _bar(start: Floats, end: Floats, radius_mm: float, albedo: npt.ArrayLike) -> Surface:
    along = (end - start) / np.linalg.norm(end - start)
    across = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    angle = np.linspace(0, 2 * np.pi, 121)[:, None]
    ring = radius_mm * (np.cos(angle) * across + np.sin(angle) * np.cross(along, across))
    # The rims stand there twice, as creases between the side and the flat ends.
    first, last = start + ring, end + ring
    return _net(np.stack([start + 0 * ring, first, first, last, last, end + 0 * ring]), albedo)


def _net(points: Floats, albedo: npt.ArrayLike | Print) -> Surface:
    """Return a net of points (r, c, 3) as triangles."""
    return Surface(points.reshape(-1, 3), net_faces(*points.shape[:2]), albedo)
