"""What every pixel of a picture of coloured fringes shows: its place on the projector axis, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_pattern import Features
from slkit.codecs._fringe_kernels import measure_phase
from slkit.codecs._fringe_light import FringeLight
from slkit.codecs._slit_kernels import SMOOTHED
from slkit.codecs._view_slits import Slits

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]

# What is doubtful: light of a foreign colour, a pixel off the fringe, and a phase off the carrier, as shares of the
# fringe's modulation and in radians; a level far from that of a raised cosine; little modulation. At a few times
# as much a pixel is dropped.
_FOREIGN, _OFF, _SHIFT = 0.3, 0.6, 1.2
_LEVEL = float(np.log(2.0))
_LEAST_MODULATION = 0.15
_MOST_DOUBT = 3.0
# Relief and shading as fine as a fringe move its phase by about so much of what they leave unexplained.
_BIAS = 1.4


@dataclass(frozen=True, eq=False)
class Phases:
    """Pixels of a picture and where on the projector axis they look.

    row, col (p,): the pixels; place, sigma (p,): in fringes, 0 in the middle of the first one; slit (p,): the slit each
    one's fringe is named after; trust (p,): 0 to 1, how much the pixel looks like a part of that fringe.
    """

    row: Wholes
    col: Wholes
    place: Singles
    sigma: Singles
    slit: npt.NDArray[np.intp]
    trust: Singles


def read_phases(
    picture: npt.NDArray[Any],
    slits: Slits,
    label: Wholes,
    sign: int,
    lamp: FringeLight,
    features: Features,
) -> Phases:
    """Return what all pixels between labelled slits show, less those that do not look like their fringe.

    picture (h, w, 3): that of lamp, in the order of the slits; label (m,), sign: see `number_fringes`.
    """
    most = picture.shape[0] * picture.shape[1]
    row, col, table = np.empty(most, np.int32), np.empty(most, np.int32), np.empty((most, 9), np.float32)
    light = np.ascontiguousarray(lamp.light), np.ascontiguousarray(lamp.white, dtype=np.float32)
    known = features.kinds, features.ideal, lamp.unmixing, sign
    count = measure_phase(picture, slits.starts, slits.col, slits.width, label, *light, *known, row, col, table)
    place, carrier, modulation, level, misfit, off, gain, foreign, slit = table[:count].T
    slit = slit.astype(np.intp)
    strength = np.maximum(modulation, np.float32(1e-6))
    off = np.abs(off) / strength
    doubt = _doubt(strength, level / strength, off, foreign, 2 * np.pi * np.abs(place - carrier))
    spread = _noise(lamp)[slit]
    sigma = np.hypot(gain * spread, _BIAS * misfit) / strength / (2 * np.pi)
    keep = doubt < _MOST_DOUBT
    trust = 1 / (1 + doubt[keep] ** 2 / 3)
    kept = place[keep].copy(), sigma[keep].astype(np.float32), slit[keep], trust.astype(np.float32)
    return Phases(row[:count][keep], col[:count][keep], *kept)


def _doubt(strength: Singles, level: Singles, off: Singles, foreign: Singles, shift: Singles) -> Singles:
    """Return how much speaks against each pixel (p,), 1 where it begins to count."""
    rise = np.abs(np.log(np.maximum(level, np.float32(1e-3))))
    each = foreign / _FOREIGN, off / _OFF, shift / _SHIFT, rise / _LEVEL, _LEAST_MODULATION / strength
    return np.maximum.reduce(each)


def _noise(lamp: FringeLight) -> Singles:
    """Return the noise of one pixel as a share of its slit's light (m,), of the part that white has not."""
    light, white = lamp.light, lamp.white
    along = (light * white).sum(axis=1) ** 2 / np.maximum((white**2).sum(axis=1), np.float32(1e-12))
    apart = np.sqrt(np.maximum((light**2).sum(axis=1) - along, np.float32(1e-12)))
    # The noise of slits is that of rows averaged by 1 2 1, before colours are unmixed.
    grown = np.sqrt((lamp.unmixing**2).sum() / 3 / SMOOTHED)
    return (lamp.noise * np.float32(grown) / apart).astype(np.float32)
