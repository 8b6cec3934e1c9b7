"""How noisy pictures are at each grey level, measured in the pictures themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import Float32s

_LEAST_VARIANCE = 1 / 12
_LEVELS = 8
_LEAST_SAMPLES = 100
_WINSOR = 3.0


@dataclass(frozen=True)
class NoiseCurve:
    """The noise of one frame: its variance is `least` up to the grey level `dark` and grows by `gain` a level above."""

    dark: float
    least: float
    gain: float

    @property
    def numbers(self) -> Float32s:
        """least, gain and dark (3,), for compiled loops."""
        return np.array([self.least, self.gain, self.dark], dtype=np.float32)

    def at(self, level: Float32s) -> Float32s:
        """Return the noise, 1 sigma in grey levels, at the grey levels `level` (...)."""
        return np.sqrt(np.float32(self.least) + np.float32(self.gain) * np.maximum(level - np.float32(self.dark), 0))


@dataclass(frozen=True, eq=False)
class Evidence:
    """A picture (h, w) that shows noise, the grey level (h, w) it belongs to, and where (h, w) both can be trusted.

    share: the variance of the picture's noise in units of one frame's; 1 for a frame itself.
    """

    picture: Float32s
    level: Float32s
    usable: npt.NDArray[np.bool_]
    share: float = 1.0


def noise_curve(evidence: Sequence[Evidence]) -> NoiseCurve:
    """Return the noise of one frame that pictures show.

    Slow changes are removed by second differences along both axes, outliers are winsorised at 3 sigma, and the
    variance is taken in steps of the grey level because light brings its own noise. Relief and print can only add to
    it: the curve is the steepest line from the darkest step that no other step lies below. Never below rounding.
    Source: Immerkaer, Fast noise variance estimation (1996); the line is the photon transfer curve of EMVA 1288.
    """
    samples, levels = (np.concatenate(part) for part in zip(*(_roughness(e) for e in evidence), strict=True))
    if not samples.size:
        return NoiseCurve(0.0, _LEAST_VARIANCE, 0.0)
    low, high = float(levels.min()), float(levels.max())
    step = np.minimum(((levels - low) * np.float32(_LEVELS / max(high - low, 1e-6))).astype(np.intp), _LEVELS - 1)
    groups = [step == i for i in range(_LEVELS)]
    groups = [g for g in groups if np.count_nonzero(g) >= _LEAST_SAMPLES] or [np.ones_like(step, dtype=bool)]
    variances = np.array([max(_winsorised(samples[g]), _LEAST_VARIANCE) for g in groups])
    centers = np.array([float(levels[g].mean()) for g in groups])
    gains = (variances[1:] - variances[0]) / (centers[1:] - centers[0])
    gain = max(float(gains.min()), 0.0) if gains.size else 0.0
    return NoiseCurve(float(centers[0]), float(variances[0]), gain)


def _roughness(evidence: Evidence) -> tuple[Float32s, Float32s]:
    picture, level = evidence.picture, evidence.level
    if min(picture.shape) < 3:
        return np.empty(0, np.float32), np.empty(0, np.float32)
    rows = picture[:-2] - 2 * picture[1:-1] + picture[2:]
    both = rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]
    # The mean of the same 3 x 3 pixels is uncorrelated with their second difference: sorting by the pixel's own level
    # would gather its outliers in the steps above and below.
    across = level[:, :-2] + level[:, 1:-1] + level[:, 2:]
    near = (across[:-2] + across[1:-1] + across[2:]) / np.float32(9)
    inner = evidence.usable[1:-1, 1:-1]
    sizes = np.abs(both)[inner] / np.float32(6 * np.sqrt(evidence.share))
    return sizes.astype(np.float32), near[inner].astype(np.float32)


def _winsorised(sizes: Float32s) -> float:
    spread = 1.4826 * median(sizes)
    # Rounding can make more than half of the differences vanish; the plain mean square is right then.
    limit = _WINSOR * spread if spread > 0 else np.inf
    return float(np.mean(np.minimum(sizes, limit) ** 2, dtype=np.float64))


def median(values: Float32s) -> float:
    """Return the median, several times as fast as NumPy's."""
    middle = len(values) // 2
    parts = np.partition(values, middle)
    return float(parts[middle]) if len(values) % 2 else float(parts[:middle].max() + parts[middle]) / 2
