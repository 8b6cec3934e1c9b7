"""Small parts of a picture, evenly spread, in which noise is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._noise import Evidence

# Rows and columns of a tile in px: one pixel in so many, but as many pixels as this at least, and at most.
_TILE, _SAMPLE_SHARE, _SAMPLE_PX = (8, 32), 5, (60_000, 600_000)


@dataclass(frozen=True, eq=False)
class Tiles:
    """Small parts of a picture, laid one below the other: rows, cols (r,) where each of their rows begins.

    shape: (r, c) of all tiles together; inner (r, 1): rows whose neighbours above and below are theirs in the picture,
    too.
    """

    rows: npt.NDArray[np.int64]
    cols: npt.NDArray[np.int64]
    shape: tuple[int, int]
    inner: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> Tiles:
        """Return tiles spread over a picture (h, w), or all of a small one."""
        height, width = shape
        high, wide = _TILE
        count = np.sqrt(np.clip(height * width // _SAMPLE_SHARE, *_SAMPLE_PX) / (high * wide))
        down, across = (int(np.ceil(count * r)) for r in (np.sqrt(height / width), np.sqrt(width / height)))
        if down * high >= height or across * wide >= width:
            return cls(np.arange(height), np.zeros(height, np.int64), (height, width), np.ones((height, 1), np.bool_))
        top, left = (
            np.linspace(0, last, n).astype(np.int64) for last, n in ((height - high, down), (width - wide, across))
        )
        rows = (np.repeat(top, across)[:, None] + np.arange(high)).ravel()
        inner = np.tile([False, *[True] * (high - 2), False], down * across)
        return cls(rows, np.repeat(np.tile(left, down), high), (len(rows), wide), inner[:, None])

    def cut(self, picture: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the pixels of the tiles (r, c)."""
        return picture[self.rows[:, None], self.cols[:, None] + np.arange(self.shape[1])]

    def usable(self) -> npt.NDArray[np.bool_]:
        """Return a mask (r, c) of the inner rows."""
        return np.broadcast_to(self.inner, self.shape).copy()


def sampled(picture: npt.NDArray[Any], saturated: npt.NDArray[np.bool_]) -> Evidence:
    """Return tiles of a picture (h, w), evenly spread, that show its noise as well as all of it."""
    from slkit.codecs._noise_kernels import cut_tiles

    tiles = Tiles.of(picture.shape)
    level, usable = np.empty(tiles.shape, np.float32), tiles.usable()
    cut_tiles(picture, saturated, tiles.rows, tiles.cols, level, usable)
    return Evidence(level, level, usable)
