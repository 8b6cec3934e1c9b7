"""Where light goes in a scene: traced once, then valid for every pattern."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import _open3d
from slkit.geometry import Rig
from slkit.simulation.rig import field_radius, working_volume
from slkit.simulation.surface import Doubles, Scene

Mask = npt.NDArray[np.bool_]
Singles = npt.NDArray[np.float32]
_CHUNK = 1 << 17
# Part of the way to the projector that a shadow ray skips, so that a point does not shade itself: 0.1 mm at 1 m.
_LIFT = 1e-4
_SPREAD_PX = 4.0


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays found, one row a ray. seen: it met a surface; lit: the projector reaches that point unhindered.

    xyz (m, 3) mm and projector_xy (m, 2) px, NaN where unseen; albedo (m, 3); light (m,): the cosine at the surface
    over the squared distance to the projector in working distances, 0 in shadow.
    """

    seen: Mask
    lit: Mask
    xyz: Doubles
    projector_xy: Doubles
    albedo: Doubles
    light: Doubles


@dataclass(frozen=True, eq=False)
class LightField:
    """All samples of a camera image; k samples a pixel, c = 1 (neutral scene) or 3 channels.

    projector_xy (h, w, k, 2) px; weight (h, w, k, c): share of the projector's light that arrives in the pixel by way
    of a sample, 0 in shadow; albedo (h, w, c): the mean over the pixel, for ambient light. All float32.
    """

    projector_xy: Singles
    weight: Singles
    albedo: Singles


