"""Which physical limit a codec has, from the light that its pictures show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences, Image, PointCloud
from slkit.geometry import Rig, steeper_axis

Float64s = npt.NDArray[np.float64]
Channel = tuple[Float64s, Float64s]
"""Amplitude and noise (n,) of places in one channel, grey levels."""

_PLACES, _NEAR = 4000, 48
"""Places at which the limit is computed, and the decoded neighbours that tell the pitch there."""
_PIXEL_PX = 1 / np.sqrt(12)
_NO_BLUR_PX = 1e-3


@dataclass(frozen=True, eq=False)
class Taken:
    """The pictures of a scan in memory, with the names of their patterns, the codec, and what it decoded."""

    names: Sequence[str]
    pictures: Sequence[Image]
    codec: Any
    correspondences: Correspondences


@dataclass(frozen=True, eq=False)
class _Places:
    """Where a limit is asked for: camera pixel (n, 2), camera px per projector px and 1 sigma of all blur in px (n,).

    axis: of the projector, 0: columns, 1: rows.
    """

    camera_xy: Float64s
    pitch: Float64s
    blur_px: Float64s
    axis: int


def limit_of(kind: str, taken: Taken, cloud: PointCloud, rig: Rig, blur_px: tuple[float, float]) -> float:
    """Return the least 1 sigma in mm across the surface that the noise of the pictures allows, median over the cloud.

    kind: the codec's registered name, NaN for one without a limit. cloud: with normals. blur_px: of the lens in camera
    px and of the projector in projector px, 1 sigma; the pixel's own is added. Source: `slkit.report.measure`.
    """
    from slkit.report.measure import limit_mm

    limit = LIMITS.get(kind)
    normals = cloud.normals
    if limit is None or normals is None or not len(cloud):
        return float("nan")
    chosen = np.linspace(0, len(cloud) - 1, min(len(cloud), _PLACES)).astype(np.intp)
    points = cloud.xyz[chosen].astype(np.float64)
    axis = _axis(taken.correspondences, rig, points)
    camera_xy = cloud.camera_xy[chosen].astype(np.float64)
    pitch = _pitch(taken.correspondences, camera_xy, axis)
    blur = np.sqrt(blur_px[0] ** 2 + (blur_px[1] * pitch) ** 2 + _PIXEL_PX**2)
    known = np.isfinite(pitch) & (pitch > 0)
    if not known.any():
        return float("nan")
    points, normal = points[known], normals[chosen][known].astype(np.float64)
    sigma = limit(taken, _Places(camera_xy[known], pitch[known], blur[known], axis))
    # Along z the point slides on its viewing ray; what counts across the surface is that step's part along the normal.
    across = np.abs((normal * points / points[:, 2:]).sum(axis=1))
    limits = limit_mm(rig, points, sigma, axis) * across
    limits = limits[np.isfinite(limits)]
    return float(np.median(limits)) if len(limits) else float("nan")


def _gray(taken: Taken, places: _Places) -> Any:
    """Cells without `subpixel`; with it their borders, of which a picture without its inverse tells half."""
    from slkit.report.measure import Signal, edge_limit_px, gray_limit_px

    if not taken.codec.subpixel:
        return gray_limit_px(taken.codec.step)
    amplitude, noise = _references(taken, places)
    half = 1.0 if taken.codec.inverse else np.sqrt(2)
    return half * edge_limit_px(Signal(amplitude, noise, places.pitch, places.blur_px))


def _line(taken: Taken, places: _Places) -> Any:
    from slkit.report.measure import Signal, line_limit_px

    if taken.codec.peaks != "spatial":
        return np.nan
    amplitude, noise = _references(taken, places)
    return line_limit_px(Signal(amplitude, noise, places.pitch, places.blur_px), taken.codec.width)


def _phase(taken: Taken, places: _Places) -> Any:
    """The fringes of the axis that is coded, all their sets together."""
    from slkit.report.measure import Signal, phase_limit_px

    axis = "xy"[places.axis]
    fringes, extent = taken.codec.fringes(axis), taken.codec.projector[axis == "y"]
    periods = [extent / n for n in fringes.periods]
    if {"white", "black"} <= set(taken.names):
        signal = Signal(*_references(taken, places), places.pitch, places.blur_px)
    else:
        # What the pictures swing is blurred already.
        signal = Signal(*_swing(taken, places), places.pitch, np.full_like(places.blur_px, _NO_BLUR_PX))
    return phase_limit_px(signal, periods, fringes.steps)


def _stripes(taken: Taken, places: _Places) -> Any:
    """Coloured slits: in each channel, what the picture shows above the darkest place within a slit's width.

    A blurred slit does not reach the height of white: what is seen is divided by what a box of that width keeps of it.
    Stripes without dark gaps have no slits, and no limit here.
    """
    import cv2
    from scipy.special import erf

    from slkit.report.measure import Signal, color_line_limit_px

    width, picture = taken.codec.width, taken.pictures[-1]
    if taken.codec.style == "edges" or picture.ndim == 2:
        return np.nan
    kept = erf(width * places.pitch / (2 * np.sqrt(2) * places.blur_px))
    reach = int(np.ceil(width * np.median(places.pitch) + 1))
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    signals: list[Any] = []
    for channel in np.moveaxis(picture, -1, 0).astype(np.float32):
        low = cv2.erode(channel, kernel).astype(np.float32)
        amplitude, noise = _at(channel - low, places), _noise(channel, channel, places)
        signals.append(Signal(np.maximum(amplitude / kept, 1e-3), noise, places.pitch, places.blur_px))
    return color_line_limit_px(signals, width)


LIMITS: dict[str, Callable[[Taken, _Places], Any]] = {
    "gray": _gray,
    "line-shift": _line,
    "phase-shift": _phase,
    "color-stripes": _stripes,
}
"""Codec name -> 1 sigma in projector px at places; a codec that is not here has no limit."""


def _references(taken: Taken, places: _Places) -> Channel:
    """Return white less black, and the noise half-way."""
    white, black = (_grey(taken.pictures[list(taken.names).index(n)]) for n in ("white", "black"))
    return np.maximum(_at(white - black, places), 1e-3), _noise(white, (white + black) / 2, places)


def _swing(taken: Taken, places: _Places) -> Channel:
    """Return what sinusoids swing about their mean, from top to bottom, and the noise there."""
    stack = np.stack([_grey(p) for p in taken.pictures])
    span = 2 * np.sqrt(2) * stack.std(axis=0)
    return np.maximum(_at(span, places), 1e-3), _noise(stack[0], stack.mean(axis=0), places)


def _noise(shown: Any, level: Any, places: _Places) -> Float64s:
    """Return the noise (n,) of one picture at the grey levels (h, w) of another, as slow changes let it be seen."""
    from slkit.codecs._noise import Evidence, noise_curve

    curve = noise_curve([Evidence(shown, shown, np.ones(shown.shape, dtype=bool))])
    return curve.at(_at(level, places).astype(np.float32)).astype(np.float64)


def _at(picture: Any, places: _Places) -> Float64s:
    """Return the values (n,) of a picture (h, w) at the nearest pixels."""
    col, row = np.rint(places.camera_xy).astype(np.intp).T
    height, width = picture.shape
    return picture[row.clip(0, height - 1), col.clip(0, width - 1)].astype(np.float64)


def _grey(picture: Image) -> Any:
    from slkit.codecs._masks import grey

    return grey(picture)


def _axis(found: Correspondences, rig: Rig, points: Float64s) -> int:
    """Return the decoded projector axis, of two the one that tells depth better."""
    decoded: npt.NDArray[np.bool_] = np.asarray(np.isfinite(found.projector_xy).any(axis=0))
    return steeper_axis(rig, points) if decoded.all() else int(decoded[1])


def _pitch(found: Correspondences, camera_xy: Float64s, axis: int) -> Float64s:
    """Return camera px per projector px (n,) across the code, from the slope of the decoded positions around."""
    from scipy.spatial import KDTree

    decoded = found.select(np.isfinite(found.projector_xy[:, axis]))
    if len(decoded) < _NEAR:
        return np.full(len(camera_xy), np.nan)
    near = KDTree(decoded.camera_xy).query(camera_xy, _NEAR)[1]
    xy, value = decoded.camera_xy[near].astype(np.float64), decoded.projector_xy[near, axis].astype(np.float64)
    xy, value = xy - xy.mean(axis=1, keepdims=True), value - value.mean(axis=1, keepdims=True)
    normal = xy.transpose(0, 2, 1) @ xy
    # Neighbours on one line tell nothing across it.
    told = np.linalg.eigvalsh(normal)[:, 0] > 1e-3 * _NEAR
    slope = np.linalg.solve(normal[told], xy[told].transpose(0, 2, 1) @ value[told][..., None])[..., 0]
    result = np.full(len(camera_xy), np.nan)
    result[told] = 1 / np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    return result
