"""Where to start from: a projector that one wrong view does not spoil."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.calibration._parameters import Array
from slkit.calibration.model import Lens
from slkit.calibration.solve import ProjectorFit, linear_projector, solve_projector
from slkit.errors import CalibrationError

_GROSS_PX, _SPOILT, _FEWEST_LIT = 3.0, 0.2, 3
"""A projector that misses its points by more than _GROSS_PX starts without one of the views where that takes the misfit
below this, and to a fifth: else it may start too far off for that view to be rejected."""


def start_projector(
    points: Sequence[Array], pixels: Sequence[Array], size: tuple[int, int], lens: Lens
) -> ProjectorFit:
    """Return the projector that all views locate, or, where one of them alone spoils it, the one of the others.

    points (n, 3) mm in the camera's frame and pixels (n, 2) px, one of each a view; size (w, h) px.
    Errors: CalibrationError where no view has points, or where they do not determine a projector.
    """
    lit = [i for i, p in enumerate(points) if len(p)]
    if not lit:
        raise CalibrationError("no view tells where the projector's light falls")

    def fit(chosen: Sequence[int], linear: bool) -> ProjectorFit | CalibrationError:
        there, seen = (np.concatenate([part[i] for i in chosen]) for part in (points, pixels))
        known = np.isfinite(np.column_stack([there, seen])).all(axis=1)
        try:
            if linear:
                return linear_projector(there[known], seen[known], size)
            return solve_projector(there[known], seen[known], size, lens=lens)
        except CalibrationError as error:
            return error

    whole = fit(lit, linear=False)
    if _misfit(whole) > _GROSS_PX and len(lit) > _FEWEST_LIT:
        without = [_misfit(fit([j for j in lit if j != i], linear=True)) for i in lit]
        del lit[int(np.argmin(without))]
        others = fit(lit, linear=False)
        if _misfit(others) < min(_SPOILT * _misfit(whole), _GROSS_PX):
            whole = others
    if isinstance(whole, CalibrationError):
        raise whole
    return whole


def _misfit(found: ProjectorFit | CalibrationError) -> float:
    # Points behind the projector have no pixel.
    return np.inf if isinstance(found, CalibrationError) or np.isnan(found.rms) else found.rms
