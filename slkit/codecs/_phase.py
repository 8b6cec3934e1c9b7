"""The wave that a set of phase-shifted sinusoids shows at every camera pixel, and the noise it carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slkit.codecs._gray_code import Mask
from slkit.codecs._masks import Reader, grey, saturation
from slkit.data import Float32s, Image

Noise = Callable[[Float32s], Float32s]
"""From grey levels (...) to the noise of one frame at that level, 1 sigma in grey levels."""

_LEAST_VARIANCE = 1 / 12
_LEVELS = 8
_LEAST_SAMPLES = 100
_WINSOR = 3.0
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
    return _noise_of(one.level - other.level, one.level, 1 / one.steps + 1 / other.steps)


def noise_of_one(wave: Wave) -> Noise:
    """Return the noise that the mean of one set shows; texture counts as noise here."""
    return _noise_of(wave.level, wave.level, 1 / wave.steps)


def _noise_of(picture: Float32s, level: Float32s, share: float) -> Noise:
    """Return the noise of one frame from a picture (h, w) that holds `share` of its variance, by grey level (h, w).

    Second differences along both axes remove what changes slowly, outliers are winsorised at 3 sigma, and the variance
    is interpolated between steps of the grey level because light brings its own noise. Never below that of rounding.
    Source: Immerkaer, Fast noise variance estimation (1996).
    """
    rows = picture[:-2] - 2 * picture[1:-1] + picture[2:]
    sizes = np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]).astype(np.float32) / np.float32(6)
    # The mean of the same 3 x 3 pixels is uncorrelated with their second difference: sorting by the pixel's own level
    # would gather its outliers in the steps above and below.
    across = level[:, :-2] + level[:, 1:-1] + level[:, 2:]
    near = (across[:-2] + across[1:-1] + across[2:]) / 9
    if not sizes.size:
        return lambda at: np.full_like(at, np.sqrt(_LEAST_VARIANCE))
    low, high = float(near.min()), float(near.max())
    step = np.minimum((near - low) * (_LEVELS / max(high - low, 1e-6)), _LEVELS - 1).astype(np.int8)
    groups = [g for i in range(_LEVELS) if np.count_nonzero(g := step == i) >= _LEAST_SAMPLES]
    groups = groups or [np.ones(step.shape, dtype=bool)]
    variances = [max(_winsorised(sizes[g]) / share, _LEAST_VARIANCE) for g in groups]
    centers = [float(near[g].mean()) for g in groups]
    return lambda at: np.sqrt(np.interp(at, centers, variances)).astype(np.float32)


def _winsorised(sizes: Float32s) -> float:
    spread = 1.4826 * float(np.median(sizes))
    # Rounding can make more than half of the differences vanish; the plain mean square is right then.
    limit = _WINSOR * spread if spread > 0 else np.inf
    return float(np.mean(np.minimum(sizes, limit) ** 2, dtype=np.float64))
