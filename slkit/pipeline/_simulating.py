"""Folders as a person would bring them home, from a rig that exists only as numbers, with the truth beside them."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slkit import registry
from slkit.data import Frames
from slkit.errors import InputError
from slkit.files import (
    Progress,
    make_folder,
    read_mesh,
    write_bytes,
    write_frames,
    write_png,
    write_rig,
    write_text,
    write_toml,
)
from slkit.geometry import Pose, Rig
from slkit.pipeline._patterns import load_codec, recipe_codec, write_capture_toml
from slkit.protocols import Codec
from slkit.simulation import (
    Optics,
    Scene,
    SimulatedScanner,
    board,
    board_poses,
    boards_for,
    build,
    fitted_mesh,
    paper_rig,
    working_distance,
)

_COMMENT = "Simulated; truth/ holds the rig and what it really saw."


def simulate_calibration(
    folder: str | Path,
    rig: Rig | None = None,
    poses: int = 10,
    codec: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    optics: Optics | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> None:
    """Write a calibration folder as `calibrate` reads it, and truth/ with rig.json and poses.json.

    rig: default the paper's. codec: None for the planar method (side_a, side_b_white, side_b_pattern), a codec's name
    or recipe for coded light on a printed board (pose0, pose1, ...). Lengths in mm, noise as in `simulation.Optics`.
    Errors: InputError where no pose is visible; FileError where the folder cannot be written.
    """
    rig, optics, folder = rig or paper_rig(), optics or Optics(), make_folder(folder)
    if poses < 1:
        raise InputError(f"poses must be at least 1, not {poses}")
    if codec is None:
        truth = _planar(folder, rig, poses, optics, seed, progress)
    else:
        name, built = _codec(codec, rig, parameters, "both")
        truth = _coded(folder, rig, poses, name, built, optics, seed, progress)
    write_rig(folder / "truth" / "rig.json", rig)
    table = {"pose": "camera_from_board", "units": "mm"} | {
        name: {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}
        for name, pose in truth.items()
    }
    write_text(folder / "truth" / "poses.json", json.dumps(table, indent=1) + "\n")


def simulate_scan(
    folder: str | Path,
    rig: Rig | None = None,
    scene: str = "free-form",
    codecs: Sequence[str] = ("gray",),
    parameters: Mapping[str, Any] | None = None,
    optics: Optics | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Path]:
    """Write a scan folder as `scan` reads it, and truth/ with rig.json, object_mesh.npz and object.npz.

    scene: a name of `simulation.SCENES`, or a mesh file, which is scaled into the volume the rig measures. codecs:
    names or recipes; several make one subfolder each. parameters: fields of all of them; a codec that can choose its
    axis codes the one that carries depth. Returns the folders to scan.
    Errors: InputError for an unknown scene; FileError where the folder cannot be written.
    """
    rig, optics, folder = rig or paper_rig(), optics or Optics(), Path(folder)
    built = [(_label(codec), *_codec(codec, rig, parameters, depth_axis(rig))) for codec in codecs]
    if not built or len({label for label, _, _ in built}) < len(built):
        raise InputError(f"codecs must be one or several different names, not {', '.join(codecs) or 'none'}")
    scanner = SimulatedScanner(_scene(scene, rig), rig, optics, seed)
    targets: list[Path] = []
    for label, name, codec in built:
        targets.append(folder if len(built) == 1 else folder / label)
        write_frames(targets[-1], scanner.capture(codec.encode()), progress)
        write_capture_toml(targets[-1], name, codec, _COMMENT, frames="*.png")
    write_rig(folder / "truth" / "rig.json", rig)
    vertices, faces = scanner.scene.mesh()
    _write_npz(folder / "truth" / "object_mesh.npz", vertices_mm=vertices, faces=faces)
    truth = scanner.truth()
    _write_npz(
        folder / "truth" / "object.npz",
        camera_xy=truth.camera_xy,
        xyz_mm=truth.xyz_mm,
        projector_xy=truth.projector_xy,
    )
    return targets


def depth_axis(rig: Rig) -> str:
    """Return "x" or "y": whether projector columns or rows move more along the camera's middle ray."""
    near = working_distance(rig)
    middle = rig.camera.normalize((np.array(rig.camera.size) - 1) / 2)
    points = np.append(middle, 1.0) * np.array([[near], [1.01 * near]])
    dx, dy = np.abs(np.diff(rig.to_projector(points), axis=0)[0])
    return "x" if dx >= dy else "y"


