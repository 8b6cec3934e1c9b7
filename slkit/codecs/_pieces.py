"""Labels of pieces of tracks from their neighbours on all sides: what single rows leave open.

A thin rod shows one slit in a row, a fold two. But what lies above and below on the same surface goes on in the same
order, and together that is a window of the sequence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_kernels import largest
from slkit.codecs._piece_kernels import FARTHEST, drop_lonely, find_pairs, group, propagate, usual_gaps
from slkit.codecs._track_kernels import along_tracks
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# Other rows, in gaps between slits, in which a piece looks for neighbours, and how far off they may be.
_SHIFTS = np.array([-2.8, -2.1, -1.4, -0.7, 0.7, 1.4, 2.1, 2.8], dtype=np.float32)
_WITHIN = 0.35
# So much weight makes a pair count fully, and so large a share of the shorter piece's rows.
_FULL, _FULL_SHARE = 4.0, 0.8
# Two pieces of one track seldom have different labels, but the rows had a reason to split them.
_SAME_TRACK = 0.3
# Prices in nats: a step that passes over a label, and one to anywhere, at an edge of the scene.
_SKIP, _JUMP = 4.0, 5.0
_SWEEPS = 6
# Neighbouring rows err together: so many count as one. A piece says at most so much.
_CORRELATED, _LOUDEST = 3.0, 25.0
# Its colour must fit its label by so many nats, on average over its rows, of which no more than so many count.
_LEAST_FIT, _FIT_ROWS = 0.6, 15
# A slit whose colour another label explains better by so many nats is not of its piece.
_WORST = 3.0
# What no piece with a sure label holds must show so many labels: five in an order that exists by chance is rare.
_FEWEST_LABELS = 6
_FEWEST_NEIGHBOURS = 2
# No stage labels what is shorter.
_FEWEST_ROWS = 2
_RULED_OUT = np.float32(-50.0)


@dataclass(frozen=True)
class _Stage:
    """alone: without the pieces that are sure; ahead: nats by which a label must lead; rows: at least of a piece;
    agreeing: share of its pairs.
    """

    alone: bool
    ahead: float
    rows: int
    agreeing: float


_STAGES = (_Stage(True, 4.5, _FEWEST_ROWS, 0.5), _Stage(False, 9.5, 4, 0.35))


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Stretches of tracks that have one label or none, p of them in m slits.

    of (m,): the piece of each slit; order (m,): slits piece by piece; starts (p,): where each begins in it; rows (p,);
    label (p,): -1 for none.
    """

    of: Wholes
    order: Longs
    starts: Longs
    rows: Longs
    label: Wholes


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Neighbours: pair (e, 3), left and right piece and by how many labels they should differ; weight (e,) 0 to 1."""

    pair: Wholes
    weight: Singles

    def among(self, use: Mask) -> _Pairs:
        return _Pairs(self.pair[use], self.weight[use])


def label_pieces(
    slits: Slits, scores: Singles, kinds: Wholes, allowed: Wholes, label: Wholes
) -> tuple[Wholes, Singles]:
    """Return labels (m,) of slits that have none, and by how many nats they are ahead of others (m,).

    scores (m, k), kinds (n,), allowed (m, 2): see `match_lines`; label (m,): what is sure, -1 for the others. First
    what hangs together by itself, then together with what is sure.
    """
    pieces = _cut(slits, label)
    result, ahead = np.full(len(slits), -1, np.int32), np.zeros(len(slits), np.float32)
    if (pieces.label >= 0).all():
        return result, ahead
    pairs = _pairs(slits, pieces)
    fit = _fit(scores, pieces)
    own = np.ascontiguousarray(fit[:, kinds])
    found, lead = pieces.label.copy(), np.zeros(len(pieces.rows), np.float32)
    for stage in _STAGES:
        best, margin = _believed(own, found, pairs, stage)
        fits = fit[np.arange(len(fit)), kinds[best]] > _LEAST_FIT * np.minimum(pieces.rows, _FIT_ROWS) / _CORRELATED
        new = (found < 0) & (pieces.rows >= stage.rows) & (margin >= stage.ahead) & fits
        new = _in_company(new, best, found, pairs, stage)
        found, lead = np.where(new, best, found), np.where(new, margin, lead)
    told = (label < 0) & (found[pieces.of] >= 0)
    told &= (allowed[:, 0] <= found[pieces.of]) & (found[pieces.of] <= allowed[:, 1])
    told &= scores[np.arange(len(slits)), kinds[found[pieces.of]]] > largest(scores) - _WORST
    result[told], ahead[told] = found[pieces.of[told]], lead[pieces.of[told]]
    return result, ahead


def _cut(slits: Slits, label: Wholes) -> _Pieces:
    order = np.argsort(slits.track, kind="stable")
    new = np.ones(len(slits), dtype=np.bool_)
    new[1:] = (np.diff(slits.track[order]) != 0) | (np.diff(label[order]) != 0)
    of = np.empty(len(slits), np.int32)
    of[order] = np.cumsum(new) - 1
    starts = np.flatnonzero(new)
    return _Pieces(of, order, starts, np.diff(np.append(starts, len(slits))), label[order[starts]])


def _pairs(slits: Slits, pieces: _Pieces) -> _Pairs:
    """Return which pieces lie beside each other, sorted along the rows, and which follow on one track."""
    gap = np.empty(len(slits), np.float32)
    usual_gaps(slits.starts, slits.col, gap)
    of = pieces.of[pieces.order]
    some = pieces.order[(pieces.label[of] < 0) & (pieces.rows[of] >= _FEWEST_ROWS)]
    most = 16 * len(pieces.rows) + 4 * len(some)
    pair, weight = np.empty((most, 3), np.int32), np.empty(most, np.float32)
    place = slits.starts, slits.row, slits.col, _pace(slits), gap
    count = find_pairs(*place, pieces.of, some, _SHIFTS, _WITHIN, pair, weight)
    pair, strong = _merged(pair[:count], weight[:count], pieces)
    first = pieces.order[pieces.starts]
    joined = np.flatnonzero(np.diff(slits.track[first]) == 0)
    track = np.stack([joined, joined + 1, np.zeros_like(joined)], axis=1).astype(np.int32)
    pair = np.concatenate([pair, track])
    strong = np.concatenate([strong, np.full(len(track), _SAME_TRACK, np.float32)])
    middle = np.bincount(pieces.of, slits.col) / pieces.rows
    along = np.argsort(middle[pair[:, 0]] + middle[pair[:, 1]], kind="stable")
    return _Pairs(np.ascontiguousarray(pair[along]), strong[along])


def _merged(pair: Wholes, weight: Singles, pieces: _Pieces) -> tuple[Wholes, Singles]:
    """Return each pair once, (e, 3), and how far it counts (e,), 0 to 1."""
    left, right, step = pair.T.astype(np.int64)
    key, inverse = np.unique((left * len(pieces.rows) + right) * (FARTHEST + 1) + step, return_inverse=True)
    both, step = np.divmod(key, FARTHEST + 1)
    left, right = np.divmod(both, len(pieces.rows))
    shorter = np.minimum(pieces.rows[left], pieces.rows[right])
    strong = np.minimum(np.bincount(inverse, weight) / np.maximum(_FULL, _FULL_SHARE * shorter), 1)
    return np.stack([left, right, step], axis=1).astype(np.int32), strong.astype(np.float32)


def _pace(slits: Slits) -> Singles:
    """Return by how many px a track moves from row to row at each slit (m,)."""
    has = slits.previous >= 0
    step = np.where(has, slits.col - slits.col[slits.previous], 0)
    total, count = along_tracks(np.stack([step, has], axis=1).astype(np.float32), slits.previous, 0.8).T
    return (total / np.maximum(count, np.float32(1e-3))).astype(np.float32)


def _fit(scores: Singles, pieces: _Pieces) -> Singles:
    """Return how well each kind fits each piece (p, k), in nats."""
    total = np.add.reduceat(scores[pieces.order], pieces.starts, axis=0) / np.float32(_CORRELATED)
    return np.clip(total, -_LOUDEST, _LOUDEST, dtype=np.float32)


def _believed(own: Singles, found: Wholes, pairs: _Pairs, stage: _Stage) -> tuple[Wholes, Singles]:
    """Return each piece's best label (p,), and by how much it leads (p,)."""
    sure = np.flatnonzero(found >= 0)
    own[sure] = _RULED_OUT
    own[sure, found[sure]] = 0
    if stage.alone:
        left, right, _ = pairs.pair.T
        pairs = pairs.among((found[left] < 0) & (found[right] < 0))
    belief = np.empty_like(own)
    propagate(own, found, pairs.pair, pairs.weight, _JUMP, _SKIP, _SWEEPS, belief)
    best = belief.argmax(axis=1).astype(np.int32)
    second, first = np.partition(belief, -2, axis=1)[:, -2:].T
    return best, first - second


