"""A rig as JSON, slkit's own form, and as OpenCV YAML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from slkit.errors import FileError, InputError
from slkit.files.atomic import write_text
from slkit.files.images import read_bytes
from slkit.geometry import Pinhole, Pose, Rig

FORMAT, VERSION, UNITS = "slkit-rig", 1, "mm"


def write_rig(path: str | Path, rig: Rig, provenance: Mapping[str, Any] | None = None) -> None:
    """Write rig.json, atomically; lengths in mm. provenance: where the rig comes from, any JSON values.

    Errors: InputError for a number that is not finite, FileError where the file cannot be written.
    """
    table = rig_table(rig, provenance)
    try:
        text = json.dumps(table, indent=1, allow_nan=False)
    except ValueError as error:
        raise InputError(f"{path} is not written: the rig holds a number that is not finite") from error
    write_text(path, text + "\n")


def rig_table(rig: Rig, provenance: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the content of rig.json as plain dicts, lists and numbers."""
    pose = rig.projector_from_camera
    table: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "units": UNITS,
        "camera": _device_table(rig.camera),
        "projector": _device_table(rig.projector),
        "projector_from_camera": {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()},
    }
    extras = {"covariance": rig.covariance, "photometry": rig.photometry, "provenance": provenance}
    return table | {name: plain(value) for name, value in extras.items() if value is not None}


def read_rig(path: str | Path) -> Rig:
    """Return the rig of rig.json.

    Errors: FileError where the file is absent, is not an slkit rig of this version, or lacks a value.
    """
    table = _read_table(path)
    try:
        pose = table["projector_from_camera"]
        return Rig(
            _device(table, "camera"),
            _device(table, "projector"),
            Pose(pose["rotation"], pose["translation"]),
            _arrays(table.get("covariance")),
            _arrays(table.get("photometry")),
        )
    except (KeyError, TypeError) as error:
        raise FileError(f"{path} lacks a value that a rig needs: {error}") from error
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def read_provenance(path: str | Path) -> dict[str, Any]:
    """Return what rig.json says of the rig's origin, {} where it says nothing. Errors: FileError as `read_rig`."""
    provenance = _read_table(path).get("provenance")
    return cast("dict[str, Any]", provenance) if isinstance(provenance, dict) else {}


def plain(value: Any) -> Any:
    """Return a value as JSON takes it: arrays and tuples as lists, NumPy's numbers as Python's."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in cast("Mapping[Any, Any]", value).items()}
    if isinstance(value, np.ndarray | np.generic):
        return cast("Any", value).tolist()
    if isinstance(value, list | tuple):
        return [plain(v) for v in cast("list[Any]", value)]
    return value


def _device_table(device: Pinhole) -> dict[str, Any]:
    return {"size": list(device.size), "K": device.K.tolist(), "distortion": device.distortion.tolist()}


def _device(table: dict[str, Any], name: str) -> Pinhole:
    device = table[name]
    try:
        return Pinhole(device["size"], device["K"], device["distortion"])
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    except KeyError as error:
        raise KeyError(f"{name}.{error.args[0]}") from error


def _read_table(path: str | Path) -> dict[str, Any]:
    def refuse(constant: str) -> float:
        raise ValueError(f"{constant} is no number")

    try:
        table: Any = json.loads(read_bytes(path).decode("utf-8"), parse_constant=refuse)
    except ValueError as error:
        raise FileError(f"{path} is not valid JSON: {error}") from error
    found = cast("dict[str, Any]", table) if isinstance(table, dict) else {}
    for key, wanted in (("format", FORMAT), ("version", VERSION), ("units", UNITS)):
        if found.get(key) != wanted:
            raise FileError(f"{path} is not a rig that this slkit reads: {key} is {found.get(key)!r}, not {wanted!r}")
    return found


def _arrays(value: Any) -> Any:
    """Return lists of numbers as arrays and lists of anything else as tuples, as the solver left them."""
    if isinstance(value, dict):
        return {k: _arrays(v) for k, v in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        items = cast("list[Any]", value)
        try:
            return np.array(items, dtype=np.float64)
        except (TypeError, ValueError):
            return tuple(items)
    return value
