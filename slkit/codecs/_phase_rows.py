"""From sets of fringes to the rows of a result: a few rows of all pictures pass through everything at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slkit.codecs._footprint import VARIANCE
from slkit.codecs._gray_code import Mask
from slkit.codecs._masks import colors_at
from slkit.codecs._rows import over_large_blocks, over_rows
from slkit.codecs._unwrap import Ladder, Place, Scratch, row_counts
from slkit.data import Correspondences, Float32s, Image
from slkit.errors import DecodeError


@dataclass(frozen=True, eq=False)
class AxisMaps:
    """What is found on one axis: position, sigma (h, w) px, NaN where unknown; light (h, w): ln(modulation); jump.

    jump: px of position from one camera pixel to the next that is an edge of the scene.
    """

    position: Float32s
    sigma: Float32s
    light: Float32s
    jump: float


def climb_all(ladders: Sequence[Ladder], mask: Mask) -> tuple[list[AxisMaps], Float32s, Mask]:
    """Return the maps of each ladder's axis, the confidence (h, w) of all together, and where (h, w) all are known.

    Errors: DecodeError where nothing is.
    """
    from slkit.codecs._period_kernels import blank_outside

    beyond = [ladder.unforeseen(mask) for ladder in ladders]
    # One piece of memory, because the system hands out a large one faster than several.
    confidence, *rest = np.empty((1 + 3 * len(ladders), *mask.shape), dtype=np.float32)
    maps = [AxisMaps(*rest[3 * i : 3 * i + 3], ladder.sets[-1].pitch / 2) for i, ladder in enumerate(ladders)]
    known = mask.copy()

    def block(rows: slice, scratch: list[Scratch]) -> None:
        confidence[rows] = 1
        for ladder, found, more, aside in zip(ladders, maps, beyond, scratch, strict=True):
            light = found.light[rows]
            place = Place(found.position[rows], found.sigma[rows], confidence[rows], mask[rows].copy())
            ladder.part(lambda pixels: pixels[rows]).climb(place, light, aside, more)
            np.log(light, out=light)
            blank_outside(place.mask, place.position)
            known[rows] &= place.mask

    over_large_blocks(lambda rows: [ladder.scratch(rows, mask.shape[1]) for ladder in ladders], block, mask.shape)
    if not known.any():
        raise DecodeError("no period could be told anywhere: the sets of fringes contradict each other or the bounds")
    return maps, confidence, known


def correspondences(maps: Mapping[int, AxisMaps], confidence: Float32s, mask: Mask, lit: Image) -> Correspondences:
    """Return one correspondence for each pixel of mask (h, w), at the pixel's centre.

    maps: of each coded axis, 0 for x and 1 for y; confidence (h, w); lit (h, w) or (h, w, 3): where the colours come
    from. The shift of a pixel that sees a patch (`displacement`) is not taken off, as it is noisier than the phase
    itself; sigma allows for it.
    """
    from slkit.codecs._patch_kernels import write_axis
    from slkit.codecs._wave_kernels import write_seen

    starts, total = row_counts(mask)
    # In one piece of memory, as above.
    camera_xy, value, spread, chance, color = _pieces(total, (2, 2, 2, 1, 3))
    chance = chance[:, 0]
    grey, brightest = (lit if lit.ndim == 2 else lit[..., 0]), float(max(int(lit.max()), 1))

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        write_seen(first, mask[part], confidence[part], grey[part], brightest, starts[part], camera_xy, chance, color)
        for axis, found in maps.items():
            told = found.position, found.sigma, found.light, found.jump, VARIANCE
            write_axis(first, last, mask, *told, axis, len(maps) == 1, starts, value, spread)

    over_rows(work, len(mask))
    return Correspondences(camera_xy, value, spread, chance, color if lit.ndim == 2 else colors_at(lit, camera_xy))


def _pieces(rows: int, widths: Sequence[int]) -> list[Float32s]:
    """Return arrays (rows, width) of one piece of memory."""
    ends = rows * np.cumsum(widths)
    return [part.reshape(rows, -1) for part in np.split(np.empty(ends[-1], dtype=np.float32), ends[:-1])]
