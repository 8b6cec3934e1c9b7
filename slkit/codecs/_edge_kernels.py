"""Sub-pixel places of edges, in compiled loops."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

# A division by zero is data here: a test for it would keep a loop out of parallel lanes.
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def refine(
    picture: Singles,
    noise: Singles,
    row: Places,
    start: Doubles,
    scale: float,
    reach: int,
    steps: int,
    col: Doubles,
    sigma: Doubles,
) -> None:
    """Write where (m,) a weighted sum of the pixels around `start` (m,) vanishes, and its 1 sigma, both in px.

    Newton's method with the kernel centred between the pixels; see `refined`. The weights are the negative of a
    Gaussian of sigma `scale` px. NaN where the sum does not fall there, or the place is more than a px from the start.
    """
    last, square = picture.shape[1] - 1, scale * scale
    ratio_step = np.exp(-1.0 / square)
    for i in range(len(row)):
        middle, place, doubt = int(np.rint(start[i])), start[i], np.nan
        here, doubts = picture[row[i]], noise[row[i]]
        for _ in range(steps):
            total, pace, spread = 0.0, 0.0, 0.0
            offset = middle - reach - place
            bell = np.exp(-offset * offset / (2 * square))
            ratio = np.exp(-(2 * offset + 1) / (2 * square))
            for k in range(-reach, reach + 1):
                at = min(max(middle + k, 0), last)
                total -= bell * here[at]
                pace -= offset / square * bell * here[at]
                spread += (bell * doubts[at]) ** 2
                bell *= ratio
                ratio *= ratio_step
                offset += 1
            if pace < 0:
                place -= min(max(total / pace, -0.5), 0.5)
                doubt = np.sqrt(spread) / -pace
            else:
                doubt = np.nan
        sigma[i] = doubt if abs(place - start[i]) <= 1 else np.nan
        col[i] = min(max(place, 0.0), float(last))
