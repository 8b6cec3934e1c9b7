"""Labels of slits from their colours: order along scan lines, one label along a track, and what stands out of order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._match_kernels import MOST_ROOM, match_lines
from slkit.codecs._track_kernels import room_before, vote
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]

# Prices in nats: a stripe that nobody saw where there was room for it, or one too many; a step anywhere else, forward
# or back, at an edge of the scene; a label that its line has already, for rows are not quite epipolar lines.
_PRICES = 4.0, 8.0, 2.0
_LEAST_ROWS = 4
# What all rows together must say for a label at least, with all that speaks against it counted three times.
_LEAST_EVIDENCE = 16.0
_CONTRADICTION = 3.0


@dataclass(frozen=True)
class _Round:
    """One pass. together: slits that are sure hold the others in order, else the others are matched by themselves.

    switch: what it costs in nats that a track changes its label; least: what a row must say for a label on average.
    """

    together: bool
    switch: float
    least: float


_ROUNDS = (
    _Round(True, 1e9, 2.0),
    _Round(True, 1e9, 2.0),
    _Round(True, 40.0, 2.0),
    _Round(False, 40.0, 0.8),
)


def label_slits(slits: Slits, scores: Singles, kinds: Wholes, allowed: Wholes) -> tuple[Wholes, Singles]:
    """Return the label (m,) of every slit, -1 for none, and by how much it is ahead of others (m,), in nats.

    scores (m, k), kinds (n,), allowed (m, 2): see `match_lines`. Tracks whose rows agree come first; they then hold the
    others in order. What is left is matched by itself with the labels that are left: slits in front of others, which
    stand out of order.
    """
    count = len(slits)
    final, ahead = np.full(count, -1, dtype=np.int32), np.zeros(count, dtype=np.float32)
    if not count:
        return final, ahead
    order, ends = np.argsort(slits.track, kind="stable"), np.cumsum(np.bincount(slits.track))
    room = np.empty(count, dtype=np.int32)
    room_before(slits.starts, slits.col, MOST_ROOM, room)
    label, margin = np.empty_like(final), np.empty_like(ahead)
    voted, evidence = np.empty_like(final), np.empty((count, 3), dtype=np.float32)
    for each in _ROUNDS:
        match_lines(slits.starts, scores, room, kinds, allowed, final, each.together, _PRICES, label, margin)
        vote(order, ends, label, margin, len(kinds), each.switch, voted, evidence)
        pro, contra, rows = evidence.T
        net = pro - _CONTRADICTION * contra
        sure = (
            (final < 0) & (voted >= 0) & (rows >= _LEAST_ROWS) & (net > np.maximum(each.least * rows, _LEAST_EVIDENCE))
        )
        final[sure], ahead[sure] = voted[sure], (pro - contra)[sure]
    return final, ahead
