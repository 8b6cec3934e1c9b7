"""Which fringe each bright slit is the middle of: what the colours say, and what neighbours hand on."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_pattern import Features
from slkit.codecs._match_kernels import MOST_ROOM, match_lines
from slkit.codecs._order_kernels import accept_chains, drop_islands, link_rows, spread_numbers
from slkit.codecs._stripe_labels import label_slits
from slkit.codecs._track_kernels import room_before
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]

# A slit takes a number from its neighbours if its colour is at most so many nats worse than the best one.
_SLACK = 1.0
# Groups of fewer slits are not believed; nor those of fewer fringes: one fringe alone fits in many places of the order.
_SURE_SLITS, _FEWEST_SLITS, _FEWEST_FRINGES = 40, 12, 2
# Prices of a row's order as in `label_slits`, where unseen fringes are cheap: most of what is left lies behind edges.
_PRICES = 2.0, 8.0, 2.0
_CHAIN_ROWS, _CHAIN_MEAN, _CHAIN_TOTAL = 6, 0.5, 12.0
_PASSES = 2


def number_fringes(
    slits: Slits, scores: Singles, features: Features, allowed: Wholes, window: int
) -> tuple[Wholes, Singles, int]:
    """Return each slit's place in the sequence (m,), -1 for none, by how much it is ahead (m,) in nats, and the sign.

    scores (m, k), allowed (m, 2): see `match_lines`; window: so many neighbours say where they are. sign: +1 where the
    numbers rise along rows, -1 in a mirrored picture.
    """
    found = label_slits(slits, scores, features, allowed)
    label, ahead = found.label.astype(np.int32), found.ahead.astype(np.float32)
    both = (label[1:] >= 0) & (label[:-1] >= 0) & (np.diff(slits.row) == 0)
    sign = -1 if np.sum(np.sign(np.diff(label)[both])) < 0 else 1
    above, below = np.empty_like(label), np.empty_like(label)
    link_rows(slits.starts, slits.col, slits.width, above, below)
    net = slits.starts, slits.row, slits.col, slits.width, above, below, sign
    told = scores, features.kinds, np.ascontiguousarray(allowed), _SLACK
    drop_islands(*net, _SURE_SLITS, window, label)
    spread_numbers(*net, *told, label, ahead)
    for _ in range(_PASSES):
        guess, margin = _guesses(slits, scores, features, allowed, label, sign)
        accept_chains(above, below, guess, margin, _CHAIN_ROWS, _CHAIN_MEAN, _CHAIN_TOTAL, label, ahead)
        spread_numbers(*net, *told, label, ahead)
    drop_islands(*net, _FEWEST_SLITS, _FEWEST_FRINGES, label)
    return label, ahead, sign


def _guesses(
    slits: Slits, scores: Singles, features: Features, allowed: Wholes, label: Wholes, sign: int
) -> tuple[Wholes, Singles]:
    """Return what each row by itself makes of its slits (m,) between those that have a label, and the margins (m,)."""
    room, guess, margin = np.empty_like(label), np.empty_like(label), np.empty(len(label), np.float32)
    room_before(slits.starts, slits.col, MOST_ROOM, room)
    last = len(features.kinds) - 1
    kinds: Any = np.ascontiguousarray(features.kinds[::sign])
    limits: Any = np.ascontiguousarray(allowed if sign > 0 else last - allowed[:, ::-1])
    fixed = label if sign > 0 else np.where(label >= 0, last - label, label)
    match_lines(slits.starts, scores, room, kinds, limits, fixed, _PRICES, guess, margin)
    return (guess if sign > 0 else np.where(guess >= 0, last - guess, guess)), margin
