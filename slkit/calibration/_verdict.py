"""A first grade of a calibration, from its residuals and the number of its views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.data import Finding, Verdict, ViewResult

_GOOD_PX, _USABLE_PX = 0.5, 1.5
_MANY_VIEWS = 5


def verdict_of(rms_joint: float, results: Sequence[ViewResult]) -> Verdict:
    """Grade by the joint reprojection error and the number of views that locate the projector."""
    used = sum(r.used and r.view is not None and bool(r.view.projected.any()) for r in results)
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
