"""Which stripe of a known sequence each observed slit shows: dynamic programming over a scan line."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
# Scores are added up in whole thousandths of a nat: the largest of many whole numbers is found in parallel lanes.
_UNIT = 1000
_NEVER = np.int32(-200_000_000)
_KNOWN = np.float32(4.0)
# No order of the others is worth leaving out a slit that has its label.
_SURELY = np.int32(1000 * _UNIT)
# Passing over more stripes than so many beyond the room there is costs more than going anywhere.
_STEPS = 2
MOST_ROOM = 4
# Labels before the first and behind the last that nothing can have: shifts stay inside the arrays.
_EDGE = 1 + MOST_ROOM + _STEPS


@numba.njit(cache=True, nogil=True)
def match_lines(
    starts: npt.NDArray[np.int64],
    scores: Singles,
    room: Wholes,
    kinds: Wholes,
    allowed: Wholes,
    fixed: Wholes,
    prices: tuple[float, float, float],
    label: Wholes,
    margin: Singles,
) -> None:
    """Match the slits of every scan line to a sequence, and write the best label and how sure it is.

    starts (h + 1,): where each line's slits begin; scores (m, k): log-likelihood ratio of each kind against "no slit of
    the pattern"; room (m,): how many unseen stripes the gap before a slit has room for, at most MOST_ROOM; kinds (n,):
    the sequence; allowed (m, 2): first and last label that may be, last < first for none; fixed (m,): labels known
    already, -1 for none; they hold their place in the order. Every stripe passed over more or less than there is room
    for costs prices[0] nats, going anywhere else, back included, prices[1], a label that another slit of the line has
    prices[2]. label (m,): -1 for none; margin (m,): how much worse, in nats, the best solution is in which the slit has
    another label or none.
    Source: dynamic programming after Monks, Carter and Shadle (1992) and Zhang, Curless and Seitz (2002), with
    max-marginals for the margin.
    """
    longest = 0
    for row in range(len(starts) - 1):
        longest = max(longest, starts[row + 1] - starts[row])
    shape = (longest + 1, len(kinds) + 2 * _EDGE)
    own, here, before = np.full(shape, _NEVER), np.full(shape, _NEVER), np.full(shape, _NEVER)
    whole = (scores * np.float32(_UNIT)).astype(np.int32)
    toll = np.zeros(len(kinds), dtype=np.int32)
    costs = (int(_UNIT * prices[0]), int(_UNIT * prices[1]))
    chain = np.empty(longest, dtype=np.int64)
    found, sure = np.empty(longest, dtype=np.int32), np.empty(longest, dtype=np.float32)
    gaps = np.empty(longest, dtype=np.int32)
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        toll[:] = 0
        for i in range(first, last):
            if fixed[i] >= 0:
                toll[fixed[i]] = int(_UNIT * prices[2])
                label[i], margin[i] = fixed[i], _KNOWN
        i = first
        while i < last:
            i, count = _next_chain(fixed, first, i, last, chain)
            if not count:
                continue
            for k in range(count):
                slit = chain[k]
                gaps[k] = room[slit]
                if fixed[slit] < 0:
                    _own_scores(whole[slit], kinds, allowed[slit, 0], allowed[slit, 1], toll, own[k])
                else:
                    own[k] = _NEVER
                    own[k, _EDGE + fixed[slit]] = _SURELY
            _forward(own, gaps[:count], costs, here, before)
            _backward(own, gaps[:count], costs, here, before, found, sure)
            for k in range(count):
                if fixed[chain[k]] < 0:
                    label[chain[k]], margin[chain[k]] = found[k], sure[k]


@numba.njit(cache=True, nogil=True)
def neighbours(starts: npt.NDArray[np.int64], label: Wholes, most: int, out: Singles) -> None:
    """Write how many of the next slits of its line, at most `most` on either side, go on from a slit's label."""
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        for i in range(first, last):
            out[i] = 0
            if label[i] < 0:
                continue
            j = i + 1
            while j < last and j <= i + most and label[j] == label[i] + j - i:
                j += 1
            k = i - 1
            while k >= first and k >= i - most and label[k] == label[i] + k - i:
                k -= 1
            out[i] = j - k - 2


@numba.njit(cache=True, nogil=True)
def _next_chain(fixed: Wholes, first: int, i: int, last: int, chain: npt.NDArray[np.int64]) -> tuple[int, int]:
    """Write which slits from i on are to be matched next, and return where to go on and how many they are.

    Slits without a label, up to the next one that has its place: the labels on both sides are all that matters to them.
    """
    count = 0
    while i < last and fixed[i] >= 0:
        i += 1
    if i == last:
        return last, 0
    if i > first and fixed[i - 1] >= 0:
        chain[0] = i - 1
        count = 1
    while i < last and fixed[i] < 0:
        chain[count] = i
        count += 1
        i += 1
    if i < last:
        chain[count] = i
        count += 1
    return i, count


