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
    merged,
    read_mesh,
    write_bytes,
    write_frames,
    write_png,
    write_rig,
    write_text,
    write_toml,
)
from slkit.geometry import Rig
from slkit.pipeline._patterns import load_codec, recipe_codec, write_capture_toml
from slkit.protocols import Codec
from slkit.simulation import (
    CODED,
    Camera,
    Optics,
    Scene,
    Session,
    SimulatedScanner,
    build,
    coded_session,
    fitted_mesh,
    paper_rig,
    planar_session,
    with_fault,
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
    fault: str | None = None,
    strength: str = "mild",
) -> None:
    """Write a calibration folder as `calibrate` reads it, and truth/ with rig.json and poses.json.

    rig: default the paper's. codec: None for the planar method (side_a, side_b_white, side_b_pattern), a codec's name
    or recipe for coded light on a printed board (pose0, pose1, ...). Lengths in mm, noise as in `simulation.Optics`.
    fault: a mistake of `simulation.FAULTS` that the user makes, `mild` or `strong`; None: none.
    Errors: InputError where no pose is visible, or for a fault that is not known or cannot befall this method;
    FileError where the folder cannot be written.
    """
    rig, optics = rig or paper_rig(), optics or Optics()
    if poses < 1:
        raise InputError(f"poses must be at least 1, not {poses}")
    rng = np.random.default_rng(seed)
    name, built = ("", None) if codec is None else _codec(codec, rig, parameters, "both")
    if built is None:
        session = planar_session(rig, poses, rng, optics, seed)
    else:
        patterns = built.encode()
        session = coded_session(rig, poses, patterns, rng, _seeing(optics, patterns), seed)
    if fault is not None:
        session = with_fault(session, fault, strength, rng)
    table = _planar_table(session) if built is None else _coded_table(session, name, built)
    folder = make_folder(folder)
    _take(folder, session, progress)
    write_toml(folder / "calibration.toml", merged(table, session.told), _COMMENT)
    write_rig(folder / "truth" / "rig.json", rig)
    write_text(folder / "truth" / "poses.json", json.dumps(_poses(session), indent=1) + "\n")


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
    axis codes the one that carries depth. Coloured patterns make coloured pictures. Returns the folders to scan.
    Errors: InputError for an unknown scene; FileError where the folder cannot be written.
    """
    rig, optics, folder = rig or paper_rig(), optics or Optics(), Path(folder)
    built = [(label(codec), *_codec(codec, rig, parameters, depth_axis(rig))) for codec in codecs]
    if not built or len({n for n, _, _ in built}) < len(built):
        raise InputError(f"codecs must be one or several different names, not {', '.join(codecs) or 'none'}")
    scanner = SimulatedScanner(scene_named(scene, rig), rig, optics, seed)
    targets: list[Path] = []
    for folder_name, name, codec in built:
        targets.append(folder if len(built) == 1 else folder / folder_name)
        patterns = codec.encode()
        seen = scanner.under(_seeing(optics, patterns), seed).capture(patterns)
        write_frames(targets[-1], seen, progress)
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


def _poses(session: Session) -> dict[str, Any]:
    return {"pose": "camera_from_board", "units": "mm"} | {
        shot.name: {"rotation": shot.pose.rotation.tolist(), "translation": shot.pose.translation.tolist()}
        for shot in session.shots
    }


def _take(folder: Path, session: Session, progress: Progress | None) -> None:
    """Render every shot of a session and write its pictures."""
    camera = Camera(session)
    for done, shot in enumerate(session.shots):
        pictures = camera.take(shot)
        if shot.role == CODED:
            write_frames(folder / shot.name, pictures)
        else:
            write_png(folder / f"{shot.name}.png", pictures[0])
        if progress is not None:
            progress("render pictures", done + 1, len(session.shots))


def _planar_table(session: Session) -> dict[str, Any]:
    """Return calibration.toml of a two-sided board."""
    sides = {"printed": "side_a/*.png", "marks": "side_b_white/*.png", "projected": "side_b_pattern/*.png"}
    targets = {name: getattr(session, name) for name in sides}
    return {"method": "planar", "projector": list(session.rig.projector.size)} | {
        name: {"images": images} | registry.parameters_of(targets[name]) for name, images in sides.items()
    }


def _coded_table(session: Session, name: str, codec: Codec) -> dict[str, Any]:
    """Return calibration.toml of a codec's light on a printed board."""
    parameters = registry.parameters_of(codec)
    return {
        "method": "local-homography",
        "projector": parameters.pop("projector"),
        "printed": registry.parameters_of(session.printed),
        "coded": {
            "poses": [shot.name for shot in session.shots],
            "codec": name,
            "parameters": parameters,
            "frames": "*.png",
        },
    }


def _codec(codec: str, rig: Rig, parameters: Mapping[str, Any] | None, axes: str) -> tuple[str, Codec]:
    if codec.endswith(".toml"):
        return recipe_codec(codec, rig.projector.size, parameters)
    plugin = registry.load("slkit.codecs", codec)
    chooses = any(f.name == "axes" for f in dataclasses.fields(plugin))
    return codec, load_codec(codec, rig.projector.size, ({"axes": axes} if chooses else {}) | dict(parameters or {}))


def _seeing(optics: Optics, patterns: Frames) -> Optics:
    """Return optics with a colour camera where any pattern is coloured."""
    return dataclasses.replace(optics, color=optics.color or any(pattern.ndim == 3 for pattern in patterns))


def label(codec: str) -> str:
    """Return what to call a codec, by its name or its recipe's."""
    return Path(codec).stem if codec.endswith(".toml") else codec


def scene_named(scene: str, rig: Rig) -> Scene:
    """Return the catalogue's scene of that name, or a mesh file's, for a rig. Errors: InputError listing the names."""
    if Path(scene).suffix:
        return fitted_mesh(rig, *read_mesh(scene))
    return build(scene, rig)


def _write_npz(path: Path, **arrays: Any) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())
