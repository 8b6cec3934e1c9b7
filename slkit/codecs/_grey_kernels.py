"""Grey levels of colour pictures, in a compiled loop over rows of pixels."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def mean_rows(colors: npt.NDArray[Any], levels: npt.NDArray[np.float32]) -> None:
    """Write the mean of the channels of colours (r, w, 3) to levels (r, w)."""
    channels = np.float32(3)
    for row in range(levels.shape[0]):
        here, to = colors[row], levels[row]
        for col in range(len(to)):
            total = np.float32(here[col, 0]) + np.float32(here[col, 1]) + np.float32(here[col, 2])
            to[col] = total / channels
