"""Direct light, which comes straight from the projector, told from global light, which the scene scatters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import Float32s

Mask = npt.NDArray[np.bool_]

# Stripes of these bits are narrow enough to separate direct from global light and wide enough to survive blur.
SEPARATION_BITS = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class Pair:
    """A pattern and its inverse, in grey levels (h, w); noise: 1 sigma of their difference."""

    lit: Float32s
    inverse: Float32s
    noise: Float32s


def separate(pairs: list[Pair], dark: Float32s) -> tuple[Float32s, Float32s]:
    """Return the direct and the global light under full white, (h, w) grey levels, from pairs of fine stripes.

    dark (h, w): the level without projected light. Stripes light half the scene, and half its global light.
    Source: Nayar et al., Fast separation of direct and global components (2006), with the dark level measured.
    """
    brightest = np.max([np.maximum(p.lit, p.inverse) for p in pairs], axis=0)
    darkest = np.min([np.minimum(p.lit, p.inverse) for p in pairs], axis=0)
    return brightest - darkest, 2 * np.maximum(darkest - dark, 0)


def robust_bit(pair: Pair, separation: tuple[Float32s, Float32s], dark: Float32s, snr: float) -> tuple[Mask, Mask]:
    """Return a bit and whether it is known, each (h, w), given direct and global light.

    Where direct light dominates the brighter picture tells; elsewhere only levels that global light alone cannot
    give. Source: Moreno and Taubin, Simple, accurate and robust projector-camera calibration (2012), after Xu and
    Aliaga (2007); their fixed level became a multiple of the noise.
    """
    direct, indirect = separation
    lit, inverse = pair.lit - dark, pair.inverse - dark
    one, beyond = lit > inverse, (lit >= indirect) & (inverse <= direct)
    below = (lit <= direct) & (inverse >= indirect)
    known = (direct > snr * pair.noise) & ((direct > indirect) | (beyond != below))
    return np.where(direct > indirect, one, beyond), known
