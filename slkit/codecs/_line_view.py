"""Pictures of lines, turned so that the lines cross the rows, and what the coarse code tells of the lines there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from slkit.codecs._footprint import SAMPLING, STEEPEST, VARIANCE, VARIANCE_DOUBT, around
from slkit.codecs._gray_code import probability
from slkit.codecs._masks import Levels, Light
from slkit.codecs._peaks import Peaks, agreeing, fill_between, pace, runs_along_rows, sample_row, slope_along_rows
from slkit.codecs._rows import over_rows
from slkit.data import Float32s

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
_T = TypeVar("_T", bound=np.generic)

# What blurs a line beyond its own width, as a variance in px: one pixel's area and a lens in focus.
_BLUR_VARIANCE = 0.4
# A wider kernel would reach the next line of the same picture.
_LARGEST_SCALE = 0.25
# Lines closer than this many px cannot be told apart in a picture of whole pixels; below the comfortable spacing
# sampling pulls their centres to the pixel grid, growing as the cube of the crowding (simulated, 0.6 px of blur).
_LEAST_SPACING, _COMFORTABLE_SPACING = 2.5, 5.0
_SLOPE_CELLS = 3
_RADII = 4, 40


@dataclass(frozen=True, eq=False)
class Coarse:
    """A coarse projector position in px, where it is known, and its margin in sigmas, (h, w) each."""

    value: Float32s
    known: Mask
    margin: Float32s


@dataclass(frozen=True, eq=False)
class View:
    """The maps of a scene (h, w), turned (rows for columns) where `turned`, so that lines cross the picture's rows.

    coarse: known only where both neighbours in the row are lit too; slope: projector px a camera px along the row,
    NaN where unknown.
    """

    light: Light
    turned: bool
    coarse: Coarse
    slope: Float32s

    @classmethod
    def across(cls, coarse: Coarse, light: Light, period: float, cell: int) -> View:
        """Return the view whose rows the lines cross. period, cell: px; a jump of a period is an edge of the scene."""
        turned = not runs_along_rows(coarse.value, coarse.known, period)
        if turned:
            light = Light(_turn(light.black), _turn(light.white), light.curve, _turn(light.mask))
            coarse = Coarse(_turn(coarse.value), _turn(coarse.known), _turn(coarse.margin))
        step = np.abs(np.diff(coarse.value, axis=1))[coarse.known[:, 1:] & coarse.known[:, :-1]]
        mean = float(step[step < period].mean()) if step.size else 1.0
        radius = int(np.clip(np.ceil(_SLOPE_CELLS * cell / max(mean, 1e-6)), *_RADII))
        slope = slope_along_rows(coarse.value, coarse.known, period, radius)
        # Beside an unlit pixel the normalised picture is cut off, and a centre there is biased.
        inside = cv2.erode(light.mask.astype(np.uint8), np.ones((1, 3), np.uint8), borderValue=0) > 0
        return cls(light, turned, Coarse(coarse.value, coarse.known & inside, coarse.margin), slope)

    def normalized(self, picture: Levels) -> tuple[Float32s, Float32s]:
        """Return a camera picture as a share of white - black, 0 where unlit, and its noise, (h, w) each, turned."""
        from slkit.codecs._peak_kernels import normalize_rows

        light, picture = self.light, self.turn(picture)
        share, noise = (np.empty(picture.shape, dtype=np.float32) for _ in range(2))

        def work(first: int, last: int) -> None:
            part = slice(first, last)
            told = picture[part], light.white[part], light.black[part], light.mask[part]
            normalize_rows(*told, light.curve.numbers, share[part], noise[part])

        over_rows(work, len(picture))
        return share, noise

    def turn(self, array: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """Return a map (h, w) of the camera picture as this view sees it."""
        return _turn(array) if self.turned else array

    @property
    def stretch(self) -> Float32s:
        """Camera px a projector px along the row, (h, w), NaN where unknown."""
        return (1 / np.maximum(np.abs(self.slope), 1e-3)).astype(np.float32)

    def line_scale(self, width: int, period: int) -> Float32s:
        """Return the sigma in px of a line `width` projector px wide, (h, w), NaN where lines cannot be found."""
        spacing = period * self.stretch
        scale = np.sqrt((width * self.stretch) ** 2 / 12 + np.float32(_BLUR_VARIANCE))
        scale = np.minimum(scale, _LARGEST_SCALE * spacing)
        return np.where(spacing >= _LEAST_SPACING, scale, np.nan).astype(np.float32)

    def centered(self, peaks: Peaks, period: float) -> Peaks:
        """Return the peaks, `period` px of value apart, moved to where they would be on a scene of even brightness.

        A pixel sees a patch of the scene whose centre of light lies towards the brighter side, so that lines appear
        to lie towards the darker one; white - black is seen through the same patch, and dividing by it does not help.
        """
        gradient = np.gradient(np.log(self.light.span), axis=1).astype(np.float32)
        brighter = np.clip(sample_row(gradient, peaks.row, peaks.col), -STEEPEST, STEEPEST)
        spacing = period * self.stretch[peaks.row, peaks.nearest]
        sampling = SAMPLING * np.maximum(_COMFORTABLE_SPACING / spacing, 1) ** 3
        doubt = VARIANCE_DOUBT * np.minimum(sample_row(around(gradient), peaks.row, peaks.col), STEEPEST)
        sigma = np.sqrt(peaks.sigma_col**2 + doubt**2 + sampling**2)
        return replace(peaks, col=peaks.col + VARIANCE * brighter, sigma_col=sigma)

    def consistent(self, peaks: Peaks, period: float) -> AxisPeaks:
        """Return the peaks that fit their neighbours, with sigma carried over to the projector by the local slope."""
        slope = self.slope[peaks.row, peaks.nearest].astype(np.float64)
        keep = agreeing(peaks, slope, period / 2)
        peaks, slope = peaks.select(keep), slope[keep]
        sigma = peaks.sigma_col * np.abs(pace(peaks, slope, period / 2))
        margin = np.minimum(self.coarse.margin[peaks.row, peaks.nearest], peaks.contrast / peaks.noise)
        confidence = probability(margin.astype(np.float32))
        return AxisPeaks(peaks, sigma, confidence, self.turned, period / 2)


@dataclass(frozen=True, eq=False)
class AxisPeaks:
    """The line centres of one projector axis. sigma (m,): of the position in projector px; confidence (m,).

    turned: rows and columns of the peaks are exchanged; reach: px of value up to which neighbours belong together.
    """

    peaks: Peaks
    sigma: Floats
    confidence: Float32s
    turned: bool
    reach: float

    @property
    def camera_xy(self) -> Floats:
        """Where the centres lie in the camera picture, (m, 2) px."""
        xy = self.peaks.col, self.peaks.row
        return np.stack(xy[::-1] if self.turned else xy, axis=1).astype(np.float64)

    def at(self, camera_xy: Floats, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
        """Return value and sigma in px at camera positions (m, 2) px of a picture (h, w); NaN between no two lines.

        Interpolated along the picture rows (columns, where turned) between neighbouring lines, then across them.
        """
        h, w = shape[:2]
        value, sigma = fill_between(self.peaks, self.sigma, (w, h) if self.turned else (h, w), self.reach)
        if self.turned:
            value, sigma = value.T, sigma.T
        found = [_bilinear(a, camera_xy) for a in (value, sigma)]
        return found[0], found[1]


def _turn(array: npt.NDArray[_T]) -> npt.NDArray[_T]:
    return np.ascontiguousarray(array.T)


def _bilinear(picture: Float32s, xy: Floats) -> Floats:
    h, w = picture.shape
    col, row = np.clip(xy[:, 0], 0, w - 1), np.clip(xy[:, 1], 0, h - 1)
    left, top = np.floor(col).astype(np.intp), np.floor(row).astype(np.intp)
    right, bottom = np.ceil(col).astype(np.intp), np.ceil(row).astype(np.intp)
    a, b = col - left, row - top
    upper = (1 - a) * picture[top, left] + a * picture[top, right]
    lower = (1 - a) * picture[bottom, left] + a * picture[bottom, right]
    return (1 - b) * upper + b * lower
