"""What a caller hands over, checked: arrays of a shape, sizes of pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError

Floats = npt.NDArray[np.floating[Any]]


def as_floats(value: npt.ArrayLike, shape: tuple[int | None, ...], name: str) -> npt.NDArray[np.float64]:
    """Return `value` as a read-only float64 array of `shape` (None: any length).

    Errors: InputError naming `name` where the shape differs or a number is not finite.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers") from error
    fits = array.ndim == len(shape) and all(s in (None, n) for s, n in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = " x ".join("n" if s is None else str(s) for s in shape)
        raise InputError(f"{name} must have the shape {wanted}, not {' x '.join(map(str, array.shape)) or 'a scalar'}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds a number that is not finite")
    array.flags.writeable = False
    return array


def as_size(value: Any, name: str) -> tuple[int, int]:
    """Return `value` as (width, height) in px.

    Errors: InputError naming `name` unless it is two positive whole numbers.
    """
    try:
        width, height = (float(v) for v in value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be two whole numbers, width and height") from error
    if not (width >= 1 and height >= 1 and width.is_integer() and height.is_integer()):
        raise InputError(f"{name} must be two positive whole numbers, not {width:g} x {height:g}")
    return int(width), int(height)
