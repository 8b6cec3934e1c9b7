"""The light of coloured fringes: what each slit has of it, and what white would give there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slkit.codecs._results import colors_at
from slkit.codecs._slit_colors import local_white
from slkit.codecs._view_slits import Slits
from slkit.data import Float32s, Image

_WHITE_ROWS, _WHITE_FRINGES = 24.0, 4.0


@dataclass(frozen=True, eq=False)
class FringeLight:
    """A picture (h, w, 3) and the light of its slits, in the same units.

    unmixing (3, 3): takes the picture's colours, as rows, to projected ones; light, white (m, 3): of the slits and what
    white would give there, unmixed; noise (m,): 1 sigma of light; color (m, 3): of the surface, 0 to 1.
    """

    picture: Image | Float32s
    unmixing: Float32s
    light: Float32s
    white: Float32s
    noise: Float32s
    color: Float32s


def learned_light(picture: Image, slits: Slits, unmixing: Float32s) -> FringeLight:
    """Return the light of slits where white is the strongest of each channel around."""
    light: Float32s = np.maximum(slits.light @ unmixing, 0, dtype=np.float32)
    white = local_white(slits.row, slits.col, light, (_WHITE_ROWS, _WHITE_FRINGES * slits.spacing))
    color = white / max(float(white.max()), 1e-6)
    return FringeLight(picture, unmixing, light, white, slits.noise, color)


def measured_light(
    picture: Image, references: tuple[Image, Image], slits: Slits, xy: Float32s, unmixing: Float32s
) -> FringeLight:
    """Return picture and light as unmixed shares of white - black, pixel by pixel.

    references: white and black; xy (m, 2) px: where the slits are in the picture.
    """
    white, black = references
    dark = black.astype(np.float32)
    span: Float32s = np.maximum((white - dark) @ unmixing, 1, dtype=np.float32)
    share = np.clip(((picture - dark) @ unmixing) / span, 0, 2, dtype=np.float32)
    col, row = np.rint(xy).astype(np.intp).T
    own = span[np.clip(row, 0, span.shape[0] - 1), np.clip(col, 0, span.shape[1] - 1)]
    light = (np.maximum(slits.light @ unmixing, 0) / own).astype(np.float32)
    noise = slits.noise / own.max(axis=1)
    return FringeLight(share, np.eye(3, dtype=np.float32), light, np.ones_like(light), noise, colors_at(white, xy))


def turned(picture: Any) -> Any:
    """Return the transpose (w, h, 3) of a picture (h, w, 3)."""
    return np.ascontiguousarray(picture.transpose(1, 0, 2))
