"""Lenses bend colours apart: how far, by the slits of two channels, and where each slit is in green light."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._chromatic_kernels import channel_centers
from slkit.codecs._view_slits import Slits
from slkit.data import Image

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_GREEN = 1
_PAIRS = ((0, 1), (2, 1), (0, 2))
# So many slits of two channels tell the offsets of a picture; one of so many rows is looked at first.
_LEAST_SLITS, _ROWS = 100, 4
# Offsets below so many px are left alone: they cost more noise than they are worth.
_LEAST_PX = 0.05
_ROUNDS, _OUTLIER = 6, 2.5


def in_green(picture: Image | Singles, slits: Slits, lit: Mask) -> Singles:
    """Return the columns (m,) in px at which slits would be if all their light were green.

    picture (h, w, 3); lit (m, 3): the channels of each slit's colour, none where it has no label. Offsets of red and
    blue against green that are linear over the picture are fitted to the slits that show two channels.
    Source: linear in the field, as lateral chromatic aberration is to first order.
    """
    some = np.flatnonzero((lit.sum(axis=1) > 1) & (slits.row % _ROWS == 0))
    if len(some) < _LEAST_SLITS:
        return slits.col
    field = _field(slits, picture.shape)
    center, _ = _centers(picture, slits, lit, some)
    offset = np.einsum("mi,ij->mj", field, _fit(field[some], center))
    if np.abs(offset).max() < _LEAST_PX:
        return slits.col
    at = np.flatnonzero(lit.any(axis=1))
    center, weight = _centers(picture, slits, lit, at)
    total = weight.sum(axis=1)
    moved = np.where(weight > 0, weight * (center - offset[at]), 0).sum(axis=1) / np.maximum(total, 1e-12)
    result = slits.col.copy()
    result[at[total > 0]] = moved[total > 0]
    return result


def _field(slits: Slits, shape: tuple[int, ...]) -> Doubles:
    """Return 1 and the place of each slit (m, 3), -1 to 1 over the picture."""
    row, col = 2 * slits.row / shape[0] - 1, 2 * slits.col / shape[1] - 1
    return np.stack([np.ones(len(slits)), row, col], axis=1).astype(np.float64)


def _centers(picture: Image | Singles, slits: Slits, lit: Mask, at: npt.NDArray[np.intp]) -> tuple[Doubles, Doubles]:
    center, weight = np.empty((len(at), 3)), np.empty((len(at), 3))
    channel_centers(picture, slits.row[at], slits.col[at], slits.width[at], lit[at], center, weight)
    return center, weight


def _fit(field: Doubles, center: Doubles) -> Doubles:
    """Return the matrix (3, 3) that takes field (m, 3) to the offsets of red, green and blue, by robust least squares.

    center (m, 3) px: NaN in the channels that a slit does not show.
    """
    rows, told = [], []
    for a, b in _PAIRS:
        known = np.isfinite(center[:, a] - center[:, b])
        row = np.zeros((int(known.sum()), 3, 3))
        row[:, a], row[:, b] = field[known], -field[known]
        row[:, _GREEN] = 0
        rows.append(row.reshape(-1, 9))
        told.append((center[:, a] - center[:, b])[known])
    system, offset = np.concatenate(rows), np.concatenate(told)
    square = np.ones(len(offset))
    solution: npt.NDArray[Any] = np.zeros(9)
    for _ in range(_ROUNDS):
        # Sums without BLAS, whose threads would wait for each other where pictures are decoded side by side.
        normal = np.einsum("mi,mj->ij", system * square[:, None], system)
        solution = np.linalg.lstsq(normal, np.einsum("mi,m->i", system, square * offset), rcond=1e-12)[0]
        away = np.abs(offset - np.einsum("mi,i->m", system, solution))
        spread = max(1.4826 * float(np.median(away)), 1e-3)
        square = np.maximum(1 - (away / (_OUTLIER * spread)) ** 2, 0) ** 2
    return np.ascontiguousarray(solution.reshape(3, 3).T, dtype=np.float64)
