"""Which stripe of a colour pattern has which colour."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slkit.codecs._debruijn import eulerian_sequence
from slkit.errors import InputError

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
    order in the pattern, back (n,): as a mirror shows it, changes the other way round; offset: where the first one
    lies, in px from the first stripe's first pixel.
    """

    ideal: npt.NDArray[np.float32]
    kinds: npt.NDArray[np.int32]
    back: npt.NDArray[np.int32]
    offset: float


@dataclass(frozen=True)
class Windows:
    """What makes a sequence unique: how many windows it has, and in how many places two of them differ at least."""

    windows: int
    distance: int


def check_colors(style: Style, colors: tuple[str, ...], sequence: tuple[int, ...]) -> None:
    """Refuse colours that make no pattern. sequence: places in `colors`, empty for the default. Errors: InputError."""
    if any(c not in PALETTE for c in colors) or len(set(colors)) < len(colors) or len(colors) < 3:
        raise InputError(f"colors must be three or more different ones of {', '.join(PALETTE)}")
    if style == "slits" and "black" in colors:
        raise InputError("black slits cannot be seen: leave black out of colors")
    if style == "edges" and not sequence and colors != tuple(PALETTE):
        raise InputError("edges between all eight colours need them in their usual order: leave colors out")
    if not all(0 <= s < len(colors) for s in sequence):
        raise InputError(f"sequence must name places in colors, 0 to {len(colors) - 1}")
    if style == "edges" and any(a == b for a, b in pairwise(sequence)):
        raise InputError("there is no edge between two stripes of one colour: neighbours in sequence must differ")


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
    slits = style == "slits"
    found: Any = stripes if slits else np.diff(stripes, axis=0)
    both = np.concatenate([found, found[::-1] if slits else -found[::-1]])
    ideal, kinds = np.unique(both, axis=0, return_inverse=True)
    kinds, back = kinds.ravel().astype(np.int32).reshape(2, -1)
    return Features(ideal.astype(np.float32), kinds, back, (placed.width - 1) / 2 if slits else placed.width - 0.5)


def unmixing(photometry: Any) -> npt.NDArray[np.float32]:
    """Return the matrix (3, 3) that takes seen colours, as rows, to projected ones; that of one for photometry None.

    photometry: see `slkit.calibration.photometry`. Errors: InputError where its mixing is absent or has no inverse.
    """
    if photometry is None:
        return np.eye(3, dtype=np.float32)
    try:
        mixing = np.asarray(photometry["mixing"], dtype=np.float64).reshape(3, 3)
        return np.ascontiguousarray(np.linalg.inv(mixing).T, dtype=np.float32)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError("photometry must have an invertible 3 x 3 matrix called mixing") from error
