"""Slits among their neighbours: tracks from row to row, the label that each piece of one carries, gaps in a row."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]

# A row says at most so much about a track's label, in nats: neighbouring rows err together.
_LOUDEST = np.float32(6.0)
_CANDIDATES = 6


@numba.njit(cache=True, nogil=True)
def link_slits(
    starts: Longs, col: Singles, chroma: Singles, reach: float, apart: float, track: Wholes, previous: Wholes
) -> int:
    """Join slits of neighbouring rows to tracks, and return how many tracks there are.

    starts (h + 1,) as `find_slits` leaves it; col (m,) px; chroma (m, 3). Two slits belong together where each is the
    other's nearest, at most `reach` px from where the track's pace, or that of the nearest track, leads, and at most
    `apart` from the colour that the track has had lately. track (m,): the number of each slit's track; previous (m,):
    the slit before it on the track, -1 at its start.
    """
    tracks = 0
    pace = np.zeros(len(col), dtype=np.float32)
    usual = chroma.copy()
    for row in range(len(starts) - 1):
        low, middle, high = (starts[row - 1] if row else 0), starts[row], starts[row + 1]
        j = low
        for i in range(middle, high):
            previous[i] = -1
            if low == middle:
                continue
            while j < middle - 1 and abs(col[j + 1] + pace[j + 1] - col[i]) <= abs(col[j] + pace[j] - col[i]):
                j += 1
            pace[i] = pace[j]
            gap = abs(col[j] + pace[j] - col[i])
            far = abs(chroma[i, 0] - usual[j, 0]) + abs(chroma[i, 1] - usual[j, 1])
            far += abs(chroma[i, 2] - usual[j, 2])
            nearer = i + 1 < high and abs(col[j] + pace[j] - col[i + 1]) < gap
            if gap <= reach and far <= apart and not nearer:
                previous[i] = j
                pace[i] = 0.7 * pace[j] + 0.3 * (col[i] - col[j])
                for channel in range(3):
                    usual[i, channel] = 0.8 * usual[j, channel] + 0.2 * chroma[i, channel]
        for i in range(middle, high):
            if previous[i] < 0:
                track[i] = tracks
                tracks += 1
            else:
                track[i] = track[previous[i]]
    return tracks


@numba.njit(cache=True, nogil=True)
def along_tracks(values: Singles, previous: Wholes, keep: float) -> Singles:
    """Return values (m, k) averaged along tracks with weights keep ** distance, towards both ends."""
    forth, back = values.copy(), values.copy()
    share = np.float32(keep)
    weight, back_weight = np.ones(len(values), np.float32), np.ones(len(values), np.float32)
    for i in range(len(values)):
        j = previous[i]
        if j >= 0:
            weight[i] += share * weight[j]
            for k in range(values.shape[1]):
                forth[i, k] += share * forth[j, k]
    for i in range(len(values) - 1, -1, -1):
        j = previous[i]
        if j >= 0:
            back_weight[j] += share * back_weight[i]
            for k in range(values.shape[1]):
                back[j, k] += share * back[i, k]
    for i in range(len(values)):
        total = np.float32(1) / (weight[i] + back_weight[i] - 1)
        for k in range(values.shape[1]):
            forth[i, k] = (forth[i, k] + back[i, k] - values[i, k]) * total
    return forth


@numba.njit(cache=True, nogil=True)
def vote(
    order: Longs,
    ends: Longs,
    label: Wholes,
    margin: Singles,
    labels: int,
    switch: float,
    voted: Wholes,
    evidence: Singles,
) -> None:
    """Give every slit of a track one label, or several along it where the rows change their mind for good.

    order (m,): the slits track by track, ends (t,): where each track ends in it; label, margin (m,): what single rows
    say, -1 for nothing. Labels are chosen by the Viterbi algorithm, in which a change costs `switch` nats. voted (m,):
    the label
    of the slit's piece of track; evidence (m, 3): margins for it, margins against it, summed, and rows of the piece.
    """
    support = np.zeros(labels, dtype=np.float32)
    first = 0
    for t in range(len(ends)):
        slits = order[first : ends[t]]
        first = ends[t]
        for i in slits:
            if label[i] >= 0:
                support[label[i]] += min(margin[i], _LOUDEST)
        candidates = _strongest(slits, label, support)
        for i in slits:
            if label[i] >= 0:
                support[label[i]] = 0
        if not len(candidates):
            voted[slits] = -1
            evidence[slits] = 0
            continue
        path = _path(slits, label, margin, candidates, switch)
        start = 0
        for k in range(1, len(slits) + 1):
            if k == len(slits) or path[k] != path[start]:
                _weigh(slits[start:k], int(candidates[path[start]]), label, margin, voted, evidence)
                start = k


@numba.njit(cache=True, nogil=True)
def _strongest(slits: Longs, label: Wholes, support: Singles) -> Wholes:
    """Return the labels with the most support, strongest first."""
    found = np.empty(_CANDIDATES, dtype=np.int32)
    count = 0
    for i in slits:
        own = label[i]
        if own < 0:
            continue
        known = False
        for k in range(count):
            known = known or found[k] == own
        if known:
            continue
        k = count if count < _CANDIDATES else _CANDIDATES - 1
        if count < _CANDIDATES:
            count += 1
        elif support[found[k]] >= support[own]:
            continue
        while k > 0 and support[found[k - 1]] < support[own]:
            found[k] = found[k - 1]
            k -= 1
        found[k] = own
    return found[:count]


@numba.njit(cache=True, nogil=True)
def _path(slits: Longs, label: Wholes, margin: Singles, candidates: Wholes, switch: float) -> Wholes:
    """Return for every slit of a track which candidate it has, by the Viterbi algorithm."""
    count = len(candidates)
    if count == 1:
        return np.zeros(len(slits), dtype=np.int32)
    came = np.empty((len(slits), count), dtype=np.int32)
    score = np.zeros(count, dtype=np.float32)
    for k in range(len(slits)):
        top = 0
        for c in range(1, count):
            top = c if score[c] > score[top] else top
        best = score[top] - np.float32(switch)
        i = slits[k]
        said = min(margin[i], _LOUDEST) if label[i] >= 0 else np.float32(0)
        for c in range(count):
            stays = score[c] >= best
            came[k, c] = c if stays else top
            score[c] = (score[c] if stays else best) + (said if candidates[c] == label[i] else -said)
    path = np.empty(len(slits), dtype=np.int32)
    last = 0
    for c in range(1, count):
        last = c if score[c] > score[last] else last
    for k in range(len(slits) - 1, -1, -1):
        path[k] = last
        last = came[k, last]
    return path


@numba.njit(cache=True, nogil=True)
def _weigh(slits: Longs, chosen: int, label: Wholes, margin: Singles, voted: Wholes, evidence: Singles) -> None:
    """Write the label of a piece of track and what its rows say for and against it.

    Its ends, as far as no row has that label, get none: there a track often goes on to another slit.
    """
    voted[slits] = -1
    evidence[slits] = 0
    first, last = 0, len(slits) - 1
    while first < last and label[slits[first]] != chosen:
        first += 1
    while last > first and label[slits[last]] != chosen:
        last -= 1
    rows = len(slits)
    slits = slits[first : last + 1]
    pro, contra = np.float32(0), np.float32(0)
    for i in slits:
        said = min(margin[i], _LOUDEST)
        if label[i] == chosen:
            pro += said
        elif label[i] >= 0:
            contra += said
    for i in slits:
        voted[i] = chosen
        evidence[i, 0], evidence[i, 1], evidence[i, 2] = pro, contra, rows


@numba.njit(cache=True, nogil=True)
def room_before(starts: Longs, col: Singles, most: int, out: Wholes) -> None:
    """Write how many more stripes the gap before each slit (m,) has room for, by the gaps around it in its row.

    At most `most`: a wider gap is an edge of the scene, of which nothing is known.
    """
    gaps = np.empty(7, dtype=np.float32)
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        for i in range(first, last):
            out[i] = 0
            if i == first or last - first < 4:
                continue
            count = 0
            for j in range(max(first + 1, i - 3), min(last, i + 4)):
                k = count
                while k > 0 and gaps[k - 1] > col[j] - col[j - 1]:
                    gaps[k] = gaps[k - 1]
                    k -= 1
                gaps[k] = col[j] - col[j - 1]
                count += 1
            room = int(np.rint((col[i] - col[i - 1]) / gaps[count // 2])) - 1
            out[i] = max(room, 0) if room <= most else 0
