"""Full-field light of every colour: to project, to simulate, and to calibrate colours from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slkit import registry
from slkit.calibration.photometry import CHANNELS, FULL_FIELDS, LEVEL_NAME, estimate_photometry
from slkit.data import Frames, Image
from slkit.errors import FileError, InputError, SlkitError
from slkit.files import (
    PICTURE_ENDINGS,
    Progress,
    make_folder,
    read_bytes,
    read_image,
    read_rig,
    write_png,
    write_rig,
    write_text,
)
from slkit.geometry import Rig
from slkit.pipeline._slideshow import write_slideshow
from slkit.simulation import Optics, SimulatedScanner, paper_rig, plane, working_volume


@dataclass(frozen=True)
class ColorFields:
    """Full-field white, black, red, green and blue, and red, green and blue of lower levels.

    projector (width, height) px; levels: 1 to 254, for the projector's response. Errors: InputError for other levels.
    """

    projector: tuple[int, int]
    levels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for level in self.levels:
            if not 1 <= level <= 254:
                raise InputError(f"levels must be from 1 to 254, not {level}")

    def frames(self) -> Frames:
        """Return the pictures to project, named as those that are taken of them: white, ..., red_064, ..."""
        levels = {"white": (255, 255, 255), "black": (0, 0, 0)}
        for level in (255, *sorted(set(self.levels))):
            for name, one in zip(CHANNELS, np.eye(3, dtype=int), strict=True):
                levels[name if level == 255 else f"{name}_{level:03d}"] = tuple(level * one)
        names = tuple(levels)

        def load(index: int) -> Image:
            return np.full((self.projector[1], self.projector[0], 3), levels[names[index]], dtype=np.uint8)

        return Frames(names, load)


def projected_color(
    projector: tuple[int, int], folder: str | Path, parameters: Mapping[str, Any] | None = None
) -> list[Path]:
    """Write what the colour calibration projects, white.png, black.png, red.png, ..., and slideshow.html.

    projector: (width, height) px; parameters: `levels`. Returns the pictures' paths.
    Errors: InputError for a wrong parameter, FileError where they cannot be written or the folder holds other ones.
    """
    fields = _fields(projector, parameters)
    folder = make_folder(folder)
    paths = _write(folder, fields.frames(), None)
    write_slideshow(folder, [path.name for path in paths], projector)
    return paths


def simulate_color(
    folder: str | Path,
    rig: Rig | None = None,
    parameters: Mapping[str, Any] | None = None,
    optics: Optics | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> None:
    """Write colour pictures of a white plane under full-field light, and truth/rig.json with the true photometry.

    rig: default the paper's; parameters: `levels`. Errors: as `projected_color`.
    """
    rig, optics = rig or paper_rig(), replace(optics or Optics(), color=True)
    fields = _fields(rig.projector.size, parameters)
    center, radius = working_volume(rig)
    white = plane(float(center[2]), size_mm=(4 * radius, 3 * radius), center_xy_mm=(float(center[0]), float(center[1])))
    folder = make_folder(folder)
    _write(folder, SimulatedScanner(white, rig, optics, seed).capture(fields.frames()), progress)
    mixing, albedo = optics.mixing(), np.mean(np.asarray(white.surfaces[0].albedo, dtype=np.float64))
    truth = {
        "mixing": mixing / mixing.sum() * 3,
        "ambient": optics.black_level + optics.ambient * albedo * mixing.sum(axis=1),
        "response": np.full(3, optics.projector_gamma),
    }
    write_rig(folder / "truth" / "rig.json", replace(rig, photometry=truth))


def measure_photometry(folder: str | Path) -> dict[str, Any]:
    """Return `calibration.photometry.estimate_photometry` of a folder with white.png, black.png, red.png, ...

    Pictures may be of any kind that slkit reads; other names are passed over.
    Errors: FileError where they cannot be read, InputError and CalibrationError as there, naming the folder.
    """
    folder = Path(folder)
    pictures = {name: read_image(path) for name, path in _named(folder).items()}
    try:
        return estimate_photometry(pictures)
    except SlkitError as error:
        raise type(error)(f"{folder}: {error}") from error


def with_photometry(rig: Rig, photometry: Mapping[str, Any]) -> Rig:
    """Return a rig with a measured photometry. Errors: InputError where its pictures had not the camera's size."""
    width, height = photometry["evidence"]["size"]
    if (width, height) != rig.camera.size:
        raise InputError(
            f"the rig is for a camera of {rig.camera.size[0]} x {rig.camera.size[1]} px, but the color pictures have "
            f"{width} x {height} px: take them as those of the calibration"
        )
    return replace(rig, photometry=photometry)


def add_photometry(rig_file: str | Path, folder: str | Path, output: str | Path | None = None) -> dict[str, Any]:
    """Measure the photometry of a rig from a folder of colour pictures, and write it into rig.json or a copy of it.

    output: default rig_file. Everything else that the file holds is kept as it stands. Returns the photometry.
    Errors: as `measure_photometry` and `with_photometry`, FileError where the rig cannot be read or written.
    """
    rig, photometry = read_rig(rig_file), measure_photometry(folder)
    with_photometry(rig, photometry)
    table = json.loads(read_bytes(rig_file)) | {"photometry": photometry}
    write_text(output or rig_file, json.dumps(table, indent=1, allow_nan=False) + "\n")
    return photometry


def _fields(projector: tuple[int, int], parameters: Mapping[str, Any] | None) -> ColorFields:
    return registry.create(ColorFields, dict(parameters or {}) | {"projector": list(projector)}, "color")


def _write(folder: Path, frames: Frames, progress: Progress | None) -> list[Path]:
    """Write frames as NAME.png and return the paths, in display order."""
    others = sorted(set(_named(folder)) - set(frames.names))
    if others:
        raise FileError(f"{folder} already holds pictures of another set ({others[0]}): choose an empty folder")
    paths = [folder / f"{name}.png" for name in frames.names]
    for index, path in enumerate(paths):
        write_png(path, frames[index])
        if progress is not None:
            progress(f"write {folder.name}", index + 1, len(paths))
    return paths


def _named(folder: Path) -> dict[str, Path]:
    """Return the pictures of a folder whose names are those of full-field light."""
    if not folder.is_dir():
        raise FileError(f"there is no folder {folder}")
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        name = path.stem.lower()
        if path.suffix.lower() in PICTURE_ENDINGS and (name in FULL_FIELDS or LEVEL_NAME.fullmatch(name)):
            if name in found:
                raise FileError(f"{folder} holds both {found[name].name} and {path.name}: keep one of them")
            found[name] = path
    return found
