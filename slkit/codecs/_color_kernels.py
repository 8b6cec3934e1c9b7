"""Loops over the colours of slits."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]

# Spread of a slit's colour about the ideal one, as a share of its strongest channel, beyond what noise explains.
_SPREAD = 0.16
# A single slit says at most so much against a colour, in nats: it may be damaged.
_FLOOR = np.float32(-6.0)


@numba.njit(cache=True, nogil=True)
def strongest_in_cells(rows: npt.NDArray[np.intp], cols: npt.NDArray[np.intp], light: Singles, cells: Singles) -> None:
    """Keep in cells (r, c, 3), at places (m,), the strongest of each channel of light (m, 3)."""
    for i in range(len(light)):
        for channel in range(3):
            cells[rows[i], cols[i], channel] = max(cells[rows[i], cols[i], channel], abs(light[i, channel]))


@numba.njit(cache=True, nogil=True)
def score(chroma: Singles, noise: Singles, ideal: Singles, room: float, out: Singles) -> None:
    """Write log-likelihood ratios (m, k); chroma (m, 3), noise (m,): as shares of the strongest channel; see
    `score_colors`. room: the area that all colours together cover.
    """
    for i in range(len(chroma)):
        # Dividing by the strongest channel adds its noise to that of the others.
        variance = _SPREAD**2 + 1.5 * noise[i] ** 2
        height = np.log(room / (2 * np.pi * variance))
        for k in range(len(ideal)):
            distance = 0.0
            for channel in range(3):
                distance += (chroma[i, channel] - ideal[k, channel]) ** 2
            out[i, k] = max(np.float32(height - distance / (2 * variance)), _FLOOR)


def largest(values: Singles) -> Singles:
    """Return the largest of each short row (m,) of values (m, k): column by column, which is ten times as fast."""
    return np.ascontiguousarray(values.T).max(axis=0)
