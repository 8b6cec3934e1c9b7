"""From maps of a picture to the rows of a result, and their colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._rows import over_rows
from slkit.data import Correspondences, Float32s, Image

Mask = npt.NDArray[np.bool_]
Longs = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Rows:
    """The fields of `Correspondences`, grey for colour (n,), with room for as many rows as there may be."""

    camera_xy: Float32s
    projector_xy: Float32s
    sigma: Float32s
    confidence: Float32s
    grey: Float32s

    @classmethod
    def room_for(cls, count: int) -> Rows:
        """Return room for so many rows."""
        # One piece of memory: a large one is given in large pages, which come at a fraction of the time.
        memory = np.empty((8, count), dtype=np.float32)
        camera_xy, projector_xy, sigma = memory[:6].reshape(3, count, 2)
        return cls(camera_xy, projector_xy, sigma, memory[6], memory[7])

    def correspondences(self, lit: Image, count: int) -> Correspondences:
        """Return the first so many rows; a colour picture (h, w, 3) gives its colours, any other has given grey."""
        grey = np.broadcast_to(self.grey[:count, None], (count, 3))
        color = grey if lit.ndim == 2 else colors_at(lit, self.camera_xy[:count])
        found = (field[:count] for field in (self.camera_xy, self.projector_xy, self.sigma, self.confidence))
        return Correspondences(*found, color=color)


def row_counts(mask: Mask) -> tuple[Longs, int]:
    """Return how many pixels of a mask (h, w) lie above each of its rows (h,), and how many there are."""
    from slkit.codecs._run_kernels import count_rows

    counts = np.empty(len(mask), dtype=np.int64)
    count_rows(mask, counts)
    return np.cumsum(counts) - counts, int(counts.sum())


def collect(
    mask: Mask, places: Mapping[int, tuple[Float32s, Float32s]], confidence: Float32s, lit: Image
) -> Correspondences:
    """Return one correspondence for each pixel of mask (h, w), at the pixel's centre.

    places: position and sigma (h, w) px of each coded axis, 0 for x and 1 for y; confidence (h, w); lit (h, w) or
    (h, w, 3): where the colours come from.
    """
    from slkit.codecs._run_kernels import write_maps, write_seen, write_values

    starts, total = row_counts(mask)
    out, (grey, brightest) = Rows.room_for(total), grey_of(lit)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        kept, at = mask[part], starts[part]
        write_seen(first, kept, grey[part], brightest, at, out.camera_xy, out.grey)
        write_values(kept, confidence[part], at, out.confidence)
        for axis, (position, sigma) in places.items():
            write_maps(kept, position[part], sigma[part], axis, len(places) == 1, at, out.projector_xy, out.sigma)

    over_rows(work, len(mask))
    return out.correspondences(lit, total)


def grey_of(lit: Image) -> tuple[Image, float]:
    """Return one channel (h, w) of a picture, for the grey of rows, and the brightest level of all, at least 1."""
    return lit if lit.ndim == 2 else lit[..., 0], float(max(int(lit.max()), 1))


def colors_at(lit: Image, camera_xy: Float32s) -> Float32s:
    """Return the colours (m, 3), 0 to 1 of the picture's brightest level, at the pixels nearest to camera_xy (m, 2)."""
    height, width = lit.shape[:2]
    cols, rows = np.rint(camera_xy).astype(np.intp).T
    found = lit[np.clip(rows, 0, height - 1), np.clip(cols, 0, width - 1)].astype(np.float32)
    found = found / np.float32(grey_of(lit)[1])
    return np.repeat(found[:, None], 3, axis=1) if lit.ndim == 2 else found
