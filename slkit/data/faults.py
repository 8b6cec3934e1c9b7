"""The mistakes of a calibration that have a name: shared by who makes them on purpose and by who looks for them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

FAULT_CODES: Mapping[str, str] = MappingProxyType(
    {
        "swapped-pictures": "the pictures under white light and under the pattern are exchanged",
        "moved-board": "the board moved between the pictures of one pose",
        "stale-frame": "a picture still shows the frame before",
        "not-native": "the pattern is resampled to another shape before it is shown",
        "keystone": "the projector's keystone correction warps the pattern",
        "mirrored": "the pattern is shown mirrored",
        "turned": "the pattern is shown turned",
        "wrong-corners": "the number of corners is not that of the board",
        "wrong-square": "the size of a square is not that of the board",
        "wrong-marks": "the places or the size of the marks are not those of the board",
        "bent-board": "the board is not flat",
        "parallel-poses": "all poses of the board are parallel",
        "one-depth": "all poses of the board are at one depth",
        "one-corner": "the board covers one corner of the picture only",
        "saturated": "a picture is over-exposed",
        "under-exposed": "a picture is too dark for its noise",
        "blurred": "a picture is out of focus or shaken",
        "zoomed": "the camera's lens changed between views",
        "exif-rotated": "a picture is turned by 90 degrees",
        "other-size": "a picture is of another size",
        "camera-skew": "the pictures are warped: the camera's pixels are not at right angles",
        "gamma": "the projector's response bends the waves of coded light",
    }
)
"""Code and meaning of every fault that a verdict may name in `Finding.code`; camera-skew is the one not simulated."""
