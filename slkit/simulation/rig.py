"""Virtual rigs, the volume that a rig can measure, and boards at poses that it can see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose, Rig, homogeneous, intersect_rays

Doubles = npt.NDArray[np.float64]


def paper_rig() -> Rig:
    """Return the rig of the paper: 768 x 576 camera, 1024 x 768 off-axis projector, 0.5 m apart, at work at 1.1 m.

    One projector pixel is about half a camera pixel. Source: Fernandez and Salvi (2011), text at Fig. 8, for sizes and
    baseline; focal lengths, principal points and distortion are assumed.
    """
    camera = _pinhole((768, 576), 900.0, (386.0, 285.0), (-0.2, 0.0, 0.0006, -0.0004, 0.0))
    projector = _pinhole((1024, 768), 1900.0, (508.0, 830.0), (-0.04, 0.01, 0.0004, 0.0003, 0.0))
    return _aimed(camera, projector, np.array([-490.0, 99.5, 0.0]), 1100.0)


def one_to_one_rig() -> Rig:
    """Return a rig with one projector column a camera column at the working distance of 1 m; baseline 250 mm.

    The projector stands lower and throws upwards, so rows lie 5 % closer than columns.
    """
    camera = _pinhole((1024, 768), 1300.0, (514.0, 380.0), (-0.1, 0.02, 0.0004, -0.0003, 0.0))
    projector = _pinhole((1024, 768), 1302.0, (509.0, 810.0), (-0.03, 0.01, 0.0003, 0.0002, 0.0))
    return _aimed(camera, projector, np.array([-200.0, 150.0, 0.0]), 1000.0)


def random_rig(rng: np.random.Generator) -> Rig:
    """Return a rig drawn from ranges that hobby and industrial rigs span.

    Working distance 600 to 1500 mm; baseline 0.2 to 0.45 of it, in any direction, also vertical; focal lengths 1.1 to
    1.3 (camera) and 1.7 to 2.2 (projector) image widths; camera k1 -0.25 to 0.1, projector k1 -0.06 to 0.06; the
    projector's principal point between the middle of its image and 15 % of the height below it.
    """
    distance = rng.uniform(600, 1500)
    width, height = ((640, 480), (768, 576), (1024, 768))[rng.integers(3)]
    center = (width * rng.uniform(0.47, 0.53), height * rng.uniform(0.47, 0.53))
    lens = (rng.uniform(-0.25, 0.1), rng.uniform(-0.03, 0.05), *rng.uniform(-1e-3, 1e-3, 2), 0.0)
    camera = _pinhole((width, height), width * rng.uniform(1.1, 1.3), center, lens)
    width, height = ((800, 600), (1024, 768), (1280, 800))[rng.integers(3)]
    center = (width * rng.uniform(0.47, 0.53), height * rng.uniform(0.5, 1.15))
    lens = (rng.uniform(-0.06, 0.06), rng.uniform(-0.02, 0.02), *rng.uniform(-5e-4, 5e-4, 2), 0.0)
    projector = _pinhole((width, height), width * rng.uniform(1.7, 2.2), center, lens)
    angle, length = rng.uniform(0, 2 * np.pi), distance * rng.uniform(0.2, 0.45)
    return _aimed(
        camera, projector, length * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.2, 0.2)]), distance
    )


def working_distance(rig: Rig) -> float:
    """Return the depth in mm at which the rays through both image centres are nearest.

    Errors: InputError where the two devices do not look at a common place in front of the camera.
    """
    camera, projector = (homogeneous(d.normalize(_center(d))) for d in (rig.camera, rig.projector))
    axis = rig.projector_from_camera.rotation.T @ projector
    middle, _ = intersect_rays(np.zeros(3), camera, rig.projector_center, axis)
    baseline = float(np.linalg.norm(rig.projector_center))
    if 0.3 * baseline < middle[2] < 30 * baseline:
        return float(middle[2])
    # Parallel axes meet nowhere: then the nearest depth that shares nearly as much as any other is the place to work.
    depths = baseline * np.geomspace(0.5, 20, 40)
    shared = np.array([in_view(rig, _sheet(rig, depth)).mean() for depth in depths])
    if not shared.max() > 0:
        raise InputError("camera and projector of this rig share no volume: check projector_from_camera")
    return float(depths[np.flatnonzero(shared >= 0.9 * shared.max())[0]])


def working_volume(rig: Rig) -> tuple[Doubles, float]:
    """Return centre (3,) and radius, in mm, of a ball that camera and projector share at the working distance."""
    points = _sheet(rig, working_distance(rig)).reshape(-1, 3)
    shared = in_view(rig, points)
    if not shared.any():
        raise InputError("camera and projector of this rig share no volume: check projector_from_camera")
    inside, outside = points[shared], points[~shared]
    reach = np.array([np.linalg.norm(outside - p, axis=1).min() for p in inside])
    wide = reach >= 0.97 * reach.max()
    from_middle = np.linalg.norm(inside - inside.mean(axis=0), axis=1)
    best = np.flatnonzero(wide)[np.argmin(from_middle[wide])]
    # A ball is nearer to the devices than the sheet on which it was measured, and frustums are narrower there.
    radius = float(reach[best])
    while not in_view(rig, inside[best] + radius * _sphere_points()).all():
        radius *= 0.97
    return inside[best], 0.99 * radius


def in_view(rig: Rig, xyz: npt.ArrayLike, margin_px: float = 0.0) -> npt.NDArray[np.bool_]:
    """Return the mask (...) of points (..., 3) mm inside both images by a margin; hidden or not is not asked."""
    return seen_by(rig.camera, xyz, margin_px) & seen_by(rig.projector, rig.projector_from_camera.apply(xyz), margin_px)


def seen_by(device: Pinhole, xyz: npt.ArrayLike, margin_px: float = 0.0) -> npt.NDArray[np.bool_]:
    """Return the mask (...) of points (..., 3) mm of the device's own frame that lie inside its image by a margin."""
    xyz = np.asarray(xyz, dtype=np.float64)
    width, height = device.size
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y = np.moveaxis(device.project(xyz), -1, 0)
        inside = (x >= margin_px - 0.5) & (x <= width - 0.5 - margin_px)
        inside &= (y >= margin_px - 0.5) & (y <= height - 0.5 - margin_px)
        radius = np.linalg.norm(xyz[..., :2], axis=-1) / xyz[..., 2]
    # The distortion polynomial folds back: a point far outside the field of view can land inside the image.
    return inside & (radius <= 1.02 * field_radius(device))


