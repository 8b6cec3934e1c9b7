"""The wave that a set of phase-shifted sinusoids shows at every camera pixel, and the noise it carries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._gray_code import Mask
from slkit.codecs._masks import Levels, Reader, Tiles, levels, saturation
from slkit.codecs._noise import Evidence, noise_curve
from slkit.codecs._rows import over_blocks
from slkit.data import Float32s, Image

Noise = Callable[[Float32s], Float32s]
"""From grey levels (...) to the noise of one frame at that level, 1 sigma in grey levels."""

_LEAST_SNR = 1e-3


@dataclass(frozen=True, eq=False)
class Wave:
    """What one set of `steps` shifted sinusoids shows at every camera pixel.

    cycle (h, w): phase in periods, 0 to 1; modulation, level (h, w): amplitude and mean in grey levels; saturated
    (h, w): where any frame is at full scale; mean: the frames' mean as a picture, (h, w) or (h, w, 3).
    """

    cycle: Float32s
    modulation: Float32s
    level: Float32s
    saturated: Mask
    mean: Image
    steps: int

    def snr(self, noise: Noise) -> Float32s:
        """Return the modulation (h, w) in units of the noise of one frame."""
        return (self.modulation / noise(self.level)).astype(np.float32)

    def cycle_sigma(self, snr: Float32s) -> Float32s:
        """Return 1 sigma of cycle (h, w) in periods: sqrt(2 / steps) / snr / (2 pi)."""
        return (np.sqrt(2 / self.steps) / (2 * np.pi) / np.maximum(snr, _LEAST_SNR)).astype(np.float32)

    def chance(self, snr: Float32s) -> Float32s:
        """Return the chance (h, w) that noise alone would modulate less: 1 - exp(-steps snr^2 / 4), after Rayleigh."""
        return (-np.expm1(-self.steps / 4 * snr**2)).astype(np.float32)


def read_wave(reader: Reader, start: int, steps: int, sign: int, offset: float) -> Wave:
    """Return the wave of the frames start ... start + steps - 1, each read once.

    sign: +1 where frame s shows cos(phase - 2 pi s / steps), -1 for plus; offset: phase at pixel 0 in radians.
    Source: the N-step algorithm; for evenly spaced shifts its two sums are the least-squares solution.
    """
    images = [reader.color(start + step) for step in range(steps)]
    shown = [levels(image) for image in images]
    shape = shown[0].shape
    saturated = np.logical_or.reduce([saturation(image) for image in images])
    cosine, sine, total = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    cycle, shifts = np.empty(shape, dtype=np.float32), sign * 2 * np.pi * np.arange(steps) / steps
    _sum_up(shown, shifts, offset, (cosine, sine, total), cycle)
    mean: Float32s = total if images[0].ndim == 2 else np.asarray(np.mean(images, axis=0, dtype=np.float32))
    return Wave(cycle, cosine, total, saturated, as_image(mean, images[0]), steps)


def _sum_up(
    shown: Sequence[Levels],
    shifts: npt.NDArray[np.float64],
    offset: float,
    sums: tuple[Float32s, Float32s, Float32s],
    cycle: Float32s,
) -> None:
    """Write cycle (h, w), and the modulation and the mean into the first and the last of `sums`, which are zero."""
    from slkit.codecs._wave_kernels import add_step, arctangent, finish_wave

    weights = [(float(np.cos(shift)), float(np.sin(shift))) for shift in shifts]

    def block(rows: slice) -> None:
        cosine, sine, total = sums[0][rows], sums[1][rows], sums[2][rows]
        for frame, weight in zip(shown, weights, strict=True):
            add_step(frame[rows], *weight, cosine, sine, total)
        finish_wave(cosine, sine, total, len(shown), offset, arctangent(), cycle[rows])

    over_blocks(block, cycle.shape)


def as_image(levels: Float32s, like: Image) -> Image:
    """Return grey levels (...) rounded to the depth of the picture `like`."""
    return np.rint(levels).astype(like.dtype)


def noise_of_pair(one: Wave, other: Wave) -> Noise:
    """Return the noise that two sets of one scene show: their means differ by noise alone, whatever the texture."""
    tiles, share = Tiles.of(one.level.shape), 1 / one.steps + 1 / other.steps
    level, usable = tiles.cut(one.level), ~(tiles.cut(one.saturated) | tiles.cut(other.saturated)) & tiles.inner
    return noise_curve([Evidence(level - tiles.cut(other.level), level, usable, share)]).at


def noise_of_one(wave: Wave) -> Noise:
    """Return the noise that the mean of one set shows; texture counts as noise here."""
    tiles = Tiles.of(wave.level.shape)
    level = tiles.cut(wave.level)
    return noise_curve([Evidence(level, level, ~tiles.cut(wave.saturated) & tiles.inner, 1 / wave.steps)]).at
