"""Pictures without a display: a cloud as shaded splats, from several sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.errors import InputError

Doubles = npt.NDArray[np.floating[Any]]

_TOP, _BOTTOM = np.array([248.0, 249.0, 251.0]), np.array([216.0, 220.0, 226.0])
_CLAY = np.array([0.82, 0.79, 0.74])
_INK = (84, 88, 96)
_LARGEST_SPLAT = 5
_COARSEST = 12  # a sparse cloud is drawn in larger pixels, not with larger discs
_FAR = 1e9
# Where light comes from in a frame with x right, y down, z away, and how strong it is.
_LIGHTS = ((np.array([-0.45, -0.65, -0.61]), 0.62), (np.array([0.75, -0.15, -0.65]), 0.22))
_AMBIENT = 0.26


@dataclass(frozen=True)
class View:
    """One panel: its caption, and how far the object is turned about the vertical and tipped towards us, in degrees."""

    caption: str
    turn_deg: float
    tip_deg: float


VIEWS = (View("from the front", 10.0, 6.0), View("turned 40 degrees", -40.0, 10.0), View("from above", 10.0, 60.0))


def draw_cloud(
    cloud: PointCloud,
    size: tuple[int, int] = (1280, 960),
    views: tuple[View, ...] = VIEWS,
    colored: bool = False,
    frame_xyz: Doubles | None = None,
) -> npt.NDArray[np.uint8]:
    """Return an RGB picture (h, w, 3) of a cloud: the first view large, the others in a column beside it.

    size (width, height) px. Splats with a depth buffer, as large as the density of the points asks for, shaded by
    normals from the neighbourhood; parallel projection with a scale bar in mm in every panel. colored: paint the
    colours that the camera saw; else the cloud looks like clay. frame_xyz (n, 3) mm: the points that fill each panel,
    default the cloud's own; clouds drawn with the same ones have one scale. Errors: InputError for a size below 320 x
    240 px.
    """
    width, height = size
    if width < 320 or height < 240 or not views:
        raise InputError(f"a picture of a cloud needs 320 x 240 px and one view or more, not {width} x {height} px")
    shade = np.linspace(0, 1, height)[:, None, None]
    picture = np.repeat(_TOP + (_BOTTOM - _TOP) * shade, width, axis=1)
    cloud = cloud.select(cloud.finite)
    color = cloud.color if colored else None
    panels = _panels(width, height, len(views)) if len(cloud) else []
    frame = cloud.xyz if frame_xyz is None else frame_xyz
    scales = [
        _draw(picture[y : y + h, x : x + w], cloud.xyz @ _turn(view).T, color, frame @ _turn(view).T)
        for (x, y, w, h), view in zip(panels, views, strict=False)
    ]
    final = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    for panel, view, mm_per_px in zip(panels, views, scales, strict=False):
        _caption(final, panel, view.caption, mm_per_px)
    count = f"{len(cloud):,} points".replace(",", " ")
    cv2.putText(final, count, (16, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _INK, 1, cv2.LINE_AA)
    return final


def _panels(width: int, height: int, count: int) -> list[tuple[int, int, int, int]]:
    """Return x, y, w, h of a large panel and of a column of small ones."""
    if count == 1:
        return [(0, 0, width, height)]
    large, small = width * 5 // 8, height // (count - 1)
    return [(0, 0, large, height)] + [(large, i * small, width - large, small) for i in range(count - 1)]


def _turn(view: View) -> npt.NDArray[np.float64]:
    a, b = np.deg2rad([view.turn_deg, view.tip_deg])
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tip = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return tip @ turn


def _draw(panel: Doubles, xyz: Doubles, color: Doubles | None, frame: Doubles) -> float:
    """Draw points (n, 3) mm, in the viewer's frame, with colours (n, 3) into a panel; return its mm per px.

    frame (k, 3) mm: the points that fill the panel.
    """
    height, width = panel.shape[:2]
    # Percentiles: a few strays must not shrink the object to a dot.
    low, high = np.percentile(frame, [0.3, 99.7], axis=0)
    span = np.maximum(high - low, 1e-3)
    mm_per_px = float(max(span[0] / (width * 0.88), span[1] / (height * 0.82)))
    place = (xyz - (low + high) / 2) / mm_per_px + np.array([width / 2, height / 2 - 14, 0])
    flat, inside, shape, radius, coarse = _raster(place, width, height)
    layers: list[Doubles] = [np.ones(len(flat)), place[inside, 2] / coarse]
    layers += [] if color is None else list(color[inside].T)
    mean, mask = _splat(flat, layers, shape, radius)
    paint = _CLAY if color is None else np.moveaxis(mean[1:], 0, -1)
    lit = 255 * np.clip(paint * _light(mean[0], mask)[..., None], 0, 1)
    cover, edge, sharp = (
        # Cropping, because a raster of coarse cells reaches over the panel's rim.
        cv2.resize(v, None, fx=coarse, fy=coarse, interpolation=cv2.INTER_LINEAR)[:height, :width]
        for v in (
            cv2.GaussianBlur(mask.astype(np.float64), (0, 0), 0.7),
            cv2.GaussianBlur(np.where(mask[..., None], lit, 0), (0, 0), 0.7),
            lit,
        )
    )
    panel[:] = np.where(cover[..., None] > 0.999, sharp, edge + (1 - cover[..., None]) * panel)
    return mm_per_px


def _raster(
    place: Doubles, width: int, height: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_], tuple[int, int], int, int]:
    """Return where each point inside falls, which points those are, the shape of the raster, disc radius and step.

    step: px a cell of the raster; the smallest at which discs of a moderate radius close the gaps.
    """
    coarse = 0
    while True:
        coarse += 1
        shape = (-(-height // coarse), -(-width // coarse))
        col, row = np.floor(place[:, :2] / coarse).astype(np.intp).T
        inside = (col >= 0) & (col < shape[1]) & (row >= 0) & (row < shape[0])
        flat = (row * shape[1] + col)[inside]
        radius = _radius(np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape) > 0)
        if radius <= _LARGEST_SPLAT or coarse == _COARSEST:
            return flat, inside, shape, min(radius, _LARGEST_SPLAT), coarse


def _splat(
    flat: npt.NDArray[np.intp], layers: list[Doubles], shape: tuple[int, int], radius: int
) -> tuple[Doubles, npt.NDArray[np.bool_]]:
    """Return the layers after the first (weights) as pictures (n, h, w) of discs around points, and their mask (h, w).

    flat: place of each point in the picture. The second layer is the depth in px: only the nearest surface is kept.
    Source: surface splatting in two passes, a depth buffer and then a weighted mean of what lies near its front.
    """
    front = np.full(shape, _FAR, dtype=np.float32)
    np.minimum.at(front.ravel(), flat, layers[1].astype(np.float32))
    disc, thickness = _disc(radius), np.float32(3 * radius)
    # The smallest depth under a disc is what a depth buffer of discs holds.
    nearest = cv2.erode(front, disc, borderType=cv2.BORDER_REPLICATE)
    visible = layers[1] <= front.ravel()[flat] + thickness
    sums = np.stack([np.bincount(flat[visible], v[visible], front.size).reshape(shape) for v in layers])
    padded = np.pad(sums.astype(np.float32), ((0, 0), (radius, radius), (radius, radius)))
    depths = np.pad(front, radius, constant_values=_FAR)
    total = np.zeros_like(sums, dtype=np.float32)
    for dy, dx in np.argwhere(disc):
        part = np.s_[..., dy : dy + shape[0], dx : dx + shape[1]]
        near = np.exp(-((dy - radius) ** 2 + (dx - radius) ** 2) / np.float32(0.5 * radius * radius + 0.5))
        total += padded[part] * (np.float32(near) * (depths[part] <= nearest + thickness))
    # The discs close gaps; taking their rim away again keeps outlines where the points are.
    mask = (
        cv2.erode((total[0] > 0).astype(np.uint8), _disc(radius - 1), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    )
    return np.where(mask, total[1:] / np.maximum(total[0], 1e-12), 0).astype(np.float64), mask


def _disc(radius: int) -> npt.NDArray[np.uint8]:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)).astype(np.uint8)


def _radius(hit: npt.NDArray[np.bool_]) -> int:
    """Return the radius in px of discs that close the gaps between the points; large where it cannot be told."""
    seen = hit.astype(np.uint8)
    wide, wider = (cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((n, n), np.uint8)) for n in (15, 31))
    if wide.sum() < 0.75 * wider.sum():
        return _LARGEST_SPLAT + 1
    gaps = cv2.distanceTransform(1 - seen, cv2.DIST_L2, 3)[wide > 0]
    return max(int(np.ceil(np.percentile(gaps, 95))) + 1, 2) if len(gaps) else 2


def _light(depth: Doubles, mask: npt.NDArray[np.bool_]) -> Doubles:
    """Return how bright each pixel is (h, w): two lamps on the normals, and less light in hollows."""
    smooth = _blur(depth, mask, 1.2)
    slopes = np.stack([_slope(smooth, mask, axis) for axis in (1, 0)])
    slopes = np.stack([_blur(s, mask, 1.0) for s in slopes])
    normal = np.concatenate([slopes, -np.ones((1, *depth.shape))])
    normal /= np.linalg.norm(normal, axis=0)
    light = np.full(depth.shape, _AMBIENT)
    for direction, strength in _LIGHTS:
        light += strength * np.clip(np.tensordot(direction, normal, 1), 0, None)
    size = max(depth.shape)
    hollow = np.clip((depth - _blur(depth, mask, size / 60)) / (size / 20), 0, 1)
    return (light * (1 - 0.5 * hollow) * 1.08).astype(np.float64)


def _slope(depth: Doubles, mask: npt.NDArray[np.bool_], axis: int) -> Doubles:
    """Return the derivative of depth along an axis, from the side with the smaller step at edges."""
    known = np.where(mask, depth, np.nan)
    step = np.diff(known, axis=axis)
    blank = np.full_like(np.take(known, [0], axis=axis), np.nan)
    before, after = np.concatenate([blank, step], axis=axis), np.concatenate([step, blank], axis=axis)
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    jump = np.abs(before - after) > 4
    return np.clip(np.nan_to_num(np.where(jump, smaller, (before + after) / 2)), -8, 8)


def _blur(values: Doubles, mask: npt.NDArray[np.bool_], sigma: float) -> Doubles:
    """Return a Gaussian mean over the masked pixels only."""
    weight = cv2.GaussianBlur(mask.astype(np.float64), (0, 0), sigma)
    blurred = cv2.GaussianBlur(np.where(mask, values, 0.0), (0, 0), sigma)
    return np.where(mask, blurred / np.maximum(weight, 1e-9), 0.0)


def _caption(picture: npt.NDArray[np.uint8], panel: tuple[int, int, int, int], text: str, mm_per_px: float) -> None:
    """Write a caption and a scale bar of a round length into the lower left corner of a panel."""
    left, bottom = panel[0] + 16, panel[1] + panel[3]
    longest = panel[2] * mm_per_px / 4
    power = 10.0 ** np.floor(np.log10(longest))
    length = power * max(n for n in (1, 2, 5) if n * power <= longest)
    end = left + round(length / mm_per_px)
    cv2.line(picture, (left, bottom - 18), (end, bottom - 18), _INK, 2)
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, f"{length:g} mm", (end + 8, bottom - 13), font, 0.45, _INK, 1, cv2.LINE_AA)
    cv2.putText(picture, text, (left, bottom - 30), font, 0.45, _INK, 1, cv2.LINE_AA)
