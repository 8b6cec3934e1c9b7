"""The wall, the rig and the exact pairs of points that all benchmarks share, and the least time of several calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from slkit.codecs._line_kernels import find_rows
from slkit.codecs._line_scales import REACH, LineRule, Room, Scales
from slkit.codecs._rows import over_large_blocks
from slkit.data import Correspondences, Frames
from slkit.geometry import Pinhole, Pose, Rig, homogeneous

PROJECTOR = (1024, 768)
NOISE = 2.0  # grey levels
SMALL, LARGE = (1024, 768), (4096, 3000)


def least_seconds(work: Callable[[], object], times: int = 5) -> float:
    """Return the least time by the clock that a call takes, after one that does not count."""
    work()
    seconds: list[float] = []
    for _ in range(times):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def rig_of(width: int, height: int, projector: tuple[int, int] = PROJECTOR) -> Rig:
    """Return a rig with distortion in both devices, of 4:3 and such sizes in px, that see the same square metre."""
    pose = Pose.from_rotation_vector([0, 0.25, 0], [-250, 0, 30])
    return Rig(_lens((width, height), [-0.1, 0.02, 0, 0, 0]), _lens(projector, [-0.05, 0.01, 0, 0, 0]), pose)


def _lens(size: tuple[int, int], distortion: list[float]) -> Pinhole:
    focal = 1300 * size[0] / 1024
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Pinhole(size, matrix, np.array(distortion))


def wall(rig: Rig) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Give camera pixels (n, 2), the projector pixels (n, 2) and the points (n, 3) mm of a waved wall, by rows."""
    width, height = rig.camera.size
    # A few rows at a time: all of a large picture would take gigabytes.
    for rows in np.array_split(np.arange(height), 24):
        camera_xy = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).reshape(-1, 2).astype(np.float32)
        rays = homogeneous(rig.camera.normalize(camera_xy))
        xyz = rays * (1000 + 60 * np.sin(7 * rays[:, :1]) * np.cos(9 * rays[:, 1:2]))
        yield camera_xy, rig.to_projector(xyz).astype(np.float32), xyz.astype(np.float32)


