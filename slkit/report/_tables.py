"""The numbers of a calibration as tables of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slkit.data import Calibration, ViewPlace, ViewResult
from slkit.geometry import LENS_NAMES, MOTION_NAMES, sigmas_of
from slkit.report._canvas import NOTHING, number, significant
from slkit.report._evidence import kept_rows

_UNITS = {name: "px" if name in ("fx", "fy", "cx", "cy", "skew") else "" for name in LENS_NAMES}


@dataclass(frozen=True)
class Table:
    """A table of text. text: the columns, counted from 0, that hold words and not numbers; missing: said if no rows."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text: tuple[int, ...] = (0,)
    note: str = ""
    missing: str = ""


def views_table(calibration: Calibration) -> Table:
    """Return one line a view: its errors in px, how many of its corners were rejected, and what is to be said of it."""
    diagnosis = calibration.diagnosis
    left_out = {} if diagnosis is None else diagnosis.left_out_px
    places = {} if diagnosis is None or "camera" not in diagnosis.devices else diagnosis.devices["camera"].views
    rows = tuple(_view_row(i, v, left_out, places.get(v.name)) for i, v in enumerate(calibration.views, 1))
    columns = (
        "no.",
        "view",
        "used",
        "camera",
        "projector",
        "joint",
        "left out",
        "rejected",
        "depth mm",
        "tilt deg",
        "remark",
    )
    note = (
        "Errors are sqrt(mean(dx² + dy²)) in px. Camera and projector: each with its own pose per view. Joint: both "
        "under one pose. Left out: error of this view in a rig that was solved without it. Depth and tilt are the "
        "camera's."
    )
    return Table("Views", columns, rows, (1, 2, 10), note, "There are no views.")


def _view_row(index: int, view: ViewResult, left_out: Mapping[str, float], place: ViewPlace | None) -> tuple[str, ...]:
    kept = kept_rows(view)
    errors = (view.rms_camera, view.rms_projector, view.rms_joint, left_out.get(view.name, np.nan))
    rejected = f"{(~kept).sum()} of {len(kept)}" if view.used and len(kept) else NOTHING
    return (
        str(index),
        view.name,
        "yes" if view.used else "no",
        *(significant(e) for e in errors),
        rejected,
        NOTHING if place is None else _range(place.depth_mm, 0),
        NOTHING if place is None else number(place.tilt_deg, 0),
        view.reason,
    )


def lenses_table(calibration: Calibration) -> Table:
    """Return the parameters of both lenses with their 1 sigma, or that they were not estimated."""
    sigma = sigmas_of(calibration.covariance)
    devices = {"camera": calibration.rig.camera, "projector": calibration.rig.projector}
    values = {d: dict(zip(LENS_NAMES, lens.parameters.tolist(), strict=True)) for d, lens in devices.items()}
    rows = tuple(
        (
            name,
            *(cell for d in devices for cell in _with_sigma(values[d][name], sigma.get(f"{d}.{name}"))),
            _UNITS[name],
        )
        for name in LENS_NAMES
    )
    columns = ("parameter", "camera", "1 sigma", "projector", "1 sigma", "unit")
    return Table("Lenses", columns, rows, (0, 5), _sigma_note(sigma))


def pose_table(calibration: Calibration) -> Table:
    """Return the pose of the projector and the baseline with their 1 sigma."""
    sigma = sigmas_of(calibration.covariance)
    pose = calibration.rig.projector_from_camera
    rows: list[tuple[str, ...]] = []
    for name, value in zip(MOTION_NAMES, (*np.degrees(pose.rotation_vector), *pose.translation), strict=True):
        turns = name.startswith("r")
        spread = sigma.get(f"projector_from_camera.{name}")
        spread = np.degrees(spread) if turns and spread is not None else spread
        label = f"{'rotation vector' if turns else 'translation'} {name[1]}"
        rows.append((label, *_with_sigma(float(value), spread), "deg" if turns else "mm"))
    baseline = float(np.linalg.norm(pose.translation))
    rows.append(("baseline", *_with_sigma(baseline, _baseline_sigma(calibration)), "mm"))
    columns = ("projector from camera", "value", "1 sigma", "unit")
    return Table("Pose of the projector", columns, tuple(rows), (0, 3), _sigma_note(sigma))


def _sigma_note(sigma: Mapping[str, float]) -> str:
    if sigma:
        return "Where 1 sigma is a dash, the parameter was kept at its value."
    return "The method gives no covariance, so no 1 sigma is known."


