"""The kernels of colour stripes against plain twins: enumeration where it can be done, loops where it cannot."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._chromatic import _fit
from slkit.codecs._color_kernels import strongest_in_cells
from slkit.codecs._match_kernels import MOST_ROOM, match_lines, neighbours
from slkit.codecs._slit_colors import score_colors
from slkit.codecs._track_kernels import _LOUDEST, along_tracks, link_slits, room_before, vote

STEPS = 2
# A known slit is never left out; scores are added up in thousandths, of which a line has fewer than 20.
SURELY, CLOSE = 1000.0, 0.02
SEEDS = st.integers(0, 2**32 - 1)


def step_price(before: int, after: int, room: int, prices: tuple[float, float, float]) -> float:
    """What it costs that `after` follows `before` where there is room for so many unseen stripes between them."""
    beyond = after - before - 1 - room
    return min(prices[0] * abs(beyond) if -min(room, STEPS) <= beyond <= STEPS else np.inf, prices[1])


def best_by_hand(own: np.ndarray, room: np.ndarray, prices: tuple[float, float, float]) -> dict:
    """The best score of a line for each choice (slit, label), label -1 for none, by trying every assignment."""
    slits, labels = own.shape
    best = dict.fromkeys(product(range(slits), range(-1, labels)), -np.inf)
    for chosen in product(range(-1, labels), repeat=slits):
        total, before = 0.0, None
        for i, label in enumerate(chosen):
            if label < 0:
                continue
            total += own[i, label]
            total -= 0 if before is None else step_price(before, label, room[i], prices)
            before = label
        for i, label in enumerate(chosen):
            best[i, label] = max(best[i, label], total)
    return best


def twin(own: np.ndarray, room: np.ndarray, prices: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Label and margin of each slit of a line, from max-marginals over all assignments."""
    best = best_by_hand(own, room, prices)
    label, margin = np.full(len(own), -1), np.zeros(len(own))
    for i in range(len(own)):
        scores = np.array([best[i, k] for k in range(-1, own.shape[1])])
        first, second = np.sort(scores)[::-1][:2]
        if scores.argmax() > 0:
            label[i], margin[i] = scores.argmax() - 1, first - second
    return label, margin


