"""What every measure does with points: their shape, those that exist, their root mean square."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError

Float64s = npt.NDArray[np.float64]


def points_of(value: npt.ArrayLike, name: str) -> Float64s:
    """Return points (n, 3) as float64. Errors: InputError for another shape, by that name."""
    points = np.asarray(value, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name} must have the shape n x 3, not {points.shape}")
    return points


def finite_points(value: npt.ArrayLike, name: str) -> Float64s:
    """Return the rows of points (n, 3) that are finite. Errors: InputError for another shape, by that name."""
    points = points_of(value, name)
    finite = np.isfinite(points).all(axis=1)
    return points if finite.all() else points[finite]


def rms_of(values: Float64s) -> float:
    """Return the root mean square of values (n,), NaN where there is none."""
    return float(np.sqrt(np.mean(values * values))) if len(values) else float("nan")


def check_positive(value: float, name: str) -> None:
    """Raise InputError, by that name, unless a value is positive and finite."""
    if not 0 < value < np.inf:
        raise InputError(f"{name} must be positive, not {value:g}")
