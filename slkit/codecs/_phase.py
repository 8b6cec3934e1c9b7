"""Sets of phase-shifted sinusoids as a camera sees them: their sums, the noise they carry, and where they are lit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._gray_code import Mask
from slkit.codecs._masks import Levels, Reader, levels, refuse_empty, saturation, without_rim
from slkit.codecs._noise import Evidence, NoiseCurve, noise_curve
from slkit.codecs._rows import over_blocks, over_large_blocks
from slkit.codecs._tiles import Tiles
from slkit.data import Float32s, Image

Four = tuple[Levels, Levels, Levels, Levels, Float32s, Levels, bool, bool]
"""Four frames of a set, weights, most, first, last: see `wave_rows`."""
Cut = Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
"""Takes the same pixels (r, c) out of any map (h, w)."""


@dataclass(frozen=True, eq=False)
class FringeSet:
    """One set of shifted sinusoids, seen: frame s shows cos(phase - sign 2 pi s / steps).

    frames: grey levels (h, w) of each step, as they are stored; most (steps,): the highest level of each that is not
    saturated; burnt (h, w): what else is; sign, offset: as `Fringes`; pitch: a period in px.
    """

    frames: tuple[Levels, ...]
    most: Levels
    burnt: Mask | None
    sign: int
    offset: float
    pitch: float

    @property
    def steps(self) -> int:
        """The number of shifts."""
        return len(self.frames)

    def part(self, cut: Cut) -> FringeSet:
        """Return the set as some of its pixels see it."""
        return replace(self, frames=tuple(cut(frame) for frame in self.frames))

    def fours(self) -> Iterator[Four]:
        """Return the set in groups of four frames, as `wave_rows` takes them.

        Source: the N-step algorithm; for evenly spaced shifts its two sums are the least-squares solution.
        """
        groups = _fours(self.steps, self.sign)
        for index, (four, weights) in enumerate(groups):
            one, two, three, other = (self.frames[step] for step in four)
            yield one, two, three, other, weights, self.most[list(four)], index == 0, index == len(groups) - 1


@cache
def _fours(steps: int, sign: int) -> tuple[tuple[tuple[int, ...], Float32s], ...]:
    """Return the steps of a set in groups of four and the weights (4, 3) of their frames, 0 for one that fills up."""
    shifts = sign * 2 * np.pi * np.arange(steps) / steps
    weights = np.stack([np.cos(shifts), np.sin(shifts), np.ones(steps)], axis=1).astype(np.float32)
    groups: list[tuple[tuple[int, ...], Float32s]] = []
    for start in range(0, steps, 4):
        count = min(4, steps - start)
        filled = np.zeros((4, 3), dtype=np.float32)
        filled[:count] = weights[start : start + count]
        groups.append((tuple(min(start + k, steps - 1) for k in range(4)), filled))
    return tuple(groups)


def set_of(images: Sequence[Image], sign: int, offset: float, pitch: float) -> FringeSet:
    """Return the set that pictures (h, w) or (h, w, 3) show, one a step; see `FringeSet`."""
    frames = tuple(levels(image) for image in images)
    if images[0].ndim == 2:
        most = np.array([_highest_whole(image) for image in images], dtype=images[0].dtype)
        return FringeSet(frames, most, None, sign, offset, pitch)
    burnt = np.logical_or.reduce([saturation(image) for image in images])
    return FringeSet(frames, np.full(len(frames), np.inf, dtype=np.float32), burnt, sign, offset, pitch)


def _highest_whole(image: Image) -> int:
    """Return the highest level that is not saturated in a grey picture."""
    # A picture saturates where it reaches its own maximum, or nowhere; only 16 bits leave open what full scale is.
    top = int(np.iinfo(image.dtype).max) if image.dtype == np.uint8 else int(image.max())
    return top - int(saturation(np.full((1, 1), top, dtype=image.dtype)).any())


def read_images(reader: Reader, start: int, steps: int) -> list[Image]:
    """Return the pictures of a set, each read once."""
    return [reader.color(start + step) for step in range(steps)]


def mean_of(images: Sequence[Image]) -> Image:
    """Return the mean of pictures, as a picture of their depth."""
    first, *others = images
    mean = np.empty_like(first)

    def work(rows: slice) -> None:
        total = first[rows].astype(np.float32)
        for image in others:
            total += image[rows]
        mean[rows] = as_image(total / np.float32(len(images)), first)

    over_blocks(work, mean.shape[:2])
    return mean


def as_image(levels: Float32s, like: Image) -> Image:
    """Return grey levels (...) rounded to the depth of the picture `like`."""
    return np.rint(levels).astype(like.dtype)


def noise_of(sets: Sequence[FringeSet]) -> NoiseCurve:
    """Return the noise of one frame that the last two sets show: their means differ by noise alone.

    A single set has only its mean to show; texture counts as noise there.
    """
    tiles, shown = Tiles.of(sets[-1].frames[0].shape), sets[-2:]
    usable = tiles.usable()
    means = [_mean_in(tiles, fringes, usable) for fringes in shown]
    picture = means[-1] - means[0] if len(means) > 1 else means[0]
    share = sum(1 / fringes.steps for fringes in shown)
    return noise_curve([Evidence(picture, means[-1], usable, share)])


def _mean_in(tiles: Tiles, fringes: FringeSet, usable: Mask) -> Float32s:
    """Return the mean of a set in tiles (r, c), and take what is saturated out of usable (r, c)."""
    from slkit.codecs._lit_kernels import add_tiles

    total = np.zeros(usable.shape, dtype=np.float32)
    for frame, most in zip(fringes.frames, fringes.most, strict=True):
        add_tiles(frame, most, tiles.rows, tiles.cols, total, usable)
    if fringes.burnt is not None:
        usable &= ~tiles.cut(fringes.burnt)
    return total * np.float32(1 / fringes.steps)


def modulated(sets: Sequence[FringeSet], noise: NoiseCurve, within: Mask | None, min_snr: float) -> tuple[Mask, Levels]:
    """Return where (h, w) all sets modulate more than min_snr times the noise and none is saturated, and a mean (h, w).

    Two rings at the rim are left out: the modulation of a rim is large enough to be read long after its place has
    become its neighbour's. within (h, w): where to look. The mean is that of the first set's grey levels, rounded; it
    comes with the sums. Errors: DecodeError where nothing is left.
    """
    from slkit.codecs._lit_kernels import lit_rows
    from slkit.codecs._wave_kernels import sums_for

    shape, steps = sets[0].frames[0].shape, max(fringes.steps for fringes in sets)
    lit, saturated, good = (np.empty(shape, dtype=np.bool_) for _ in range(3))
    mean = np.empty_like(sets[0].frames[0])

    def block(rows: slice, sums: Float32s) -> None:
        bright, burnt = lit[rows], saturated[rows]
        bright[:], burnt[:] = True, False
        for index, fringes in enumerate(sets):
            to = mean[:0] if index else mean[rows]
            for four in fringes.part(lambda frame: frame[rows]).fours():
                lit_rows(*four, sums, fringes.steps, noise.numbers, min_snr, bright, burnt, to)
            if fringes.burnt is not None:
                burnt |= fringes.burnt[rows]
        np.greater(bright, burnt, out=good[rows])
        if within is not None:
            good[rows] &= within[rows]

    over_large_blocks(lambda rows: sums_for(steps, rows, shape[1]), block, shape)
    mask = without_rim(without_rim(good))
    refuse_empty(mask, lit, saturated)
    return mask, mean
