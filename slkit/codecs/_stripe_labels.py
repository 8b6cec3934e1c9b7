"""Labels of slits from their colours: order along scan lines, one label along a track, and company on all sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_kernels import largest
from slkit.codecs._color_pattern import Features
from slkit.codecs._match_kernels import MOST_ROOM, match_lines, neighbours
from slkit.codecs._pieces import label_pieces
from slkit.codecs._track_kernels import room_before, vote
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

# Prices in nats: a stripe that nobody saw where there was room for it, or one too many; a step anywhere else, forward
# or back, at an edge of the scene; a label that its line has already, for rows are not quite epipolar lines.
_PRICES = 4.0, 6.0, 2.0
# What the first round makes sure of holds the rest in order.
_ROUNDS = 2
_LEAST_ROWS = 4
# What all rows together must say for a label at least, with all that speaks against it counted three times.
_LEAST_EVIDENCE = 8.0
_CONTRADICTION = 3.0
# Only a window of the sequence is unique: of the next three slits on either side so many must go on from a label, on
# average along its piece of track. What stands alone may be any slit of its colour.
_NEIGHBOURS, _LEAST_NEIGHBOURS = 3, 1.5
# A slit whose colour another label explains better by so many nats is not of its track.
_WORST = 3.0
# What it costs in nats that a track changes its label.
_SWITCH = 40.0
# By so many nats a slit has the colour that fits it best rather than any.
_CLEAR = 1.0
# One of so many rows tells whether the picture is mirrored.
_SAMPLED_ROWS = 16


@dataclass(frozen=True, eq=False)
class _View:
    """The pattern as a picture shows it, from its start or from its end: kinds (n,), allowed (m, 2)."""

    kinds: Wholes
    allowed: Wholes


@dataclass(frozen=True, eq=False)
class Labels:
    """label (m,): of every slit, -1 for none; ahead (m,): by how much it is ahead of others, in nats.

    order: how far what rows say by themselves follows the pattern, 0 to 1.
    """

    label: Wholes
    ahead: Singles
    order: float


def label_slits(slits: Slits, scores: Singles, features: Features, allowed: Wholes, edges: bool = False) -> Labels:
    """Return the labels of slits.

    scores (m, k), allowed (m, 2): see `match_lines`; edges: slits are changes of colour. A mirrored picture shows the
    pattern from its end. Tracks whose rows agree come first; what they leave open, unless edges, is told by what lies
    around it, see `label_pieces`.
    """
    room = np.empty(len(slits), dtype=np.int32)
    room_before(slits.starts, slits.col, MOST_ROOM, room)
    last = len(features.kinds) - 1
    views = [_View(features.kinds, allowed), _View(features.back, last - allowed[:, ::-1])]
    back = _agreement(slits, scores, room, views[1]) > _agreement(slits, scores, room, views[0])
    view = views[back]
    label, ahead = _label(slits, scores, room, view)
    order = _in_order(slits, scores, view, label)
    if not edges:
        other, lead = label_pieces(slits, scores, view.kinds, view.allowed, label)
        label, ahead = np.where(label < 0, other, label), np.where(label < 0, lead, ahead)
    return Labels(np.where(back & (label >= 0), last - label, label), ahead, order)


def _in_order(slits: Slits, scores: Singles, view: _View, label: Wholes) -> float:
    """Return how far labels (m,) follow the pattern, 0 to 1.

    Of the slits whose colour is clear and which might be any of several stripes, the share that has a label, times the
    share of labelled neighbours that follow each other. 1 without such slits.
    """
    clear = (largest(scores) > _CLEAR) & (view.allowed[:, 1] - view.allowed[:, 0] > _NEIGHBOURS)
    if not clear.any():
        return 1.0
    both = (np.diff(slits.row) == 0) & (label[1:] >= 0) & (label[:-1] >= 0)
    following = np.diff(label)[both] == 1
    return float((label[clear] >= 0).mean()) * (float(following.mean()) if len(following) else 0.0)


def _agreement(slits: Slits, scores: Singles, room: Wholes, view: _View) -> float:
    """Return how well some of the rows fit a sequence, in nats."""
    at = np.flatnonzero(slits.row % _SAMPLED_ROWS == 0)
    starts = np.searchsorted(slits.row[at], np.arange(0, len(slits.starts) + _SAMPLED_ROWS, _SAMPLED_ROWS))
    label, margin = np.empty(len(at), dtype=np.int32), np.empty(len(at), dtype=np.float32)
    free = np.full_like(label, -1)
    told = view.kinds, np.ascontiguousarray(view.allowed[at]), free
    match_lines(starts, scores[at], room[at], *told, _PRICES, label, margin)
    return float(margin[label >= 0].sum())


def _label(slits: Slits, scores: Singles, room: Wholes, view: _View) -> tuple[Wholes, Singles]:
    count, allowed = len(slits), np.ascontiguousarray(view.allowed)
    final, ahead = np.full(count, -1, dtype=np.int32), np.zeros(count, dtype=np.float32)
    order, ends = np.argsort(slits.track, kind="stable"), np.cumsum(np.bincount(slits.track))
    label, margin = np.empty_like(final), np.empty_like(ahead)
    voted, evidence = np.empty_like(final), np.empty((count, 3), dtype=np.float32)
    for _ in range(_ROUNDS):
        match_lines(slits.starts, scores, room, view.kinds, allowed, final, _PRICES, label, margin)
        vote(order, ends, label, margin, len(view.kinds), _SWITCH, voted, evidence)
        pro, contra, rows = evidence.T
        sure = (final < 0) & (voted >= 0) & (rows >= _LEAST_ROWS)
        sure &= pro - _CONTRADICTION * contra > np.maximum(rows, _LEAST_EVIDENCE)
        sure &= _among_others(slits, np.where(sure, voted, final), order)
        sure &= scores[np.arange(count), view.kinds[voted]] > largest(scores) - _WORST
        final[sure], ahead[sure] = voted[sure], (pro - contra)[sure]
    return final, ahead


def _among_others(slits: Slits, label: Wholes, order: npt.NDArray[np.int64]) -> Mask:
    """Tell which slits (m,) have neighbours that go on from their label, on average over their piece of track."""
    beside = np.empty(len(slits), dtype=np.float32)
    neighbours(slits.starts, label, _NEIGHBOURS, beside)
    changes = (np.diff(label[order]) != 0) | (np.diff(slits.track[order]) != 0)
    piece = np.concatenate([[0], np.cumsum(changes)])
    mean = np.bincount(piece, beside[order]) / np.bincount(piece)
    result = np.empty(len(slits), dtype=np.bool_)
    result[order] = (mean >= _LEAST_NEIGHBOURS)[piece]
    return result
