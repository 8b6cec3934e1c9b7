"""How far a calibration can be trusted: what predicting left-out views, and its two halves, tell of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slkit.data import Calibration, Diagnosis, Finding, VolumeMap
from slkit.errors import CalibrationError, InputError
from slkit.files import Progress
from slkit.geometry import Rig
from slkit.protocols import Calibrator

_PREDICTS = 3.0
_NOTICED_PX = 0.3
_DIFFERS, _FAR = 3.0, 20.0
"""By how many times what their noise lets expect two halves of the views differ where a rig is usable only, or bad."""
_VAGUE, _UNKNOWN = 1e-3, 5e-3
"""A rig whose points are uncertain by a larger share of their depth is usable only, or bad; and bad, one whose
halves differ by as much."""
_REPEATS, _REPEATS_PX = 0.25, 0.1
"""More than this share of the printed points, off by three sigma in all views alike, tell of an inexact print."""


def diagnose(calibration: Calibration, calibrator: Calibrator, progress: Progress | None = None) -> Calibration:
    """Return a calibration with its diagnosis: coverage, parameters, left-out views, and maps over the working volume.

    What cannot be had from so few views, or from a calibrator of another make, is left empty.
    """
    from slkit.calibration.diagnose import board_depths, diagnosed, with_left_out
    from slkit.calibration.left_out import left_out, solver_of
    from slkit.calibration.model import Model
    from slkit.calibration.verdict import judged

    diagnosis = diagnosed(calibration)
    model = getattr(calibrator, "model", None)
    if isinstance(model, Model) and model.release_mm is None:
        solver = solver_of(calibration, calibrator, model)
        errors = left_out(calibration, solver, telling(progress, "leave views out"))
        diagnosis = with_left_out(diagnosis, errors, calibration)
    depths = board_depths(calibration)
    apart, noise = _halves_apart(calibration, calibrator, depths)
    diagnosis = replace(
        diagnosis,
        uncertainty=_uncertainty(calibration.rig, depths),
        cross_validation=apart,
        cross_validation_noise_mm=noise,
    )
    verdict = judged(calibration, _findings(calibration, diagnosis))
    return replace(calibration, diagnosis=diagnosis, verdict=verdict)


def diagnosis_table(calibration: Calibration) -> dict[str, Any]:
    """Return the numbers of a diagnosis as rig.json and --json hold them; px, mm and degrees, by name."""
    table: dict[str, Any] = {
        "residuals": {
            name: {"rows": c.rows, "rejected": c.rejected, "dof": c.dof, "sigma_px": c.sigma_px, "scale": c.scale}
            for name, c in calibration.classes.items()
        }
    }
    found = calibration.diagnosis
    if found is None:
        return table
    table["devices"] = {
        name: {
            "coverage": d.coverage,
            "depth_mm": _finite(d.depth_mm),
            "tilt_deg": _finite(d.tilt_deg),
            "parameters": {n: {"value": v, "three_sigma": 3 * s} for n, (v, s) in d.parameters.items()},
            "views": {
                n: {
                    "coverage": p.coverage,
                    "depth_mm": p.depth_mm,
                    "tilt_deg": p.tilt_deg if np.isfinite(p.tilt_deg) else None,
                }
                for n, p in d.views.items()
            },
        }
        for name, d in found.devices.items()
    }
    table["correlations"] = [list(pair) for pair in found.correlations]
    table["repeating_px"] = {n: _largest(means) for n, (_, means, _) in found.repeating.items()}
    table["left_out_px"] = dict(found.left_out_px)
    known = np.isfinite(found.left_out_rms_px)
    table["left_out_rms_px"] = found.left_out_rms_px if known else None
    for name in ("uncertainty", "cross_validation"):
        volume: VolumeMap | None = getattr(found, name)
        table[name] = None if volume is None else _volume_table(volume)
    if table["cross_validation"] is not None:
        noise = found.cross_validation_noise_mm
        table["cross_validation"]["noise_mm"] = noise if np.isfinite(noise) else None
    return table


def _finite(values: tuple[float, float]) -> list[float | None]:
    """Return numbers as JSON takes them: None for what is not known."""
    return [v if np.isfinite(v) else None for v in values]


def _largest(means: Any) -> float:
    return float(np.linalg.norm(means, axis=1).max())


def _volume_table(volume: VolumeMap) -> dict[str, Any]:
    layers = [v[np.isfinite(v)] for v in volume.value_mm]
    return {
        "depths_mm": volume.depths_mm,
        "rms_mm": [float(np.sqrt(np.mean(v**2))) if len(v) else None for v in layers],
        "max_mm": [float(v.max()) if len(v) else None for v in layers],
    }


def _uncertainty(rig: Rig, depths: tuple[float, ...]) -> VolumeMap | None:
    from slkit.triangulation.uncertainty import uncertainty_map

    if not depths or rig.covariance is None:
        return None
    try:
        return uncertainty_map(rig, depths, aligned=True)
    except InputError:
        return None


def _halves_apart(
    calibration: Calibration, calibrator: Calibrator, depths: tuple[float, ...]
) -> tuple[VolumeMap | None, float]:
    """Return how far rigs from two halves of the views are apart, and how far their noise lets expect, rms in mm."""
    from slkit.calibration.left_out import halves
    from slkit.report.measure import volume_difference
    from slkit.triangulation import ray_plane

    parts = halves([r.view for r in calibration.views if r.used and r.view is not None])
    nothing = None, float("nan")
    if parts is None or not depths:
        return nothing
    try:
        a, b = (calibrator.solve(part).rig for part in parts)
        of_a, of_b = _uncertainty(a, depths), _uncertainty(b, depths)
        noise = nothing[1] if of_a is None or of_b is None else float(np.hypot(of_a.rms_mm, of_b.rms_mm))
        return volume_difference(a, b, ray_plane, depths), noise
    except (CalibrationError, InputError):
        return nothing


def _findings(calibration: Calibration, diagnosis: Diagnosis) -> list[Finding]:
    found = [
        _poor_prediction(calibration, diagnosis),
        _vague(diagnosis),
        _halves_finding(diagnosis),
        _inexact_print(diagnosis),
    ]
    return [f for f in found if f is not None]


def _poor_prediction(calibration: Calibration, diagnosis: Diagnosis) -> Finding | None:
    error, joint = diagnosis.left_out_rms_px, calibration.rms_joint
    if not error > max(_PREDICTS * joint, _NOTICED_PX):
        return None
    fault = f"a view that is left out is predicted to {error:.2f} px only, the others fit to {joint:.2f} px"
    remedy = "take more views at more different depths and tilts, or estimate fewer distortion coefficients (--select)"
    return Finding(fault, "", remedy, limit="usable")


def _vague(diagnosis: Diagnosis) -> Finding | None:
    volume = diagnosis.uncertainty
    if volume is None:
        return None
    share = volume.rms_mm / float(np.mean(volume.depths_mm))
    if not share > _VAGUE:
        return None
    fault = (
        f"over the working volume points are uncertain by {volume.rms_mm:.2g} mm, {100 * share:.1f} % of their depth"
    )
    remedy = "take more views, at more depths and tilts, whose points fill the images of both devices"
    return Finding(fault, "", remedy, limit="bad" if share > _UNKNOWN else "usable")


def _halves_finding(diagnosis: Diagnosis) -> Finding | None:
    halves, noise = diagnosis.cross_validation, diagnosis.cross_validation_noise_mm
    if halves is None or not halves.rms_mm > _DIFFERS * noise:
        return None
    fault = (
        f"rigs from two halves of the views differ by {halves.rms_mm:.2g} mm; by their noise it would be "
        f"about {noise:.2g} mm"
    )
    remedy = "something is not in the model: a bent board, a lens that moved, a print that is not exact"
    far = halves.rms_mm > min(_FAR * noise, _UNKNOWN * float(np.mean(halves.depths_mm)))
    return Finding(fault, "", remedy, limit="bad" if far else "usable")


def _inexact_print(diagnosis: Diagnosis) -> Finding | None:
    if "printed" not in diagnosis.repeating:
        return None
    _, means, sigma = diagnosis.repeating["printed"]
    off = np.linalg.norm(means, axis=1)
    beyond = off > np.maximum(3 * sigma, _REPEATS_PX)
    if beyond.mean() < _REPEATS:
        return None
    fault = f"{beyond.sum()} of {len(off)} printed points lie elsewhere in all views alike, by up to {off.max():.2f} px"
    remedy = "the print is not exact, or the board not flat: print it anew, or set model.release_mm or model.warp"
    return Finding(fault, "", remedy, limit="good")


def telling(progress: Progress | None, what: str) -> Callable[[int, int], None] | None:
    """Return a function that reports how many of how many are done of `what`, None where nobody listens."""
    return None if progress is None else lambda done, total: progress(what, done, total)
