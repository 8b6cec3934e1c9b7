"""Counting periods: from a coarse place on the projector axis to a fine one, with a test that rejects outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from slkit.codecs._gray_code import Mask
from slkit.codecs._noise import median
from slkit.codecs._phase import Cut, FringeSet
from slkit.codecs._results import row_counts
from slkit.codecs._rows import over_rows
from slkit.data import Float32s

Longs = npt.NDArray[np.int64]

# A period is taken where it is 99 times likelier than its neighbour.
_LOG_ODDS = float(np.log(99))
# What pictures show beyond noise is measured on so many pixels.
_SAMPLE_PX = 100_000
# How far beyond its bounds, in sigma and in px, a position may lie.
_SLACK_SIGMAS, _SLACK_PX = 4.0, 0.5
_RIM_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Place:
    """A position on one projector axis for every pixel: position, sigma (h, w) px; confidence (h, w); mask (h, w)."""

    position: Float32s
    sigma: Float32s
    confidence: Float32s
    mask: Mask

    @classmethod
    def blank(cls, mask: Mask) -> Place:
        """Return a place still to be found at the pixels of a mask (h, w), which is copied."""
        position, sigma = (np.empty(mask.shape, dtype=np.float32) for _ in range(2))
        return cls(position, sigma, np.ones(mask.shape, dtype=np.float32), mask.copy())

    def part(self, cut: Cut) -> Place:
        """Return some of the pixels."""
        return Place(cut(self.position), cut(self.sigma), cut(self.confidence), cut(self.mask))


@dataclass(frozen=True, eq=False)
class Scratch:
    """Memory for what is only needed within some rows: sums (`sums_for`); cycle, sigma (r, w) of a set in periods."""

    sums: Float32s
    cycle: Float32s
    sigma: Float32s


@dataclass(frozen=True, eq=False)
class Ladder:
    """How the sets of one axis are joined.

    extent: length of the axis in px. reach: how far, in periods, a coarser place may point from a whole period.
    sets: coarsest first. noise (3,): `NoiseCurve.numbers`. start: where each pixel is, coarser than all sets, or None:
    the coarsest set tells. interval: smallest and largest position allowed (h, w) px, NaN where there is none; or None.
    """

    extent: int
    reach: float
    sets: tuple[FringeSet, ...]
    noise: Float32s
    start: Place | None
    interval: tuple[Float32s, Float32s] | None

    def part(self, cut: Cut) -> Ladder:
        """Return the ladder of some of the pixels."""
        start = None if self.start is None else self.start.part(cut)
        interval = None if self.interval is None else (cut(self.interval[0]), cut(self.interval[1]))
        return replace(self, sets=tuple(s.part(cut) for s in self.sets), start=start, interval=interval)

    def scratch(self, rows: int, width: int) -> Scratch:
        """Return what `climb` needs for at most so many rows of a picture."""
        from slkit.codecs._wave_kernels import sums_for

        cycle, sigma = np.empty((2, rows, width), dtype=np.float32)
        return Scratch(sums_for(max(fringes.steps for fringes in self.sets), rows, width), cycle, sigma)

    @property
    def _longest(self) -> float | None:
        """The coarsest period in px, where a position may have wrapped at the ends of the axis; else None."""
        pitch = self.sets[0].pitch
        return pitch if self.start is None and holds_axis(pitch, self.extent) else None

    def unforeseen(self, mask: Mask) -> list[float]:
        """Return by how much the distances of each set vary beyond noise (see `_refine`): variances in periods squared.

        From some of the pixels of mask (h, w), or of those that a start knows.
        """
        mask = mask if self.start is None else self.start.mask
        cut = sample(mask, _SAMPLE_PX)
        some, place = self.part(cut), Place.blank(cut(mask))
        return some.climb(place, np.empty_like(place.position), self.scratch(*place.mask.shape), None)

    def climb(self, place: Place, light: Float32s, scratch: Scratch, beyond: Sequence[float] | None) -> list[float]:
        """Write the place on the finest set, and its modulation, at least 1 grey level, to light (h, w).

        place: doubtful pixels are taken out of its mask, its confidence is multiplied, and the rest is written.
        scratch: see `scratch`. beyond: see `unforeseen`, and returned as it was; None: measured in these very pixels.
        """
        from slkit.codecs._wave_kernels import arctangent, wave_rows

        cycle, own = scratch.cycle[: len(light)], scratch.sigma[: len(light)]
        found: list[float] = []
        self._begin(place)
        for index, fringes in enumerate(self.sets):
            told = scratch.sums, fringes.steps, self.noise, fringes.offset, arctangent()
            for four in fringes.fours():
                wave_rows(*four, *told, place.mask, cycle, own, light, place.confidence)
            if index == 0 and self.start is None:
                self._place_alone(place, cycle, own)
                found.append(0.0)
            else:
                found.append(self._refine(place, cycle, own, fringes.pitch, None if beyond is None else beyond[index]))
        self._keep_inside(place)
        return found

    def _begin(self, place: Place) -> None:
        if self.start is not None:
            place.position[:], place.sigma[:] = self.start.position, self.start.sigma
            np.multiply(place.confidence, self.start.confidence, out=place.confidence)
            np.logical_and(place.mask, self.start.mask, out=place.mask)

    def _place_alone(self, place: Place, cycle: Float32s, own: Float32s) -> None:
        """Write the place that the coarsest set tells, with or without an interval."""
        from slkit.codecs._period_kernels import place_on_axis

        pitch = self.sets[0].pitch
        if self._longest is not None:
            place_on_axis(cycle, own, pitch, (self.extent - 1) / 2, place.position, place.sigma)
        elif self.interval is None:
            place.mask[:] = False
        else:
            self._place_in_interval(place, cycle, own, np.float32(pitch), self.interval)

    @staticmethod
    def _place_in_interval(
        place: Place, cycle: Float32s, own: Float32s, pitch: np.float32, interval: tuple[Float32s, Float32s]
    ) -> None:
        """Write the place where exactly one period brings the phase into the interval."""
        slack = np.float32(_SLACK_SIGMAS) * own + np.float32(_SLACK_PX) / pitch
        low, high = interval
        first = np.ceil(low / pitch - cycle - slack)
        place.mask[:] &= first == np.floor(high / pitch - cycle + slack)
        place.position[:] = (cycle + np.where(place.mask, first, 0)) * pitch
        place.sigma[:] = own * pitch

    def _refine(self, place: Place, cycle: Float32s, own: Float32s, pitch: float, beyond: float | None) -> float:
        """Move the place to a finer set, whose period the coarse place chooses; return `beyond`, measured if None.

        The distance d to the nearest whole period, in periods, must stay below `reach`, and below the d at which the
        chosen period is 99 times likelier than its neighbour. For two Gaussians one period apart the odds are
        exp((1 - 2 |d|) / (2 s^2)), and the confidence is multiplied by odds / (1 + odds). The spread s is that
        predicted from noise, widened by what the distances of the whole picture show beyond it (gamma, stray light).
        """
        from slkit.codecs._period_kernels import distances, refine_rows

        axis = (self.extent - 1) / 2, float(self.extent), np.inf if self._longest is None else self._longest
        if beyond is None:
            distance = np.empty_like(cycle)
            distances(place.position, cycle, pitch, *axis, distance)
            beyond = _unforeseen(distance, place, own, pitch)
        told = cycle, own, pitch, *axis, beyond, self.reach, _LOG_ODDS
        refine_rows(*told, place.position, place.sigma, place.confidence, place.mask)
        return beyond

    def _keep_inside(self, place: Place) -> None:
        from slkit.codecs._period_kernels import keep_inside

        # Where the coarsest period is as long as the axis, both ends show one phase: what noise could carry over from
        # one end to the other is not decoded.
        end = np.inf if self._longest is None else self._longest / 2
        axis = (self.extent - 1) / 2, self.extent / 2 + _SLACK_PX, end
        keep_inside(place.position, place.sigma, *axis, _RIM_SIGMAS, place.mask)
        if self.interval is not None:
            slack = np.float32(_SLACK_SIGMAS) * place.sigma + np.float32(_SLACK_PX)
            low, high = self.interval
            place.mask[:] &= (place.position >= low - slack) & (place.position <= high + slack)


def holds_axis(pitch: float, extent: int) -> bool:
    """Return whether one period of `pitch` px is as long as the axis, so that its phase alone is a position."""
    return pitch >= extent * (1 - 1e-9)


def sample(mask: Mask, most: int) -> Cut:
    """Return what takes every n-th pixel of a mask (h, w) out of a map (h, w), at most so many, as one row (1, m)."""
    from slkit.codecs._patch_kernels import pick_pixels

    starts, total = row_counts(mask)
    step = max(-(-total // most), 1)
    at = np.empty((1, -(-total // step)), dtype=np.int64)
    over_rows(lambda first, last: pick_pixels(first, mask[first:last], starts[first:last], step, at[0]), len(mask))
    return lambda pixels: np.take(pixels, at)


def _unforeseen(distance: Float32s, place: Place, own: Float32s, pitch: float) -> float:
    """Return the variance in periods squared that distances (r, c) show beyond that of noise, in the pixels of mask."""
    if not place.mask.any():
        return 0.0
    away, coarse, fine = distance[place.mask], place.sigma[place.mask], own[place.mask]
    predicted = (coarse / np.float32(pitch)) ** 2 + fine**2
    return max((1.4826 * median(np.abs(away))) ** 2 - median(predicted), 0.0)
