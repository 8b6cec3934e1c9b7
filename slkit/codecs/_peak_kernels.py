"""Sub-pixel centres of lines and edges, and pictures of lines as shares of white less black, in compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Levels = npt.NDArray[Any]
Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

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
    rising: bool,
    steps: int,
    col: Doubles,
    sigma: Doubles,
) -> None:
    """Write where (m,) a weighted sum of the pixels around `start` (m,) vanishes, and its 1 sigma, both in px.

    Newton's method with the kernel centred between the pixels; see `refined`. rising: the weights are those of edges,
    else of lines. NaN where the sum does not fall there, or the place is more than a px from the start.
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
                weight = -bell if rising else offset * bell
                slope = -offset / square * bell if rising else (offset * offset / square - 1) * bell
                total += weight * here[at]
                pace += slope * here[at]
                spread += (weight * doubts[at]) ** 2
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


@_compiled
def normalize_rows(
    picture: Levels, high: Levels, low: Levels, mask: Mask, noise: Singles, share: Singles, spread: Singles
) -> None:
    """Write a picture (r, w) as a share of white less black, 0 outside of mask, and the noise of that share.

    high, low (r, w): white and black; noise (3,): variance in dark, its gain a level, the dark level.
    """
    least, gain, dark, nothing = noise[0], noise[1], noise[2], np.float32(0)
    for row in range(picture.shape[0]):
        shown, white, black, used = picture[row], high[row], low[row], mask[row]
        to_share, to_spread = share[row], spread[row]
        for col in range(len(shown)):
            a, b, c = np.float32(shown[col]), np.float32(white[col]), np.float32(black[col])
            span = max(b - c, np.float32(1))
            part = (a - c) / span if used[col] else nothing
            own = least + gain * max(a - dark, nothing)
            of_white, of_black = least + gain * max(b - dark, nothing), least + gain * max(c - dark, nothing)
            rest = np.float32(1) - part
            to_share[col] = part
            to_spread[col] = np.sqrt(own + rest * rest * of_black + part * part * of_white) / span
