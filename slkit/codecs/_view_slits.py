"""The slits of one picture: where they are, what colour they have, and how they go on from row to row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_kernels import largest
from slkit.codecs._noise import Evidence, noise_curve
from slkit.codecs._slit_kernels import CHANGED, SMOOTHED, find_slits, light_above
from slkit.codecs._track_kernels import along_tracks, link_slits
from slkit.data import Image

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]

# Slits of neighbouring rows belong together at most so many px and so much of the strongest channel apart.
_REACH, _APART = 1.5, 0.65
# A slit's neighbours along the track count by this power of their distance in rows.
_KEEP = 0.8
_FLOOR_SLITS = 3
# Noise is measured in one of so many rows: enough of it, at a fraction of the time.
_NOISE_ROWS = 24


@dataclass(frozen=True, eq=False)
class Slits:
    """The slits that cross the rows of a picture, by row and column; m of them in h rows.

    starts (h + 1,): where each row begins; row, col (m,) px, sub-pixel columns with sigma_col; width (m,) px at half
    height; contrast (m,): height above the valleys, grey levels; light (m, 3): colour above what is there without the
    slit, averaged along its track; noise (m,): its 1 sigma; track (m,): number of the track; previous (m,): the slit
    before it on the track, -1 at its start.
    """

    starts: npt.NDArray[np.int64]
    row: Wholes
    col: Singles
    sigma_col: Singles
    width: Singles
    contrast: Singles
    light: Singles
    noise: Singles
    track: Wholes
    previous: Wholes

    def __len__(self) -> int:
        return len(self.row)

    @property
    def spacing(self) -> float:
        """The usual distance in px from a slit to the next one in its row."""
        gaps = np.diff(self.col)[np.diff(self.row) == 0]
        return float(np.median(gaps)) if len(gaps) else 1.0

    def xy(self, turned: bool) -> Singles:
        """Return where the slits are, (m, 2) px; turned: in a picture of which this one is the transpose."""
        xy = np.stack([self.col, self.row], axis=1).astype(np.float32)
        return np.ascontiguousarray(xy[:, ::-1]) if turned else xy


def along_columns(picture: Image | Singles) -> bool:
    """Tell whether the stripes of a picture (h, w, 3) run along its rows rather than its columns."""
    down, right = (a.astype(np.float32) for a in (picture[:, ::8, 1], picture[::8, :, 1]))
    return float(np.abs(np.diff(down, axis=0)).mean()) > float(np.abs(np.diff(right, axis=1)).mean())


def see_slits(picture: Image | Singles, edges: bool, min_snr: float, min_contrast: float) -> Slits:
    """Return the slits of a picture (h, w, 3), or with `edges` the borders between stripes of different colours.

    min_snr: contrast over noise; min_contrast: contrast as a share of the height.
    """
    height, width = picture.shape[:2]
    noise = _noise(picture, edges)
    most = height * (width // 3 + 1)
    row, starts, table = np.empty(most, np.int32), np.zeros(height + 1, np.int64), np.empty((most, 15), np.float32)
    count = find_slits(picture, edges, noise, min_snr, min_contrast, row, starts, table)
    row, table = row[:count].copy(), table[:count].copy()
    light = np.empty((count, 3), np.float32)
    light_above(starts, table, 0 if edges else _FLOOR_SLITS, light)
    strongest: Singles = np.maximum(largest(np.abs(light)), np.float32(1e-6), dtype=np.float32)
    col = np.ascontiguousarray(table[:, 0])
    track, previous = np.empty(count, np.int32), np.empty(count, np.int32)
    link_slits(starts, col, light / strongest[:, None], _REACH, _APART, track, previous)
    light = along_tracks(light, previous, _KEEP)
    spread = np.sqrt(noise[0] + noise[1] * largest(np.abs(light))).astype(np.float32)
    return Slits(starts, row, col, table[:, 1], table[:, 3], table[:, 2], light, spread, track, previous)


def _noise(picture: Image | Singles, edges: bool) -> npt.NDArray[np.float64]:
    """Return variance in dark, its gain a level, and the dark level of what `find_slits` looks at."""
    bands = [picture[i : i + 3, :, 1] for i in range(0, max(picture.shape[0] - 2, 1), _NOISE_ROWS)]
    level = np.concatenate(bands, axis=1).astype(np.float32)
    curve = noise_curve([Evidence(level, level, np.ones(level.shape, dtype=np.bool_))])
    if edges:
        usual = level.mean(keepdims=True)
        return np.array([CHANGED * SMOOTHED * float(curve.at(usual)[0, 0]) ** 2, 0.0, 0.0])
    return np.array([SMOOTHED * curve.least, SMOOTHED * curve.gain, curve.dark])
