"""How well a picture is exposed and focused where its board is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from slkit.calibration.detect import Singles, grey
from slkit.data import Finding, Image
from slkit.geometry import Floats

_FULL = 254
_CLIPPED_SHARE = 0.25
"""A picture with a larger share of pixels at full scale around its corners is over-exposed."""
_LEAST_SNR = 12.0
_LEAST_LEVELS = 20.0
"""Least difference between black and white, in units of the noise, and in levels of an 8-bit picture."""
_SMOOTH_PX = 0.7
_WINDOW_PX = (3, 10)
_SOFT_PX = 1.2
_SOFT_SHARE = 0.055
_SOFTER = 1.7
"""An edge is blurred that is wider than this in px (1 sigma) and either than this share of a square, or so many times
wider than in the other pictures."""


@dataclass(frozen=True)
class Look:
    """What a picture is like where its board is, or as a whole where none was found.

    clipped: share of the pixels around corners at full scale, or of the bright ones where no board was found; contrast:
    between black and white, in grey levels of 8 bits; noise: 1 sigma of it; edge_px: 1 sigma of an edge's blur, NaN
    where the contrast is too weak to tell; square_px: distance of neighbouring corners, NaN where no board was found.
    """

    view: str
    role: str
    clipped: float
    contrast: float
    noise: float
    edge_px: float
    square_px: float


def look_at(view: str, role: str, picture: Image, points: Floats, full: float) -> Look:
    """Return what a picture is like around points (n, 2) px, or as a whole for fewer than four.

    full: the level of full scale.
    """
    levels = grey(picture) * np.float32(255 / full)
    noise = noise_of(levels)
    if len(points) < 4:
        low, high = np.percentile(levels, (2, 98))
        edge = _edge_px(levels, float(high - low), 99.9) if high - low > _LEAST_SNR * noise else np.nan
        # A board that was not found may be small: of what is bright most is then paper.
        bright = levels > 0.5 * np.percentile(levels, 99.8)
        clipped = float((levels >= _FULL).sum() / max(int(bright.sum()), 1))
        return Look(view, role, clipped, float(high - low), noise, edge, np.nan)
    square = spacing(points)
    windows = [w for at in points if (w := _window(levels, at, int(np.clip(0.35 * square, *_WINDOW_PX)))) is not None]
    if not windows:
        return Look(view, role, 0.0, np.inf, noise, np.nan, np.nan)
    contrasts = np.array([np.subtract(*np.percentile(window, (95, 5))) for window in windows])
    contrast = float(np.median(contrasts))
    clipped = float(np.mean([(window >= _FULL).mean() for window in windows]))
    edges = [_edge_px(window, float(step), 97) for window, step in zip(windows, contrasts, strict=True)]
    edge = float(np.median(edges)) if contrast > _LEAST_SNR * noise else np.nan
    return Look(view, role, clipped, contrast, noise, edge, square)


def exposure_findings(looks: Sequence[Look]) -> list[Finding]:
    """Return the pictures that are over-exposed, too dark, or blurred."""
    found: list[Finding] = []
    for look in looks:
        if look.clipped > _CLIPPED_SHARE:
            fault = f"{100 * look.clipped:.0f} % of the {look.role} picture is saturated"
            found.append(Finding(fault, look.view, "expose for a shorter time or close the aperture", "saturated"))
        elif look.contrast < max(_LEAST_SNR * look.noise, _LEAST_LEVELS * (look.role != "marks")):
            # Marks beside the projector's light, which only the room lights, need not be bright.
            fault = (
                f"the {look.role} picture is too dark: black and white differ by {look.contrast:.0f} of 255 levels, "
                f"at a noise of {look.noise:.1f}"
            )
            found.append(Finding(fault, look.view, "expose for longer, or open the aperture", "under-exposed"))
    dark = {f.view for f in found if f.code == "under-exposed"}
    return found + _blurred([look for look in looks if look.view not in dark])


def _blurred(looks: Sequence[Look]) -> list[Finding]:
    found: list[Finding] = []
    for role in dict.fromkeys(look.role for look in looks):
        mine = [look for look in looks if look.role == role]
        usual = float(np.nanmedian([look.edge_px for look in mine] + [np.inf]))
        for look in mine:
            wide = look.edge_px > _SOFT_SHARE * look.square_px or look.edge_px > _SOFTER * usual
            if look.edge_px > _SOFT_PX and wide:
                fault = f"the {look.role} picture is blurred: its edges are {look.edge_px:.1f} px wide (1 sigma)"
                remedy = "focus both devices on the board, hold it still, and expose for a shorter time"
                found.append(Finding(fault, look.view, remedy, "blurred"))
    return found


def noise_of(levels: Singles) -> float:
    """Return 1 sigma of the noise of a picture; at least that of rounding.

    Source: Immerkaer, Fast noise variance estimation (1996), with a median instead of the mean.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    response: Any = np.abs(cv2.filter2D(levels, cv2.CV_32F, kernel))
    lit = response[(levels > 2) & (levels < 253)]
    return max(float(np.median(lit)) / 0.6745 / 6 if len(lit) else 0.0, 0.29)


def _window(levels: Singles, at: Floats, half: int) -> Singles | None:
    x, y = (int(v) for v in np.rint(at))
    window = levels[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
    return window if window.shape == (2 * half + 1, 2 * half + 1) else None


def _edge_px(levels: Singles, contrast: float, share: float) -> float:
    """Return 1 sigma in px of a Gaussian edge of that contrast whose steepest slope is the picture's."""
    smooth: Any = cv2.GaussianBlur(np.ascontiguousarray(levels), (0, 0), _SMOOTH_PX)
    across, down = np.gradient(smooth, axis=1), np.gradient(smooth, axis=0)
    steepest = float(np.percentile(np.hypot(across, down), share))
    sigma = contrast / (np.sqrt(2 * np.pi) * max(steepest, 1e-6))
    # The slope is taken over two pixels, which widens an edge as a box of that width does.
    return float(np.sqrt(max(sigma**2 - _SMOOTH_PX**2 - 1 / 3, 0.0)))


def spacing(points: Floats) -> float:
    """Return the median distance in px of a point to its nearest neighbour."""
    away = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(away, np.inf)
    return float(np.median(away.min(axis=1)))
