"""Pictures of lines, turned so that the lines cross the rows, and what the coarse code tells of the lines there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from slkit.codecs._footprint import COMFORTABLE_SPACING, SAMPLING, STEEPEST, VARIANCE, VARIANCE_DOUBT, around
from slkit.codecs._line_scales import FLATTEST
from slkit.codecs._masks import Light
from slkit.codecs._noise import probability
from slkit.codecs._peaks import Peaks, agreeing, fill_between, mean_changes, pace, sample_row, slope_along_rows
from slkit.data import Float32s

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
_T = TypeVar("_T", bound=np.generic)

_SLOPE_CELLS = 3
_RADII = 4, 40
_LEAST_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Coarse:
    """A coarse projector position in px, where it is known, and the square of its margin in sigmas, (h, w) each."""

    value: Float32s
    known: Mask
    square: Float32s


@dataclass(frozen=True, eq=False)
class View:
    """The maps of a scene (h, w), turned (rows for columns) where `turned`, so that lines cross the picture's rows.

    jump: px of value from one pixel to the next that is an edge of the scene; radius: half the width in px of the
    window over which slopes are averaged.
    """

    light: Light
    turned: bool
    coarse: Coarse
    jump: float
    radius: int

    @classmethod
    def across(cls, coarse: Coarse, light: Light, period: float, cell: int) -> View:
        """Return the view whose rows the lines cross. period, cell: px; a jump of a period is an edge of the scene."""
        along, down = mean_changes(coarse.value, coarse.known, period)
        turned = along < down
        if turned:
            light = Light(_turn(light.black), _turn(light.white), light.curve, _turn(light.mask))
            coarse = Coarse(_turn(coarse.value), _turn(coarse.known), _turn(coarse.square))
        step = max(along, down, _LEAST_STEP)
        return cls(light, turned, coarse, period, int(np.clip(np.ceil(_SLOPE_CELLS * cell / step), *_RADII)))

    @cached_property
    def slope(self) -> Float32s:
        """Projector px a camera px along the row, (h, w), NaN where unknown."""
        return slope_along_rows(self.coarse.value, self.coarse.known, self.jump, self.radius)

    @property
    def known(self) -> Mask:
        """Where the coarse position is known and both neighbours in the row are lit, too, (h, w).

        Beside an unlit pixel the normalised picture is cut off, and a centre there is biased.
        """
        inside = cv2.erode(self.light.mask.view(np.uint8), np.ones((1, 3), np.uint8), borderValue=0)
        return self.coarse.known & inside.astype(np.bool_)

    def turn(self, array: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """Return a map (h, w) of the camera picture as this view sees it."""
        return _turn(array) if self.turned else array

    def centered(self, peaks: Peaks, period: float) -> Peaks:
        """Return the peaks, `period` px of value apart, moved to where they would be on a scene of even brightness.

        A pixel sees a patch of the scene whose centre of light lies towards the brighter side, so that lines appear
        to lie towards the darker one; white - black is seen through the same patch, and dividing by it does not help.
        """
        if not len(peaks):
            return peaks  # a picture may be too small to have a gradient
        gradient = np.gradient(np.log(self.light.span), axis=1).astype(np.float32)
        brighter = np.clip(sample_row(gradient, peaks.row, peaks.col), -STEEPEST, STEEPEST)
        moved = replace(peaks, col=peaks.col + VARIANCE * brighter)
        # A line whose new place has no slope is left out later; its old place need not have one.
        spacing = period / np.maximum(np.abs(self.slope[peaks.row, moved.nearest]), FLATTEST)
        sampling = SAMPLING * np.maximum(COMFORTABLE_SPACING / spacing, 1) ** 3
        doubt = VARIANCE_DOUBT * np.minimum(sample_row(around(gradient), peaks.row, peaks.col), STEEPEST)
        sigma = np.sqrt(peaks.sigma_col**2 + doubt**2 + sampling**2)
        return replace(moved, sigma_col=sigma)

    def consistent(self, peaks: Peaks, period: float) -> AxisPeaks:
        """Return the peaks that fit their neighbours, with sigma carried over to the projector by the local slope."""
        slope = self.slope[peaks.row, peaks.nearest].astype(np.float64)
        keep = agreeing(peaks, slope, period / 2)
        peaks, slope = peaks.select(keep), slope[keep]
        sigma = peaks.sigma_col * np.abs(pace(peaks, slope, period / 2))
        square = np.minimum(self.coarse.square[peaks.row, peaks.nearest], (peaks.contrast / peaks.noise) ** 2)
        confidence = probability(square.astype(np.float32))
        return AxisPeaks(peaks.row, peaks.col, peaks.value, sigma, confidence, self.turned, period / 2)


@dataclass(frozen=True, eq=False)
class AxisPeaks:
    """The line centres of one projector axis, (m,) each: picture row and sub-pixel column, projector position in px.

    sigma: of the position, 1 sigma in projector px; confidence: the probability that it is right. turned: rows and
    columns of the picture are exchanged; reach: px of value up to which neighbours belong together.
    """

    row: npt.NDArray[np.intp]
    col: Floats
    value: Floats
    sigma: npt.NDArray[np.floating[Any]]
    confidence: Float32s
    turned: bool
    reach: float

    @property
    def camera_xy(self) -> Floats:
        """Where the centres lie in the camera picture, (m, 2) px."""
        xy = self.col, self.row
        return np.stack(xy[::-1] if self.turned else xy, axis=1).astype(np.float64)

    def at(self, camera_xy: npt.NDArray[np.floating[Any]], shape: tuple[int, ...]) -> tuple[Floats, Floats]:
        """Return value and sigma in px at camera positions (m, 2) px of a picture (h, w); NaN between no two lines.

        Interpolated along the picture rows (columns, where turned) between neighbouring lines, then across them.
        """
        h, w = shape[:2]
        lines = self.row, self.col, self.value, self.sigma
        value, sigma = fill_between(*lines, (w, h) if self.turned else (h, w), self.reach)
        if self.turned:
            value, sigma = value.T, sigma.T
        found = [_bilinear(a, camera_xy.astype(np.float64)) for a in (value, sigma)]
        return found[0], found[1]


def _turn(array: npt.NDArray[_T]) -> npt.NDArray[_T]:
    # OpenCV's turns blocks that fit the cache.
    plain: npt.NDArray[Any] = array.view(np.uint8) if array.dtype == np.bool_ else array
    turned = cv2.transpose(plain)
    return turned.view(array.dtype)


def _bilinear(picture: Float32s, xy: Floats) -> Floats:
    h, w = picture.shape
    col, row = np.clip(xy[:, 0], 0, w - 1), np.clip(xy[:, 1], 0, h - 1)
    left, top = np.floor(col).astype(np.intp), np.floor(row).astype(np.intp)
    right, bottom = np.ceil(col).astype(np.intp), np.ceil(row).astype(np.intp)
    a, b = col - left, row - top
    upper = (1 - a) * picture[top, left] + a * picture[top, right]
    lower = (1 - a) * picture[bottom, left] + a * picture[bottom, right]
    return (1 - b) * upper + b * lower
