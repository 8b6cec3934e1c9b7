"""Direct light, which comes straight from the projector, told from global light, which the scene scatters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import Float32s

Mask = npt.NDArray[np.bool_]

# Stripes of these bits are narrow enough to separate direct from global light and wide enough to survive blur.
SEPARATION_BITS = (1, 2, 3)
# The light that dark parts of a pattern give, as a share of what its lit parts give.
_DARK_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Pair:
    """A pattern and its inverse, in grey levels (h, w); noise: 1 sigma of their difference."""

    lit: Float32s
    inverse: Float32s
    noise: Float32s


def separate(pairs: list[Pair]) -> tuple[Float32s, Float32s]:
    """Return the direct and the global light, (h, w) grey levels, from pairs of fine stripes.

    Source: Nayar et al., Fast separation of direct and global components (2006), as used by Moreno and Taubin (2012).
    """
    brightest = np.max([np.maximum(p.lit, p.inverse) for p in pairs], axis=0)
    darkest = np.min([np.minimum(p.lit, p.inverse) for p in pairs], axis=0)
    b = _DARK_SHARE
    direct = (brightest - darkest) / (1 - b)
    return direct, np.maximum(2 * (darkest - b * brightest) / (1 - b * b), 0)


def robust_bit(pair: Pair, separation: tuple[Float32s, Float32s], snr: float) -> tuple[Mask, Mask]:
    """Return a bit and whether it is known, each (h, w), given direct and global light.

    Where direct light dominates the brighter picture tells; elsewhere only levels that global light alone cannot
    give. Source: Moreno and Taubin, Simple, accurate and robust projector-camera calibration (2012), after Xu and
    Aliaga (2007); their fixed level became a multiple of the noise.
    """
    direct, indirect = separation
    one = pair.lit > pair.inverse
    beyond = (pair.lit >= indirect) & (pair.inverse <= direct)
    below = (pair.lit <= direct) & (pair.inverse >= indirect)
    known = (direct > snr * pair.noise) & ((direct > indirect) | (beyond != below))
    return np.where(direct > indirect, one, beyond), known
