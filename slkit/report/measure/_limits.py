"""The physical limit: how well a code family can locate the light, and what that is in depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError
from slkit.geometry import Rig
from slkit.report.measure._points import Float64s, check_positive, points_of, rms_of

Values = float | npt.NDArray[np.floating]

_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Signal:
    """What a camera pixel sees of a pattern; each a number, or an array with one for each of several places.

    amplitude: white less black, in grey levels; noise: 1 sigma of a pixel of one picture, in grey levels, of which
    rounding to whole levels alone makes 1 / sqrt(12); pitch: camera px per projector px across the code; blur_px: 1
    sigma of all blur together, projector, lens and pixel, in camera px. Errors: InputError unless all are positive.
    """

    amplitude: Values
    noise: Values
    pitch: Values = 1.0
    blur_px: Values = 1.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "noise", "pitch", "blur_px"):
            if not np.all(np.asarray(getattr(self, name)) > 0):
                raise InputError(f"{name} of a signal must be positive")


def gray_limit_px(step_px: float = 1.0) -> float:
    """Return 1 sigma in projector px of a code that names cells of step_px: uniform over one, step / sqrt(12)."""
    check_positive(step_px, "step_px")
    return float(step_px / np.sqrt(12))


def edge_limit_px(signal: Signal) -> Values:
    """Return the least 1 sigma in projector px of the border between two cells, seen as pattern and as inverse.

    One camera row, an edge A Phi(u / s): sqrt(s sqrt(pi)) noise / A camera px.
    Source: Cramer and Rao's bound, 2 A^2 times the integral of p'^2, p' the Gaussian of the blur.
    """
    # The integral of one picture is 1 / (2 s sqrt(pi)).
    return _from_camera(signal, 1 / (signal.blur_px * np.sqrt(np.pi)))


def edge_crossing_px(signal: Signal) -> Values:
    """Return 1 sigma in projector px of an edge found where pattern and inverse cross: sqrt(pi) s noise / A camera px.

    Noise of the difference over its slope at the crossing; smoothing along the row comes closer to `edge_limit_px`.
    """
    return np.sqrt(np.pi) * signal.blur_px * signal.noise / signal.amplitude / signal.pitch


def line_limit_px(signal: Signal, width_px: float = 1.0) -> Values:
    """Return the least 1 sigma in projector px of the centre of a bright line, or slit, in one camera row.

    width_px: of the line in projector px; its profile is the box of that width under the signal's Gaussian blur, of
    height 1 where the box is wide. A line that is one of several shifts has the neighbours' light in its flanks, which
    is not counted.
    Source: Cramer and Rao's bound, noise^2 / (A^2 times the integral of p'^2), the integral in closed form:
    (1 - exp(-w^2 / 4 s^2)) / (s sqrt(pi)).
    """
    check_positive(width_px, "width_px")
    blur = signal.blur_px
    return _from_camera(signal, -np.expm1(-((width_px * signal.pitch / blur) ** 2) / 4) / (blur * np.sqrt(np.pi)))


def color_line_limit_px(channels: Sequence[Signal], width_px: float = 1.0) -> Values:
    """Return the least 1 sigma in projector px of the centre of a coloured line, all channels that show it together.

    channels: one signal for each, its amplitude what the line's colour makes of white less black there. Colour fringes
    of the lens are no noise and not in it. Errors: InputError without channels.
    """
    if not channels:
        raise InputError("a coloured line needs the signal of one or more channels")
    return _together([line_limit_px(signal, width_px) for signal in channels])


def phase_limit_px(signal: Signal, periods_px: Sequence[float], steps: int) -> Values:
    """Return the least 1 sigma in projector px of N-step phase shifting with fringes of several periods.

    periods_px: in projector px; steps: N, three or more, the same for each. For one period 1 / (2 pi) sqrt(2 / N)
    noise / B periods, with the modulation B = A / 2 exp(-2 pi^2 (s / period)^2), blur and period in camera px.
    Errors: InputError without periods or with fewer than three steps.
    Source: Cramer and Rao's bound for offset, modulation and phase in additive normal noise.
    """
    if not periods_px or steps < 3:
        raise InputError("phase shifting needs one or more periods_px and three or more steps")
    each: list[Values] = []
    for period in periods_px:
        check_positive(period, "each of periods_px")
        seen = np.exp(-2 * (np.pi * signal.blur_px / (period * signal.pitch)) ** 2)
        each.append(period / (2 * np.pi) * np.sqrt(2 / steps) * signal.noise / (signal.amplitude / 2 * seen))
    return _together(each)


def limit_mm(rig: Rig, xyz: npt.ArrayLike, sigma_projector_px: Values, axis: int = 0) -> Float64s:
    """Return 1 sigma (n,) mm of z that a sigma of the projector position makes of points (n, 3) mm.

    The point slides along its viewing ray: sigma times |d z / d x_p|. sigma_projector_px: one, or (n,); axis 0: x_p is
    the column, 1: the row. Infinite where it does not tell depth, NaN for a point that is NaN or behind the projector.
    Errors: InputError for an axis that does not exist.
    """
    if axis not in (0, 1):
        raise InputError(f"axis must be 0 for columns or 1 for rows, not {axis}")
    points = points_of(xyz, "xyz")
    moved = rig.to_projector((1 + _STEP) * points) - rig.to_projector((1 - _STEP) * points)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.abs(sigma_projector_px * 2 * _STEP * points[:, 2] / moved[:, axis])


def efficiency(measured_mm: float, limits_mm: npt.ArrayLike) -> float:
    """Return a measured rms in z over the rms of the limits (n,) of the same points: 1 is optimal, more is worse.

    Limits that are not finite are left out. Errors: InputError where none is left.
    """
    limits = np.asarray(limits_mm, dtype=np.float64).ravel()
    limits = limits[np.isfinite(limits)]
    if not len(limits):
        raise InputError("none of the limits is finite: does this axis of the projector tell depth?")
    return measured_mm / rms_of(limits)


def _from_camera(signal: Signal, information: Values) -> Values:
    """Return projector px from the integral of p'^2 over one camera row, 1 / px."""
    return signal.noise / signal.amplitude / np.sqrt(information) / signal.pitch


def _together(sigmas: Sequence[Values]) -> Values:
    return 1 / np.sqrt(sum(1 / np.square(sigma) for sigma in sigmas))