def _in_company(new: Mask, best: Wholes, found: Wholes, pairs: _Pairs, stage: _Stage) -> Mask:
    """Return which new labels (p,) hang together with sure ones, or with so many others that chance is ruled out.

    Colours that are none of the pattern's find some order too, but contradict each other: of the pairs that new labels
    are part of, a share must agree, for each piece, and alone for all that hang together.
    """
    label = np.where(new, best, -1 if stage.alone else found).astype(np.int32)
    claimed = label.copy()
    drop_lonely(label, new, pairs.pair, _FEWEST_NEIGHBOURS)
    root = np.empty(len(label), np.int64)
    group(label, pairs.pair, root)
    told, sure = label >= 0, (found >= 0) & (not stage.alone)
    whose = root if stage.alone else np.arange(len(root))
    left, right, step = pairs.pair.T
    both = (step > 0) & (claimed[left] >= 0) & (claimed[right] >= 0) & ~(sure[left] & sure[right])
    agree = both & told[left] & told[right] & (label[right] - label[left] == step)
    share = _weight_of(pairs, whose, agree & both) / np.maximum(_weight_of(pairs, whose, both), 1e-6)
    span = int(label.max(initial=0)) + 1
    shown = np.unique(root[told] * span + label[told]) // span
    many = np.bincount(shown, minlength=len(root))[root] >= _FEWEST_LABELS
    held = np.bincount(root[sure & told], minlength=len(root))[root] > 0
    return new & told & (held | many) & (share[whose] >= stage.agreeing)


def _weight_of(pairs: _Pairs, whose: Longs, use: Mask) -> npt.NDArray[np.float64]:
    """Return the weight (p,) of some pairs (e,), summed up at both ends under the number `whose` (p,) of a piece."""
    left, right, _ = pairs.pair[use].T
    weight = pairs.weight[use].astype(np.float64)
    both = np.concatenate([whose[left], whose[right]])
    return np.bincount(both, np.tile(weight, 2), len(whose)).astype(np.float64)
