"""From residuals to a Calibration: rms per view and device, covariance, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slkit.calibration._parameters import Array, rms
from slkit.data import BoardView, Calibration, Finding, Verdict, ViewResult
from slkit.geometry import Rig

_GOOD_PX, _USABLE_PX = 0.5, 1.5
_MANY_VIEWS = 5


def calibration(
    method: str,
    rig: Rig,
    views: Sequence[BoardView],
    own: Mapping[str, tuple[Array, Array]],
    joint: Mapping[str, tuple[Array, Array]],
    parameters: Sequence[str],
    covariance: Array,
) -> Calibration:
    """Return the calibration with its evidence.

    own, joint: for each used view's name its camera residuals (n, 2) and projector residuals (m, 2) px, under the
    view's own pose for each device, and under the shared pose.
    """
    results = tuple(
        ViewResult(v.name, False, v.problem or "not needed")
        if v.name not in own
        else ViewResult(
            v.name,
            True,
            "; ".join(v.notes),
            rms(own[v.name][0]),
            rms(own[v.name][1]),
            rms(np.concatenate(joint[v.name])),
        )
        for v in views
    )
    rms_camera = rms(np.concatenate([camera for camera, _ in own.values()]))
    rms_projector = rms(np.concatenate([projector for _, projector in own.values()]))
    rms_joint = rms(np.concatenate([residual for pair in joint.values() for residual in pair]))
    used = sum(len(projector) > 0 for _, projector in own.values())
    evidence: dict[str, Any] = {"parameters": list(parameters), "matrix": covariance}
    return Calibration(
        rig=Rig(rig.camera, rig.projector, rig.projector_from_camera, evidence, rig.photometry),
        method=method,
        views=results,
        rms_camera=rms_camera,
        rms_projector=rms_projector,
        rms_joint=rms_joint,
        covariance=evidence,
        verdict=_verdict(rms_joint, used, results),
        notes=tuple(f"{r.name}: {r.reason}" for r in results if r.reason),
    )


def _verdict(rms_joint: float, used: int, results: Sequence[ViewResult]) -> Verdict:
    """Grade by the joint reprojection error and the number of views that locate the projector."""
    reasons: list[Finding] = []
    if rms_joint > _GOOD_PX:
        worst = max((r for r in results if r.used), key=lambda r: np.nan_to_num(r.rms_joint))
        remedy = f"look at the worst view, {worst.name} ({worst.rms_joint:.2f} px): board moved, blurred or bent?"
        reasons.append(Finding(f"the joint reprojection error is {rms_joint:.2f} px", worst.name, remedy))
    if used < _MANY_VIEWS:
        remedy = f"take at least {_MANY_VIEWS}, at different depths and tilts, over the whole image"
        reasons.append(Finding(f"only {used} views locate the projector", "", remedy))
    reasons += [Finding(r.reason, r.name, "take this view again, or remove it") for r in results if not r.used]
    bad = rms_joint > _USABLE_PX
    good = rms_joint <= _GOOD_PX and used >= _MANY_VIEWS
    return Verdict("bad" if bad else "good" if good else "usable", tuple(reasons))