@lru_cache(maxsize=1)
def seen_at(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Return the projector column and row (h, w) that each pixel of the camera sees on the wall."""
    width, height = rig.camera.size
    projector_xy = np.concatenate([lit for _, lit, _ in wall(rig)]).reshape(height, width, 2)
    return np.ascontiguousarray(projector_xy[..., 0]), np.ascontiguousarray(projector_xy[..., 1])


def seen(codec: Any, rig: Rig) -> Frames:
    """Return what the camera sees of a codec's patterns on an ellipse of the wall, with noise."""
    (width, height), rng = rig.camera.size, np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    lit = ((x / width - 0.5) / 0.46) ** 2 + ((y / height - 0.5) / 0.46) ** 2 < 1
    paint = np.where(lit, 0.5 + 0.25 * np.sin(9 * x / width) * np.cos(7 * y / height), 0)
    noise = [rng.normal(10, NOISE, (height, width)).astype(np.float32) for _ in range(3)]
    pictures = []
    for k, pattern in enumerate(codec.encode()):
        light = cv2.remap(pattern.astype(np.float32), *seen_at(rig), cv2.INTER_LINEAR)
        level = cv2.GaussianBlur(light, (0, 0), 0.7) * paint + noise[k % 3]
        pictures.append(np.clip(np.rint(level), 0, 255).astype(np.uint8))
    return Frames.of(pictures, codec.encode().names)


def middle_of(picture: np.ndarray) -> np.ndarray:
    """Return the middle of a picture (h, w), all of which is lit."""
    height, width = picture.shape
    return picture[height // 3 : -height // 3, width // 3 : -width // 3]


def within(found: np.ndarray, true: np.ndarray, limit: float = 1.0) -> bool:
    """Tell whether a map (h, w) is right within a limit in all but 2 % of its middle."""
    return float((np.abs(middle_of(found) - middle_of(true)) <= limit).mean()) > 0.98


def right(found: Correspondences, rig: Rig) -> bool:
    """Tell whether all but 2 % of projector columns are right within 1 px."""
    true = map_coordinates(seen_at(rig)[0], found.camera_xy.T[::-1], order=1)
    return float((np.abs(found.projector_xy[:, 0] - true) <= 1).mean()) > 0.98


def pairs(rig: Rig) -> tuple[Correspondences, np.ndarray]:
    """Return what every pixel sees of the wall that the projector lights, exactly, and the points (n, 3) mm."""
    parts = []
    for part in wall(rig):
        lit = ((part[1] >= 0) & (part[1] <= np.array(rig.projector.size) - 1)).all(axis=1)
        parts.append([a[lit] for a in part])
    camera_xy, projector_xy, xyz = (np.concatenate(part) for part in zip(*parts, strict=True))
    ones = np.ones(len(xyz), np.float32)
    return Correspondences(camera_xy, projector_xy, np.full_like(camera_xy, 0.1), ones, np.ones_like(xyz)), xyz


def with_columns_only(found: Correspondences) -> Correspondences:
    """Return the same without what the projector's rows say."""
    projector_xy, sigma = found.projector_xy.copy(), found.sigma.copy()
    projector_xy[:, 1] = sigma[:, 1] = np.nan
    return Correspondences(found.camera_xy, projector_xy, sigma, found.confidence, found.color)


def lines(rig: Rig) -> Any:
    """Return a picture (h, w) of lines 6 px apart, the variance of its noise, and where the line of a row near x is."""
    (width, height), rng = rig.camera.size, np.random.default_rng(0)
    shift = 0.5 * np.sin(np.arange(height) / 40)
    away = (np.arange(width) - shift[:, None] - 8 + 3) % 6 - 3
    picture = np.exp(-(away**2) / 2).astype(np.float32)
    picture += rng.normal(0, 0.01, picture.shape).astype(np.float32)
    return (
        picture,
        np.full_like(picture, 0.01**2),
        lambda row, x: 8 + 6 * np.rint((x - shift[row] - 8) / 6) + shift[row],
    )


def lines_by_kernels(picture: np.ndarray, variance: np.ndarray, scale: float, spacing: float) -> tuple[np.ndarray, ...]:
    """Return row, column, its sigma, contrast, noise and value of all lines in a picture (h, w), by one kernel.

    scale: sigma in px of the kernel; spacing: px between lines.
    """
    reach, width, pace = int(np.ceil(REACH * scale)), picture.shape[1], 8.0
    bell = np.exp(-((np.arange(reach + 1) / scale) ** 2) / 2)
    least, square = (np.array([a], np.float32) for a in (0, scale**2))
    scales = Scales(np.inf, least, square, np.array([reach]), bell[None].astype(np.float32))
    rule = LineRule(0.0, pace, pace, -np.inf, np.inf, -np.inf, -np.inf)
    parts: dict[int, tuple[np.ndarray, ...]] = {}

    def scratch(most: int) -> tuple[np.ndarray, ...]:
        mask, value, slope = np.ones((most, width), bool), np.zeros((most, width), np.float32), pace / spacing
        runs = np.array([[0, width, 0]] * most, np.int32)
        return (
            mask,
            mask,
            value,
            np.full_like(value, slope),
            value.astype(np.uint8),
            runs,
            np.empty((most * (width // 2 + 1), 5)),
        )

    def work(rows: slice, aside: tuple[np.ndarray, ...]) -> None:
        count = rows.stop - rows.start
        *scene, found = *(a[:count] for a in aside[:-1]), aside[-1]
        starts, ends = np.arange(count + 1, dtype=np.int32), np.zeros(count + 1, np.int32)
        find_rows(picture[rows], variance[rows], *scene, starts, scales, rule, Room.of(width, scales), found, ends)
        parts[rows.start] = np.repeat(np.arange(rows.start, rows.stop), np.diff(ends)), *found[: ends[-1]].T.copy()

    over_large_blocks(scratch, work, picture.shape)
    return tuple(np.concatenate(part) for part in zip(*(parts[first] for first in sorted(parts)), strict=True))
