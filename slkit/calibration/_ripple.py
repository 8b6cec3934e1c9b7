"""What decoded coded light tells of the projector's response and of the order of frames, on a board that is flat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, Finding
from slkit.geometry import Floats

_PERIODS_PX = (2.2, 40.0)
_BINS_A_PX = 8
_FEWEST_PIXELS = 2000
_FEWEST_AROUND = 30
_CORNERS = 60
_OVER_SIGMA = 1.2
_LEAST_PX = 0.02
_OFF_SIGMAS = 5.0
_OFF_PX = 1.0
_ROUNDS = 15
_LEAST_AGREEING = 0.75
_LEAST_READ = 0.45
"""Least share of decoded pixels that agree with their neighbours, and of pixels that are decoded at all, the latter as
a share of what is usual: black squares are often too dark to be read."""
_NOTHING, _MOST_SILENT = 0.2, 0.15
"""Where a wrong frame gives codes that are not the projector's, parts of the board seem to be unlit: corners with a
smaller share of decoded pixels around them than the best one of their view has."""
_AGAIN = "wait longer after a change of the pattern, and take this pose again"


@dataclass(frozen=True, eq=False)
class Flatness:
    """How decoded light departs from a smooth map around the corners of a flat board.

    projector_xy, residual_xy, sigma (m, 2) px: of the pixels that agree; read: share of the pixels that were decoded;
    agreeing: share of those that agree with their neighbours; silent: share of the lit corners around which next to
    nothing is decoded.
    """

    view: str
    projector_xy: Floats
    residual_xy: Floats
    sigma: Floats
    read: float
    agreeing: float
    silent: float = 0.0


def flatness(
    view: str, corners: Floats, half_px: float, found: Correspondences, lit: npt.NDArray[np.bool_] | None = None
) -> Flatness:
    """Return what the pixels within half_px of corners (n, 2) px say, against a quadratic map around each corner.

    lit (n,): the corners that the projector's image reaches, None where it is not known.
    """
    camera_xy, projector_xy = found.camera_xy.astype(np.float64), found.projector_xy.astype(np.float64)
    coded = np.isfinite(projector_xy).all(axis=1)
    camera_xy, projector_xy, sigma = camera_xy[coded], projector_xy[coded], found.sigma[coded].astype(np.float64)
    order = np.argsort(camera_xy[:, 1], kind="stable")
    camera_xy, projector_xy, sigma = camera_xy[order], projector_xy[order], sigma[order]
    empty = np.empty((0, 2))
    parts: list[tuple[Floats, Floats, Floats]] = [(empty, empty, empty)]
    chosen = slice(None, None, max(len(corners) // _CORNERS, 1))
    counts: list[int] = []
    for corner in corners[chosen]:
        first, last = np.searchsorted(camera_xy[:, 1], [corner[1] - half_px, corner[1] + half_px])
        near = first + np.flatnonzero(np.abs(camera_xy[first:last, 0] - corner[0]) <= half_px)
        counts.append(len(near))
        if len(near) >= _FEWEST_AROUND:
            residual, agreeing = _departure(camera_xy[near] - corner, projector_xy[near], sigma[near])
            parts.append((projector_xy[near][agreeing], residual[agreeing], sigma[near][agreeing]))
    place, residual, spread = (np.concatenate(column) for column in zip(*parts, strict=True))
    read, agreeing = float(np.mean(counts)) / (2 * half_px) ** 2, len(place) / max(sum(counts), 1)
    there = np.array(counts)[np.zeros(len(counts), dtype=bool) if lit is None else lit[chosen]]
    silent = float((there < _NOTHING * max(counts)).sum() / max(len(there), 1))
    return Flatness(view, place, residual, spread, read, agreeing, silent)


def _departure(camera_xy: Floats, projector_xy: Floats, sigma: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the residual (n, 2) px of a quadratic map, and the mask (n,) of the rows that agree with it."""
    x, y = (camera_xy / max(float(np.abs(camera_xy).max()), 1e-9)).T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    start = np.median(projector_xy, axis=0)
    residual = projector_xy - start
    # Least absolute values: the majority decides, however far off the others are.
    for _ in range(_ROUNDS):
        off = np.linalg.norm(residual / sigma, axis=1)
        weight = (1 / np.sqrt(np.maximum(off, 1)) / np.linalg.norm(sigma, axis=1))[:, None]
        residual = projector_xy - start - terms @ np.linalg.lstsq(weight * terms, weight * (projector_xy - start))[0]
    spread = np.maximum(1.4826 * np.median(np.abs(residual / sigma), axis=0), 1)
    agreeing = np.asarray((np.abs(residual) <= np.maximum(_OFF_SIGMAS * spread * sigma, _OFF_PX)).all(axis=1))
    return residual, agreeing


