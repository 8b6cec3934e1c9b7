"""Markers that carry a number: OpenCV's dictionaries, by name, as cells of black and white."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError


def dictionary(name: str) -> Any:
    """Return OpenCV's dictionary of that name, such as 4x4_100 or apriltag_36h11, in any case.

    Errors: InputError that lists the names.
    """
    import cv2

    numbers = {n.removeprefix("DICT_").lower(): getattr(cv2.aruco, n) for n in dir(cv2.aruco) if n.startswith("DICT_")}
    number = numbers.get(name.lower().removeprefix("dict_"))
    if number is None:
        raise InputError(f"dictionary must be one of {', '.join(sorted(numbers))}, not {name!r}")
    return cv2.aruco.getPredefinedDictionary(number)


def check_dictionary(name: str, count: int) -> None:
    """Refuse an unknown dictionary, or one with fewer markers than a board needs. Errors: InputError."""
    held = len(dictionary(name).bytesList)
    if held < count:
        raise InputError(f"the dictionary {name} holds {held} markers, but the board needs {count}: take a larger one")


def modules(name: str) -> int:
    """Return how many cells a marker is wide, its black border included."""
    return int(dictionary(name).markerSize) + 2


def markers(name: str, count: int) -> npt.NDArray[np.float64]:
    """Return the markers 0 to count - 1 (count, n, n), border included; 1 is black."""
    held = dictionary(name)
    side = int(held.markerSize) + 2
    return np.array([held.generateImageMarker(i, side) == 0 for i in range(count)], dtype=np.float64)
