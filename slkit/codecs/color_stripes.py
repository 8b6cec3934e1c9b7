"""Colour stripes: coloured slits in an order in which every few neighbours occur once, read from a single picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    Style,
    Transitions,
    Windows,
    check_colors,
    default_sequence,
    features,
    layout,
    unmixing,
)
from slkit.codecs._debruijn import least_distance, repeated_window
from slkit.codecs._masks import Reader
from slkit.codecs._results import colors_at
from slkit.data import Correspondences, Float32s, Frames, Image
from slkit.errors import DecodeError, InputError
from slkit.geometry import as_size
from slkit.protocols import Bounds

if TYPE_CHECKING:
    from slkit.codecs._view_slits import Slits

_WHITE_ROWS, _WHITE_SLITS = 24.0, 4.0
# A channel is not believed to be reflected less than this share of the strongest one.
_LEAST_WHITE = 0.02
# Of this pattern pictures keep half of the order and more, 0.23 on squares of paint; of others mostly less. A few slits
# tell nothing.
_LEAST_ORDER, _ENOUGH_SLITS = 0.2, 500


@dataclass(frozen=True)
class ColorStripes:
    """One picture of coloured slits, `width` px wide and `gap` px apart, in which every `window` neighbours occur once.

    projector (width, height) px. axes: "x" finds columns, "y" rows. colors: names, see `PALETTE`, neighbours differ;
    transitions: "switch" lets only colours follow each other of which one channel goes off and another on. width,
    gap: px, default 4 and as little above 8 as makes the sequence cover the projector; first: px, where the first slit
    begins. sequence: places in `colors`, for a pattern made elsewhere, default the longest that exists. style "edges":
    stripes of all eight colours without gaps, of which the borders are found, three changes a window. references: white
    and black are shown first and cancel the object's own colour. photometry: what `slkit rig color` measured, see
    `slkit.calibration.photometry`, or None: then the colours are learned from the picture itself.

    min_snr: contrast of a slit in units of the noise; min_contrast: the same as a share of its height.

    Errors: InputError where a parameter is out of range or a window occurs twice.
    Source: Monks, Carter and Shadle, Colour-encoded structured light for digitisation of real-time 3D data (1992);
    edges: Zhang, Curless and Seitz, Rapid shape acquisition using color structured light (2002).
    """

    projector: tuple[int, int]
    axes: Literal["x", "y"] = "x"
    colors: tuple[str, ...] = ()
    window: int = 3
    transitions: Transitions = "any"
    width: int | None = None
    gap: int | None = None
    first: int = 0
    sequence: tuple[int, ...] = ()
    style: Style = "slits"
    references: bool = False
    min_snr: float = 5.0
    min_contrast: float = 0.15
    photometry: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "projector", as_size(self.projector, "projector"))
        object.__setattr__(self, "colors", self.colors or (HUES if self.style == "slits" else tuple(PALETTE)))
        check_colors(self.style, self.colors, self.sequence)
        if self.window < 2:
            raise InputError(f"window must be at least 2, not {self.window}")
        if not 0 <= self.first < self._extent:
            raise InputError(f"first must lie inside the image, 0 to {self._extent - 1}, not {self.first}")
        if not (self.min_snr > 0 and 0 < self.min_contrast < 1):
            raise InputError("min_snr must be positive, and min_contrast between 0 and 1")
        unmixing(self.photometry)
        self._check_layout()
        # Filled in, so that a capture.toml says what was projected even if the defaults change.
        for name, value in (("width", self.layout.width), ("gap", self.layout.gap), ("sequence", self.layout.stripes)):
            object.__setattr__(self, name, value)

    def _check_layout(self) -> None:
        layout = self.layout
        if layout.width < 1 or layout.gap < (self.style == "slits") or (self.style == "edges" and layout.gap):
            raise InputError("width and gap must be at least 1 px, and edges have no gap")
        if len(layout.stripes) < self.window + 2:
            raise InputError(f"only {len(layout.stripes)} stripes of {layout.width} + {layout.gap} px fit in the image")
        self.validate()

    def validate(self) -> Windows:
        """Return how many windows the pattern has and how much they differ. Errors: InputError where two are equal."""
        kinds = self._features.kinds.tolist()
        equal = repeated_window(kinds, self.window)
        if equal is not None:
            raise InputError(f"the {self.window} stripes from {equal[0]} and from {equal[1]} on have the same colours")
        return Windows(len(kinds) - self.window + 1, least_distance(kinds, self.window))

    def encode(self) -> Frames:
        """Return the picture of stripes, RGB, after white and black where references are wanted."""
        extent, (wide, high) = self._extent, self.projector
        line = np.zeros((extent, 3), dtype=np.uint8)
        layout = self.layout
        for place, color in enumerate(layout.stripes):
            start = self.first + place * layout.period
            line[start : start + layout.width] = 255 * np.array(PALETTE[self.colors[color]], dtype=np.uint8)
        shape = (high, wide, 3)
        stripes = np.broadcast_to(line[None] if self.axes == "x" else line[:, None], shape)
        flat = [np.full(shape, level, np.uint8) for level in (255, 0)] if self.references else []
        return Frames.of([*flat, np.ascontiguousarray(stripes)], self._names())

    def decode(self, frames: Frames, bounds: Bounds | None = None) -> Correspondences:
        """Return the centres of the slits that could be told apart.

        bounds (h, w, 4): stripes outside are ruled out. Errors: InputError where frames do not fit the patterns or are
        grey, DecodeError where there are no slits.
        """
        from slkit.codecs._chromatic import in_green
        from slkit.codecs._color_kernels import largest
        from slkit.codecs._slit_colors import local_white, score_colors
        from slkit.codecs._stripe_labels import label_slits
        from slkit.codecs._view_slits import along_columns, see_slits

        picture, references = read_colors(frames, self._names(), "colour stripes")
        if bounds is not None and bounds.shape != (*picture.shape[:2], 4):
            raise InputError(f"bounds must have a row for each pixel of the picture, not the shape {bounds.shape}")
        turned = along_columns(picture)
        seen: Any = np.ascontiguousarray(picture.transpose(1, 0, 2)) if turned else picture
        edges = self.style == "edges"
        slits = see_slits(seen, edges, self.min_snr, self.min_contrast)
        if not len(slits):
            raise DecodeError("there are no coloured slits: was the pattern projected, is the exposure long enough?")
        light = np.einsum("mi,ij->mj", slits.light, unmixing(self.photometry))
        light = light if edges else np.maximum(light, 0)
        if references is None:
            white = local_white(slits.row, slits.col, light, (_WHITE_ROWS, _WHITE_SLITS * slits.spacing))
        else:
            white = self._full(references, slits.xy(turned))
        scores = score_colors(light / white, slits.noise / largest(white), self._features.ideal, edges)
        found = label_slits(slits, scores, self._features, self._allowed(slits, bounds, turned), edges)
        if found.order < _LEAST_ORDER and len(slits) > _ENOUGH_SLITS:
            self._check_order(slits, scores, edges)
        label = found.label
        if not edges:
            slits = replace(slits, col=in_green(seen, slits, self._channels(label)))
        color = np.clip(white / max(float(np.percentile(white, 99)), 1e-6), 0, 1)
        shown = largest(np.abs(light / white))
        return self._found(slits, label, found.ahead, turned, color, shown)

    def lit(self, frames: Frames) -> Image:
        """Return the fully lit picture (h, w): the strongest channel of white, or of what is around each pixel."""
        import cv2

        picture = Reader(frames, self._names()).color(0)
        picture = picture if picture.ndim == 2 else picture.max(axis=2)
        if self.references:
            return picture
        side = 2 * self.layout.period + 1
        grown: Any = cv2.dilate(picture, np.ones((side, side), np.uint8))
        return grown

    @cached_property
    def layout(self) -> Layout:
        """Which stripes fit into the image, and how wide and far apart they are in px."""
        return layout(self.style, self._sequence, self.width, self.gap, self._extent - self.first)

    @cached_property
    def _features(self) -> Features:
        return features(self.style, self.colors, self.layout)

    @property
    def _sequence(self) -> tuple[int, ...]:
        return self.sequence or default_sequence(self.style, self.colors, self.window, self.transitions)

    @property
    def _extent(self) -> int:
        return self.projector[self.axes == "y"]

    def _names(self) -> list[str]:
        return [*(REFERENCES if self.references else ()), f"{self.axes}_stripes"]

    def _full(self, references: tuple[Image, Image], xy: Float32s) -> Float32s:
        """Return what white gives above black at places (m, 2) px, unmixed (m, 3)."""
        white, black = (colors_at(r, xy) * float(r.max()) for r in references)
        light = np.asarray((white - black) @ unmixing(self.photometry), dtype=np.float32)
        return np.maximum(light, np.float32(_LEAST_WHITE) * light.max(axis=1, keepdims=True, initial=1))

    def _check_order(self, slits: Slits, scores: Float32s, edges: bool) -> None:
        """Refuse a picture of another pattern. Without bounds: a scene outside of them shows little order within."""
        from slkit.codecs._stripe_labels import label_slits

        if label_slits(slits, scores, self._features, self._allowed(slits, None, False), edges).order < _LEAST_ORDER:
            raise DecodeError(
                "the picture shows coloured slits, but not in the order of this pattern: was another one projected, or "
                "are the camera's red and blue exchanged?"
            )

    def _channels(self, label: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Return which channels the slits of labels (m,) show (m, 3), none for -1."""
        found = self._features
        return (found.ideal[found.kinds[label]] > 0) & (label >= 0)[:, None]

    def _center(self, label: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Return the projector position in px of labels (m,)."""
        return self.first + self._features.offset + self.layout.period * label.astype(np.float64)

    def _allowed(self, slits: Slits, bounds: Bounds | None, turned: bool) -> npt.NDArray[np.int32]:
        """Return the first and the last label (m, 2) that bounds allow, last < first for none."""
        count = len(self._features.kinds)
        if bounds is None:
            return any_label(len(slits), count)
        limits = limits_at(bounds, slits.xy(turned), int(self.axes == "y"))
        return labels_within(limits, float(self._center(np.zeros(1))[0]), self.layout.period, count)

    def _found(
        self,
        slits: Slits,
        label: npt.NDArray[np.int32],
        ahead: Float32s,
        turned: bool,
        color: npt.NDArray[Any],
        shown: Float32s,
    ) -> Correspondences:
        from slkit.codecs._slit_quality import pace, regular

        good = regular(slits, label, shown)
        keep, axis = good.keep, 1 if self.axes == "y" else 0
        value, sigma = (np.full((int(keep.sum()), 2), np.nan, dtype=np.float32) for _ in range(2))
        value[:, axis] = self._center(label[keep])
        steep = self.layout.period * pace(slits, label, keep)[keep]
        sigma[:, axis] = steep * np.hypot(slits.sigma_col, good.doubt)[keep]
        confidence = 1 / (1 + np.exp(-ahead[keep] / CORRELATED_ROWS))
        return Correspondences(
            slits.xy(turned)[keep], value, sigma, confidence.astype(np.float32), color[keep].astype(np.float32)
        )
