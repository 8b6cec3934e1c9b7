"""Coloured slits in one picture: their centres along picture rows, and their colours."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Picture = npt.NDArray[Any]

# Gaussians of these sigmas in px are matched to slits; a narrower one would pull centres towards the pixel grid.
_SCALES = (0.9, 1.2, 1.6, 2.2, 3.0, 4.2, 6.0)
_REACH = 3.5
# Tops and valleys are told apart by a little less than what a slit must rise, for they are single pixels.
_STEP = 0.7
# What averaging three rows by 1 2 1 leaves of the noise's variance.
SMOOTHED = 6 / 16
# And what `_changes` makes of the rest.
CHANGED = 10 / 16


@numba.njit(cache=True, nogil=True)
def find_slits(
    picture: Picture,
    edges: bool,
    noise: Doubles,
    snr: float,
    share: float,
    row_of: Wholes,
    starts: Longs,
    table: Singles,
) -> int:
    """Find the bright slits that cross the rows of a picture (h, w, 3), and return how many there are.

    Rows are averaged with their neighbours by 1 2 1. edges: slits are where colours change along the row, and their
    colour is the change. noise (3,): variance of such a row in dark, its gain a level, the dark level. A slit rises
    above the valleys on both sides by more than `snr` times the noise and `share` of its own height over the dark
    level. row_of (k,), starts (h + 1,): where each row's slits begin; table (k, 15): column, sigma of it, contrast,
    width, left and right valley, then red, green, blue at the top, in the left and in the right valley. What does not
    fit into k rows is left out.
    """
    height, width = picture.shape[0], picture.shape[1]
    pixels = np.empty((width, 3), dtype=np.float32)
    changes = np.zeros((width, 3), dtype=np.float32)
    line = np.empty(width, dtype=np.float32)
    count = 0
    for row in range(height):
        starts[row] = count
        _smooth(picture[max(row - 1, 0)], picture[row], picture[min(row + 1, height - 1)], pixels)
        for i in range(width):
            line[i] = max(pixels[i, 0], pixels[i, 1], pixels[i, 2])
        if edges:
            _changes(pixels, changes, line)
            count = _row_slits(changes, line, noise, snr, share, row, row_of, table, count)
        else:
            count = _row_slits(pixels, line, noise, snr, share, row, row_of, table, count)
    starts[height] = count
    return count


@numba.njit(cache=True, nogil=True)
def _smooth(above: Picture, middle: Picture, below: Picture, pixels: Singles) -> None:
    """Write three rows (w, 3), weighted 1 2 1; flat, so that the loop runs in parallel lanes."""
    a, b, c, out = above.ravel(), middle.ravel(), below.ravel(), pixels.ravel()
    for i in range(len(out)):
        out[i] = (np.float32(a[i]) + 2 * np.float32(b[i]) + np.float32(c[i])) * np.float32(0.25)


@numba.njit(cache=True, nogil=True)
def _changes(pixels: Singles, changes: Singles, line: Singles) -> None:
    """Write how each channel of a row (w, 3) changes to the right, and the strongest change (w,)."""
    last = len(line) - 1
    for i in range(len(line)):
        for channel in range(3):
            far = pixels[min(i + 2, last), channel] - pixels[max(i - 2, 0), channel]
            near = pixels[min(i + 1, last), channel] - pixels[max(i - 1, 0), channel]
            changes[i, channel] = (far + 2 * near) * np.float32(0.25)
        line[i] = max(abs(changes[i, 0]), abs(changes[i, 1]), abs(changes[i, 2]))


@numba.njit(cache=True, nogil=True)
def _row_slits(
    pixels: Picture,
    line: Singles,
    noise: Doubles,
    snr: float,
    share: float,
    row: int,
    row_of: Wholes,
    table: Singles,
    count: int,
) -> int:
    """Walk along a row from valley to top to valley, and measure each top whose valleys lie deep enough."""
    width = len(line)
    low_at, high_at, before, rising = 0, 0, 0, False
    low, high = np.float32(np.inf), np.float32(-np.inf)
    # Most pixels are decided by the noise in dark: what a step must be at their level is worked out for the others.
    least = np.float32(_STEP * snr * np.sqrt(noise[0]))
    for i in range(1, width):
        last = i == width - 1
        value = line[i] if last else (line[i - 1] + 2 * line[i] + line[i + 1]) * np.float32(0.25)
        if rising:
            if value > high:
                high, high_at = value, i
            elif last or high - value > least:
                deep = high - value > _step(float(high), noise, snr, share)
                if deep and count < len(row_of):
                    end = _descend(line, i)
                    if _measure(pixels, line, noise, before, high_at, end, table[count]):
                        row_of[count] = row
                        count += 1
                if deep or last:
                    rising, low, low_at = False, value, i
        elif value < low:
            low, low_at = value, i
        elif value - low > least and value - low > _step(float(max(value, high)), noise, snr, share):
            rising, before, high, high_at = True, low_at, value, i
    return count


@numba.njit(cache=True, nogil=True, inline="always")
def _step(level: float, noise: Doubles, snr: float, share: float) -> float:
    """Return by how much a slit of that height rises above its valleys."""
    above = level - noise[2]
    return max(_STEP * snr * np.sqrt(noise[0] + noise[1] * max(above, 0.0)), share * above)


@numba.njit(cache=True, nogil=True, inline="always")
def _descend(line: Singles, i: int) -> int:
    """Return where a falling line stops falling."""
    while i < len(line) - 1 and line[i + 1] < line[i]:
        i += 1
    return i


@numba.njit(cache=True, nogil=True)
def _measure(
    pixels: Picture,
    line: Singles,
    noise: Doubles,
    left: int,
    top: int,
    right: int,
    out: Singles,
) -> bool:
    """Write what one slit between two valleys is; return whether it has a centre."""
    while left < top - 1 and line[left + 1] <= line[left]:
        left += 1
    base = (line[left] + line[right]) / 2
    half = (line[top] + base) / 2
    a, b = top, top
    while a > left and line[a - 1] > half:
        a -= 1
    while b < right and line[b + 1] > half:
        b += 1
    if a <= 0 or b >= len(line) - 1:
        return False
    start = a - (line[a] - half) / max(line[a] - line[a - 1], 1e-6)
    end = b + (line[b] - half) / max(line[b] - line[b + 1], 1e-6)
    level = 0
    while level < len(_SCALES) - 1 and _SCALES[level] * 2.6 < end - start:
        level += 1
    center, slope = _crossing(line, (start + end) / 2, _SCALES[level])
    if not (start - 0.5 < center < end + 0.5):
        return False
    variance = noise[0] + noise[1] * max(half - noise[2], 0)
    out[0] = center
    out[1] = np.sqrt(variance) / slope
    out[2] = line[top] - base
    out[3] = end - start
    out[4], out[5] = left, right
    near = int(np.rint(center))
    reach = 1 if end - start > 2.5 else 0
    for channel in range(3):
        total = np.float32(0)
        for i in range(max(near - reach, 0), min(near + reach + 1, len(line))):
            total += pixels[i, channel]
        out[6 + channel] = total / (2 * reach + 1)
        out[9 + channel], out[12 + channel] = pixels[left, channel], pixels[right, channel]
    return True


@numba.njit(cache=True, nogil=True)
def _crossing(line: Singles, start: float, scale: float) -> tuple[float, float]:
    """Return where the derivative of a line, smoothed by a Gaussian, falls through zero, and its steepness over noise.

    The second number turns the noise of a pixel into that of the centre: sigma_center = noise / number.
    Source: Blais and Rioux (1986) with a Gaussian derivative (Steger 1998); two Newton steps.
    """
    center = start
    width = len(line)
    steep = 1e-6
    for _ in range(2):
        middle = int(np.rint(center))
        reach = int(np.ceil(_REACH * scale))
        first = max(middle - reach, 0)
        last = min(middle + reach, width - 1)
        value, pace, gain = 0.0, 0.0, 0.0
        step = np.exp(-1.0 / (scale * scale))
        offset = first - center
        bell = np.exp(-offset * offset / (2 * scale * scale))
        ratio = np.exp(-(2 * offset + 1) / (2 * scale * scale))
        for i in range(first, last + 1):
            weight = offset * bell
            value += weight * line[i]
            pace += (offset * offset / (scale * scale) - 1) * bell * line[i]
            gain += weight * weight
            bell *= ratio
            ratio *= step
            offset += 1
        if pace >= 0:
            return np.nan, 1e-6
        move = value / pace
        center -= min(max(move, -1.0), 1.0)
        steep = -pace / np.sqrt(gain)
    return center, steep


@numba.njit(cache=True, nogil=True)
def light_above(starts: Longs, table: Singles, near: int, out: Singles) -> None:
    """Write what the projector gives each slit (m, 3): its colour above what is there without it.

    table: of `find_slits`. The floor of a channel is its lowest valley among the `near` next ones on either side, of
    the two sides the higher: between close slits the nearest valley is lit by both, and beyond an object's edge it is
    darker than the object. near 0: no floor.
    """
    for row in range(len(starts) - 1):
        first, last = starts[row], starts[row + 1]
        for i in range(first, last):
            for channel in range(3):
                left, right = table[i, 9 + channel], table[i, 12 + channel]
                for j in range(max(first, i - near + 1), i):
                    left = min(left, table[j, 9 + channel])
                for j in range(i + 1, min(last, i + near)):
                    right = min(right, table[j, 12 + channel])
                floor = max(left, right)
                top = table[i, 6 + channel]
                out[i, channel] = max(top - floor, np.float32(0)) if near > 0 else top
