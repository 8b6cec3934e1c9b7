"""What the one-shot colour codecs share: how their frames are read, and which labels bounds leave."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.codecs._masks import Reader
from slkit.data import Float32s, Frames, Image
from slkit.errors import InputError
from slkit.protocols import Bounds

REFERENCES = ("white", "black")
# Neighbouring rows see the same surface and err together: so many count as one.
CORRELATED_ROWS = 5.0
_LEAST_SIDE = 8


def read_colors(frames: Frames, names: list[str], what: str) -> tuple[Image, tuple[Image, Image] | None]:
    """Return the last frame (h, w, 3), and white and black where the frames `names` hold them before.

    what: the pattern, for messages. Errors: InputError where a frame does not fit, or the picture is grey or tiny.
    """
    reader = Reader(frames, names)
    *references, last = (reader.color(i) for i in range(len(frames)))
    levels = last[::3, ::3]
    if last.ndim != 3 or (np.ptp(levels) > 0 and bool((levels == levels[:, :, :1]).all())):
        raise InputError(f"frame {frames.names[-1]} is grey, but {what} need colour pictures")
    if min(last.shape[:2]) < _LEAST_SIDE:
        raise InputError(f"frame {frames.names[-1]} is only {last.shape[1]} x {last.shape[0]} px large")
    return last, (references[0], references[1]) if references else None


def limits_at(bounds: Bounds, xy: Float32s, axis: int) -> Float32s:
    """Return the smallest and the largest position in px (m, 2) that bounds allow at the pixels nearest to xy (m, 2).

    axis: 0: columns, 1: rows of the projector.
    """
    col, row = np.rint(xy).astype(np.intp).T
    near = bounds[np.clip(row, 0, bounds.shape[0] - 1), np.clip(col, 0, bounds.shape[1] - 1)]
    return near[:, 2 * axis : 2 * axis + 2]


def labels_within(limits: Float32s, first_px: float, period_px: float, count: int) -> npt.NDArray[np.int32]:
    """Return the first and the last label (m, 2) inside limits (m, 2) px, last < first for none.

    first_px: where label 0 lies; period_px: from one label to the next; count: how many there are.
    """
    places = (limits - first_px) / period_px
    known = np.isfinite(places).all(axis=1)
    places = np.nan_to_num(places)
    first = np.maximum(np.ceil(places[:, 0] - 0.5), 0)
    last = np.where(known, np.minimum(np.floor(places[:, 1] + 0.5), count - 1), -1)
    return np.stack([first, last], axis=1).astype(np.int32)


def any_label(rows: int, count: int) -> npt.NDArray[np.int32]:
    """Return limits (rows, 2) that rule out none of `count` labels."""
    return np.tile(np.array([0, count - 1], dtype=np.int32), (rows, 1))
