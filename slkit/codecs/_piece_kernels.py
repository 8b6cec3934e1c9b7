"""Pieces of tracks and their neighbours: who lies beside whom, and what neighbours say of each other's labels."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# A neighbour in the same row may be so many labels on; in other rows so many steps are looked for.
FARTHEST, _STEPS = 3, 2
# What one slit says for a pair: in its own row, in other rows one label on, and two.
_BESIDE, _NEAR, _FAR = 1.0, 0.5, 0.4
_NEVER = np.float32(-1e9)


@numba.njit(cache=True, nogil=True)
def usual_gaps(starts: Longs, col: Singles, out: Singles) -> None:
    """Write the usual distance in px (m,) from a slit to the next in its row, from four gaps around; NaN for none."""
    gaps = np.empty(4, dtype=np.float32)
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        for i in range(first, last):
            count = 0
            for j in range(max(first + 1, i - 1), min(last, i + 3)):
                gap = col[j] - col[j - 1]
                k = count
                while k > 0 and gaps[k - 1] > gap:
                    gaps[k] = gaps[k - 1]
                    k -= 1
                gaps[k] = gap
                count += 1
            out[i] = gaps[(count - 1) // 2] if count else np.nan


@numba.njit(cache=True, nogil=True)
def find_pairs(
    starts: Longs,
    row: Wholes,
    col: Singles,
    pace: Singles,
    gap: Singles,
    piece: Wholes,
    order: Longs,
    shifts: Singles,
    within: float,
    pair: Wholes,
    weight: Singles,
) -> int:
    """Write which pieces lie beside the slits of open ones, and return how many pairs there are.

    order (k,): the slits of open pieces, piece by piece; pace (m,): px by which a track moves from row to row; gap
    (m,) px, see `usual_gaps`; piece (m,): each slit's. A neighbour is the next slit in the row, or what lies where the
    track, moved sideways by one or two gaps, is some rows on: by `shifts` (s,), in gaps, at most `within` gaps off.
    pair (e, 3): left piece, right piece, how many labels the right one should be ahead; weight (e,). Pairs of a piece
    stand there once, those of two open pieces from both ends. What does not fit is left out.
    """
    count, first = 0, 0
    for k in range(len(order)):
        i = order[k]
        if k and piece[i] != piece[order[k - 1]]:
            first = count
        if not gap[i] > 0:
            continue
        for side in (-1, 1):
            count = _beside(starts, row, col, gap, piece, i, side, first, count, pair, weight)
            for away in range(1, _STEPS + 1):
                for s in range(len(shifts)):
                    rows = int(np.rint(shifts[s] * away * gap[i]))
                    place = col[i] + side * away * gap[i] + pace[i] * rows
                    j = _nearest(starts, col, int(row[i]) + rows, place, float(within * gap[i]))
                    if j >= 0:
                        said = _NEAR if away == 1 else _FAR
                        count = _note(int(piece[i]), int(piece[j]), side, away, said, first, count, pair, weight)
    return count


@numba.njit(cache=True, nogil=True, inline="always")
def _beside(
    starts: Longs,
    row: Wholes,
    col: Singles,
    gap: Singles,
    piece: Wholes,
    i: int,
    side: int,
    first: int,
    count: int,
    pair: Wholes,
    weight: Singles,
) -> int:
    """Note the next slit in the row of slit i, unless it is far away."""
    j = i + side
    if j < starts[row[i]] or j >= starts[row[i] + 1]:
        return count
    away = max(int(np.rint(abs(col[j] - col[i]) / gap[i])), 1)
    if away > FARTHEST:
        return count
    return _note(int(piece[i]), int(piece[j]), side, away, _BESIDE, first, count, pair, weight)


@numba.njit(cache=True, nogil=True, inline="always")
def _nearest(starts: Longs, col: Singles, row: int, place: float, reach: float) -> int:
    """Return the slit of a row that lies nearest to a place, -1 where none is within reach."""
    if row < 0 or row >= len(starts) - 1:
        return -1
    first, last = starts[row], starts[row + 1]
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if col[middle] < place:
            low = middle + 1
        else:
            high = middle
    if low == last or (low > first and place - col[low - 1] < col[low] - place):
        low -= 1
    return low if low >= first and abs(col[low] - place) <= reach else -1


@numba.njit(cache=True, nogil=True, inline="always")
def _note(
    own: int, other: int, side: int, step: int, said: float, first: int, count: int, pair: Wholes, weight: Singles
) -> int:
    """Add to the weight of a pair, which is new unless it stands among those from `first` on."""
    if own == other:
        return count
    left, right = (own, other) if side > 0 else (other, own)
    for e in range(first, count):
        if pair[e, 0] == left and pair[e, 1] == right and pair[e, 2] == step:
            weight[e] += said
            return count
    if count == len(pair):
        return count
    pair[count, 0], pair[count, 1], pair[count, 2] = left, right, step
    weight[count] = said
    return count + 1


@numba.njit(cache=True, nogil=True)
def propagate(
    own: Singles, label: Wholes, pair: Wholes, weight: Singles, jump: float, skip: float, sweeps: int, belief: Singles
) -> None:
    """Write what each piece's own colour and all others say of its labels together, belief (p, n) in nats.

    own (p, n); label (p,): of pieces that are sure, -1 for others; pair (e, 3), weight (e,): see `find_pairs`, from
    left to right. To be off by one label costs `skip` times the weight, by any
    other number, and against the order, `jump` times it.
    Source: max-product belief propagation (Pearl 1988) on a graph with cycles, forth and back along the pairs.
    """
    labels = own.shape[1]
    told = np.zeros((2, len(pair), labels), dtype=np.float32)
    rest, message = np.empty(labels, dtype=np.float32), np.empty(labels, dtype=np.float32)
    belief[:] = own
    for sweep in range(sweeps):
        for back in range(2):
            for k in range(len(pair)):
                e = len(pair) - 1 - k if back else k
                source, target = pair[e, back], pair[e, 1 - back]
                # What is sure says the same in every sweep.
                if label[target] >= 0 or (sweep and label[source] >= 0):
                    continue
                best = _NEVER
                for j in range(labels):
                    rest[j] = belief[source, j] - told[1 - back, e, j]
                    best = max(best, rest[j])
                _say(rest, float(best), pair[e, 2], back, weight[e], jump, skip, message)
                for j in range(labels):
                    belief[target, j] += message[j] - told[back, e, j]
                    told[back, e, j] = message[j]


@numba.njit(cache=True, nogil=True)
def _say(
    rest: Singles, best: float, step: int, back: int, weight: float, jump: float, skip: float, message: Singles
) -> None:
    """Write what a piece with belief `rest` (n,) says of the labels (n,) of one that is `step` labels on, or back."""
    labels = len(rest)
    floor = np.float32(best - jump * weight)
    for j in range(labels):
        message[j] = floor
    for off in range(-1, 2):
        toll = np.float32(abs(off) * skip * weight)
        ahead = step + off
        if toll >= jump * weight or ahead < min(step, 1):
            continue
        ahead = -ahead if back else ahead
        for j in range(max(0, ahead), min(labels, labels + ahead)):
            message[j] = max(message[j], rest[j - ahead] - toll)
    for j in range(labels):
        message[j] -= best


@numba.njit(cache=True, nogil=True)
def drop_lonely(label: Wholes, open_ones: Mask, pair: Wholes, fewest: int) -> None:
    """Set the label (p,) of open ones (p,) to -1 that have fewer than `fewest` different neighbours that agree."""
    agreeing = np.empty(len(label), dtype=np.int64)
    changed = True
    while changed:
        agreeing[:] = 0
        for e in range(len(pair)):
            left, right, step = pair[e]
            if step and label[left] >= 0 and label[right] - label[left] == step:
                agreeing[left] |= 1 << (FARTHEST + step)
                agreeing[right] |= 1 << (FARTHEST - step)
        changed = False
        for i in range(len(label)):
            count, bits = 0, agreeing[i]
            while bits:
                bits &= bits - 1
                count += 1
            if open_ones[i] and label[i] >= 0 and count < fewest:
                label[i] = -1
                changed = True


@numba.njit(cache=True, nogil=True)
def group(label: Wholes, pair: Wholes, root: Longs) -> None:
    """Write one piece (p,) for all that hang together by pairs that agree with their labels (p,), -1 for none."""
    for i in range(len(root)):
        root[i] = i
    for e in range(len(pair)):
        left, right, step = pair[e]
        if label[left] >= 0 and label[right] >= 0 and label[right] - label[left] == step:
            root[_top(root, right)] = _top(root, left)
    for i in range(len(root)):
        root[i] = _top(root, i)


@numba.njit(cache=True, nogil=True)
def _top(root: Longs, i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i
