"""Counting periods: from a coarse place on the projector axis to a fine one, with a test that rejects outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slkit.codecs._gray_code import Mask
from slkit.data import Float32s

# A period is taken where it is 99 times likelier than its neighbour.
_LOG_ODDS = float(np.log(99))
# exp(-50) is nothing, and exp(-500) would overflow float32.
_MOST_LOG_ODDS = 50.0
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
        order, distance = _nearest_period(coarse.position, rung)
        if longest is not None:
            self._mend_ends(order, distance, coarse.position, rung, longest)
        pitch = np.float32(rung.pitch)
        variance = _variance(distance, np.hypot(coarse.sigma / pitch, rung.sigma), coarse.mask)
        distance = np.abs(distance)
        limit = np.minimum(np.float32(self.reach), np.float32(0.5) - np.float32(_LOG_ODDS) * variance)
        log_odds = (1 - 2 * distance) / (2 * np.maximum(variance, np.float32(1e-6)))
        odds = np.exp(np.minimum(log_odds, np.float32(_MOST_LOG_ODDS)))
        confidence = coarse.confidence * (odds / (1 + odds)).astype(np.float32)
        return Place((rung.cycle + order) * pitch, rung.sigma * pitch, confidence, coarse.mask & (distance < limit))

    def _mend_ends(self, order: Float32s, distance: Float32s, position: Float32s, rung: Rung, longest: float) -> None:
        """Move pixels at one end of the axis to the other, in place, where that fits image and phase better."""
        center = (self.extent - 1) / 2
        near = np.abs(position - np.float32(center)) > np.float32(self.extent / 2 - rung.pitch)
        here = Rung(rung.cycle[near], rung.sigma[near], rung.pitch)
        there = position[near] - np.float32(longest) * np.sign(position[near] - np.float32(center))
        other_order, other_distance = _nearest_period(there, here)

        def cost(chosen: Float32s, off: Float32s) -> Float32s:
            beyond = np.abs((here.cycle + chosen) - np.float32(center / rung.pitch))
            return np.abs(off) + np.maximum(beyond - np.float32(self.extent / 2 / rung.pitch), 0)

        better = cost(other_order, other_distance) < cost(order[near], distance[near])
        order[near] = np.where(better, other_order, order[near])
        distance[near] = np.where(better, other_distance, distance[near])

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


def _nearest_period(position: Float32s, rung: Rung) -> tuple[Float32s, Float32s]:
    raw = position / np.float32(rung.pitch) - rung.cycle
    order = np.rint(raw)
    return order, raw - order


def _variance(distance: Float32s, predicted: Float32s, mask: Mask) -> Float32s:
    """Return the variance (h, w) of the distances in periods squared: noise, and what the picture shows beyond it."""
    variance = predicted**2
    if not mask.any():
        return variance
    seen = (1.4826 * float(np.median(np.abs(distance[mask])))) ** 2
    return variance + np.float32(max(seen - float(np.median(variance[mask])), 0.0))
