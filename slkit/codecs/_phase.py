"""The wave that a set of phase-shifted sinusoids shows at every camera pixel, and the noise it carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slkit.codecs._gray_code import Mask
from slkit.codecs._masks import Reader, grey, saturation
from slkit.codecs._noise import Evidence, noise_curve
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
    image = reader.color(start)
    total = np.zeros(image.shape, dtype=np.float32)
    cosine, sine = np.zeros(image.shape[:2], dtype=np.float32), np.zeros(image.shape[:2], dtype=np.float32)
    saturated = np.zeros(image.shape[:2], dtype=bool)
    for step in range(steps):
        image = image if step == 0 else reader.color(start + step)
        frame, shift = grey(image), sign * 2 * np.pi * step / steps
        cosine += np.float32(np.cos(shift)) * frame
        sine += np.float32(np.sin(shift)) * frame
        total += image
        saturated |= saturation(image)
    total /= np.float32(steps)
    cycle = ((np.arctan2(sine, cosine) - np.float32(offset)) / np.float32(2 * np.pi)) % 1
    level = total if total.ndim == 2 else total.mean(axis=2)
    modulation = np.hypot(sine, cosine) * np.float32(2 / steps)
    return Wave(cycle, modulation, level, saturated, as_image(total, image), steps)


def as_image(levels: Float32s, like: Image) -> Image:
    """Return grey levels (...) rounded to the depth of the picture `like`."""
    return np.rint(levels).astype(like.dtype)


def noise_of_pair(one: Wave, other: Wave) -> Noise:
    """Return the noise that two sets of one scene show: their means differ by noise alone, whatever the texture."""
    usable = ~(one.saturated | other.saturated)
    share = 1 / one.steps + 1 / other.steps
    return noise_curve([Evidence(one.level - other.level, one.level, usable, share)]).at


def noise_of_one(wave: Wave) -> Noise:
    """Return the noise that the mean of one set shows; texture counts as noise here."""
    return noise_curve([Evidence(wave.level, wave.level, ~wave.saturated, 1 / wave.steps)]).at