def _baseline_sigma(calibration: Calibration) -> float | None:
    """Return the 1 sigma in mm of the distance between camera and projector, None where it is not known."""
    names = [] if calibration.covariance is None else list(calibration.covariance["parameters"])
    wanted = [f"projector_from_camera.{n}" for n in MOTION_NAMES[3:]]
    translation = calibration.rig.projector_from_camera.translation
    length = float(np.linalg.norm(translation))
    if calibration.covariance is None or length == 0 or not set(wanted) <= set(names):
        return None
    places = [names.index(n) for n in wanted]
    block = np.asarray(calibration.covariance["matrix"], dtype=np.float64)[np.ix_(places, places)]
    slope = translation / length
    return float(np.sqrt(max(slope @ block @ slope, 0)))


def _with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """Return a value and its 1 sigma, both to the second digit of sigma."""
    if sigma is None:
        return significant(value, 6), NOTHING
    if not (np.isfinite(sigma) and sigma > 0):
        return significant(value, 6), "0" if sigma == 0 else "not determined"
    digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 8))
    return number(value, digits), number(sigma, digits)


def classes_table(calibration: Calibration) -> Table:
    """Return one line a kind of residuals."""
    rows = tuple(
        (name, str(c.rows), str(c.rejected), number(c.dof, 1), significant(c.sigma_px), number(c.scale, 2))
        for name, c in calibration.classes.items()
    )
    note = (
        "1 sigma is of one coordinate, with the parameters that the residuals pay for taken off (degrees of freedom). "
        "Scale: by how much the scatter exceeds what was claimed beforehand."
    )
    columns = ("kind", "corners", "rejected", "degrees of freedom", "1 sigma px", "scale")
    return Table("Kinds of residuals", columns, rows, (0,), note, "The method does not part its residuals into kinds.")


def correlations_table(calibration: Calibration) -> Table:
    """Return the pairs of parameters that the views hardly tell apart."""
    pairs = () if calibration.diagnosis is None else calibration.diagnosis.correlations
    strongest = sorted(pairs, key=lambda p: -abs(p[2]))
    rows = tuple((a, b, number(value, 4)) for a, b, value in strongest)
    missing = "No two parameters are correlated above 0.99."
    if calibration.diagnosis is None:
        missing = "Correlations were not examined."
    note = "A correlation near 1 means that the views do not tell the two apart: tilt the board more, vary its depth."
    return Table("Correlations above 0.99", ("parameter", "and", "correlation"), rows, (0, 1), note, missing)


def geometry_table(calibration: Calibration) -> Table:
    """Return one line a device: over which depths and tilts the boards were seen."""
    devices = {} if calibration.diagnosis is None else calibration.diagnosis.devices
    rows = tuple(
        (name, _range(d.depth_mm, 0), _range(d.tilt_deg, 1), str(int(np.min(d.coverage))), str(int(np.sum(d.coverage))))
        for name, d in devices.items()
    )
    columns = ("device", "depth mm", "tilt deg", "points in the emptiest ninth", "points")
    return Table("Poses of the board", columns, rows, (0,), "", "The poses were not examined.")


def _range(ends: Sequence[float], digits: int) -> str:
    return f"{number(ends[0], digits)} to {number(ends[1], digits)}" if np.isfinite(ends).all() else NOTHING


def summary_table(calibration: Calibration) -> Table:
    """Return the numbers that the grade rests on, each with what it means."""
    diagnosis = calibration.diagnosis
    uncertainty = None if diagnosis is None else diagnosis.uncertainty
    halves = None if diagnosis is None else diagnosis.cross_validation
    used = [v for v in calibration.views if v.used]
    kept = np.concatenate([np.empty(0, np.bool_), *(kept_rows(v) for v in used)])
    nan = float("nan")
    noise = nan if diagnosis is None else diagnosis.cross_validation_noise_mm
    rows = (
        (
            "Joint reprojection error",
            f"{significant(calibration.rms_joint)} px",
            "both devices under one pose per view",
        ),
        ("Camera", f"{significant(calibration.rms_camera)} px", "with its own pose per view"),
        ("Projector", f"{significant(calibration.rms_projector)} px", "with its own pose per view"),
        (
            "Left-one-view-out error",
            f"{significant(nan if diagnosis is None else diagnosis.left_out_rms_px)} px",
            "views predicted by a rig that did not see them",
        ),
        (
            "3D uncertainty",
            f"{significant(nan if uncertainty is None else uncertainty.rms_mm)} mm",
            "1 sigma over the working volume, from the covariance",
        ),
        (
            "Two halves of the views",
            f"{significant(nan if halves is None else halves.rms_mm)} mm",
            f"how far the rigs of either half are apart, after rigid alignment; {significant(noise)} mm by their noise",
        ),
        ("Views used", f"{len(used)} of {len(calibration.views)}", "the table of views says why one was not used"),
        (
            "Points rejected",
            f"{(~kept).sum()} of {len(kept)}" if len(kept) else NOTHING,
            "single points that do not fit",
        ),
    )
    shown = tuple((name, NOTHING if value.startswith(NOTHING) else value, meaning) for name, value, meaning in rows)
    return Table("What the grade rests on", ("", "", ""), shown, (0, 2))
