"""A rig as a YAML file of cv2.FileStorage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import FileError, InputError
from slkit.files.atomic import write_text
from slkit.files.images import read_bytes
from slkit.geometry import Pinhole, Pose, Rig


def write_opencv(path: str | Path, rig: Rig) -> None:
    """Write a rig as cv2.stereoCalibrate would return it, camera first, projector second, T in mm; atomically.

    Keys: camera_size, camera_matrix, camera_distortion (k1 k2 p1 p2 k3), the same for projector, R (3, 3), T (3, 1).
    Errors: InputError where a matrix has skew, which OpenCV ignores; FileError where the file cannot be written.
    """
    import cv2

    storage = cv2.FileStorage("rig.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, device in (("camera", rig.camera), ("projector", rig.projector)):
        if device.K[0, 1]:
            raise InputError(f"the {name} matrix has skew, which OpenCV's functions ignore: the rig is not exported")
        storage.write(f"{name}_size", np.array([device.size], dtype=np.int32))
        storage.write(f"{name}_matrix", device.K.copy())
        storage.write(f"{name}_distortion", device.distortion.reshape(1, 5).copy())
    storage.write("R", rig.projector_from_camera.rotation.copy())
    storage.write("T", rig.projector_from_camera.translation.reshape(3, 1).copy())
    write_text(path, storage.releaseAndGetString())


def read_opencv(path: str | Path) -> Rig:
    """Return the rig of a YAML file with the keys of `write_opencv`; distortion may have four or five numbers.

    Errors: FileError naming what is absent or wrong.
    """
    import cv2

    text = read_bytes(path).decode("utf-8", errors="replace")
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        devices = [_device(storage, name, path) for name in ("camera", "projector")]
        pose = Pose(_matrix(storage, "R", path), _matrix(storage, "T", path).reshape(-1))
    except (cv2.error, SystemError) as error:
        raise FileError(f"{path} is not a YAML file of OpenCV") from error
    except InputError as error:
        raise FileError(f"{path}: {error}") from error
    return Rig(devices[0], devices[1], pose)


def _device(storage: Any, name: str, path: str | Path) -> Pinhole:
    distortion = _matrix(storage, f"{name}_distortion", path).reshape(-1)
    if len(distortion) not in (4, 5):
        raise FileError(
            f"{path}: {name}_distortion must hold k1 k2 p1 p2 and perhaps k3, not {len(distortion)} numbers"
        )
    size = _matrix(storage, f"{name}_size", path).reshape(-1)
    matrix = _matrix(storage, f"{name}_matrix", path)
    return Pinhole((size[0], size[1]), matrix, np.append(distortion, 0.0)[:5])


def _matrix(storage: Any, key: str, path: str | Path) -> npt.NDArray[np.float64]:
    node = storage.getNode(key)
    value = None if node.empty() else node.mat()
    if value is None:
        raise FileError(f"{path} has no matrix {key}")
    return np.asarray(value, dtype=np.float64)
