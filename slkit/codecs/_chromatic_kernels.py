"""The centre of a slit in each channel of a picture."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from slkit.codecs._slit_kernels import _REACH, _SCALES, _crossing

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]


@numba.njit(cache=True, nogil=True)
def channel_centers(
    picture: npt.NDArray[Any],
    row: Wholes,
    col: Singles,
    width: Singles,
    lit: npt.NDArray[np.bool_],
    center: Doubles,
    weight: Doubles,
) -> None:
    """Write where slits at row, col (m,) px of a picture (h, w, 3) are in each channel that shows them, lit (m, 3).

    width (m,) px; center (m, 3) px, NaN where there is none; weight (m, 3): one over its variance, but for the noise.
    """
    height, wide = picture.shape[0], picture.shape[1]
    line = np.empty(2 * int(np.ceil(_REACH * _SCALES[-1])) + 5, dtype=np.float32)
    for k in range(len(row)):
        level = 0
        while level < len(_SCALES) - 1 and _SCALES[level] * 2.6 < width[k]:
            level += 1
        reach = int(np.ceil(_REACH * _SCALES[level])) + 2
        first = max(int(np.rint(col[k])) - reach, 0)
        last = min(int(np.rint(col[k])) + reach, wide - 1)
        above, below = max(row[k] - 1, 0), min(row[k] + 1, height - 1)
        for channel in range(3):
            center[k, channel], weight[k, channel] = np.nan, 0.0
            if not lit[k, channel]:
                continue
            for i in range(first, last + 1):
                side = np.float32(picture[above, i, channel]) + np.float32(picture[below, i, channel])
                line[i - first] = side + 2 * np.float32(picture[row[k], i, channel])
            found, steep = _crossing(line[: last - first + 1], col[k] - first, _SCALES[level])
            if abs(found + first - col[k]) < width[k] / 2:
                center[k, channel], weight[k, channel] = found + first, steep * steep
