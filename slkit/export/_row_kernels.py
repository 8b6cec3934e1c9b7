"""From the columns of a cloud to the rows of a PLY file, in compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _put(row: Bytes, at: int, value: Any) -> None:
    """Store a number with its lowest byte first, at any place: rows of 27 bytes keep no number aligned."""
    bits = np.float32(value).view(np.uint32)
    for byte in range(4):
        row[at + byte] = np.uint8(bits >> np.uint32(8 * byte))


@_compiled
def _byte(share: Any, without: Any) -> Any:
    known = without if np.isnan(share) else share
    return np.uint8(np.rint(np.float32(255) * min(max(known, np.float32(0)), np.float32(1))))


@_compiled
def write_rows(
    xyz: Singles,
    normals: Singles,
    color: Singles,
    sigma: Singles,
    sigma_cal: Singles,
    residual: Singles,
    grey: Any,
    rows: Bytes,
) -> None:
    """Write rows (n, 27), or (n, 39) with normals: xyz, normals, colour as bytes, both sigmas, residual.

    normals: (n, 3) or (0, 3). grey: the colour, float32, of points whose own is NaN.
    """
    for i in range(len(rows)):
        row, at = rows[i], 0
        for k in range(3):
            _put(row, at, xyz[i, k])
            at += 4
        if len(normals):
            for k in range(3):
                _put(row, at, normals[i, k])
                at += 4
        for k in range(3):
            row[at] = _byte(color[i, k], grey)
            at += 1
        _put(row, at, sigma[i])
        _put(row, at + 4, sigma_cal[i])
        _put(row, at + 8, residual[i])