def line_of(seed: int):
    rng = np.random.default_rng(seed)
    slits, labels, colors = rng.integers(1, 5), rng.integers(2, 6), 3
    kinds = rng.integers(0, colors, labels).astype(np.int32)
    scores = rng.normal(0, 3, (slits, colors)).astype(np.float32)
    room = rng.integers(0, min(MOST_ROOM, 2) + 1, slits).astype(np.int32)
    low = rng.integers(0, labels, slits)
    allowed = np.stack([low // 2, np.maximum(low, labels - 1 - low)], axis=1).astype(np.int32)
    return rng, kinds, scores, room, allowed


def matched(scores, room, kinds, allowed, fixed, prices):
    label, margin = np.full(len(room), -9, np.int32), np.full(len(room), np.nan, np.float32)
    starts = np.array([0, len(room)], dtype=np.int64)
    match_lines(starts, scores, room, kinds, allowed, fixed, prices, label, margin)
    return label, margin


def own_scores(scores, kinds, allowed, toll=None):
    own = scores[:, kinds].astype(float) - (0 if toll is None else toll)
    place = np.arange(len(kinds))
    return np.where((place >= allowed[:, :1]) & (place <= allowed[:, 1:]), own, -np.inf)


@settings(max_examples=150, deadline=None)
@given(seed=SEEDS)
def test_matching_finds_the_best_of_all_assignments_and_its_margin(seed):
    _, kinds, scores, room, allowed = line_of(seed)
    prices = (2.0, 5.0, 1.0)
    free = np.full(len(room), -1, np.int32)
    label, margin = matched(scores, room, kinds, allowed, free, prices)
    expected, sure = twin(own_scores(scores, kinds, allowed), room, prices)
    clear = sure > CLOSE
    np.testing.assert_array_equal(label[clear], expected[clear])
    np.testing.assert_allclose(margin[clear], sure[clear], atol=CLOSE)
    assert (margin[(expected < 0) & (label >= 0)] < CLOSE).all()


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS)
def test_known_slits_hold_the_others_in_order_and_keep_their_label(seed):
    rng, kinds, scores, room, allowed = line_of(seed)
    prices = (2.0, 5.0, 1.0)
    fixed = np.full(len(room), -1, np.int32)
    fixed[rng.integers(len(room))] = held = rng.integers(len(kinds))
    label, margin = matched(scores, room, kinds, allowed, fixed, prices)
    toll = np.where(np.arange(len(kinds)) == held, prices[2], 0)
    own = own_scores(scores, kinds, allowed, toll)
    own[fixed >= 0] = -np.inf
    own[fixed >= 0, held] = SURELY
    expected, sure = twin(own, room, prices)
    clear = (fixed < 0) & (sure > CLOSE)
    np.testing.assert_array_equal(label[clear], expected[clear])
    np.testing.assert_array_equal(label[fixed >= 0], held)
    np.testing.assert_allclose(margin[clear], sure[clear], atol=CLOSE)


def test_lines_do_not_see_each_other():
    _, kinds, scores, room, allowed = line_of(3)
    free = np.full(len(room), -1, np.int32)
    alone = matched(scores, room, kinds, allowed, free, (2.0, 5.0, 1.0))
    twice = [np.concatenate([a, a]) for a in (scores, room, allowed, free)]
    label, margin = np.empty(2 * len(room), np.int32), np.empty(2 * len(room), np.float32)
    starts = np.array([0, len(room), 2 * len(room)], dtype=np.int64)
    match_lines(starts, twice[0], twice[1], kinds, twice[2], twice[3], (2.0, 5.0, 1.0), label, margin)
    np.testing.assert_array_equal(label, np.tile(alone[0], 2))


@settings(max_examples=150, deadline=None)
@given(seed=SEEDS, switch=st.sampled_from([2.0, 10.0, 1e9]))
def test_a_track_gets_the_labels_that_most_of_its_rows_stand_for(seed, switch):
    """Viterbi against all ways of labelling a short track; ends that no row supports get none."""
    rng = np.random.default_rng(seed)
    rows, labels = rng.integers(1, 7), 3
    label = rng.integers(-1, labels, rows).astype(np.int32)
    margin = rng.uniform(0.1, 9, rows).astype(np.float32)
    voted, evidence = np.empty(rows, np.int32), np.empty((rows, 3), np.float32)
    vote(np.arange(rows), np.array([rows]), label, margin, labels, switch, voted, evidence)
    said = np.minimum(margin, _LOUDEST)

    def score(path):
        agreed = sum(s if p == k else -s for p, k, s in zip(path, label, said, strict=True) if k >= 0)
        return agreed - switch * np.count_nonzero(np.diff(path))

    candidates = np.unique(label[label >= 0])
    if not len(candidates):
        assert (voted == -1).all() and not evidence.any()
        return
    best = max(product(candidates, repeat=rows), key=score)
    expected = np.full(rows, -1)
    others = (score(p) for p in product(candidates, repeat=rows) if p != best)
    if np.isclose(score(best), max(others, default=-np.inf)):
        return  # A tie: either path will do.
    for piece in np.split(np.arange(rows), np.flatnonzero(np.diff(best)) + 1):
        chosen = best[piece[0]]
        backed = piece[label[piece] == chosen]
        kept = piece[(piece >= backed.min(initial=rows)) & (piece <= backed.max(initial=-1))]
        expected[kept] = chosen
        against = (label[kept] >= 0) & (label[kept] != chosen)
        told = [said[kept][label[kept] == chosen].sum(), said[kept][against].sum(), len(piece)]
        np.testing.assert_allclose(evidence[kept], np.tile(told, (len(kept), 1)), rtol=1e-5)
    np.testing.assert_array_equal(voted, expected)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, most=st.integers(1, 4))
