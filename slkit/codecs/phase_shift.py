"""Phase shift: sinusoidal fringes, moved in equal steps, whose periods are counted by coarser fringes or Gray code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slkit.codecs._cell_bits import BitRule, read_cells
from slkit.codecs._cell_places import place, possible
from slkit.codecs._gray_code import Axes, Axis, CellCode, Profile, coded_axes, constant, patterns
from slkit.codecs._masks import Light, Reader, grey, measure_light
from slkit.codecs._noise import NoiseCurve, probability
from slkit.codecs._phase import FringeSet, as_image, mean_of, modulated, noise_of, read_images, set_of
from slkit.codecs._phase_rows import decode_rows
from slkit.codecs._unwrap import Ladder, Place, holds_axis
from slkit.data import Correspondences, Frames, Image
from slkit.errors import InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds

_DEFAULT_PITCH_PX = 16
_SHORTEST_PITCH_PX = 3
# A bit is known above 3 sigma of its difference and 5 % of white - black: the defaults of `Gray`.
_BIT_RULE = BitRule(snr=3.0, contrast=0.05, robust=False)


@dataclass(frozen=True)
class Fringes:
    """The sinusoids of one projector axis.

    periods: numbers of periods across the axis in display order, whole or not; steps: shifts a set, 3 or more;
    sign: the direction of the shift; offset: the phase at pixel 0 in radians. Frame s of a set shows
    127.5 (1 + cos(2 pi i periods / n + offset - sign 2 pi s / steps)) at pixel i of n.
    Errors: InputError where these are no fringes.
    """

    periods: tuple[float, ...]
    steps: int = 4
    sign: Literal[1, -1] = 1
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not self.periods or len({f"{p:g}" for p in self.periods}) < len(self.periods):
            raise InputError("periods must hold one number or more, all different")
        if not all(0 < p < np.inf for p in self.periods) or not np.isfinite(self.offset):
            raise InputError("periods must be positive numbers, and offset a finite one")
        if self.steps < 3:
            raise InputError(f"steps must be 3 or more, not {self.steps}")
        if self.sign not in (1, -1):
            raise InputError(f"sign must be 1 or -1, not {self.sign}")

    def profiles(self, axis: Axis, extent: int) -> dict[str, Profile]:
        """Return the patterns by name, `x_64_0` for 64 periods and step 0, as lines (1, extent) or (extent, 1)."""
        result: dict[str, Profile] = {}
        for periods in self.periods:
            phase = 2 * np.pi * periods / extent * np.arange(extent) + self.offset
            for step in range(self.steps):
                line = 127.5 * (1 + np.cos(phase - self.sign * 2 * np.pi * step / self.steps))
                levels = np.rint(line).astype(np.uint8)
                result[f"{axis}_{periods:g}_{step}"] = levels[None, :] if axis == "x" else levels[:, None]
        return result


@dataclass(frozen=True)
class PhaseShift:
    """Sinusoidal fringes on one or both projector axes.

    projector (w, h) px. x, y: the fringes of an axis; None is filled in where the axis is coded: about 16 px a period
    at the finest set, whole numbers of periods down to one in steps of about 8, four shifts each. Four is the least
    that is blind to the second harmonic, where a projector's gamma of about 2 puts nearly all of its distortion; more
    shifts lower sigma with their root.
    references: a white and a black frame first; without them the mean of the first set is the lit picture. order:
    "temporal" counts periods with coarser sets; "gray" has one set of fringes and a Gray code with cells of at most
    half a period, and needs references.

    Thresholds, all relative. min_snr: least modulation in units of the noise of one frame. max_period_distance: how far
    from a whole period, in periods, a coarser set may point; a noisy picture lowers it further.

    Errors: InputError where the parameters contradict each other.
    Source: N-step phase shifting with hierarchical temporal unwrapping: Zuo et al., Temporal phase unwrapping
    algorithms for fringe projection profilometry: a comparative review (2016).
    """

    projector: tuple[int, int]
    axes: Axes = "x"
    x: Fringes | None = None
    y: Fringes | None = None
    references: bool = True
    order: Literal["temporal", "gray"] = "temporal"
    min_snr: float = 4.0
    max_period_distance: float = 0.4

    def __post_init__(self) -> None:
        object.__setattr__(self, "projector", as_size(self.projector, "projector"))
        if self.order not in ("temporal", "gray"):
            raise InputError(f"order must be 'temporal' or 'gray', not {self.order!r}")
        if not 0 < self.min_snr < np.inf:
            raise InputError(f"min_snr must be a positive number, not {self.min_snr}")
        if not 0 < self.max_period_distance < 0.5:
            raise InputError(f"max_period_distance must lie between 0 and 0.5, not {self.max_period_distance}")
        if self.order == "gray" and not self.references:
            raise InputError("order 'gray' compares its bits with white and black: set references = true")
        for axis in coded_axes(self.axes):
            # Filled in, so that a capture.toml says what was projected even if the defaults change.
            object.__setattr__(self, axis, self.fringes(axis))
            periods = self.fringes(axis).periods
            if self._extent(axis) / max(periods) < _SHORTEST_PITCH_PX:
                raise InputError(f"{axis}: {max(periods):g} periods are shorter than {_SHORTEST_PITCH_PX} px each")
            if self.order == "gray" and len(periods) != 1:
                raise InputError(f"{axis}: order 'gray' takes one number of periods, not {len(periods)}")

    def fringes(self, axis: Axis) -> Fringes:
        """Return the fringes of an axis, as given or by default."""
        given = self.x if axis == "x" else self.y
        if given is not None:
            return given
        finest = max(round(self._extent(axis) / _DEFAULT_PITCH_PX), 1)
        counts = (finest,) if self.order == "gray" else (finest, round(finest**0.5), 1)
        return Fringes(tuple(float(count) for count in dict.fromkeys(counts)))

    def encode(self) -> Frames:
        """Return white and black (if references), then for each axis its Gray code (if any) and its sets of fringes."""
        return patterns(self._profiles(), self.projector)

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return one correspondence for every pixel that all coded axes label, at the pixel's centre.

        Each frame is read once. sigma: period / (2 pi) sqrt(2 / steps) noise / modulation in projector px, with the
        noise of one frame measured in the frames themselves at that grey level, hypot the shift of a pixel that sees a
        patch (`displacement`). Two rings at the rim of what is lit are left out. confidence: the odds of every chosen
        period against its neighbour (`Ladder`), times the chance that noise alone modulates less (`wave_rows`).
        bounds (h, w, 4) choose the period where the coarsest set has more than one; otherwise they reject what lies
        outside. Errors: InputError where frames do not fit the patterns or the fringes need bounds; DecodeError where
        nothing is lit, or the sets contradict each other everywhere.
        """
        self._check_order(bounds)
        names, axes = list(self._profiles()), coded_axes(self.axes)
        reader = Reader(frames, names)
        references = [reader.color(0), reader.color(1)] if self.references else []
        light = measure_light(references[0], references[1], self.min_snr) if self.order == "gray" else None
        sets, shown = self._read_sets(reader, names)
        every = [fringes for axis in axes for fringes in sets[axis]]
        shape = every[0].frames[0].shape
        if bounds is not None and bounds.shape != (*shape, 4):
            raise InputError(f"bounds must have the shape {(*shape, 4)}, not {bounds.shape}")
        noise = noise_of(every) if light is None or len(every) > 1 else light.curve
        mask, mean = modulated(every, noise, None if light is None else light.mask, self.min_snr)
        if shown is None:
            shown = references[0] if self.references else mean
        ladders: dict[int, Ladder] = {}
        for axis in axes:
            start = None if light is None else self._read_order(axis, reader, names, light, bounds)
            ladders[int(axis == "y")] = self._ladder(axis, sets[axis], noise, start, bounds)
        return decode_rows(ladders, mask, shown)

    def lit(self, frames: Frames) -> Image:
        """Return the white picture as grey (h, w), or the mean of the first set of fringes. Errors: as `decode`."""
        reader = Reader(frames, list(self._profiles()))
        steps = self.fringes(coded_axes(self.axes)[0]).steps
        image = reader.color(0) if self.references else mean_of(read_images(reader, 0, steps))
        return as_image(grey(image), image)

    def _extent(self, axis: Axis) -> int:
        return self.projector[axis == "y"]

    def _code(self, axis: Axis) -> CellCode:
        half = self._extent(axis) / max(self.fringes(axis).periods) / 2
        return CellCode(axis, self._extent(axis), int(half), inverse=False)

    def _profiles(self) -> dict[str, Profile]:
        profiles: dict[str, Profile] = {"white": constant(255), "black": constant(0)} if self.references else {}
        for axis in coded_axes(self.axes):
            if self.order == "gray":
                profiles |= self._code(axis).profiles()
            profiles |= self.fringes(axis).profiles(axis, self._extent(axis))
        return profiles

    def _check_order(self, bounds: Bounds | None) -> None:
        for axis in coded_axes(self.axes):
            fewest, extent = min(self.fringes(axis).periods), self._extent(axis)
            if self.order == "temporal" and bounds is None and not holds_axis(extent / fewest, extent):
                raise InputError(
                    f"{axis}: the coarsest fringes have {fewest:g} periods, so a pixel's period is open: "
                    "add a set of one period, use order 'gray', or decode with bounds from a rig and a depth range"
                )

    def _read_sets(self, reader: Reader, names: list[str]) -> tuple[dict[Axis, tuple[FringeSet, ...]], Image | None]:
        """Return the sets of each axis, coarsest first; without references the mean of the first if it has colours."""
        sets, mean = dict[Axis, tuple[FringeSet, ...]](), None
        for axis in coded_axes(self.axes):
            fringes, found = self.fringes(axis), list[FringeSet]()
            for periods in sorted(fringes.periods):
                images = read_images(reader, names.index(f"{axis}_{periods:g}_0"), fringes.steps)
                if mean is None and not self.references and images[0].ndim == 3:
                    mean = mean_of(images)
                found.append(set_of(images, fringes.sign, fringes.offset, self._extent(axis) / periods))
            sets[axis] = tuple(found)
        return sets, mean

    def _read_order(self, axis: Axis, reader: Reader, names: list[str], light: Light, bounds: Bounds | None) -> Place:
        """Return the place that the Gray code gives: a pixel between two cells has both, and the border between."""
        code = self._code(axis)
        cells = read_cells(code, lambda name: reader.grey(names.index(name)), light, _BIT_RULE)
        position, good = place(possible(cells, code, bounds), code, 2, light.mask)
        sigma = np.full_like(position, code.step / np.sqrt(12))
        return Place(position, sigma, probability(cells.square), good)

    def _ladder(
        self, axis: Axis, sets: tuple[FringeSet, ...], noise: NoiseCurve, start: Place | None, bounds: Bounds | None
    ) -> Ladder:
        first = 0 if axis == "x" else 2
        interval = None if bounds is None else (bounds[..., first], bounds[..., first + 1])
        return Ladder(self._extent(axis), self.max_period_distance, sets, noise.numbers, start, interval)
