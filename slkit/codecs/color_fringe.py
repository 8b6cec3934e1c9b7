"""Colour fringes: sinusoids whose colours tell their order, for a value at every pixel of a single picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_frames import CORRELATED_ROWS, REFERENCES, any_label, labels_within, limits_at, read_colors
from slkit.codecs._color_pattern import (
    HUES,
    PALETTE,
    Features,
    Layout,
    Transitions,
    default_sequence,
    features,
    unmixing,
)
from slkit.codecs._debruijn import repeated_window
from slkit.codecs._masks import Reader, grey, measure_light
from slkit.data import Correspondences, Float32s, Frames, Image
from slkit.errors import DecodeError, InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds

if TYPE_CHECKING:
    from slkit.codecs._fourier import Phases
    from slkit.codecs._view_slits import Slits

_PERIOD_PX, _SHORTEST_PX = 16, 4
# A position may lie so far outside the bounds.
_SLACK_PX = 0.5


@dataclass(frozen=True)
class ColorFringe:
    """One picture of sinusoidal fringes, dark between them, in whose colours every `window` neighbours occur once.

    projector (width, height) px. axes: "x" finds columns, "y" rows. colors: names of hues, see `HUES`, neighbours
    differ; transitions: "switch" lets only colours follow each other of which one channel goes off and another on.
    period: px, default 16, or as little more as makes the sequence cover the projector. sequence: places in `colors`,
    default the longest that exists. references: white and black are shown first and cancel the object's own colour.
    photometry: what `slkit rig color` measured, see `slkit.calibration.photometry`, or None: then the colours are
    learned from the picture itself.

    min_snr: contrast of a fringe in units of the noise; min_contrast: the same as a share of its height.

    Errors: InputError where a parameter is out of range or a window occurs twice.
    Source: Fernandez, Salvi and Pribanic, Absolute phase mapping for one-shot dense pattern projection (2010).
    """

    projector: tuple[int, int]
    axes: Literal["x", "y"] = "x"
    colors: tuple[str, ...] = HUES
    window: int = 3
    transitions: Transitions = "any"
    period: int | None = None
    sequence: tuple[int, ...] = ()
    references: bool = False
    min_snr: float = 5.0
    min_contrast: float = 0.15
    photometry: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "projector", as_size(self.projector, "projector"))
        if not set(self.colors) <= set(HUES) or len(set(self.colors)) < len(self.colors) or len(self.colors) < 3:
            raise InputError(f"colors must be three or more different ones of {', '.join(HUES)}")
        if self.window < 2:
            raise InputError(f"window must be at least 2, not {self.window}")
        if not all(0 <= s < len(self.colors) for s in self.sequence):
            raise InputError(f"sequence must name places in colors, 0 to {len(self.colors) - 1}")
        if self.period is not None and self.period < _SHORTEST_PX:
            raise InputError(f"period must be at least {_SHORTEST_PX} px, not {self.period}")
        if not (self.min_snr > 0 and 0 < self.min_contrast < 1):
            raise InputError("min_snr must be positive, and min_contrast between 0 and 1")
        unmixing(self.photometry)
        fringes = self.layout.stripes
        if len(fringes) < self.window + 2:
            raise InputError(f"only {len(fringes)} fringes of {self.layout.period} px fit in the image")
        equal = repeated_window(fringes, self.window)
        if equal is not None:
            raise InputError(f"the {self.window} fringes from {equal[0]} and from {equal[1]} on have the same colours")
        # Filled in, so that a capture.toml says what was projected even if the defaults change.
        object.__setattr__(self, "period", self.layout.period)
        object.__setattr__(self, "sequence", fringes)

    def encode(self) -> Frames:
        """Return the picture of fringes, RGB, after white and black where references are wanted."""
        wide, high = self.projector
        at, period, fringes = np.arange(self._extent), self.layout.period, self.layout.stripes
        wave = (1 + np.cos(2 * np.pi * (at - self._features.offset) / period)) / 2
        # What the sequence does not reach stays dark.
        hues = np.zeros((at[-1] // period + 1, 3))
        hues[: len(fringes)] = [PALETTE[self.colors[color]] for color in fringes]
        line = np.rint(255 * wave[:, None] * hues[at // period]).astype(np.uint8)
        shape = (high, wide, 3)
        shown = np.broadcast_to(line[None] if self.axes == "x" else line[:, None], shape)
        flat = [np.full(shape, level, np.uint8) for level in (255, 0)] if self.references else []
        return Frames.of([*flat, np.ascontiguousarray(shown)], self._names())

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return one correspondence for every pixel whose fringe could be told, at the pixel's centre.

        sigma: from the noise of the picture and from what a sinusoid leaves unexplained in the window. confidence:
        that of the fringe's number, times how much the pixel looks like a part of it. bounds (h, w, 4): what lies
        outside is ruled out. Errors: InputError where frames do not fit the patterns or are grey, DecodeError where
        there are no fringes.
        """
        from slkit.codecs._fourier import read_phases
        from slkit.codecs._fringe_light import learned_light, measured_light, turned
        from slkit.codecs._fringe_orders import number_fringes
        from slkit.codecs._slit_colors import score_colors
        from slkit.codecs._view_slits import along_columns, see_slits

        picture, references = read_colors(frames, self._names(), "colour fringes")
        if references is not None:
            measure_light(*references, self.min_snr)
        turn = along_columns(picture)
        slits = see_slits(turned(picture) if turn else picture, False, self.min_snr, self.min_contrast)
        if not len(slits):
            raise DecodeError(
                "there are no coloured fringes: was the pattern projected, and is the exposure long enough?"
            )
        if references is None:
            lamp = learned_light(picture, slits, unmixing(self.photometry))
        else:
            lamp = measured_light(picture, references, slits, slits.xy(turn), unmixing(self.photometry))
        shown = lamp.light / lamp.white, lamp.noise / lamp.white.max(axis=1)
        scores = score_colors(*shown, self._features.ideal, False)
        allowed = self._allowed(slits, bounds, turn)
        label, ahead, sign = number_fringes(slits, scores, self._features, allowed, self.window)
        seen = turned(lamp.picture) if turn else lamp.picture
        phases = read_phases(seen, slits, label, sign, lamp, self._features)
        return self._found(phases, ahead, turn, bounds, lamp.color)

    def lit(self, frames: Frames) -> Image:
        """Return the fully lit picture as grey (h, w): white, or the brightest of each channel around a pixel."""
        import cv2

        picture: Any = Reader(frames, self._names()).color(0)
        if not self.references:
            side = 2 * self.layout.period + 1
            picture = cv2.dilate(picture, np.ones((side, side), np.uint8))
        return np.rint(grey(picture)).astype(picture.dtype)

    @cached_property
    def layout(self) -> Layout:
        """Which fringes the pattern has, and how wide they are."""
        period = self.period or max(_PERIOD_PX, -(-self._extent // len(self._sequence)))
        return Layout(self._sequence[: -(-self._extent // period)], period, 0)

    @cached_property
    def _features(self) -> Features:
        return features("slits", self.colors, self.layout)

    @property
    def _sequence(self) -> tuple[int, ...]:
        return self.sequence or default_sequence("slits", self.colors, self.window, self.transitions)

    @property
    def _extent(self) -> int:
        return self.projector[self.axes == "y"]

    def _names(self) -> list[str]:
        return [*(REFERENCES if self.references else ()), f"{self.axes}_fringes"]

    def _allowed(self, slits: Slits, bounds: Bounds | None, turned: bool) -> npt.NDArray[np.int32]:
        """Return the first and the last fringe (m, 2) that bounds allow, last < first for none."""
        count = len(self.layout.stripes)
        if bounds is None:
            return any_label(len(slits), count)
        limits = limits_at(bounds, slits.xy(turned), int(self.axes == "y"))
        return labels_within(limits, self._features.offset, self.layout.period, count)

    def _found(
        self,
        phases: Phases,
        ahead: Float32s,
        turned: bool,
        bounds: Bounds | None,
        color: Float32s,
    ) -> Correspondences:
        """Return the pixels inside the image and the bounds. color (m, 3): of the surface at each slit."""
        camera_xy = np.stack([phases.col, phases.row], axis=1).astype(np.float32)
        camera_xy = np.ascontiguousarray(camera_xy[:, ::-1]) if turned else camera_xy
        position = self._features.offset + self.layout.period * phases.place
        keep = (position > -0.5) & (position < self._extent - 0.5)
        if bounds is not None:
            low, high = limits_at(bounds, camera_xy, int(self.axes == "y")).T
            keep &= (position >= low - _SLACK_PX) & (position <= high + _SLACK_PX)
        axis = int(self.axes == "y")
        value, sigma = (np.full((int(keep.sum()), 2), np.nan, dtype=np.float32) for _ in range(2))
        value[:, axis], sigma[:, axis] = position[keep], self.layout.period * phases.sigma[keep]
        sure = 1 / (1 + np.exp(-ahead[phases.slit] / CORRELATED_ROWS))
        confidence = (sure * phases.trust)[keep].astype(np.float32)
        return Correspondences(camera_xy[keep], value, sigma, confidence, color[phases.slit[keep]].astype(np.float32))