@dataclass(frozen=True)
class Wave:
    """A wave in the residuals: amplitude and period in px, and its strength in units of what would be worth a word."""

    amplitude: float
    period: float
    strength: float


def ripple(maps: Sequence[Flatness], axis: int) -> Wave:
    """Return the strongest wave in the residuals over one projector axis; strength 0 for too few pixels.

    The residuals of all maps are added up by projector position; a wave of the fringes' own making shows there.
    """
    place = np.concatenate([m.projector_xy[:, axis] for m in maps])
    residual = np.concatenate([m.residual_xy[:, axis] for m in maps])
    if len(place) < _FEWEST_PIXELS:
        return Wave(0.0, np.nan, 0.0)
    sigma = float(np.median(np.concatenate([m.sigma[:, axis] for m in maps])))
    index = np.rint((place - place.min()) * _BINS_A_PX).astype(np.intp)
    # Padded to twice the length, so that no period falls between two frequencies.
    length = 2 * (int(index.max()) + 1)
    sums = np.bincount(index, weights=residual, minlength=length)
    amplitude: Any = 2 * np.abs(np.fft.rfft(sums)) / len(place)
    frequency = np.fft.rfftfreq(length, 1 / _BINS_A_PX)
    within = (frequency > 1 / _PERIODS_PX[1]) & (frequency < 1 / _PERIODS_PX[0])
    best = int(np.argmax(np.where(within, amplitude, 0)))
    worth = max(_LEAST_PX, _OVER_SIGMA * float(np.sqrt(2)) * sigma)
    return Wave(float(amplitude[best]), float(1 / frequency[best]), float(amplitude[best]) / worth)


def code_findings(maps: Sequence[Flatness]) -> list[Finding]:
    """Return that the projector's gamma bends the waves, and the poses whose frames do not belong together."""
    if not maps:
        return []
    found: list[Finding] = []
    waves = [max((ripple([flat], axis) for axis in (0, 1)), key=lambda wave: wave.strength) for flat in maps]
    rippled = [flat.view for flat, wave in zip(maps, waves, strict=True) if wave.strength > 1]
    strongest = max(waves, key=lambda wave: wave.strength)
    fault = f"decoded positions ripple by {strongest.amplitude:.2f} px with a period of {strongest.period:.1f} px"
    if 2 * len(rippled) > len(maps):
        found.append(Finding(fault, "", "set the projector's gamma to linear, or use more steps a period", "gamma"))
    else:
        # The projector's response is the same in all views: what only some of them show is a wrong frame.
        found += [Finding(f"{fault}, in few views", view, _AGAIN, "stale-frame") for view in rippled]
    usual = max(flat.read for flat in maps)
    for flat in maps:
        if flat.agreeing < _LEAST_AGREEING:
            share = f"{100 * (1 - flat.agreeing):.0f} % of the decoded pixels contradict their neighbours"
            found.append(_wrong_frame(flat, share))
        elif flat.silent > _MOST_SILENT:
            share = f"around {100 * flat.silent:.0f} % of the corners that are lit there is no code"
            found.append(_wrong_frame(flat, share))
        elif flat.read < _LEAST_READ * usual:
            share = (
                f"{100 * flat.read:.0f} % of the pixels on the board are decoded, {100 * usual:.0f} % in other views"
            )
            found.append(_wrong_frame(flat, share))
    return found


def _wrong_frame(flat: Flatness, evidence: str) -> Finding:
    return Finding(f"{evidence}: a frame is not the one it should be", flat.view, _AGAIN, "stale-frame")


def undecoded(view: str) -> Finding:
    """Return the finding for a well lit pose whose frames contradict each other everywhere."""
    return Finding(
        "its frames contradict each other: they are not those of the codec, in order", view, _AGAIN, "stale-frame"
    )