def field_radius(device: Pinhole) -> float:
    """Return the largest distance from the optical axis, in normalised units, that the image's border shows."""
    width, height = device.size
    x, y = np.linspace(-0.5, width - 0.5, 33), np.linspace(-0.5, height - 0.5, 33)
    rows = [np.stack([x, np.full(33, v)], axis=-1) for v in (y[0], y[-1])]
    columns = [np.stack([np.full(33, u), y], axis=-1) for u in (x[0], x[-1])]
    return float(np.nanmax(np.linalg.norm(device.normalize(np.concatenate(rows + columns)), axis=-1)))


def _sphere_points(count: int = 400) -> Doubles:
    """Return points (count, 3) spread evenly over the unit sphere, on a golden spiral."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=-1)


def _pinhole(size: tuple[int, int], focal: float, center: tuple[float, float], lens: tuple[float, ...]) -> Pinhole:
    return Pinhole(size, np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]]), np.array(lens))


def _aimed(camera: Pinhole, projector: Pinhole, position: Doubles, distance_mm: float) -> Rig:
    """Return a rig whose projector stands at `position` and whose image centres meet at the distance."""
    target = homogeneous(camera.normalize(_center(camera))) * distance_mm
    there = _frame(homogeneous(projector.normalize(_center(projector))))
    rotation = there @ _frame(target - position).T
    return Rig(camera, projector, Pose(rotation, -rotation @ position))


def _frame(axis: Doubles) -> Doubles:
    z = axis / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _center(device: Pinhole) -> Doubles:
    return (np.array(device.size, dtype=np.float64) - 1) / 2


def _sheet(rig: Rig, depth_mm: float) -> Doubles:
    """Return points (29, 37, 3) mm of a plane at that depth, a little wider than the camera's view."""
    width, height = rig.camera.size
    rays = rig.camera.normalize([[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]])
    x = np.linspace(1.05 * rays[0, 0], 1.05 * rays[1, 0], 37)
    y = np.linspace(1.05 * rays[2, 1], 1.05 * rays[3, 1], 29)
    return homogeneous(np.stack(np.meshgrid(x, y), axis=-1)) * depth_mm
