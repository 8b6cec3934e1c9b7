"""Numbers of fringes handed on from slit to slit, along rows and across them, as far as a surface goes on."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]

# Slits of neighbouring rows are of one fringe where they are so much of a half width, and half a px, apart.
_ACROSS, _SLACK_PX = 0.6, 0.5
# Neighbours in a row are of neighbouring fringes where their distance is the sum of their widths, give or take: a
# raised cosine is half a period wide at half its height.
_ALONG = 1.7
# A number handed on is a little less sure than where it came from.
_FADE = 0.95
# One row says at most so much, in nats.
_LOUDEST = np.float32(6.0)


@numba.njit(cache=True, nogil=True)
def link_rows(starts: Longs, col: Singles, width: Singles, above: Wholes, below: Wholes) -> None:
    """Write the slit of the row above and of the row below that each slit (m,) goes on to, -1 for none.

    starts (h + 1,), col, width (m,) as in `Slits`. Each is the other's nearest.
    """
    above[:] = -1
    below[:] = -1
    for row in range(1, len(starts) - 1):
        low, middle, high = starts[row - 1], starts[row], starts[row + 1]
        if low == middle:
            continue
        j = low
        for i in range(middle, high):
            while j < middle - 1 and abs(col[j + 1] - col[i]) <= abs(col[j] - col[i]):
                j += 1
            gap = abs(col[j] - col[i])
            nearer = (i + 1 < high and abs(col[j] - col[i + 1]) < gap) or (
                i > middle and abs(col[j] - col[i - 1]) < gap
            )
            if not nearer and gap <= _ACROSS * min(width[i], width[j]) + _SLACK_PX:
                above[i] = j
                below[j] = i


@numba.njit(cache=True, nogil=True)
def _look_around(
    i: int, first: int, end: int, col: Singles, width: Singles, above: Wholes, below: Wholes, sign: int, found: Longs
) -> None:
    """Write the four neighbours of slit i of the row first ... end - 1, -1 for none: above, below, left and right.

    found (2, 4): neighbours, and what makes each one's number that of slit i.
    """
    found[:] = 0
    found[0, 0], found[0, 1], found[0, 2], found[0, 3] = above[i], below[i], -1, -1
    found[1, 2], found[1, 3] = sign, -sign
    if i > first and 1 / _ALONG < (col[i] - col[i - 1]) / (width[i] + width[i - 1]) < _ALONG:
        found[0, 2] = i - 1
    if i + 1 < end and 1 / _ALONG < (col[i + 1] - col[i]) / (width[i] + width[i + 1]) < _ALONG:
        found[0, 3] = i + 1


@numba.njit(cache=True, nogil=True)
def spread_numbers(
    starts: Longs,
    row: Wholes,
    col: Singles,
    width: Singles,
    above: Wholes,
    below: Wholes,
    sign: int,
    scores: Singles,
    kinds: Wholes,
    allowed: Wholes,
    slack: float,
    label: Wholes,
    ahead: Singles,
) -> None:
    """Hand labels (m,) on to neighbours that have none, -1, in place: a flood that starts everywhere at once.

    sign: +1 where labels rise along rows, else -1. scores (m, k), kinds (n,), allowed (m, 2): as `match_lines`; a slit
    takes a label only if its colour is at most `slack` nats worse than its best one. Neighbours that agree outvote
    others, and a tie is none. ahead (m,): by how much a label is ahead of others, in nats.
    """
    count = len(col)
    queue, waiting = np.empty(count, dtype=np.int64), np.zeros(count, dtype=np.bool_)
    around = np.empty((2, 4), dtype=np.int64)
    head, held = 0, 0
    for i in range(count):
        if label[i] < 0:
            queue[held], waiting[i] = i, True
            held += 1
    while held:
        i = queue[head]
        head, held = (head + 1) % count, held - 1
        waiting[i] = False
        first, end = int(starts[row[i]]), int(starts[row[i] + 1])
        _look_around(i, first, end, col, width, above, below, sign, around)
        chosen, trust = _chosen(i, around, scores, kinds, allowed, slack, label, ahead)
        twice = (i > first and label[i - 1] == chosen) or (i + 1 < end and label[i + 1] == chosen)
        if chosen < 0 or twice:
            continue
        label[i], ahead[i] = chosen, _FADE * trust
        for k in range(4):
            j = around[0, k]
            if j >= 0 and label[j] < 0 and not waiting[j]:
                queue[(head + held) % count], waiting[j] = j, True
                held += 1


@numba.njit(cache=True, nogil=True)
def _chosen(
    i: int,
    around: Longs,
    scores: Singles,
    kinds: Wholes,
    allowed: Wholes,
    slack: float,
    label: Wholes,
    ahead: Singles,
) -> tuple[int, float]:
    """Return the label that most neighbours of slit i stand for, -1 for none, and the least that they are ahead."""
    best, most, trust, tie = -1, 0, 0.0, False
    lowest = scores[i].max() - np.float32(slack)
    for k in range(4):
        if around[0, k] < 0 or label[around[0, k]] < 0:
            continue
        own = label[around[0, k]] + around[1, k]
        if own == best or not allowed[i, 0] <= own <= allowed[i, 1] or scores[i, kinds[own]] < lowest:
            continue
        votes, least = 0, np.inf
        for other in range(4):
            j = around[0, other]
            if j >= 0 and label[j] >= 0 and label[j] + around[1, other] == own:
                votes, least = votes + 1, min(least, float(ahead[j]))
        if votes > most:
            best, most, trust, tie = own, votes, least, False
        elif votes == most:
            tie = True
    return (-1 if tie else best), trust


@numba.njit(cache=True, nogil=True)
def drop_islands(
    starts: Longs,
    row: Wholes,
    col: Singles,
    width: Singles,
    above: Wholes,
    below: Wholes,
    sign: int,
    fewest: int,
    fringes: int,
    label: Wholes,
) -> None:
    """Take the labels (m,) from groups of slits that agree with each other but are too few, in place.

    fewest: slits of a group; fringes: different labels of a group.
    """
    count = len(col)
    group, stack, done = np.empty(count, np.int64), np.empty(count, np.int64), np.zeros(count, np.bool_)
    around = np.empty((2, 4), dtype=np.int64)
    for seed in range(count):
        if label[seed] < 0 or done[seed]:
            continue
        size, top = 0, 1
        stack[0], done[seed] = seed, True
        low, high = label[seed], label[seed]
        while top:
            top -= 1
            i = stack[top]
            group[size] = i
            size += 1
            low, high = min(low, label[i]), max(high, label[i])
            first, end = int(starts[row[i]]), int(starts[row[i] + 1])
            _look_around(i, first, end, col, width, above, below, sign, around)
            for k in range(4):
                j = around[0, k]
                if j >= 0 and not done[j] and label[j] >= 0 and label[j] + around[1, k] == label[i]:
                    stack[top], done[j] = j, True
                    top += 1
        if size < fewest or high - low + 1 < fringes:
            for k in range(size):
                label[group[k]] = -1


@numba.njit(cache=True, nogil=True)
def accept_chains(
    above: Wholes,
    below: Wholes,
    guess: Wholes,
    margin: Singles,
    rows: int,
    mean: float,
    total: float,
    label: Wholes,
    ahead: Singles,
) -> None:
    """Give slits without label (m,) the label that single rows guess, in place, where it is the same down a chain.

    guess, margin (m,): as `match_lines` leaves them. A chain has `rows` slits or more, whose margins, of which each
    counts up to a limit, are `mean` nats on average and `total` nats together.
    """
    for i in range(len(label)):
        if label[i] >= 0 or guess[i] < 0:
            continue
        before = above[i]
        if before >= 0 and label[before] < 0 and guess[before] == guess[i]:
            continue
        evidence, length, j = np.float32(0), 0, i
        while j >= 0 and label[j] < 0 and guess[j] == guess[i]:
            evidence += min(margin[j], _LOUDEST)
            length += 1
            j = below[j]
        if length < rows or evidence < max(total, mean * length):
            continue
        j = i
        for _ in range(length):
            label[j], ahead[j] = guess[i], evidence
            j = below[j]
