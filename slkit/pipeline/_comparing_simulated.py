"""A comparison without hardware: one object under several codecs, on one simulated calibration."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slkit.files import Progress, make_folder, plain, read_provenance, read_rig, write_rig
from slkit.geometry import Rig
from slkit.pipeline._calibrating import calibrate, provenance
from slkit.pipeline._comparing import compare, origin
from slkit.pipeline._comparing_measures import Rules
from slkit.pipeline._comparing_surface import Truth
from slkit.pipeline._simulating import label, scene_named, simulate_calibration, simulate_scan
from slkit.report.comparison import Comparison
from slkit.simulation import Optics, paper_rig

_MADE = "comparison"


def compare_simulated(
    folder: str | Path,
    scene: str,
    codecs: Sequence[str],
    rig: Rig | None = None,
    optics: Optics | None = None,
    seed: int = 0,
    rules: Rules | None = None,
    limits_mm: tuple[float, float] = (1.0, 2.0),
    true_rig: Rig | None = None,
    poses: int = 10,
    progress: Progress | None = None,
) -> Comparison:
    """Return a comparison of codecs on a simulated scene, and keep its pictures in `scans/` of a folder.

    rig: renders and triangulates. Without one, true_rig (default the paper's) renders, and a rig that the planar
    method calibrates from `poses` simulated poses of each side triangulates; it is kept in rig.json and used again by a
    comparison with the same optics, seed and poses. limits_mm: how near counts as complete, how far as outlier.
    Errors: as `simulate_scan` and `compare`.
    """
    truth, table = rig or true_rig or paper_rig(), dict[str, Any]()
    # A wrong name is told before a calibration is simulated.
    scene_named(scene, truth)
    folder, optics = make_folder(folder), optics or Optics()
    if rig is None:
        rig, table = _calibrated(folder, truth, optics, seed, poses, progress)
        words = f"{poses} simulated poses of each side of a board, with the noise of the scans: {origin(table)}"
    else:
        words = "the given rig renders and triangulates: there is no calibration, and so no error of one"
    # A folder for each method, also for a single one, so that another may follow.
    scans = folder / "scans" / (label(codecs[0]) if len(codecs) == 1 else "")
    made = simulate_scan(scans, truth, scene, codecs, optics=optics, seed=seed, progress=progress)
    rules = dataclasses.replace(rules or Rules(), blur_px=(optics.camera_blur_px, optics.projector_blur_px))
    with np.load(scans / "truth" / "object_mesh.npz") as mesh, np.load(scans / "truth" / "object.npz") as seen:
        vertices, faces, lit = mesh["vertices_mm"], mesh["faces"], seen["xyz_mm"]
    calibrated = bool(table)
    name = f"the true surface of the simulated scene {Path(scene).name}"
    reference = Truth(vertices, faces, name, *limits_mm, also_aligned=calibrated, seen_xyz=lit)
    return compare(made, rig, reference, rules, table, words, truth if calibrated else None, progress)


def _calibrated(
    folder: Path, truth: Rig, optics: Optics, seed: int, poses: int, progress: Progress | None
) -> tuple[Rig, Mapping[str, Any]]:
    """Return rig and provenance of the planar method, from the folder where they were made alike before."""
    kept, pictures = folder / "rig.json", folder / "calibration"
    asked = plain({"optics": dataclasses.asdict(optics), "seed": seed, "poses": poses})
    true_file = pictures / "truth" / "rig.json"
    if kept.is_file() and true_file.is_file():
        table = read_provenance(kept)
        if table.get(_MADE) == asked and _same(read_rig(true_file), truth):
            return read_rig(kept), table
    simulate_calibration(pictures, truth, poses, optics=optics, seed=seed, progress=progress)
    calibration = calibrate(pictures, progress=progress)
    table = provenance(calibration) | {_MADE: asked}
    write_rig(kept, calibration.rig, table)
    return calibration.rig, table


def _same(a: Rig, b: Rig) -> bool:
    devices = [(a.camera, b.camera), (a.projector, b.projector)]
    poses = (a.projector_from_camera, b.projector_from_camera)
    return (
        all(x.size == y.size and np.array_equal(x.parameters, y.parameters) for x, y in devices)
        and np.array_equal(poses[0].rotation, poses[1].rotation)
        and np.array_equal(poses[0].translation, poses[1].translation)
    )
