"""Which stripe of a colour pattern has which colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.codecs._debruijn import eulerian_sequence

Style = Literal["slits", "edges"]
Transitions = Literal["any", "switch"]

PALETTE: dict[str, tuple[int, int, int]] = {
    "black": (0, 0, 0),
    "blue": (0, 0, 1),
    "green": (0, 1, 0),
    "cyan": (0, 1, 1),
    "red": (1, 0, 0),
    "magenta": (1, 0, 1),
    "yellow": (1, 1, 0),
    "white": (1, 1, 1),
}
HUES = ("red", "yellow", "green", "cyan", "blue", "magenta")
# The channels that change from a stripe to the next one, as bits red green blue, after Zhang, Curless and Seitz.
_FLIPS = (0b001, 0b010, 0b100, 0b101, 0b110)


_WIDTH, _LEAST_GAP = 4, 8


@dataclass(frozen=True)
class Layout:
    """stripes: their colours in order; width, gap: px."""

    stripes: tuple[int, ...]
    width: int
    gap: int

    @property
    def period(self) -> int:
        """From one stripe to the next, px."""
        return self.width + self.gap


@dataclass(frozen=True, eq=False)
class Features:
    """What a camera can find of a pattern. ideal (k, 3): the kinds, colours or changes of colour; kinds (n,): their
    order in the pattern; offset: where the first one lies, in px from the first stripe's first pixel.
    """

    ideal: npt.NDArray[np.float32]
    kinds: npt.NDArray[np.int32]
    offset: float


def default_sequence(style: Style, colors: tuple[str, ...], window: int, transitions: Transitions) -> tuple[int, ...]:
    """Return the longest sequence of colours, as places in `colors`, in which every window occurs once.

    slits: windows of slits; edges: all eight colours, windows of changes. Errors: InputError where none exists.
    """
    if style == "edges":
        flips = eulerian_sequence(len(_FLIPS), window, lambda _a, _b: True)
        stripes = np.bitwise_xor.accumulate([0b111, *(_FLIPS[f] for f in flips[: len(_FLIPS) ** window - 1])])
        return tuple(int(s) for s in stripes)
    shown = np.array([PALETTE[c] for c in colors])

    def allowed(a: int, b: int) -> bool:
        change = shown[b] - shown[a]
        return a != b and (transitions == "any" or bool(change.min() < 0 < change.max()))

    return eulerian_sequence(len(colors), window, allowed)


def layout(style: Style, sequence: tuple[int, ...], width: int | None, gap: int | None, extent: int) -> Layout:
    """Return where the stripes of a sequence lie in `extent` px; what does not fit is left out.

    width, gap: px; None for slits 4 px wide, as little above 8 px apart as covers the extent, and for edges as wide as
    covers it.
    """
    pitch = -(-extent // len(sequence))
    if style == "edges":
        width, gap = width or pitch, gap or 0
    else:
        width = _WIDTH if width is None else width
        gap = max(_LEAST_GAP, pitch - width) if gap is None else gap
    period = max(width + gap, 1)
    return Layout(sequence[: max((extent + gap) // period, 0)], width, gap)


def features(style: Style, colors: tuple[str, ...], placed: Layout) -> Features:
    """Return what of a layout a camera can find: the slits, or the borders between stripes."""
    shown = np.array([PALETTE[c] for c in colors], dtype=np.float32)
    stripes = shown[np.asarray(placed.stripes, dtype=np.intp)]
    found: Any = stripes if style == "slits" else np.diff(stripes, axis=0)
    ideal, kinds = np.unique(found, axis=0, return_inverse=True)
    offset = (placed.width - 1) / 2 if style == "slits" else placed.width - 0.5
    return Features(ideal.astype(np.float32), kinds.ravel().astype(np.int32), offset)
