"""Methods beside each other on one rig: scan every folder, measure every cloud alike, collect."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slkit.data import Frames
from slkit.errors import InputError, SlkitError
from slkit.files import Progress, merged, read_capture
from slkit.geometry import Rig
from slkit.pipeline._comparing_limits import Taken
from slkit.pipeline._comparing_measures import Measure, Rules, Scanned, covered, gap_px, radius
from slkit.pipeline._comparing_references import Mask, Nothing, Reference
from slkit.pipeline._comparing_surface import Truth
from slkit.pipeline._patterns import load_codec
from slkit.pipeline._scanning import bounds, scan, with_rig_colors
from slkit.report.comparison import Comparison, Method, file_name


def compare(
    folders: Sequence[str | Path],
    rig: Rig,
    reference: Reference | None = None,
    rules: Rules | None = None,
    provenance: Mapping[str, Any] | None = None,
    calibration: str = "",
    true_rig: Rig | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Return what each scan folder measures with one rig, by the same rules.

    reference: what the clouds are compared with, default nothing but each other. provenance: of rig.json, for the
    verdict; calibration: in words, where the rig comes from. true_rig: of a simulation, to tell what the calibration
    adds. A folder that cannot be scanned or measured is listed as failed.
    Errors: InputError where a folder is named twice, or where no folder can be compared.
    """
    reference, rules = reference or Nothing(), rules or Rules()
    names = _names(folders)
    if isinstance(reference, Truth):
        reference = reference.seen_by(rig)
    failed: dict[str, str] = {}
    scanned: list[Scanned] = []
    for folder, name in zip(folders, names, strict=True):
        _try(failed, folder, lambda f=folder, n=name: scanned.append(_scan(f, n, rig, rules, progress)))
    common, union = _shared([s.area for s in scanned], rig.camera.size)
    radius_mm = rules.radius_mm or radius([s.result.cloud for s in scanned])
    methods: list[Method] = []
    for one in scanned:
        measure = Measure(reference, rules, rig, true_rig, radius_mm, common, union)
        _try(failed, one.folder, lambda s=one, m=measure: methods.append(m.method(s)))
    if not methods:
        raise InputError("nothing could be compared: " + "; ".join(failed.values()))
    return Comparison(
        tuple(methods),
        rig,
        reference.error,
        reference.words,
        calibration or origin(provenance or {}),
        dict((provenance or {}).get("verdict") or {}),
        _settings(reference, rules, radius_mm, rig),
        os.cpu_count() or 1,
        reference.seen_xyz if isinstance(reference, Truth) else None,
        failed,
        _notes(common, union, reference, len(scanned) > 1),
    )


def _try(failed: dict[str, str], folder: str | Path, work: Callable[[], Any]) -> None:
    try:
        work()
    except SlkitError as error:
        told = str(error)
        failed[str(folder)] = told if str(folder) in told else f"{folder}: {told}"


def _names(folders: Sequence[str | Path]) -> list[str]:
    """Return what to call each folder: its name, or its path where two have the same."""
    places = [Path(folder).resolve() for folder in folders]
    for place, folder in zip(places, folders, strict=True):
        if places.count(place) > 1:
            raise InputError(f"{folder} is given twice: name every scan once")
    short = [place.stem if place.suffix == ".toml" else place.name for place in places]
    named = [name if short.count(name) == 1 else str(f) for name, f in zip(short, folders, strict=True)]
    files = [file_name(name) for name in named]
    return [n if files.count(f) == 1 else f"{n} {i}" for i, (n, f) in enumerate(zip(named, files, strict=True))]


def _scan(folder: str | Path, name: str, rig: Rig, rules: Rules, progress: Progress | None) -> Scanned:
    result = scan(folder, rig, depth=rules.depth_mm, progress=progress)
    found = read_capture(folder)
    codec = with_rig_colors(load_codec(found.codec, found.projector, found.parameters, str(found.file)), rig)
    names = codec.encode().names
    frames = found.frames(names)
    pictures = Frames.of(list(frames), frames.names)
    limits = None if rules.depth_mm is None else bounds(rig, rules.depth_mm)
    # Once more with everything in memory: the first time compiles.
    started = time.perf_counter()
    codec.decode(pictures, limits)
    seconds = min(result.seconds["decode"], time.perf_counter() - started)
    taken = Taken(names, list(pictures), codec, result.correspondences)
    parameters = merged(found.parameters, {})
    area = covered(result.cloud, rig.camera.size)
    return Scanned(name, str(folder), found.codec, parameters, result, taken, seconds, area)


def _settings(reference: Reference, rules: Rules, radius_mm: float, rig: Rig) -> dict[str, float]:
    settings = {"roughness_radius_mm": radius_mm, "gap_closed_px": 2.0 * gap_px(rig.camera.size)}
    settings |= {"camera_blur_px": rules.blur_px[0], "projector_blur_px": rules.blur_px[1]}
    if isinstance(reference, Truth):
        settings |= {"near_mm": reference.near_mm, "outlier_mm": reference.outlier_mm}
    if rules.depth_mm is not None:
        settings |= {"nearest_depth_mm": rules.depth_mm[0], "farthest_depth_mm": rules.depth_mm[1]}
    return settings


def origin(provenance: Mapping[str, Any]) -> str:
    """Return in words how a rig was calibrated."""
    if not provenance:
        return "a rig of unknown origin: its file says nothing of a calibration"
    joint = (provenance.get("rms_px") or {}).get("joint")
    views = [v for v in provenance.get("views") or () if v.get("used")]
    told = [f"calibrated by {provenance.get('method', 'an unknown method')}", f"{len(views)} views used"]
    told += [] if joint is None else [f"joint reprojection error {joint:.3f} px"]
    return ", ".join(told)


def _shared(areas: Sequence[Mask], size: tuple[int, int]) -> tuple[Mask, Mask]:
    """Return the camera pixels (h, w) that all areas have, and those that any has."""
    common, union = np.ones((size[1], size[0]), dtype=bool), np.zeros((size[1], size[0]), dtype=bool)
    for area in areas:
        common &= area
        union |= area
    return common, union


def _notes(common: Mask, union: Mask, reference: Reference, several: bool) -> tuple[str, ...]:
    share = 100 * common.sum() / max(union.sum(), 1)
    notes = [f"All methods saw {share:.0f} % of the camera pixels that any of them saw."] if several else []
    if not isinstance(reference, Truth):
        notes.append(
            "Complete: share of the camera pixels that any method saw; narrow gaps between points count as seen."
        )
    return tuple(notes)
