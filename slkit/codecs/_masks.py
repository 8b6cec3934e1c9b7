"""What every codec asks of its frames first: how many, how bright, how noisy, where lit.

Nothing here knows a grey level: contrast is judged against the noise that the pictures themselves show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._noise import NoiseCurve, noise_curve
from slkit.codecs._rows import over_rows
from slkit.codecs._tiles import sampled
from slkit.data import Float32s, Frames, Image, check_image, describe_image
from slkit.errors import DecodeError, InputError

_LEAST_NEIGHBOURS = 6
_SENSOR_BITS = (10, 12, 14)

Levels = npt.NDArray[Any]
"""Grey levels (h, w): uint8, uint16 or float32."""


class Reader:
    """Reads each frame of a set once, in any order, and refuses one that does not fit the first."""

    def __init__(self, frames: Frames, expected: Sequence[str]) -> None:
        """Errors: InputError where the number of frames is not that of the patterns `expected`, by name."""
        if len(frames) != len(expected):
            verb = "is" if len(frames) == 1 else "are"
            raise InputError(
                f"{len(expected)} frames are needed ({expected[0]} to {expected[-1]}), but there {verb} {len(frames)}"
            )
        self._frames = frames
        self._first: tuple[str, Image] | None = None

    def color(self, index: int) -> Image:
        """Return frame `index` as it is, (h, w) or (h, w, 3).

        Errors: InputError naming the frame where it is no picture, or of another size or depth than the first.
        """
        image, name = self._frames[index], self._frames.names[index]
        check_image(image, name)
        if self._first is None:
            self._first = name, image
        first_name, first = self._first
        if image.shape != first.shape or image.dtype != first.dtype:
            raise InputError(f"frame {name} is {describe_image(image)}, but {first_name} is {describe_image(first)}")
        return image

    def levels(self, index: int) -> Levels:
        """Return frame `index` as grey levels (h, w), as they are stored. Errors: as `color`."""
        return levels(self.color(index))

    def grey(self, index: int) -> Float32s:
        """Return frame `index` as grey levels (h, w). Errors: as `color`."""
        return grey(self.color(index))


@dataclass(frozen=True, eq=False)
class Light:
    """The range of grey levels a scene spans, and where it can be decoded.

    black, white (h, w): dark and fully lit picture in grey levels, as they are stored; curve: the noise of one frame at
    each grey level; mask (h, w): lit well enough and not saturated.
    """

    black: Levels
    white: Levels
    curve: NoiseCurve
    mask: npt.NDArray[np.bool_]

    @cached_property
    def low(self) -> Float32s:
        """The dark picture in grey levels (h, w)."""
        return self.black.astype(np.float32, copy=False)

    @cached_property
    def high(self) -> Float32s:
        """The fully lit picture in grey levels (h, w)."""
        return self.white.astype(np.float32, copy=False)

    @property
    def span(self) -> Float32s:
        """The difference high - low in grey levels, (h, w), never below one level."""
        return np.maximum(self.high - self.low, np.float32(1))

    def noise(self, level: Float32s) -> Float32s:
        """Return the noise of one frame, 1 sigma in grey levels, expected at a grey level (...)."""
        return self.curve.at(level)


def measure_light(white: Image, black: Image, min_snr: float) -> Light:
    """Return the light of a scene from its white and black reference pictures.

    A pixel is used where white - black exceeds `min_snr` times the noise of that difference, white is not saturated,
    and the same holds around it. Errors: DecodeError where that leaves no pixel.
    """
    from slkit.codecs._cell_kernels import light_rows

    high, low = levels(white), levels(black)
    saturated = saturation(white)
    curve = noise_curve([sampled(high, saturated), sampled(low, saturation(black))])
    lit = np.empty(high.shape, dtype=np.bool_)

    def work(first: int, last: int) -> None:
        rows = slice(first, last)
        light_rows(high[rows], low[rows], saturated[rows], curve.numbers, min_snr, lit[rows])

    over_rows(work, len(lit))
    mask = without_rim(lit)
    refuse_empty(mask, lit, saturated)
    return Light(low, high, curve, mask)


def without_rim(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return a mask (h, w) without the pixels at its border: those with more than two of eight neighbours outside.

    The lens spreads light a pixel beyond what the projector lights, and over the outline of an object: such a pixel
    reports its neighbour's position. Single holes do not grow, and the picture's own border is none.
    """
    from slkit.codecs._cell_kernels import keep_inner

    kept = np.empty(mask.shape, dtype=np.bool_)
    over_rows(lambda first, last: keep_inner(mask, _LEAST_NEIGHBOURS, first, kept[first:last]), len(mask))
    return kept


def refuse_empty(mask: npt.NDArray[np.bool_], lit: npt.NDArray[np.bool_], saturated: npt.NDArray[np.bool_]) -> None:
    """Refuse a set in which nothing can be decoded. Errors: DecodeError that says whether light or contrast lacks."""
    if mask.any():
        return
    if saturated.any() and saturated.sum() >= lit.sum():
        raise DecodeError("the fully lit picture is saturated: shorten the exposure or dim the projector")
    raise DecodeError(
        "no pixel is lit well above the noise: the patterns were not projected, or the exposure is too short"
    )


def levels(image: Image) -> Levels:
    """Return a picture's grey levels (h, w) as they are stored: colour as float32, by the mean of its channels."""
    return image if image.ndim == 2 else grey(image)


def grey(image: Image) -> Float32s:
    """Return a picture as float32 grey levels (h, w): colour by the mean of its channels."""
    if image.ndim == 2:
        return image.astype(np.float32)
    from slkit.codecs._grey_kernels import mean_rows

    found = np.empty(image.shape[:2], dtype=np.float32)
    over_rows(lambda first, last: mean_rows(image[first:last], found[first:last]), len(found))
    return found


def saturation(image: Image) -> npt.NDArray[np.bool_]:
    """Return the mask (h, w) of pixels at full scale in any channel.

    Full scale is that of the type, or of 10, 12 or 14 bits, at the low or the high end of the word, where a 16-bit
    picture tops out exactly there.
    """
    top = int(image.max())
    full = int(np.iinfo(image.dtype).max)
    sensors = [(2**bits - 1) << shift for bits in _SENSOR_BITS for shift in (0, 16 - bits)]
    if image.dtype == np.uint16 and top in sensors:
        full = top
    at_top = image >= full
    return at_top if image.ndim == 2 else np.any(at_top, axis=2)
