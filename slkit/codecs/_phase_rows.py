"""From sets of fringes to the rows of a result: a few rows of all pictures pass through everything at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.codecs._footprint import VARIANCE
from slkit.codecs._gray_code import Mask
from slkit.codecs._results import Rows, grey_of, row_counts
from slkit.codecs._rows import over_large_blocks, over_rows
from slkit.codecs._unwrap import Ladder, Place, Scratch
from slkit.data import Correspondences, Float32s, Image
from slkit.errors import DecodeError

# A picture is worked out in bands of so many pixels, one after the other in the same memory. What a pixel's patch and
# those of its neighbours add needs so many rows more.
_BAND_PX, _HALO_PX = 3_000_000, 3


@dataclass(frozen=True, eq=False)
class Band:
    """What is found in some rows of a picture.

    position, sigma (axes, r, w): in px, position NaN where unknown; light (axes, r, w): ln(modulation); confidence
    (r, w): of all axes together; mask (r, w): where all are known.
    """

    position: Float32s
    sigma: Float32s
    light: Float32s
    confidence: Float32s
    mask: Mask

    @classmethod
    def blank(cls, axes: int, mask: Mask) -> Band:
        """Return room for a number of axes at the pixels of a mask."""
        # One piece of memory, because the system hands out a large one faster than several.
        maps = np.empty((3 * axes + 1, *mask.shape), dtype=np.float32)
        confidence: Float32s = maps[-1]
        return cls(maps[:axes], maps[axes : 2 * axes], maps[2 * axes : -1], confidence, np.empty_like(mask))

    def part(self, rows: slice) -> Band:
        """Return some of the rows."""
        maps = self.position[:, rows], self.sigma[:, rows], self.light[:, rows]
        return Band(*maps, self.confidence[rows], self.mask[rows])


def decode_rows(ladders: Mapping[int, Ladder], mask: Mask, lit: Image) -> Correspondences:
    """Return one correspondence for each pixel of mask (h, w) whose period every ladder can tell, at its centre.

    ladders: of each coded axis, 0 for x and 1 for y; lit (h, w) or (h, w, 3): where the colours come from. Errors:
    DecodeError where no period can be told anywhere.
    """
    height, width = mask.shape
    shown = grey_of(lit)
    beyond = [ladder.unforeseen(mask) for ladder in ladders.values()]
    out, done, step = Rows.room_for(row_counts(mask)[1]), 0, max(_BAND_PX // width, 1)
    memory = Band.blank(len(ladders), mask[: step + 2 * _HALO_PX])
    for top in range(0, height, step):
        bottom = min(top + step, height)
        rows = slice(max(top - _HALO_PX, 0), min(bottom + _HALO_PX, height))
        band = memory.part(slice(0, rows.stop - rows.start))
        _climb([ladder.part(partial(_rows_of, rows)) for ladder in ladders.values()], beyond, mask[rows], band)
        done += _write(ladders, band, (rows.start, top, bottom), shown, done, out)
    if not done:
        raise DecodeError("no period could be told anywhere: the sets of fringes contradict each other or the bounds")
    return out.correspondences(lit, done)


def _climb(ladders: Sequence[Ladder], beyond: Sequence[Sequence[float]], mask: Mask, band: Band) -> None:
    """Write what the ladders of some rows find at the pixels of mask (r, w)."""
    from slkit.codecs._period_kernels import blank_outside

    def block(rows: slice, scratch: list[Scratch]) -> None:
        here = band.part(rows)
        here.confidence[:], here.mask[:] = 1, mask[rows]
        for axis, ladder in enumerate(ladders):
            place = Place(here.position[axis], here.sigma[axis], here.confidence, mask[rows].copy())
            ladder.part(partial(_rows_of, rows)).climb(place, here.light[axis], scratch[axis], beyond[axis])
            np.log(here.light[axis], out=here.light[axis])
            blank_outside(place.mask, place.position)
            np.logical_and(here.mask, place.mask, out=here.mask)

    over_large_blocks(lambda rows: [ladder.scratch(rows, mask.shape[1]) for ladder in ladders], block, mask.shape)


def _write(
    ladders: Mapping[int, Ladder],
    band: Band,
    rows: tuple[int, int, int],
    shown: tuple[Image, float],
    done: int,
    out: Rows,
) -> int:
    """Write rows of a picture, after `done` rows of a result, and return how many pixels they have.

    rows: where the band begins in the picture, and the first and the last that are written; shown: grey
    picture (h, w) and the brightest level.
    The shift of a pixel that sees a patch (`displacement`) is not taken off, as it is noisier than the phase itself;
    sigma allows for it.
    """
    from slkit.codecs._patch_kernels import write_doubted
    from slkit.codecs._run_kernels import write_seen, write_values

    row0, top, bottom = rows
    starts, total = row_counts(band.mask[top - row0 : bottom - row0])
    starts += done
    grey, brightest = shown

    def work(first: int, last: int) -> None:
        here, there, at = slice(first + top - row0, last + top - row0), first + top, starts[first:last]
        write_seen(there, band.mask[here], grey[there : last + top], brightest, at, out.camera_xy, out.grey)
        write_values(band.mask[here], band.confidence[here], at, out.confidence)
        for index, (axis, ladder) in enumerate(ladders.items()):
            maps = band.mask, band.position[index], band.sigma[index], band.light[index]
            jump = ladder.sets[-1].pitch / 2
            told = axis, len(ladders) == 1, at, out.projector_xy, out.sigma
            write_doubted(here.start, here.stop, *maps, jump, VARIANCE, *told)

    over_rows(work, len(starts))
    return total


def _rows_of(rows: slice, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return pixels[rows]