class Tracer:
    """A scene ready for rays from the camera of a rig.

    samples: a side of the grid of rays in a pixel; a print is averaged over the footprint of one ray.
    """

    def __init__(self, scene: Scene, rig: Rig, samples: int) -> None:
        self.scene, self.rig, self.samples = scene, rig, samples
        self.vertices, self.faces = scene.mesh()
        corners = self.vertices[self.faces]
        self.face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = _vertex_normals(scene)
        self.owner = np.repeat(np.arange(len(scene.surfaces)), [len(s.faces) for s in scene.surfaces])
        self.starts = np.cumsum([0, *(len(s.vertices) for s in scene.surfaces)])
        middle = working_volume(rig)[0]
        self.reference_mm = float(np.linalg.norm(middle - rig.projector_center))
        self.o3d = _open3d.load()
        self.raycaster: Any = self.o3d.t.geometry.RaycastingScene()
        tensor = self.o3d.core.Tensor
        self.raycaster.add_triangles(tensor(self.vertices.astype(np.float32)), tensor(self.faces.astype(np.uint32)))

    def field(self) -> LightField:
        """Trace samples x samples rays through every pixel."""
        width, height = self.rig.camera.size
        k, channels = self.samples**2, 3 if any(s.coloured for s in self.scene.surfaces) else 1
        xy = np.zeros((height, width, k, 2), dtype=np.float32)
        weight = np.zeros((height, width, k, channels), dtype=np.float32)
        albedo = np.zeros((height, width, channels), dtype=np.float32)
        offset = (np.arange(self.samples) + 0.5) / self.samples - 0.5
        shift = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(k, 2)

        def fill(rows: slice) -> None:
            grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)[rows]), axis=-1)
            shape = (*grid.shape[:2], k)
            hits = self.trace((grid[:, :, None, :] + shift).reshape(-1, 2))
            xy[rows] = np.where(hits.light[:, None] > 0, hits.projector_xy, 0).reshape(*shape, 2)
            colour = hits.albedo[:, :channels]
            weight[rows] = (colour * hits.light[:, None] / k).reshape(*shape, channels)
            albedo[rows] = colour.reshape(*shape, channels).mean(axis=2)

        with ThreadPoolExecutor() as pool:
            list(pool.map(fill, _bands(height, max(_CHUNK // (width * k), 1))))
        return LightField(xy, weight, albedo)

    def centers(self) -> Hits:
        """Trace one ray through the centre of every pixel, row by row."""
        width, height = self.rig.camera.size
        return self.trace(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2))

    def trace(self, camera_xy: npt.ArrayLike) -> Hits:
        """Follow rays through camera positions (m, 2) px to a surface and from there to the projector."""
        from slkit.simulation._kernels import illuminate, look, meet

        camera, pixels = self.rig.camera, np.asarray(camera_xy, dtype=np.float64)
        rays = np.empty((len(pixels), 3))
        look(pixels, camera.K, camera.distortion, rays)
        single = np.zeros((len(rays), 6), dtype=np.float32)
        single[:, 3:] = rays
        cast = self.raycaster.cast_rays(self.o3d.core.Tensor(single))
        depth = cast["t_hit"].numpy()
        seen = np.isfinite(depth) & (rays[:, 2] > 0)
        rays, depth = rays[seen], depth[seen].astype(np.float64)
        face = cast["primitive_ids"].numpy()[seen].astype(np.int64)
        uv = cast["primitive_uvs"].numpy()[seen].astype(np.float64)
        xyz, cosine = np.empty_like(rays), np.empty(len(rays))
        center, net = self.rig.projector_center, (self.vertices, self.faces, self.face_normals, self.normals)
        meet(rays, depth, face, uv, *net, center, xyz, cosine)
        projector, motion = self.rig.projector, self.rig.projector_from_camera
        pose = np.column_stack([motion.rotation, motion.translation])
        xy, radius = np.empty((len(xyz), 2)), 1.05 * field_radius(projector)
        off = illuminate(xyz, pose, projector.K, projector.distortion, radius, projector.size, xy)
        # A defocused border spreads past the image, but only what lies inside it can be decoded.
        light = self._unhidden(xyz, np.where(off < _SPREAD_PX, cosine, 0))
        return Hits(
            seen,
            _scatter(seen, (off <= 0) & (light > 0)),
            _scatter(seen, xyz, np.nan),
            _scatter(seen, xy, np.nan),
            _scatter(seen, self._albedo(xyz, face, uv)),
            _scatter(seen, light),
        )

    def _unhidden(self, xyz: Doubles, cosine: Doubles) -> Doubles:
        """Return the light (m,) that arrives at points, 0 where something stands in its way."""
        towards = self.rig.projector_center - xyz
        light = cosine * self.reference_mm**2 / (towards * towards).sum(axis=1)
        lit = np.flatnonzero(cosine > 0)
        if len(lit):
            rays = np.concatenate([xyz[lit], towards[lit]], axis=1).astype(np.float32)
            hidden = self.raycaster.test_occlusions(self.o3d.core.Tensor(rays), tnear=_LIFT, tfar=1.0).numpy()
            light[lit[hidden]] = 0
        return light

    def _albedo(self, xyz: Doubles, face: npt.NDArray[np.int64], uv: Doubles) -> Doubles:
        result = np.empty_like(xyz)
        owner = self.owner[face]
        for index, surface in enumerate(self.scene.surfaces):
            mine = owner == index
            if mine.any():
                corners = self.faces[face[mine]] - self.starts[index]
                footprint = float(np.mean(surface.vertices[:, 2])) / self.rig.camera.K[0, 0] / self.samples
                result[mine] = surface.reflectance(xyz[mine], corners, uv[mine], max(footprint, 0.0))
        return result


def _vertex_normals(scene: Scene) -> Doubles:
    vertices, faces = scene.mesh()
    corners = vertices[faces]
    # The length of the cross product weighs each triangle by its area.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], normals)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def _scatter(where: Mask, values: npt.NDArray[Any], empty: float = 0) -> npt.NDArray[Any]:
    result = np.full((len(where), *values.shape[1:]), empty, dtype=values.dtype)
    result[where] = values
    return result


def _bands(height: int, rows: int) -> Iterator[slice]:
    return (slice(start, min(start + rows, height)) for start in range(0, height, rows))
