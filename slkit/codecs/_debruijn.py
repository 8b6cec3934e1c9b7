"""Sequences in which every window of a few symbols occurs once, as Eulerian circuits of a graph of windows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from slkit.errors import InputError

Allowed = Callable[[int, int], bool]


def eulerian_sequence(symbols: int, window: int, allowed: Allowed) -> tuple[int, ...]:
    """Return the longest sequence in which every window of `window` symbols that may occur does so exactly once.

    window: 2 or more; allowed(a, b): whether symbol b may follow a. The vertices are the windows less their last
    symbol, every window is an edge; with all unequal neighbours allowed the length is
    symbols * (symbols - 1) ** (window - 1) + window - 1.
    Errors: InputError where no closed walk over all edges exists.
    Source: Hierholzer's algorithm; de Bruijn (1946) for the sequence.
    """
    short = [v for v in product(range(symbols), repeat=window - 1) if all(map(allowed, v, v[1:]))]
    left = {v: [(*v, s)[1:] for s in range(symbols) if allowed(v[-1], s)] for v in short}
    edges = sum(map(len, left.values()))
    if not edges:
        raise InputError(f"no sequence of {symbols} colours exists in which neighbours follow these rules")
    path, circuit = [short[0]], []
    # Where the longest unvisited vertex and then symbol come next, pieces shorter than a window recur far apart.
    visited, used, step = dict.fromkeys(short, -1), [-1] * symbols, 0
    while path:
        here = path[-1]
        visited[here], used[here[-1]], step = step, step, step + 1
        if left[here]:
            path.append(min(left[here], key=lambda v: (visited[v], used[v[-1]])))
            left[here].remove(path[-1])
        else:
            circuit.append(path.pop())
    circuit.reverse()
    if len(circuit) != edges + 1 or circuit[0] != circuit[-1]:
        raise InputError(f"no closed sequence of {symbols} colours has every window of {window} that these rules allow")
    return (*circuit[0], *(v[-1] for v in circuit[1:]))


def repeated_window(sequence: Sequence[int], window: int) -> tuple[int, int] | None:
    """Return the places of two equal windows of a sequence, or None where all differ."""
    seen: dict[tuple[int, ...], int] = {}
    for place in range(len(sequence) - window + 1):
        key = tuple(sequence[place : place + window])
        if key in seen:
            return seen[key], place
        seen[key] = place
    return None


def least_distance(sequence: Sequence[int], window: int) -> int:
    """Return the smallest Hamming distance between two windows of a sequence."""
    codes = np.lib.stride_tricks.sliding_window_view(np.asarray(sequence), window)
    differing = (codes[:, None] != codes[None]).sum(axis=2)
    return int(differing[~np.eye(len(codes), dtype=bool)].min(initial=window))
