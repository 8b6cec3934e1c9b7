"""Sequences of which every window occurs once."""

from collections import Counter
from itertools import pairwise, product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._debruijn import eulerian_sequence, least_distance, repeated_window
from slkit.errors import InputError


def windows_of(sequence, window):
    return [tuple(sequence[i : i + window]) for i in range(len(sequence) - window + 1)]


@pytest.mark.parametrize(("symbols", "window", "count"), [(6, 3, 150), (6, 2, 30), (4, 3, 36), (5, 3, 80), (6, 4, 750)])
def test_lengths_are_those_of_the_formula(symbols, window, count):
    sequence = eulerian_sequence(symbols, window, lambda a, b: a != b)
    assert count == symbols * (symbols - 1) ** (window - 1)
    assert len(sequence) == count + window - 1


@settings(max_examples=40, deadline=None)
@given(symbols=st.integers(3, 6), window=st.integers(2, 4))
def test_every_window_of_unequal_neighbours_occurs_exactly_once(symbols, window):
    sequence = eulerian_sequence(symbols, window, lambda a, b: a != b)
    wanted = [w for w in product(range(symbols), repeat=window) if all(a != b for a, b in pairwise(w))]
    assert Counter(windows_of(sequence, window)) == Counter(wanted)
    assert repeated_window(sequence, window) is None


@settings(max_examples=20, deadline=None)
@given(symbols=st.integers(2, 5), window=st.integers(2, 4))
def test_with_everything_allowed_it_is_a_de_bruijn_sequence(symbols, window):
    sequence = eulerian_sequence(symbols, window, lambda a, b: True)
    assert set(windows_of(sequence, window)) == set(product(range(symbols), repeat=window))
    assert len(sequence) == symbols**window + window - 1


def test_pairs_recur_far_apart_in_a_pattern_of_triples():
    """A piece of two slits must not fit a few slits on: each of 30 pairs comes back after about 30, not after 3."""
    pairs = windows_of(eulerian_sequence(6, 3, lambda a, b: a != b)[:107], 2)
    seen, gaps = {}, []
    for place, pair in enumerate(pairs):
        gaps.append(place - seen.get(pair, -1000))
        seen[pair] = place
    assert min(gaps) >= 12


def test_rules_that_leave_no_closed_walk_are_refused():
    with pytest.raises(InputError, match="no sequence of 3 colours"):
        eulerian_sequence(3, 3, lambda a, b: False)
    with pytest.raises(InputError, match="no closed sequence"):
        eulerian_sequence(3, 2, lambda a, b: a < b)


@settings(max_examples=60, deadline=None)
@given(sequence=st.lists(st.integers(0, 3), min_size=4, max_size=20), window=st.integers(2, 4))
def test_repeats_and_distances_are_those_of_all_pairs(sequence, window):
    windows = windows_of(sequence, window)
    distances = [
        sum(a != b for a, b in zip(v, w, strict=True)) for i, v in enumerate(windows) for w in windows[i + 1 :]
    ]
    found = repeated_window(sequence, window)
    assert (found is None) == (len(set(windows)) == len(windows))
    if found is not None:
        assert found[0] < found[1] and windows[found[0]] == windows[found[1]]
    assert least_distance(sequence, window) == min(distances, default=window)
