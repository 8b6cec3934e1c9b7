"""The verdict: a grade, and the reasons for it in order of weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.data import Calibration, Finding, Verdict, ViewResult

_GRADES = ("bad", "usable", "good")
_GOOD_PX, _USABLE_PX = 0.5, 1.5
_MANY_VIEWS = 5
_SPOILT = {"zoomed", "wrong-marks", "wrong-corners", "mirrored", "swapped-pictures"}
"""Mistakes after which the rig is not the one that will scan."""
_MENDED = {"moved-board", "stale-frame", "exif-rotated", "other-size", "turned", ""}
"""Mistakes of single views, which are left out, and remarks."""


def verdict_of(rms_joint: float, results: Sequence[ViewResult], findings: Sequence[Finding]) -> Verdict:
    """Return the verdict on a joint rms in px, the views' results, and the mistakes found, in order of weight."""
    used = sum(r.used and r.view is not None and bool(r.view.projected.any()) for r in results)
    reasons = list(findings)
    if rms_joint > _GOOD_PX:
        worst = max((r for r in results if r.used), key=lambda r: np.nan_to_num(r.rms_joint))
        remedy = f"look at the worst view, {worst.name} ({worst.rms_joint:.2f} px): board moved, blurred or bent?"
        reasons.append(Finding(f"the joint reprojection error is {rms_joint:.2f} px", worst.name, remedy))
    if used < _MANY_VIEWS:
        remedy = f"take at least {_MANY_VIEWS}, at different depths and tilts, over the whole image"
        reasons.append(Finding(f"only {used} views locate the projector", "", remedy))
    named = {f.view for f in findings}
    reasons += [
        Finding(r.reason, r.name, "take this view again, or remove it")
        for r in results
        if not r.used and r.name not in named
    ]
    limits = [_limit(f) for f in findings]
    limits.append("bad" if rms_joint > _USABLE_PX else "usable" if rms_joint > _GOOD_PX else "good")
    limits.append("usable" if used < _MANY_VIEWS else "good")
    return Verdict(min(limits, key=_GRADES.index), tuple(sorted(reasons, key=_weight)))


def judged(calibration: Calibration, findings: Sequence[Finding]) -> Verdict:
    """Return the verdict of a calibration when more mistakes are known, such as those that its pictures show."""
    if not findings:
        return calibration.verdict
    known = {(f.code, f.view) for f in findings if f.code}
    own = [f for f in calibration.verdict.reasons if not f.code or (f.code, f.view) not in known]
    grade = min([calibration.verdict.grade, *(_limit(f) for f in findings)], key=_GRADES.index)
    return Verdict(grade, tuple(sorted([*findings, *own], key=_weight)))


def _limit(finding: Finding) -> str:
    """Return the best grade that a calibration with this mistake can have."""
    return "bad" if finding.code in _SPOILT else "good" if finding.code in _MENDED else "usable"


def _weight(finding: Finding) -> int:
    """Return the place of a finding among others: what spoils first, remarks last."""
    return _GRADES.index(_limit(finding)) + 3 * (not finding.code)
