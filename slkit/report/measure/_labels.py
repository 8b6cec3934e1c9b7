"""Decoded projector positions against the true ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slkit.data import Correspondences
from slkit.errors import InputError
from slkit.report.measure._points import check_positive, rms_of


@dataclass(frozen=True)
class LabelError:
    """How right the decoded positions of one projector axis are.

    points: how many were compared; unknown: decoded where the truth has no position, compared with nothing; wrong:
    share of the compared ones that are off by more than half a period; rms_px: error of the others in projector px.
    NaN where there is nothing to measure.
    """

    points: int
    unknown: int
    wrong: float
    rms_px: float


def label_error(
    correspondences: Correspondences, true_projector_xy: npt.ArrayLike, period_px: float, axis: int = 0
) -> LabelError:
    """Return the share of wrong labels, those off by more than half a period, and the error of the right ones.

    true_projector_xy (m, 2) px: the true projector position at the camera position of each correspondence, NaN where
    the projector does not reach; period_px: the distance at which the pattern looks the same, or of its lines; axis 0:
    columns, 1: rows. Errors: InputError for another shape, an axis that does not exist, a period that is not positive.
    """
    truth = np.asarray(true_projector_xy, dtype=np.float64)
    if truth.shape != correspondences.projector_xy.shape:
        raise InputError(
            f"true_projector_xy must have a row for each correspondence, the shape "
            f"{correspondences.projector_xy.shape}, not {truth.shape}"
        )
    if axis not in (0, 1):
        raise InputError(f"axis must be 0 for columns or 1 for rows, not {axis}")
    check_positive(period_px, "period_px")
    found = correspondences.projector_xy[:, axis].astype(np.float64)
    decoded = np.isfinite(found)
    error = (found - truth[:, axis])[decoded]
    known = np.isfinite(error)
    error = error[known]
    right = np.abs(error) <= period_px / 2
    wrong = 1 - float(right.mean()) if len(error) else np.nan
    return LabelError(len(error), int((~known).sum()), wrong, rms_of(error[right]))
