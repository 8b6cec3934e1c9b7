"""Which views and which single rows do not belong to a calibration."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from slkit.calibration._normal import Problem
from slkit.calibration._parameters import Array
from slkit.calibration._residuals import Block, Masks
from slkit.calibration._scatter import row_sigma

_FALSE_ALARMS = 0.01
"""How many clean rows of a class the test for single corners may reject, on average."""
_VIEW_RATIO = 3.0
"""A view whose median distance exceeds that of all views this many times is rejected."""
_FEWEST_VIEWS = 5
"""With fewer views that have a class, a bad one cannot be told from the good."""
_CALLED = {
    "printed": "printed points",
    "marks": "marks",
    "projected": "projected corners",
    "decoded": "decoded corners",
}


def reject(
    problem: Problem, blocks: Mapping[str, Block], level: Mapping[str, float], kept: Masks, rejected: dict[int, str]
) -> bool:
    """Take out the worst view, if any is beyond the test, else single rows; return whether anything changed."""
    from scipy.stats import chi2

    distances = {
        p.name: np.linalg.norm(blocks[p.name].error / row_sigma(p, level[p.name]), axis=1) for p in problem.parts
    }
    worst = _worst_view(problem, distances, kept)
    if worst is not None:
        view, name, ratio = worst
        rejected[view] = f"its {_CALLED[name]} lie {ratio:.1f} times as far from the model as those of the other views"
        for part in problem.parts:
            kept[part.name][part.view == view] = False
        return True
    changed = False
    for part in problem.parts:
        limit = float(np.sqrt(chi2.isf(_FALSE_ALARMS / max(len(part.view), 1), 2)))
        beyond = kept[part.name] & (distances[part.name] > limit)
        kept[part.name] &= ~beyond
        changed |= bool(beyond.any())
    return changed


def _worst_view(problem: Problem, distances: Mapping[str, Array], kept: Masks) -> tuple[int, str, float] | None:
    worst = None
    for part in problem.parts:
        mask = kept[part.name]
        views, medians = _medians(distances[part.name][mask], part.view[mask])
        if len(views) < _FEWEST_VIEWS:
            continue
        ratios = medians / max(float(np.median(medians)), 1e-12)
        top = int(np.argmax(ratios))
        if ratios[top] > _VIEW_RATIO and (worst is None or ratios[top] > worst[2]):
            worst = int(views[top]), part.name, float(ratios[top])
    return worst


def _medians(values: Array, view: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the views that occur, and the upper median of the values (n,) of each."""
    views, starts, counts = np.unique(view, return_index=True, return_counts=True)
    return views, values[np.lexsort((values, view))][starts + counts // 2]
