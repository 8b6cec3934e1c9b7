"""The phase of coloured fringes at every pixel of a row, by a Fourier transform in a window that fits the fringe."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Wholes = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]

_TURN = 2 * np.pi
# The window is a Gaussian of this sigma in periods, cut off at so many of them.
_WINDOW, _CUT = 0.3, 2.5
_WIDEST_PX = 80
# A fringe goes on so many periods beyond the last slit of its surface, at most half way to the next one.
_BEYOND = 0.75
# It ends where there is not such a share of the light of a raised cosine, give or take, or so much more light. Below
# the last number, all as shares of the light of the slit, the raised cosine is dark.
_DIMMEST, _SLACK, _BRIGHTEST, _DARK = 0.3, 0.05, 1.0, 0.2
# Slits of a row are of one surface if their distance is that of their widths, give or take, and at most one is missing.
_EVEN, _STEPS = 1.8, 2
# Nothing here is ever NaN: sums over the window run in parallel lanes.
_LANES = {"nnan", "nsz", "reassoc", "contract", "arcp"}


@numba.njit(cache=True, nogil=True)
def measure_phase(
    picture: npt.NDArray[Any],
    starts: Longs,
    col: Singles,
    width: Singles,
    label: Wholes,
    light: Singles,
    white: Singles,
    kinds: Wholes,
    ideal: Singles,
    unmixing: Singles,
    sign: int,
    row_of: Wholes,
    col_of: Wholes,
    table: Singles,
) -> int:
    """Measure the phase of every pixel between labelled slits, and return how many there are.

    picture (h, w, 3); starts (h + 1,), col, width, label (m,), light, white (m, 3): slits, their labels, colours and
    what white would give, unmixed; kinds (n,), ideal (k, 3): the fringes' colours; unmixing (3, 3): from seen to
    projected, rows times it; sign: +1 where labels rise along rows. row_of, col_of (p,): the pixels; table (p, 9):
    place in fringes, the carrier's place, modulation and level of the fringe as shares of its slit's light, misfit and
    the pixel's own deviation in the same, factor from the noise of a pixel to that of the phase, light of a foreign
    colour, the slit it belongs to.
    """
    wide = picture.shape[1]
    nodes, run = np.empty(wide + 1, dtype=np.int64), np.empty(wide, dtype=np.int64)
    place, period, value, foreign, cosine, sine = np.empty((6, wide), dtype=np.float32)
    slit = np.empty(wide, dtype=np.int64)
    count = 0
    for row in range(picture.shape[0]):
        run[:] = -1
        at, end = starts[row], starts[row + 1]
        while at < end:
            if label[at] < 0:
                at += 1
                continue
            found = _surface(at, end, col, width, label, sign, nodes)
            low, high = _lay(nodes[:found], starts[row], end, col, width, label, sign, place, period, slit, wide)
            for i in range(low, high + 1):
                number = sign * int(np.floor(place[i] + 0.5))
                if 0 <= number < len(kinds):
                    j = slit[i]
                    own = light[j] if label[j] == number else white[j] * ideal[kinds[number]]
                    value[i], foreign[i] = _share(picture[row, i], unmixing, own, white[j])
                    cosine[i], sine[i] = np.cos(_TURN * place[i]), np.sin(_TURN * place[i])
                    run[i] = at
            _end(int(np.ceil(col[nodes[0]])), low, place, value, run)
            _end(int(np.floor(col[nodes[found - 1]])), high, place, value, run)
            at = nodes[found - 1] + 1
        for i in range(wide):
            if run[i] >= 0 and _fit(i, run, period[i], value, cosine, sine, table[count]):
                table[count, 0] = sign * (place[i] + table[count, 0])
                table[count, 1] = sign * place[i]
                table[count, 7], table[count, 8] = foreign[i], slit[i]
                row_of[count], col_of[count] = row, i
                count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _surface(at: int, end: int, col: Singles, width: Singles, label: Wholes, sign: int, nodes: Longs) -> int:
    """Write the slits from `at` on that follow each other on one surface, and return how many; `end`: of the row."""
    nodes[0] = at
    found, last = 1, at
    for i in range(at + 1, end):
        if label[i] < 0:
            continue
        step = sign * (label[i] - label[last])
        even = (col[i] - col[last]) / (max(step, 1) * (width[i] + width[last]))
        if not 1 <= step <= _STEPS or not 1 / _EVEN < even < _EVEN or (step == 1 and i > last + 1):
            break
        nodes[found] = i
        found, last = found + 1, i
    return found


@numba.njit(cache=True, nogil=True)
def _lay(
    nodes: Longs,
    first: int,
    end: int,
    col: Singles,
    width: Singles,
    label: Wholes,
    sign: int,
    place: Singles,
    period: Singles,
    slit: Longs,
    wide: int,
) -> tuple[int, int]:
    """Write the carrier along the slits `nodes` of a surface, and return the first and the last pixel of it.

    place (w,): sign times the label, interpolated between slits; period (w,) px; slit (w,): the nearest one.
    """
    a, b = nodes[0], nodes[-1]
    before, behind = 2 * width[a], 2 * width[b]
    if len(nodes) > 1:
        before = (col[nodes[1]] - col[a]) / abs(label[nodes[1]] - label[a])
        behind = (col[b] - col[nodes[-2]]) / abs(label[b] - label[nodes[-2]])
    left, right = _BEYOND * before, _BEYOND * behind
    left = min(left, (col[a] - col[a - 1]) / 2) if a > first else left
    right = min(right, (col[b + 1] - col[b]) / 2) if b + 1 < end else right
    low, high = max(int(np.ceil(col[a] - left)), 0), min(int(np.floor(col[b] + right)), wide - 1)
    k = 0
    for i in range(low, high + 1):
        while k < len(nodes) - 1 and i > col[nodes[k + 1]]:
            k += 1
        j = nodes[k]
        if i < col[a]:
            period[i] = before
        elif k == len(nodes) - 1:
            period[i] = behind
        else:
            period[i] = (col[nodes[k + 1]] - col[j]) / abs(label[nodes[k + 1]] - label[j])
        place[i] = sign * label[j] + (i - col[j]) / period[i]
        nearer = k < len(nodes) - 1 and i >= col[a] and col[nodes[k + 1]] - i < i - col[j]
        slit[i] = nodes[k + 1] if nearer else j
    return low, high


@numba.njit(cache=True, nogil=True)
def _end(start: int, stop: int, place: Singles, value: Singles, run: Longs) -> None:
    """Take pixels from a surface between its last slit, at `start`, and `stop`, from where it is not lit as it should.

    The dark between two fringes is part of it only if there is light behind.
    """
    step = 1 if stop > start else -1
    last, at = start, start
    while step * (stop - at) >= 0:
        wanted = (1 + np.cos(_TURN * place[at])) / 2
        if value[at] < _DIMMEST * wanted - _SLACK or value[at] > wanted + _BRIGHTEST:
            break
        last = at if wanted > _DARK else last
        at += step
    if step * (stop - at) >= 0:
        for i in range(last + step, stop + step, step):
            run[i] = -1


@numba.njit(cache=True, nogil=True)
def _share(pixel: npt.NDArray[Any], unmixing: Singles, own: Singles, white: Singles) -> tuple[float, float]:
    """Return how much light of the colour `own` a pixel (3,) has beside white light, and how much that is neither.

    Least squares over the three channels, as shares of `own` (3,). White is room light: it has no part in the fringe.
    """
    oo, ow, ww, op, wp, pp = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        x = pixel[0] * unmixing[0, c] + pixel[1] * unmixing[1, c] + pixel[2] * unmixing[2, c]
        oo += own[c] * own[c]
        ow += own[c] * white[c]
        ww += white[c] * white[c]
        op += own[c] * x
        wp += white[c] * x
        pp += x * x
    det = max(oo * ww - ow * ow, 1e-3 * oo * ww) + 1e-12
    share, rest = (ww * op - ow * wp) / det, (oo * wp - ow * op) / det
    return share, np.sqrt(max(pp - share * op - rest * wp, 0.0) / max(oo, 1e-12))


@numba.njit(cache=True, nogil=True, fastmath=_LANES)
def _fit(at: int, run: Longs, period: float, value: Singles, cosine: Singles, sine: Singles, out: Singles) -> bool:
    """Fit level + modulation cos(carrier + shift) around pixel `at` of a row, and write what `table` holds of it.

    Return whether the window tells the three apart. run (w,): the pixels that count have the number of pixel `at`.
    """
    reach = min(int(np.ceil(_CUT * _WINDOW * period)), _WIDEST_PX)
    low, high = at, at
    while low > 0 and at - low < reach and run[low - 1] == run[at]:
        low -= 1
    while high < len(run) - 1 and high - at < reach and run[high + 1] == run[at]:
        high += 1
    fall = 1 / (2 * (_WINDOW * period) ** 2)
    offset = low - at
    bell, ratio, step = np.exp(-fall * offset**2), np.exp(-fall * (2 * offset + 1)), np.exp(-2 * fall)
    total, square, c1, s1, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    v0, vc, vs, vv = 0.0, 0.0, 0.0, 0.0
    for i in range(low, high + 1):
        total += bell
        square += bell * bell
        c, s, v = bell * cosine[i], bell * sine[i], value[i]
        c1, s1, v0 = c1 + c, s1 + s, v0 + bell * v
        cc, cs, ss = cc + c * cosine[i], cs + c * sine[i], ss + s * sine[i]
        vc, vs, vv = vc + c * v, vs + s * v, vv + bell * v * v
        bell *= ratio
        ratio *= step
    cc, cs, ss = cc - c1 * c1 / total, cs - c1 * s1 / total, ss - s1 * s1 / total
    vc, vs, vv = vc - c1 * v0 / total, vs - s1 * v0 / total, vv - v0 * v0 / total
    det = cc * ss - cs * cs
    if cc < 1e-3 * total or ss < 1e-3 * total or det < 0.05 * cc * ss:
        return False
    real, imaginary = (ss * vc - cs * vs) / det, (cc * vs - cs * vc) / det
    level = (v0 - real * c1 - imaginary * s1) / total
    out[0] = np.arctan2(-imaginary, real) / _TURN
    out[2], out[3] = np.hypot(real, imaginary), level
    out[4] = np.sqrt(max(vv - real * vc - imaginary * vs, 0.0) / total)
    out[5] = value[at] - level - real * cosine[at] - imaginary * sine[at]
    out[6] = np.sqrt(square / total * cc / det)
    return True
