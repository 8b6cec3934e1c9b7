"""How a camera sees the red, green and blue of a projector, from pictures of a neutral plane under full-field light."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import permutations
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Image, check_image, describe_image
from slkit.errors import CalibrationError, InputError

CHANNELS = ("red", "green", "blue")
FULL_FIELDS = ("white", "black", *CHANNELS)
LEVEL_NAME = re.compile(r"(white|red|green|blue)_(\d{1,3})")
"""An intermediate level: red_064 is what (64, 0, 0) of 255 projects."""

_SENSORS = [(2**bits - 1) << shift for bits in (10, 12, 14) for shift in (0, 16 - bits)]
_SATURATED, _DARK, _UNLIT = 0.98, 0.02, 0.1
"""Shares of full scale at which a pixel counts as saturated and a field as dark, and of the brightest light as lit."""
_BLOCKS, _FEWEST = 30_000, 50
_OUTLIER, _ROUNDING, _UNEVEN = 5.0, 0.5, 0.1
"""How far a place may be off and still count as neutral: sigmas of noise, at least grey levels, and a share of its
gain, for neither device is equally coloured all over."""
_MOST_ADDITIVITY, _MOST_MISFIT = 0.05, 0.05
_WORST_CONDITION = 20.0

Doubles = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def estimate_photometry(pictures: Mapping[str, Image]) -> dict[str, Any]:
    """Return what takes projected to seen colours: C = ambient + gain * mixing @ (p / 255) ** response.

    pictures: RGB (h, w, 3) of one size and depth, named by what was projected: white, black, red, green, blue, and as
    many intermediate levels as there are, such as red_064 or white_128. C (3,): shares of full scale; p (3,): projected
    levels; gain: one number a pixel, so that shading, vignetting and neutral prints cancel.

    mixing (3, 3): rows seen, columns projected, scaled so that mixing @ (1, 1, 1) has the mean 1. Its rows do not add
    up to 1 each: they hold the white balance, and one inverse undoes crosstalk and white balance together. gain is then
    the mean over the channels of white - black. ambient (3,): room light and black level. response (3,): an exponent a
    projector channel, absent where a channel has no intermediate level. evidence: `size` (w, h) of the pictures,
    `pixels` used, `neutral` (share of the lit field that agrees on one mixing), `saturated` (share of the lit field,
    left out), `additivity` (3,) (red + green + blue over white, less 1), `mixing_sigma` (3, 3), `response_misfit` (3,)
    (largest share of white by which the power is off). warnings: sentences. All are lists and numbers.

    Errors: InputError for pictures that are missing, unknown, grey or unequal; CalibrationError where they contradict
    their names, are too dark, saturated, or mostly not neutral.
    Source: Caspi, Kiryati and Shamir, Range imaging with adaptive color structured light (1998), with one gain a pixel.
    """
    _check(pictures)
    usable, saturated = _usable(pictures)
    light, side = _block_means(pictures, usable)
    black = light.pop("black")
    light = {name: mean - black for name, mean in light.items()}
    gain, seen = light["white"].mean(axis=1), np.stack([light[name] for name in CHANNELS], axis=2)
    keep = _neutral(seen, gain, _ROUNDING / np.iinfo(pictures["white"].dtype).max)
    total = {name: mean[keep].sum(axis=0) / gain[keep].sum() for name, mean in light.items()}
    mixing = np.stack([total[name] for name in CHANNELS], axis=1)
    scale = mixing.sum() / 3
    residual = seen[keep] - mixing * gain[keep][:, None, None]
    # The scale is made of the same noise.
    residual -= mixing / scale * residual.sum(axis=(1, 2), keepdims=True) / 3
    sigma = np.sqrt((residual**2).sum(axis=0)) / gain[keep].sum()
    additivity = mixing.sum(axis=1) / total["white"] - 1
    response, misfit, warnings = _response(total, mixing)
    evidence: dict[str, Any] = {
        "size": list(usable.shape[::-1]),
        "pixels": int(keep.sum()) * side**2,
        "neutral": float(keep.mean()),
        "saturated": saturated,
        "additivity": additivity.tolist(),
        "mixing_sigma": (sigma / scale).tolist(),
    } | misfit
    told = {"evidence": evidence, "warnings": [*_additivity_warnings(additivity), *warnings]}
    return {"mixing": (mixing / scale).tolist(), "ambient": black[keep].mean(axis=0).tolist()} | response | told


def _check(pictures: Mapping[str, Image]) -> None:
    """Refuse a set that lacks a picture, or whose pictures are no colour pictures of one size and depth."""
    for name in pictures:
        level = LEVEL_NAME.fullmatch(name)
        if name not in FULL_FIELDS and not (level and 1 <= int(level[2]) <= 254):
            raise InputError(
                f"{name!r} names no picture of a color calibration: there are {', '.join(FULL_FIELDS)}, and levels 1 "
                "to 254 of them such as red_064"
            )
    missing = [name for name in FULL_FIELDS if name not in pictures]
    if missing:
        raise InputError(f"a color calibration needs the picture {missing[0]}: project full-field {missing[0]}")
    first = pictures["white"]
    for name, picture in pictures.items():
        check_image(picture, name)
        if picture.ndim == 2:
            raise InputError(f"picture {name} is grey: take color pictures")
        if picture.shape != first.shape or picture.dtype != first.dtype:
            raise InputError(f"picture {name} is {describe_image(picture)}, but white is {describe_image(first)}")


def _usable(pictures: Mapping[str, Image]) -> tuple[Mask, float]:
    """Return the mask (h, w) of pixels lit by white and saturated nowhere, and the share of the lit that is."""
    white = pictures["white"]
    top = int(white.max())
    # A 16-bit picture that tops out exactly where a sensor of fewer bits does comes from one.
    full = top if white.dtype == np.uint16 and top in _SENSORS else int(np.iinfo(white.dtype).max)
    gain = white.mean(axis=2, dtype=np.float32) - pictures["black"].mean(axis=2, dtype=np.float32)
    least, most = (float(v) for v in np.percentile(gain, (1, 99)))
    if -least > max(most, _DARK * full):
        raise CalibrationError("black is brighter than white: the two pictures are exchanged")
    if most < _DARK * full:
        raise CalibrationError("white is hardly brighter than black: was it projected, and exposed for long enough?")
    lit = gain > _UNLIT * most
    saturated = np.zeros_like(lit)
    for picture in pictures.values():
        saturated |= (picture >= _SATURATED * full).any(axis=2)
    share = float(saturated[lit].mean())
    if share > 0.5:
        raise CalibrationError(
            f"{100 * share:.0f} % of the lit field are saturated: shorten the exposure, of all pictures alike"
        )
    return lit & ~saturated, share


def _block_means(pictures: Mapping[str, Image], usable: Mask) -> tuple[dict[str, Doubles], int]:
    """Return the means (n, 3) of every picture over blocks that are usable throughout, and the blocks' side in px.

    Shares of full scale. Blocks hold the noise down, so that a pale object stands out, and neighbouring pixels, whose
    noise a camera may mix, lie within one.
    """
    height, width = usable.shape
    side = max(int(np.sqrt(height * width / _BLOCKS)), 1)
    rows, columns = height // side, width // side
    whole = usable[: rows * side, : columns * side].reshape(rows, side, columns, side).all(axis=(1, 3))
    if whole.sum() < _FEWEST:
        raise CalibrationError(
            f"only {int(usable.sum())} pixels are lit in white and saturated in no picture: "
            "take the pictures of a white plane that fills the field, and shorten the exposure"
        )
    means: dict[str, Doubles] = {}
    for name, picture in pictures.items():
        cells = picture[: rows * side, : columns * side].reshape(rows, side, columns, side, 3)
        means[name] = cells.mean(axis=(1, 3), dtype=np.float64)[whole] / np.iinfo(picture.dtype).max
    return means, side


def _neutral(seen: Doubles, gain: Doubles, rounding: float) -> Mask:
    """Return the mask (n,) of places whose colours seen (n, 3, 3) are gain (n,) times the mixing that most agree on."""
    mixing = np.median(seen / gain[:, None, None], axis=0)
    _check_mixing(mixing)
    # Neighbours differ by noise alone, whatever stands in the field.
    noise = 1.4826 / np.sqrt(2) * np.median(np.abs(np.diff(seen - mixing * gain[:, None, None], axis=0)), axis=0)
    limit = _OUTLIER * np.maximum(noise, rounding) + _UNEVEN * gain[:, None, None]
    keep = np.ones(len(gain), dtype=bool)
    for _ in range(3):
        keep = np.all(np.abs(seen - mixing * gain[:, None, None]) <= limit, axis=(1, 2))
        if keep.mean() < 0.5:
            raise CalibrationError(
                f"only {100 * keep.mean():.0f} % of the lit field agree on one color mixing: "
                "take the pictures of a plain white or grey plane that fills most of the field"
            )
        mixing = seen[keep].sum(axis=0) / gain[keep].sum()
    return keep


def _check_mixing(mixing: Doubles) -> None:
    """Refuse a mixing (3, 3) that contradicts the names of the pictures."""
    for name, share in zip(CHANNELS, mixing.mean(axis=0), strict=True):
        if share > 1 + _MOST_ADDITIVITY:
            raise CalibrationError(f"{name} is brighter than white: the two pictures are exchanged or misnamed")
        if share < _DARK:
            raise CalibrationError(f"{name} is hardly brighter than black: was it projected, or are the two exchanged?")
    # Neither the camera's white balance nor the projector's counts here.
    even = mixing / np.maximum(mixing.sum(axis=1, keepdims=True), 1e-6)
    if np.linalg.cond(even / np.maximum(even.sum(axis=0), 1e-6)) > _WORST_CONDITION:
        raise CalibrationError(
            "red, green and blue look nearly alike in the pictures: each must show what its name says, taken by a "
            "color camera and not stored as grey"
        )
    strength = np.log(np.maximum(mixing, 1e-6))
    order = max(permutations(range(3)), key=lambda rows: sum(strength[row, j] for j, row in enumerate(rows)))
    moved = [name for j, name in enumerate(CHANNELS) if order[j] != j]
    if moved:
        names = f"{', '.join(moved[:-1])} and {moved[-1]}"
        raise CalibrationError(
            f"{names} look exchanged: the pictures are misnamed, or their channels are not in the order red green blue"
        )


def _response(
    total: Mapping[str, Doubles], mixing: Doubles
) -> tuple[dict[str, list[float]], dict[str, list[float]], list[str]]:
    """Return `response` and `response_misfit` of the projector channels, empty where not measured, and warnings.

    total: seen colours (3,) in units of gain. Light s of a level u, both shares of white, has the exponent that fits
    log s = response * log u with the weights s^2, for s is known equally well at every level.
    """
    points = _response_points(total, mixing)
    without = [name for name, found in zip(CHANNELS, points, strict=True) if not found]
    if without:
        lacks = f"the response is not measured: there is no intermediate level of {' and '.join(without)}"
        return {}, {}, [lacks] if len(without) < 3 else []
    response, misfit = list[float](), list[float]()
    for found in points:
        u, s = np.array(found).T
        response.append(float((s**2 * np.log(s) * np.log(u)).sum() / (s**2 * np.log(u) ** 2).sum()))
        misfit.append(float(np.abs(s - u ** response[-1]).max()))
    worst = int(np.argmax(misfit))
    no_power = (
        f"the response of {CHANNELS[worst]} is no power of the level, off by up to {100 * misfit[worst]:.0f} % of "
        "white: switch the projector's picture modes off"
    )
    return {"response": response}, {"response_misfit": misfit}, [no_power] if misfit[worst] > _MOST_MISFIT else []


def _response_points(total: Mapping[str, Doubles], mixing: Doubles) -> list[list[tuple[float, float]]]:
    """Return for each projector channel the levels that were shown and the light they gave, shares of white."""
    points: list[list[tuple[float, float]]] = [[], [], []]
    for name in total:
        level = LEVEL_NAME.fullmatch(name)
        if level is None:
            continue
        color = level[1]
        shown = [0, 1, 2] if color == "white" else [CHANNELS.index(color)]
        light, full = (np.linalg.solve(mixing, total[picture])[shown] for picture in (name, color))
        if (light >= full).any():
            raise CalibrationError(f"{name} is not darker than {color}: the two pictures are exchanged or misnamed")
        for channel, share in zip(shown, light / full, strict=True):
            points[channel].append((int(level[2]) / 255, max(float(share), 1e-6)))
    return points


def _additivity_warnings(additivity: Doubles) -> list[str]:
    worst = float(additivity[np.argmax(np.abs(additivity))])
    if abs(worst) <= _MOST_ADDITIVITY:
        return []
    if worst > 0:
        return [
            f"red, green and blue together are {100 * worst:.0f} % brighter than white: the camera is not linear; "
            "switch its gamma, automatic exposure and automatic white balance off"
        ]
    return [
        f"white is {100 * (1 / (1 + worst) - 1):.0f} % brighter than red, green and blue together: the projector adds "
        "white of its own; switch its picture modes off, and the camera's automatic exposure"
    ]