@numba.njit(cache=True, nogil=True, inline="always")
def _places(count: int) -> range:
    """Return 0, 1 ... as numbers without a sign: NumPy's negative indices would keep a loop out of parallel lanes."""
    return range(np.uint64(count))


@numba.njit(cache=True, nogil=True)
def _largest(values: Wholes, row: int) -> int:
    """Return the largest number in a row of values (m, n)."""
    at, best = np.uint64(row), _NEVER
    for j in _places(values.shape[1]):
        best = max(best, values[at, j])
    return int(best)


@numba.njit(cache=True, nogil=True)
def _own_scores(scores: Wholes, kinds: Wholes, low: int, high: int, toll: Wholes, own: Wholes) -> None:
    """Write what each label adds by itself, between the edges."""
    for j in range(len(kinds)):
        own[_EDGE + j] = scores[kinds[j]] - toll[j]
    for j in range(min(low, len(kinds))):
        own[_EDGE + j] = _NEVER
    for j in range(max(high + 1, 0), len(kinds)):
        own[_EDGE + j] = _NEVER


@numba.njit(cache=True, nogil=True)
def _come(value: Wholes, row: int, room: int, sign: int, skip: int, least: int, come: Wholes) -> None:
    """Write the best of value[row, j - sign * (1 + room + d)] - skip * |d| over few steps d, and at least `least`."""
    count = len(come) - 2 * _EDGE
    at, edge = np.uint64(row), np.uint64(_EDGE)
    shift = _EDGE - sign * (1 + room)
    none, one, two = np.uint64(shift), np.uint64(shift - sign), np.uint64(shift - 2 * sign)
    once, twice, floor = np.int32(skip), np.int32(2 * skip), np.int32(least)
    for j in _places(count):
        near = max(value[at, none + j], value[at, one + j] - once)
        come[edge + j] = max(near, max(value[at, two + j] - twice, floor))
    for less in range(1, min(room, _STEPS) + 1):
        price, nearer = np.int32(less * skip), np.uint64(shift + less * sign)
        for j in _places(count):
            come[edge + j] = max(come[edge + j], value[at, nearer + j] - price)


@numba.njit(cache=True, nogil=True)
def _forward(own: Wholes, room: Wholes, costs: tuple[int, int], here: Wholes, before: Wholes) -> None:
    """Write the best score of the slits up to each that has a label, here, and of those before each, before.

    before[i, j]: the best of the slits before i of which the last matched one is j.
    """
    come = np.full(own.shape[1], _NEVER)
    before[0] = _NEVER
    for i in range(len(room)):
        _come(before, i, room[i], 1, costs[0], max(_largest(before, i) - costs[1], 0), come)
        at, later = np.uint64(i), np.uint64(i + 1)
        for j in _places(len(come)):
            here[at, j] = come[j] + own[at, j]
            before[later, j] = max(before[at, j], here[at, j])


@numba.njit(cache=True, nogil=True)
def _backward(
    own: Wholes, room: Wholes, costs: tuple[int, int], here: Wholes, before: Wholes, label: Wholes, margin: Singles
) -> None:
    """Walk back from the last slit: write each one's best label and the margin over everything else it might be.

    after[j]: the best that the slits behind add when the last matched one is j.
    """
    width = own.shape[1]
    after, come = np.zeros(width, np.int32), np.full(width, _NEVER)
    skipped, joined = np.empty((1, width), np.int32), np.empty((1, width), np.int32)
    rest = 0
    for i in range(len(room) - 1, -1, -1):
        at, only = np.uint64(i), np.uint64(0)
        for j in _places(width):
            skipped[only, j] = before[at, j] + after[j]
            here[at, j] += after[j]
            joined[only, j] = after[j] + own[at, j]
        best, without, far = _largest(here, i), max(rest, _largest(skipped, 0)), _largest(joined, 0)
        label[i], margin[i] = -1, (best - without) / _UNIT
        if best > without:
            chosen = 0
            while here[i, chosen] < best:
                chosen += 1
            here[i, chosen] = _NEVER
            lead = best - max(_largest(here, i), without)
            margin[i] = lead / _UNIT
            label[i] = chosen - _EDGE if lead > 0 else -1
        rest = max(rest, far)
        _come(joined, 0, room[i], -1, costs[0], far - costs[1], come)
        for j in _places(width):
            after[j] = max(after[j], come[j])
