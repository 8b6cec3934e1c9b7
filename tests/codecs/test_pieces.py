"""Pieces of tracks among their neighbours: belief propagation against all assignments, and a thin rod."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._piece_kernels import drop_lonely, find_pairs, group, propagate, usual_gaps
from slkit.codecs._pieces import label_pieces
from slkit.codecs._view_slits import Slits
from slkit.codecs.color_stripes import ColorStripes

SEEDS = st.integers(0, 2**32 - 1)
JUMP, SKIP = 5.0, 4.0


def toll(step: int, wanted: int, weight: float) -> float:
    """What a pair costs in nats whose labels differ by `step` where `wanted` is expected."""
    near = step >= min(wanted, 1) and -1 <= step - wanted <= 1
    return weight * min(JUMP, SKIP * abs(step - wanted)) if near else weight * JUMP


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS)
def test_on_a_tree_the_belief_is_the_best_of_all_assignments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pieces, labels = int(rng.integers(2, 5)), 4
    own = rng.normal(0, 3, (pieces, labels)).astype(np.float32)
    label = np.full(pieces, -1, np.int32)
    if rng.random() < 0.5:
        label[0] = rng.integers(labels)
        own[0], own[0, label[0]] = -50, 0
    other = [int(rng.integers(i)) for i in range(1, pieces)]
    ends = [(i, o) if rng.random() < 0.5 else (o, i) for i, o in enumerate(other, 1)]
    pair = np.array([(*e, rng.integers(0, 3)) for e in ends], np.int32).reshape(-1, 3)
    weight = rng.uniform(0.2, 1, len(pair)).astype(np.float32)
    belief = np.empty_like(own)
    propagate(own, label, pair, weight, JUMP, SKIP, 8, belief)
    best = np.full_like(own, -np.inf)
    for chosen in product(range(labels), repeat=pieces):
        worth = sum(own[i, c] for i, c in enumerate(chosen))
        worth -= sum(toll(chosen[r] - chosen[a], w, s) for (a, r, w), s in zip(pair.tolist(), weight, strict=True))
        for i, c in enumerate(chosen):
            best[i, c] = max(best[i, c], worth)
    free = label < 0
    np.testing.assert_allclose(
        belief[free] - belief[free].max(axis=1, keepdims=True),
        best[free] - best[free].max(axis=1, keepdims=True),
        atol=1e-3,
    )


def test_pieces_that_agree_make_a_group_and_lonely_ones_are_dropped() -> None:
    pair = np.array([(0, 1, 1), (1, 2, 1), (2, 3, 1), (4, 5, 2), (0, 2, 2)], np.int32)
    label = np.array([7, 8, 9, 3, 1, 3, -1], np.int32)
    root = np.empty(len(label), np.int64)
    group(label, pair, root)
    assert len({*root[:3].tolist()}) == 1 and root[3] == 3 and root[4] == root[5] != root[0] and root[6] == 6
    drop_lonely(label, np.ones(len(label), dtype=np.bool_), pair, 2)
    assert label.tolist() == [7, 8, 9, -1, -1, -1, -1]


def test_neighbours_lie_a_gap_beside_the_track_also_some_rows_on() -> None:
    """Track 0 in rows 0 to 9 at column 20; one of the next label in rows 14 to 23, a gap of 10 px to the right."""
    row = np.repeat(np.arange(24), 2).astype(np.int32)
    col = np.where(np.arange(48) % 2 == 0, 20, 30).astype(np.float32)
    starts = np.arange(0, 50, 2)
    gap = np.empty(48, np.float32)
    usual_gaps(starts, col, gap)
    assert (gap == 10).all()
    here = ((col == 20) & (row < 10)) | ((col == 30) & (row >= 14))
    row, col, gap = row[here], col[here], gap[here]
    starts = np.searchsorted(row, np.arange(25))
    piece = (col == 30).astype(np.int32)
    pair, weight = np.empty((50, 3), np.int32), np.empty(50, np.float32)
    shifts = np.array([-1.4, 1.4], np.float32)
    some = np.arange(len(row))
    count = find_pairs(starts, row, col, np.zeros_like(col), gap, piece, some, shifts, 0.3, pair, weight)
    assert pair[:count].tolist() == [[0, 1, 1], [0, 1, 1]] and weight[:count].tolist() == [5.0, 5.0]


@pytest.mark.parametrize(("shown", "found"), [(8, True), (5, False)])
def test_a_slanted_rod_is_told_by_its_slits_one_after_another(shown: int, found: bool) -> None:
    """A rod with one slit in a row before a plane of ten: the slits follow each other down the rod."""
    codec = ColorStripes((360, 200))
    kinds = np.asarray(codec.layout.stripes, np.int32)
    rows, first, plane = 12, 20, 5
    slits, true = rod_before_plane(rows, shown, first, plane)
    scores = np.full((len(slits), 6), -6.0, np.float32)
    scores[np.arange(len(slits)), kinds[true]] = 2.5
    known = np.where(true < first, true, -1).astype(np.int32)
    allowed = np.tile(np.array([0, len(kinds) - 1], np.int32), (len(slits), 1))
    label, ahead = label_pieces(slits, scores, kinds, allowed, known)
    rod = true >= first
    assert (label[~rod] == -1).all()
    assert (label[rod] == (true[rod] if found else -1)).all()
    assert not found or (ahead[rod] >= 4.5).all()
    allowed[rod] = [0, first - 1]
    assert (label_pieces(slits, scores, kinds, allowed, known)[0] == -1).all()


def rod_before_plane(rows: int, shown: int, first: int, plane: int) -> tuple[Slits, np.ndarray]:
    """Slits of a plane, 12 px apart from label `plane` on, and of a rod; and their true labels (m,)."""
    at, col, true, track = [], [], [], []
    for r in range(rows * shown):
        step = r // rows
        for k in range(shown + 4):
            hidden = k == step + 2
            at.append(r)
            col.append(12.0 * k + (17.0 if hidden else 12.0))
            true.append(first + step if hidden else plane + k)
            track.append(100 + step if hidden else k)
    _, number = np.unique(track, return_inverse=True)
    previous, last = np.full(len(at), -1, np.int32), dict[int, int]()
    for i, t in enumerate(number.tolist()):
        j = last.get(t, -1)
        previous[i] = j if j >= 0 and at[i] - at[j] == 1 else -1
        last[t] = i
    starts = np.searchsorted(at, np.arange(rows * shown + 1))
    flat = np.ones(len(at), np.float32)
    columns = np.asarray(col, np.float32)
    slits = Slits(
        starts,
        np.asarray(at, np.int32),
        columns,
        flat,
        flat,
        flat,
        np.ones((len(at), 3), np.float32),
        flat,
        number.astype(np.int32),
        previous,
    )
    return slits, np.asarray(true)
