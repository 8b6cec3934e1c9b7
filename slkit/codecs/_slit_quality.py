"""Which labelled slits lie where their stripe is, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._track_kernels import along_tracks
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]

# A slit much narrower, wider or darker than along its track is cut by an edge, or two in one. At the ends of a track
# that is likely, and less is forgiven.
_NARROWEST, _WIDEST, _DARKEST = 0.7, 1.6, 0.5
_END_WIDTH, _END_CONTRAST = 0.12, 0.2
# And rows are smoothed over the edge there: in the last two rows a centre may be off by this share of its width.
_END_DOUBT = 0.15
# How far a slit's centre may be off, as a share of its width, for each unit of the logarithm by which it differs.
_WIDTH_DOUBT, _CONTRAST_DOUBT = 0.4, 0.1
# Pixels and the smoothing of rows leave so much of a centre's place open, in px.
_SAMPLING_DOUBT = 0.015
# A slit is narrower than this share of its neighbour's width only where something cuts it.
_USUAL_WIDTH = 0.9
# And with such a share of its neighbour's width or light an edge has cut it for certain.
_CUT_WIDTH, _CUT_LIGHT = 0.7, 0.4
_KEEP = 0.9
_FARTHEST_NEIGHBOUR = 3


@dataclass(frozen=True, eq=False)
class Regular:
    """keep (m,): slits that look like their neighbours on track and row; doubt (m,): how far each may be off, in px."""

    keep: Mask
    doubt: Singles


def regular(slits: Slits, label: Wholes, shown: Singles) -> Regular:
    """Tell which labelled slits are whole; a slit with no neighbour on its track is not.

    label (m,): -1 for none; shown (m,): light as a share of what white gives there.
    """
    following = np.full(len(slits), -1)
    has = slits.previous >= 0
    following[slits.previous[has]] = np.flatnonzero(has)
    same = [(n >= 0) & (label[n] == label) for n in (slits.previous, following)]
    shape = np.log(np.maximum(np.stack([slits.width, slits.contrast], axis=1), 1e-6)).astype(np.float32)
    width, contrast = (shape - along_tracks(shape, slits.previous, _KEEP)).T
    whole = (width > np.log(_NARROWEST)) & (width < np.log(_WIDEST)) & (contrast > np.log(_DARKEST))
    like = (np.abs(width) < _END_WIDTH) & (np.abs(contrast) < _END_CONTRAST)
    doubt = slits.width * np.hypot(_WIDTH_DOUBT * width, _CONTRAST_DOUBT * contrast)
    moved, cut = _cut(slits, label, shown)
    within = same[0] & same[1]
    within &= within[slits.previous] & within[following]
    doubt = np.hypot(np.hypot(doubt, moved), np.where(within, _SAMPLING_DOUBT, _END_DOUBT * slits.width))
    return Regular(
        (label >= 0) & whole & ~cut & (same[0] & same[1] | (same[0] | same[1]) & like), doubt.astype(np.float32)
    )


def _cut(slits: Slits, label: Wholes, shown: Singles) -> tuple[Singles, Mask]:
    """Return how far in px an edge may have moved the slit beside it (m,), and which slits it has cut for certain (m,).

    At the end of a row of labelled slits something hides the others: shadow, or an edge all along the track. It may
    have moved the last one by half of what that is narrower than the next.
    """
    joined = (np.diff(slits.row) == 0) & (np.abs(np.diff(label)) == 1) & (label[1:] >= 0) & (label[:-1] >= 0)
    after, before = np.append(joined, False), np.insert(joined, 0, False)
    last = after != before
    width, bright = (np.where(after, np.roll(v, -1), np.roll(v, 1)) for v in (slits.width, shown))
    lacking = np.where(last, np.maximum(_USUAL_WIDTH * width - slits.width, 0) / 2, 0)
    sure = last & ((slits.width < _CUT_WIDTH * width) | (shown < _CUT_LIGHT * bright))
    return lacking.astype(np.float32), sure


def pace(slits: Slits, label: Wholes, keep: Mask) -> Singles:
    """Return how many stripes a px the labels change by along the row (m,), up or down, from kept neighbours.

    A missing one is the median of those that are known.
    """
    result = np.full(len(slits), np.nan, dtype=np.float32)
    at = np.flatnonzero(keep)
    rise, run = np.diff(label[at]), np.diff(slits.col[at])
    near = (np.diff(slits.row[at]) == 0) & (rise != 0) & (np.abs(rise) <= _FARTHEST_NEIGHBOUR) & (run > 0)
    step = np.where(near, np.abs(rise) / np.maximum(run, 1e-6), np.nan).astype(np.float32)
    sides = np.stack([np.concatenate([[np.nan], step]), np.concatenate([step, [np.nan]])])
    known = np.isfinite(sides)
    mean = np.where(known, sides, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    usual = float(np.median(step[near])) if near.any() else np.nan
    result[at] = np.where(known.any(axis=0), mean, usual)
    return result