def _planar(
    folder: Path, rig: Rig, poses: int, optics: Optics, seed: int, progress: Progress | None
) -> dict[str, Pose]:
    printed, marks, projected = boards_for(rig)
    rng = np.random.default_rng(seed)
    side_a = board_poses(rig, printed.extent(), poses, rng)
    side_b = board_poses(rig, marks.extent(), poses, rng, projected=projected, marks=marks)
    truth: dict[str, Pose] = {}
    for i, pose in enumerate(side_a):
        name = f"side_a/{i:03d}"
        truth[name] = pose
        write_png(folder / f"{name}.png", _scanner(board(printed, pose), rig, optics, seed, i).photograph())
        _tell(progress, i + 1, 2 * poses)
    width, height = rig.projector.size
    shown = Frames.of([np.full((height, width), 255, np.uint8), projected.draw((width, height))], ["white", "pattern"])
    for i, pose in enumerate(side_b):
        seen = _scanner(board(marks, pose), rig, optics, seed, poses + i).capture(shown)
        for picture, name in zip(seen, ("side_b_white", "side_b_pattern"), strict=True):
            truth[f"{name}/{i:03d}"] = pose
            write_png(folder / name / f"{i:03d}.png", picture)
        _tell(progress, poses + i + 1, 2 * poses)
    table = {
        "method": "planar",
        "projector": [width, height],
        "printed": {"images": "side_a/*.png"} | registry.parameters_of(printed),
        "marks": {"images": "side_b_white/*.png"} | registry.parameters_of(marks),
        "projected": {"images": "side_b_pattern/*.png"} | registry.parameters_of(projected),
    }
    write_toml(folder / "calibration.toml", table, _COMMENT)
    return truth


def _coded(
    folder: Path, rig: Rig, poses: int, name: str, codec: Codec, optics: Optics, seed: int, progress: Progress | None
) -> dict[str, Pose]:
    printed = boards_for(rig, lit=True)[0]
    found = board_poses(rig, printed.extent(), poses, np.random.default_rng(seed), lit=True)
    names = [f"pose{i}" for i in range(poses)]
    for i, pose in enumerate(found):
        write_frames(folder / names[i], _scanner(board(printed, pose), rig, optics, seed, i).capture(codec.encode()))
        _tell(progress, i + 1, poses)
    parameters = registry.parameters_of(codec)
    table = {
        "method": "local-homography",
        "projector": parameters.pop("projector"),
        "printed": registry.parameters_of(printed),
        "coded": {"poses": names, "codec": name, "parameters": parameters, "frames": "*.png"},
    }
    write_toml(folder / "calibration.toml", table, _COMMENT)
    return dict(zip(names, found, strict=True))


def _scanner(scene: Scene, rig: Rig, optics: Optics, seed: int, pose: int) -> SimulatedScanner:
    # Every pose has its own noise, also for the frames that all poses have in common.
    return SimulatedScanner(scene, rig, optics, 1000 * seed + pose)


def _codec(codec: str, rig: Rig, parameters: Mapping[str, Any] | None, axes: str) -> tuple[str, Codec]:
    if codec.endswith(".toml"):
        return recipe_codec(codec, rig.projector.size, parameters)
    plugin = registry.load("slkit.codecs", codec)
    chooses = any(f.name == "axes" for f in dataclasses.fields(plugin))
    return codec, load_codec(codec, rig.projector.size, ({"axes": axes} if chooses else {}) | dict(parameters or {}))


def _label(codec: str) -> str:
    return Path(codec).stem if codec.endswith(".toml") else codec


def _scene(scene: str, rig: Rig) -> Scene:
    if Path(scene).suffix:
        return fitted_mesh(rig, *read_mesh(scene))
    return build(scene, rig)


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress("render poses", done, total)


def _write_npz(path: Path, **arrays: Any) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())
