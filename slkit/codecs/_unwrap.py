"""Counting periods: from a coarse place on the projector axis to a fine one, with a test that rejects outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slkit.codecs._gray_code import Mask
from slkit.codecs._rows import over_rows
from slkit.data import Float32s

# A period is taken where it is 99 times likelier than its neighbour.
_LOG_ODDS = float(np.log(99))
# What pictures show beyond noise is measured on so many pixels.
_SAMPLE_PX = 100_000
# How far beyond its bounds, in sigma and in px, a position may lie.
_SLACK_SIGMAS, _SLACK_PX = 4.0, 0.5
_RIM_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Rung:
    """One set of fringes: cycle (h, w) in periods, 0 to 1; sigma (h, w) in periods; pitch: a period in px."""

    cycle: Float32s
    sigma: Float32s
    pitch: float


@dataclass(frozen=True, eq=False)
class Place:
    """A position on one projector axis for every pixel: position, sigma (h, w) px; confidence (h, w); mask (h, w)."""

    position: Float32s
    sigma: Float32s
    confidence: Float32s
    mask: Mask


@dataclass(frozen=True, eq=False)
class Ladder:
    """How the sets of one axis are joined.

    extent: length of the axis in px. reach: how far, in periods, a coarser place may point from a whole period.
    interval: smallest and largest position allowed (h, w) px, NaN where there is none; or None.
    """

    extent: int
    reach: float
    interval: tuple[Float32s, Float32s] | None

    def climb(self, rungs: Sequence[Rung], mask: Mask, start: Place | None) -> Place:
        """Return the place on the last of `rungs`, coarsest first, from `start` or from the coarsest rung itself."""
        place, longest = start, None
        if place is None:
            first, rungs = rungs[0], rungs[1:]
            if holds_axis(first.pitch, self.extent):
                place, longest = self._place_on_one_period(first, mask), first.pitch
            else:
                place = self._place_in_interval(first, mask)
        for rung in rungs:
            place = self._refine(place, rung, longest)
        return Place(place.position, place.sigma, place.confidence, place.mask & mask & self._inside(place, longest))

    def _place_on_one_period(self, rung: Rung, mask: Mask) -> Place:
        # Taken around the middle of the axis, so that noise wraps at both ends alike.
        center = (self.extent - 1) / 2
        away = (rung.cycle - np.float32(center / rung.pitch) + np.float32(0.5)) % 1 - np.float32(0.5)
        position = np.float32(center) + away * np.float32(rung.pitch)
        return Place(position, rung.sigma * np.float32(rung.pitch), np.ones_like(position), mask)

    def _place_in_interval(self, rung: Rung, mask: Mask) -> Place:
        """Return the place where exactly one period brings the phase into the interval."""
        if self.interval is None:
            return Place(rung.cycle, rung.sigma, rung.cycle, np.zeros_like(mask))
        pitch = np.float32(rung.pitch)
        slack = np.float32(_SLACK_SIGMAS) * rung.sigma + np.float32(_SLACK_PX) / pitch
        low, high = self.interval
        first = np.ceil(low / pitch - rung.cycle - slack)
        mask = mask & (first == np.floor(high / pitch - rung.cycle + slack))
        position = (rung.cycle + np.where(mask, first, 0)) * pitch
        return Place(position, rung.sigma * pitch, np.ones_like(position), mask)

    def _refine(self, coarse: Place, rung: Rung, longest: float | None) -> Place:
        """Return the place on a finer rung, whose period the coarse place chooses.

        The distance d to the nearest whole period, in periods, must stay below `reach`, and below the d at which the
        chosen period is 99 times likelier than its neighbour. For two Gaussians one period apart the odds are
        exp((1 - 2 |d|) / (2 s^2)), and the confidence is multiplied by odds / (1 + odds). The spread s is that
        predicted from noise, widened by what the distances of the whole picture show beyond it (gamma, stray light).
        longest: the coarsest period in px, which may have wrapped at the ends of the axis; None: nothing wraps.
        """
        from slkit.codecs._wave_kernels import choose_period, mend_ends, nearest_period

        order, distance = np.empty_like(rung.cycle), np.empty_like(rung.cycle)
        position, sigma = np.empty_like(rung.cycle), np.empty_like(rung.cycle)
        confidence, mask = coarse.confidence.copy(), coarse.mask.copy()

        def near(first: int, last: int) -> None:
            part = slice(first, last)
            here = coarse.position[part], rung.cycle[part], rung.pitch
            nearest_period(*here, order[part], distance[part])
            if longest is not None:
                mend_ends(*here, (self.extent - 1) / 2, float(self.extent), longest, order[part], distance[part])

        over_rows(near, len(order))
        beyond = _unforeseen(distance, coarse, rung)

        def choose(first: int, last: int) -> None:
            part = slice(first, last)
            told = order[part], distance[part], rung.cycle[part], rung.sigma[part], coarse.sigma[part]
            out = position[part], sigma[part], confidence[part], mask[part]
            choose_period(*told, rung.pitch, beyond, self.reach, _LOG_ODDS, *out)

        over_rows(choose, len(order))
        return Place(position, sigma, confidence, mask)

    def _inside(self, place: Place, longest: float | None) -> Mask:
        rim = self.extent / 2 + _SLACK_PX
        if longest is not None:
            # Where the coarsest period is as long as the axis, both ends show one phase: what noise could carry over
            # from one end to the other is not decoded.
            rim = np.minimum(rim, np.float32(longest / 2) - np.float32(_RIM_SIGMAS) * place.sigma)
        inside = np.abs(place.position - np.float32((self.extent - 1) / 2)) <= rim
        if self.interval is None:
            return inside
        slack = np.float32(_SLACK_SIGMAS) * place.sigma + np.float32(_SLACK_PX)
        low, high = self.interval
        return inside & (place.position >= low - slack) & (place.position <= high + slack)


def holds_axis(pitch: float, extent: int) -> bool:
    """Return whether one period of `pitch` px is as long as the axis, so that its phase alone is a position."""
    return pitch >= extent * (1 - 1e-9)


def _unforeseen(distance: Float32s, coarse: Place, rung: Rung) -> float:
    """Return the variance in periods squared that distances (h, w) show beyond that of noise, from some pixels."""
    at = np.flatnonzero(coarse.mask)
    if not len(at):
        return 0.0
    at = at[:: -(-len(at) // _SAMPLE_PX)]
    away, coarsely, finely = (a.ravel()[at] for a in (distance, coarse.sigma, rung.sigma))
    predicted = (coarsely / np.float32(rung.pitch)) ** 2 + finely**2
    seen = (1.4826 * float(np.median(np.abs(away)))) ** 2
    return max(seen - float(np.median(predicted)), 0.0)
