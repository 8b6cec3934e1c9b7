"""Which stripe of a known sequence each observed slit shows: dynamic programming over a scan line."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
_NEVER = np.float32(-1e9)
_KNOWN = np.float32(4.0)
# No order of the others is worth leaving out a slit that has its label.
_SURELY = np.float32(1e3)
# Passing over more stripes than so many beyond the room there is costs more than going anywhere.
_STEPS = 2
MOST_ROOM = 4
# Labels before the first and behind the last that nothing can have: shifts stay inside the arrays.
_EDGE = 1 + MOST_ROOM + _STEPS
# Nothing here is ever NaN, and the order of a maximum does not matter: loops over labels run in parallel lanes.
_LANES = {"nnan", "nsz", "reassoc"}


@numba.njit(cache=True, nogil=True)
def match_lines(
    starts: npt.NDArray[np.int64],
    scores: Singles,
    room: Wholes,
    kinds: Wholes,
    allowed: Wholes,
    fixed: Wholes,
    together: bool,
    prices: tuple[float, float, float],
    label: Wholes,
    margin: Singles,
) -> None:
    """Match the slits of every scan line to a sequence, and write the best label and how sure it is.

    starts (h + 1,): where each line's slits begin; scores (m, k): log-likelihood ratio of each kind against "no slit of
    the pattern"; room (m,): how many unseen stripes the gap before a slit has room for, at most MOST_ROOM; kinds (n,):
    the sequence; allowed (m, 2): first and last label that may be, last < first for none; fixed (m,): labels known
    already, -1 for none. together: fixed slits hold their place in the order; else the others are matched as if they
    were not there. Every stripe passed over more or less than there is room for costs prices[0] nats, going anywhere
    else, back included, prices[1], a label that another slit of the line has prices[2]. label (m,): -1 for none; margin
    (m,): how much worse, in nats, the best solution is in which the slit has another label or none.
    Source: dynamic programming after Monks, Carter and Shadle (1992) and Zhang, Curless and Seitz (2002), with
    max-marginals for the margin.
    """
    longest = 0
    for row in range(len(starts) - 1):
        longest = max(longest, starts[row + 1] - starts[row])
    shape = (longest + 1, len(kinds) + 2 * _EDGE)
    own, here, before = np.full(shape, _NEVER), np.full(shape, _NEVER), np.full(shape, _NEVER)
    toll = np.zeros(len(kinds), dtype=np.float32)
    chain = np.empty(longest, dtype=np.int64)
    found, sure = np.empty(longest, dtype=np.int32), np.empty(longest, dtype=np.float32)
    gaps = np.empty(longest, dtype=np.int32)
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        toll[:] = 0
        for i in range(first, last):
            if fixed[i] >= 0:
                toll[fixed[i]] = prices[2]
                label[i], margin[i] = fixed[i], _KNOWN
        i = first
        while i < last:
            i, count = _next_chain(fixed, first, i, last, together, chain)
            if not count:
                continue
            for k in range(count):
                slit = chain[k]
                gaps[k] = room[slit]
                if fixed[slit] < 0:
                    _own_scores(scores[slit], kinds, allowed[slit, 0], allowed[slit, 1], toll, own[k])
                else:
                    own[k] = _NEVER
                    own[k, _EDGE + fixed[slit]] = _SURELY
            _forward(own, gaps[:count], prices, here, before)
            _backward(own, gaps[:count], prices, here, before, found, sure)
            for k in range(count):
                if fixed[chain[k]] < 0:
                    label[chain[k]], margin[chain[k]] = found[k], sure[k]


@numba.njit(cache=True, nogil=True)
def _next_chain(
    fixed: Wholes, first: int, i: int, last: int, together: bool, chain: npt.NDArray[np.int64]
) -> tuple[int, int]:
    """Write which slits from i on are to be matched next, and return where to go on and how many they are.

    Slits without a label, up to the next one that has its place: the labels on both sides are all that matters to them.
    """
    count = 0
    while i < last and fixed[i] >= 0:
        i += 1
    if i == last:
        return last, 0
    if together and i > first and fixed[i - 1] >= 0:
        chain[0] = i - 1
        count = 1
    while i < last and (fixed[i] < 0 or not together):
        if fixed[i] < 0:
            chain[count] = i
            count += 1
        i += 1
    if i < last:
        chain[count] = i
        count += 1
    return i, count


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _largest(values: Singles, folded: Singles) -> float:
    """Return the largest of values (n,), by folding them in half: a plain loop would wait for every comparison."""
    count = (len(values) + 1) // 2
    other = values[len(values) - count :]
    for j in range(count):
        folded[j] = max(values[j], other[j])
    while count > 8:
        half = (count + 1) // 2
        other = folded[count - half : count]
        for j in range(half):
            folded[j] = max(folded[j], other[j])
        count = half
    best = folded[0]
    for j in range(1, count):
        best = max(best, folded[j])
    return best


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _own_scores(scores: Singles, kinds: Wholes, low: int, high: int, toll: Singles, own: Singles) -> None:
    """Write what each label adds by itself, between the edges."""
    own[:] = _NEVER
    for j in range(low, high + 1):
        own[_EDGE + j] = scores[kinds[j]] - toll[j]


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _come(value: Singles, room: int, sign: int, skip: float, least: float, come: Singles) -> None:
    """Write the best of value[j - sign * (1 + room + d)] - skip * |d| over few steps d, and not less than `least`."""
    count = len(value) - 2 * _EDGE
    come[:] = np.float32(least)
    for d in range(-min(room, _STEPS), _STEPS + 1):
        shift = _EDGE - sign * (1 + room + d)
        price = np.float32(abs(d) * skip)
        source = value[shift : shift + count]
        for j in range(count):
            come[j] = max(come[j], source[j] - price)


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _forward(own: Singles, room: Wholes, prices: tuple[float, float, float], here: Singles, before: Singles) -> None:
    """Write the best score of the slits up to each that has a label, here, and of those before each, before.

    before[i, j]: the best of the slits before i of which the last matched one is j.
    """
    count = own.shape[1] - 2 * _EDGE
    come, folded = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    before[0] = _NEVER
    for i in range(len(room)):
        earlier, later = before[i, _EDGE : _EDGE + count], before[i + 1, _EDGE : _EDGE + count]
        mine, ended = own[i, _EDGE : _EDGE + count], here[i, _EDGE : _EDGE + count]
        _come(before[i], room[i], 1, prices[0], max(_largest(earlier, folded) - prices[1], 0.0), come)
        for j in range(count):
            ended[j] = come[j] + mine[j]
            later[j] = max(earlier[j], ended[j])


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _backward(
    own: Singles,
    room: Wholes,
    prices: tuple[float, float, float],
    here: Singles,
    before: Singles,
    label: Wholes,
    margin: Singles,
) -> None:
    """Walk back from the last slit: write each one's best label and the margin over everything else it might be.

    after[j]: the best that the slits behind add when the last matched one is j.
    """
    count = own.shape[1] - 2 * _EDGE
    after, come = np.zeros(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    skipped, folded = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    value = np.full(own.shape[1], _NEVER)
    rest = 0.0
    for i in range(len(room) - 1, -1, -1):
        earlier, ended = before[i, _EDGE : _EDGE + count], here[i, _EDGE : _EDGE + count]
        mine, joined = own[i, _EDGE : _EDGE + count], value[_EDGE : _EDGE + count]
        for j in range(count):
            skipped[j] = earlier[j] + after[j]
            ended[j] += after[j]
            joined[j] = after[j] + mine[j]
        best, without, far = _largest(ended, folded), max(rest, _largest(skipped, folded)), _largest(joined, folded)
        label[i], margin[i] = -1, best - without
        if best > without:
            chosen = 0
            while ended[chosen] < best:
                chosen += 1
            ended[chosen] = _NEVER
            margin[i] = best - max(_largest(ended, folded), without)
            label[i] = chosen if margin[i] > 0 else -1
        rest = max(rest, far)
        _come(value, room[i], -1, prices[0], far - prices[1], come)
        for j in range(count):
            after[j] = max(after[j], come[j])