def test_neighbours_are_counted_as_far_as_the_labels_go_on(seed, most):
    rng = np.random.default_rng(seed)
    label = rng.integers(-1, 4, 12).astype(np.int32)
    run = rng.integers(0, 8)
    label[run : run + 4] = 7 + np.arange(4)
    starts = np.array([0, 5, 12], dtype=np.int64)
    out = np.empty(12, np.float32)
    neighbours(starts, label, most, out)
    for first, last in ((0, 5), (5, 12)):
        for i in range(first, last):
            count = 0
            for way in (1, -1):
                for d in range(1, most + 1):
                    j = i + way * d
                    if not (first <= j < last) or label[i] < 0 or label[j] != label[i] + way * d:
                        break
                    count += 1
            assert out[i] == count


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, keep=st.floats(0.1, 0.95))
def test_averages_along_tracks_weigh_by_distance_in_both_directions(seed, keep):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(9, 2)).astype(np.float32)
    # Two tracks, one slit of each in a row, and the last row has only the first.
    previous = np.array([-1, -1, 0, 1, 2, 3, 4, 5, 6], dtype=np.int32)
    got = along_tracks(values, previous, keep)
    for track in (np.arange(0, 9, 2), np.arange(1, 9, 2)):
        weight = keep ** np.abs(np.subtract.outer(np.arange(len(track)), np.arange(len(track))))
        expected = weight @ values[track] / weight.sum(axis=1, keepdims=True)
        np.testing.assert_allclose(got[track], expected, rtol=2e-4, atol=1e-5)


def test_tracks_follow_slanted_slits_and_end_where_the_color_changes():
    rows, slits = 12, 4
    starts = np.arange(0, rows * slits + 1, slits, dtype=np.int64)
    row, place = np.divmod(np.arange(rows * slits), slits)
    col = (20 * place + 0.9 * row).astype(np.float32)
    chroma = np.eye(3, dtype=np.float32)[place % 3]
    chroma[(place == 2) & (row >= 6)] = [1, 0, 0]
    track, previous = np.empty(len(col), np.int32), np.empty(len(col), np.int32)
    assert link_slits(starts, col, chroma, 1.5, 0.8, track, previous) == slits + 1
    for k in (0, 1, 3):
        assert len(set(track[place == k])) == 1
    assert len(set(track[(place == 2) & (row < 6)])) == 1
    assert track[(place == 2) & (row == 5)] != track[(place == 2) & (row == 6)]
    linked = previous >= 0
    np.testing.assert_array_equal(place[previous[linked]], place[linked])


def test_room_is_what_a_gap_holds_more_than_the_gaps_around():
    col = np.cumsum([0, 10, 10, 20, 10, 10, 10, 40, 10, 10, 10, 99], dtype=np.float32)
    room = np.empty(len(col), np.int32)
    room_before(np.array([0, len(col)], dtype=np.int64), col, 4, room)
    # The last gap holds nine: an edge, of which nothing is known.
    assert room.tolist() == [0, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0]


def test_cells_keep_the_strongest_of_each_channel():
    light = np.array([[1, -5, 0], [3, 2, 0], [9, 9, 9]], dtype=np.float32)
    cells = np.zeros((1, 2, 3), np.float32)
    strongest_in_cells(np.array([0, 0, 0]), np.array([0, 0, 1]), light, cells)
    assert cells.tolist() == [[[3, 5, 0], [9, 9, 9]]]


def test_each_color_scores_best_for_itself_and_grey_for_none():
    ideal = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1]], dtype=np.float32)
    light = np.concatenate([80 * ideal, [[60.0, 58.0, 61.0]]]).astype(np.float32)
    scores = score_colors(light, np.full(len(light), 1, np.float32), ideal, False)
    np.testing.assert_array_equal(scores[:6].argmax(axis=1), np.arange(6))
    assert (scores[:6].max(axis=1) > 1).all() and (scores[6] < 0).all()


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_offsets_of_colors_are_fitted_despite_outliers(seed):
    rng = np.random.default_rng(seed)
    row, col = rng.uniform(-1, 1, (2, 900))
    field = np.stack([np.ones(900), row, col], axis=1)
    true = np.stack([rng.uniform(-0.5, 0.5, 3), np.zeros(3), rng.uniform(-0.5, 0.5, 3)], axis=1)
    center = 300 + field @ true + rng.normal(0, 0.05, (900, 3))
    center[np.arange(900), rng.integers(0, 3, 900)] = np.nan
    center[:90, 0] += rng.uniform(-3, 3, 90)
    # 300 slits of each pair with a noise of 0.07 px: 0.07 / sqrt(300) / 0.58 = 0.007 px for a slope over the picture.
    np.testing.assert_allclose(_fit(field, center), true, atol=0.05)
