"""Ideal cameras that see a projector through a known map: what a codec is tried on without geometry or optics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Frames, Image
from slkit.protocols import Bounds

Floats = npt.NDArray[np.floating[Any]]

_DARK, _BRIGHT, _NOISE = 30.0, 220.0, 1.0
_UNLIT_SHARE = 0.2


@dataclass(frozen=True)
class View:
    """A camera of shape (h, w) whose pixel (c, r) sees the projector position `see(c, r)`.

    projector: size (w, h) px. Left of column unlit_px, and beyond the projector's image, nothing is lit.
    """

    name: str
    shape: tuple[int, int]
    projector: tuple[int, int]
    see: Callable[[Floats, Floats], tuple[Floats, Floats]]
    unlit_px: int = 0

    def truth(self, camera_xy: Floats) -> npt.NDArray[np.float64]:
        """Return the projector positions (n, 2) px that camera positions (n, 2) px see."""
        xy = np.asarray(camera_xy, dtype=np.float64)
        return np.stack(self.see(xy[:, 0], xy[:, 1]), axis=1, dtype=np.float64)

    def picture(self, pattern: Image, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        """Return what the camera sees of a pattern (h, w) or (h, w, 3), in that form.

        A little blurred, 30 to 220 of 255 grey levels, with a noise of 1.
        """
        rows, cols = np.indices(self.shape, dtype=np.float64)
        x, y = self.see(cols, rows)
        sent = pattern / np.iinfo(pattern.dtype).max
        channels = np.moveaxis(np.atleast_3d(sent), 2, 0)
        share = np.stack([_bilinear(_blurred(channel), x, y) for channel in channels], axis=-1)
        share[:, : self.unlit_px] = 0
        share = share[..., 0] if pattern.ndim == 2 else share
        seen = _DARK + (_BRIGHT - _DARK) * share + rng.normal(0, _NOISE, share.shape)
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)

    def capture(self, patterns: Frames) -> Frames:
        """Return one picture a pattern."""
        rng = np.random.default_rng(1)
        return Frames.of([self.picture(pattern, rng) for pattern in patterns], patterns.names)

    def margin(self) -> npt.NDArray[np.float64]:
        """Return how far inside what is lit each camera pixel looks, (h, w) px, negative outside."""
        rows, cols = np.indices(self.shape, dtype=np.float64)
        x, y = self.see(cols, rows)
        width, height = self.projector
        return np.minimum.reduce([x, width - 1 - x, y, height - 1 - y, cols - self.unlit_px])

    def bounds(self, slack_px: float, shift_px: float = 0.0) -> Bounds:
        """Return bounds (h, w, 4) around the truth, give or take slack_px, shifted by shift_px."""
        rows, cols = np.indices(self.shape, dtype=np.float64)
        x, y = (position + shift_px for position in self.see(cols, rows))
        return np.stack([x - slack_px, x + slack_px, y - slack_px, y + slack_px], axis=-1).astype(np.float32)


def views_of(size: tuple[int, int]) -> tuple[View, View, View]:
    """Return a camera pixel for projector pixel, one that is mirrored and warped, and one turned by 90 degrees."""
    width, height = size
    wide, high = round(width * 1.2), round(height * 1.2)
    straight = View("a camera that sees the projector pixel for pixel", (height, width), size, lambda c, r: (c, r))

    def mirror(c: Floats, r: Floats) -> tuple[Floats, Floats]:
        return width - 1 - c / 1.2 - np.sin(r / 15), r / 1.2 + np.sin(c / 20)

    def turn(c: Floats, r: Floats) -> tuple[Floats, Floats]:
        return r / 1.2 + np.sin(c / 20), height - 1 - c / 1.2 - np.sin(r / 15)

    mirrored = View("a mirrored, warped camera", (high, wide), size, mirror, round(wide * _UNLIT_SHARE))
    turned = View("a camera turned by 90 degrees", (wide, high), size, turn, round(high * _UNLIT_SHARE))
    return straight, mirrored, turned


def _blurred(picture: Floats) -> Floats:
    """Return a picture filtered by (1 2 1) / 4 along both axes, a blur of 0.7 px; outside it is dark."""
    wide = np.pad(picture, 1)
    tall = (wide[:, :-2] + 2 * wide[:, 1:-1] + wide[:, 2:]) / 4
    return (tall[:-2] + 2 * tall[1:-1] + tall[2:]) / 4


def _bilinear(picture: Floats, x: Floats, y: Floats) -> Floats:
    height, width = picture.shape
    inside = (x > -1) & (x < width) & (y > -1) & (y < height)
    padded = np.pad(picture, 1)
    x, y = np.where(inside, x, 0) + 1, np.where(inside, y, 0) + 1
    col, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    u, v = x - col, y - row
    top = padded[row, col] * (1 - u) + padded[row, col + 1] * u
    low = padded[row + 1, col] * (1 - u) + padded[row + 1, col + 1] * u
    return np.where(inside, top * (1 - v) + low * v, 0.0)
