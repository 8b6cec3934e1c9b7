"""The verdict: a grade, and the reasons for it in order of weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.data import Calibration, Finding, Verdict, ViewResult

_GRADES = ("bad", "usable", "good")
_GOOD_PX, _USABLE_PX = 0.5, 1.5
_SPOILT = {"zoomed", "wrong-marks", "wrong-corners", "mirrored", "swapped-pictures"}
"""Mistakes after which the rig is not the one that will scan."""
_OF_A_VIEW = {"moved-board", "stale-frame", "exif-rotated", "other-size"}
"""Mistakes that spoil the view that they befell, and the rig with it where that view was used."""
_MANY = 3
"""A rig of which one view in so many is spoilt is bad."""


def verdict_of(
    rms_joint: float, results: Sequence[ViewResult], findings: Sequence[Finding], enough_views: int
) -> Verdict:
    """Return the verdict on a joint rms in px, the views' results, and the mistakes found, in order of weight.

    enough_views: that locate the projector; fewer are no good calibration.
    """
    lit = len(_locating(results))
    reasons = list(findings)
    if not rms_joint <= _GOOD_PX:
        worst = max((r for r in results if r.used), key=lambda r: np.nan_to_num(r.rms_joint))
        remedy = f"look at the worst view, {worst.name} ({worst.rms_joint:.2f} px): board moved, blurred or bent?"
        limit = "usable" if rms_joint <= _USABLE_PX else "bad"
        fault = f"the joint reprojection error is {rms_joint:.2f} px"
        reasons.append(Finding(fault, worst.name, remedy, limit=limit))
    if lit < enough_views:
        remedy = f"take at least {enough_views}, at different depths and tilts, over the whole image"
        fault = f"only {lit} view{'s' * (lit != 1)} locate{'s' * (lit == 1)} the projector"
        reasons.append(Finding(fault, "", remedy, limit="usable"))
    named = {f.view for f in findings}
    reasons += [
        Finding(r.reason, r.name, "take this view again, or remove it", limit="good")
        for r in results
        if not r.used and r.name not in named
    ]
    return _graded(reasons, results)


def judged(calibration: Calibration, findings: Sequence[Finding]) -> Verdict:
    """Return the verdict of a calibration when more is found, such as the mistakes that its pictures show."""
    known = {(f.code, f.view) for f in findings if f.code}
    named = {f.view for f in findings if f.code and f.view}
    # Residuals tell that a view is spoilt; what its pictures tell says by what.
    spoilt = {f.view for f in findings if f.code in _OF_A_VIEW | _SPOILT}

    def told(own: Finding) -> bool:
        if not own.code:
            return own.limit == "good" and own.view in named
        return (own.code, own.view) in known or (own.code in _OF_A_VIEW and own.view in spoilt)

    own = [f for f in calibration.verdict.reasons if not told(f)]
    return _graded([*findings, *own], calibration.views)


def _graded(reasons: Sequence[Finding], results: Sequence[ViewResult]) -> Verdict:
    used, lit = {r.name for r in results if r.used}, _locating(results)
    spoilt = {f.view for f in reasons if f.code in _OF_A_VIEW and f.view in used}

    def limit(finding: Finding) -> int:
        grade = finding.limit or _limit(finding, spoilt, _MANY * len(spoilt) >= len(lit))
        return _GRADES.index(grade)

    # Of what weighs alike, mistakes with a name come before other remarks.
    ordered = sorted(reasons, key=lambda f: (limit(f), not f.code))
    return Verdict(_GRADES[min(map(limit, reasons), default=2)], tuple(ordered))


def _limit(finding: Finding, spoilt: set[str], many: bool) -> str:
    """Return the best grade that a calibration with this mistake can have; spoilt: names of views that were used."""
    if finding.code in _SPOILT or (finding.view in spoilt and finding.code in _OF_A_VIEW and many):
        return "bad"
    harmless = finding.code == "turned" or (finding.code in _OF_A_VIEW and finding.view not in spoilt)
    return "good" if harmless else "usable"


def _locating(results: Sequence[ViewResult]) -> set[str]:
    """Return the names of the views that were used and locate the projector."""
    return {r.name for r in results if r.used and r.view is not None and bool(r.view.projected.any())}
