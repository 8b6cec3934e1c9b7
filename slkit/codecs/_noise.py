"""How noisy pictures are at each grey level, measured in the pictures themselves, and what noise turns over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._rows import over_rows
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
    from slkit.codecs._noise_kernels import sort_by_level

    seen = [e for e in evidence if min(e.picture.shape) > 2]
    counts = [(e.picture.shape[0] - 2) * (e.picture.shape[1] - 2) for e in seen]
    sizes, levels = np.empty((2, sum(counts)), np.float32)
    starts = np.cumsum([0, *counts]).tolist()
    parts = [slice(*ends) for ends in zip(starts[:-1], starts[1:], strict=True)]
    limits = [_roughness(e, sizes[part], levels[part]) for e, part in zip(seen, parts, strict=True)]
    low, high = min((low for low, _ in limits), default=np.inf), max((high for _, high in limits), default=-np.inf)
    if low > high:
        return NoiseCurve(0.0, _LEAST_VARIANCE, 0.0)
    found, cuts, totals = np.empty_like(sizes), np.empty(_LEVELS + 1, np.int64), np.empty(_LEVELS)
    sort_by_level(sizes, levels, np.float32(low), np.float32(_LEVELS / max(high - low, 1e-6)), cuts, totals, found)
    groups = [i for i in range(_LEVELS) if cuts[i + 1] - cuts[i] >= _LEAST_SAMPLES]
    if not groups:
        return NoiseCurve(float(totals.sum() / cuts[-1]), _variance(found[: cuts[-1]]), 0.0)
    variances = np.array([_variance(found[cuts[i] : cuts[i + 1]]) for i in groups])
    centers = totals[groups] / np.diff(cuts)[groups]
    gains = (variances[1:] - variances[0]) / (centers[1:] - centers[0])
    gain = max(float(gains.min()), 0.0) if gains.size else 0.0
    return NoiseCurve(float(centers[0]), float(variances[0]), gain)


def _roughness(evidence: Evidence, sizes: Float32s, near: Float32s) -> tuple[float, float]:
    """Write second differences of a picture (h, w) and the level around, ((h - 2) (w - 2),) each; see `rough_rows`.

    Return the least and the highest level that counts; the least is above the highest where none does.
    """
    from slkit.codecs._noise_kernels import rough_rows

    picture, level = (np.ascontiguousarray(a) for a in (evidence.picture, evidence.level))
    usable = np.ascontiguousarray(evidence.usable)
    height, width = picture.shape[0] - 2, picture.shape[1] - 2
    # The mean of the same 3 x 3 pixels is uncorrelated with their second difference: sorting by the pixel's own level
    # would gather its outliers in the steps above and below.
    to_sizes, to_near, ends = (
        sizes.reshape(height, width),
        near.reshape(height, width),
        np.empty((height, 2), np.float32),
    )
    scale = np.float32(1 / (6 * np.sqrt(evidence.share)))

    def work(first: int, last: int) -> None:
        given, to = slice(first, last + 2), slice(first, last)
        rough_rows(picture[given], level[given], usable[given], scale, to_sizes[to], to_near[to], ends[to])

    over_rows(work, height)
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def _variance(sizes: Float32s) -> float:
    spread = 1.4826 * median(sizes)
    # Rounding can make more than half of the differences vanish; the plain mean square is right then.
    limit = _WINSOR * spread if spread > 0 else np.inf
    return max(float(np.mean(np.minimum(sizes, limit) ** 2, dtype=np.float64)), _LEAST_VARIANCE)


def median(values: Float32s) -> float:
    """Return the median, several times as fast as NumPy's."""
    middle = len(values) // 2
    parts = np.partition(values, middle)
    return float(parts[middle]) if len(values) % 2 else float(parts[:middle].max() + parts[middle]) / 2


def probability(square: Float32s) -> Float32s:
    """Return the probability (...) that noise does not turn a difference over; square (...): of it in sigmas.

    See `chance_of`.
    """
    from slkit.codecs._noise_kernels import write_chances

    found = np.empty(square.shape, np.float32)
    write_chances(square.ravel(), found.ravel())
    return found
