"""How much of the visible slits of a colour pattern is labelled, and how well, where the true positions are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences
from slkit.report.measure import LabelError, label_error

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# A slit can be told from the next one where they are so many camera px apart, and no edge is so near.
LEAST_SPACING_PX = 3.0
EDGE_PX = 2
# A labelled centre belongs to the true one within so many camera px.
_SAME_PX = 1.5


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where the true centres of slits cross the rows of a picture, and which of them are visible; c of them."""

    row: npt.NDArray[np.intp]
    col: Floats
    label: npt.NDArray[np.intp]
    visible: Mask


@dataclass(frozen=True)
class Score:
    """error: of the labels; visible, lit: share labelled of the crossings that are visible, and of all that are lit;
    clear: share of the lit crossings that are visible."""

    error: LabelError
    visible: float
    lit: float
    clear: float


def score(codec: Any, found: Correspondences, truth: npt.NDArray[Any]) -> Score:
    """Judge what a codec found by the true projector positions truth (h, w, 2) px, NaN where nothing is lit."""
    true, got = labelled(codec, found, truth)
    axis = int(codec.axes == "y")
    first, period, _ = grid_of(codec)
    position, across = _across((truth[..., axis] - first) / period, found)
    expected = np.full(found.projector_xy.shape, np.nan)
    expected[:, axis] = first + period * at(position, across)
    share = float(got[true.visible].mean()), float(got.mean()), float(true.visible.mean())
    return Score(label_error(found, expected, period, axis), *share)


def labelled(codec: Any, found: Correspondences, truth: npt.NDArray[Any]) -> tuple[Crossings, Mask]:
    """Return the true crossings, of columns where slits run along the rows, and which have a centre of their label."""
    axis = int(codec.axes == "y")
    first, period, labels = grid_of(codec)
    position, across = _across((truth[..., axis] - first) / period, found)
    true = crossings(position, labels)
    named = np.rint((found.projector_xy[:, axis] - first) / period).astype(np.intp)
    return true, _labelled(true, np.rint(across[:, 1]).astype(np.intp), across[:, 0], named)


def _across(position: Floats, found: Correspondences) -> tuple[Floats, Floats]:
    """Return positions (h, w) and places (m, 2) px, both turned where the slits run along the rows."""
    xy = found.camera_xy.astype(np.float64)
    return (position.T, xy[:, ::-1]) if runs_along_rows(position) else (position, xy)


def grid_of(codec: Any) -> tuple[float, int, int]:
    """Return the projector px of the first slit's centre, the period in px, and how many slits there are."""
    return float(codec._center(np.zeros(1))[0]), codec.layout.period, len(codec._features.kinds)


def runs_along_rows(position: Floats) -> bool:
    """Tell whether the position (h, w) in the pattern changes more from row to row than along them."""
    return bool(np.nanmedian(np.abs(np.diff(position, axis=0))) > np.nanmedian(np.abs(np.diff(position, axis=1))))


def crossings(position: Floats, labels: int) -> Crossings:
    """Return where positions (h, w), in periods of the pattern, pass a whole number along the rows."""
    left, right = position[:, :-1], position[:, 1:]
    low, high = np.minimum(left, right), np.maximum(left, right)
    label = np.ceil(low)
    # A step of almost a period between two pixels is an edge of the object, not a slit.
    hit = (high - low < 0.9) & (high > low) & (label <= high) & (label >= 0) & (label < labels)
    row, col = np.nonzero(hit)
    exact = col + (label - left)[hit] / (right - left)[hit]
    middle = np.rint(exact).astype(np.intp)
    near = np.clip(middle[:, None] + np.arange(-EDGE_PX, EDGE_PX + 1), 0, position.shape[1] - 1)
    around = position[row[:, None], near]
    # NaN, off the object or in shadow, is not below.
    visible = np.abs(np.diff(around, axis=1)).max(axis=1) <= 1 / LEAST_SPACING_PX
    return Crossings(row, exact, label[hit].astype(np.intp), visible)


def at(position: Floats, xy: Floats) -> Floats:
    """Return the true position (m,) at places (m, 2) px, between pixels in a row unless there is an edge."""
    row = np.rint(xy[:, 1]).astype(np.intp)
    col = np.clip(np.floor(xy[:, 0]).astype(np.intp), 0, position.shape[1] - 2)
    left, right = position[row, col], position[row, col + 1]
    share = xy[:, 0] - col
    between = left * (1 - share) + right * share
    nearest = np.where(share < 0.5, left, right)
    return np.where(np.abs(right - left) < 1 / LEAST_SPACING_PX, between, nearest)


def _labelled(true: Crossings, row: npt.NDArray[np.intp], col: Floats, label: npt.NDArray[np.intp]) -> Mask:
    """Return which crossings (c,) have a centre of the same label beside them."""
    places: dict[tuple[int, int], list[float]] = {}
    for r, c, k in zip(row.tolist(), col.tolist(), label.tolist(), strict=True):
        places.setdefault((r, k), []).append(c)
    keys = zip(true.row.tolist(), true.label.tolist(), true.col.tolist(), strict=True)
    return np.array([any(abs(c - col) < _SAME_PX for c in places.get((r, k), ())) for r, k, col in keys], dtype=bool)
