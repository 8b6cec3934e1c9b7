"""Which distortion coefficients a lens needs: measured by predicting views that were left out, not guessed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slkit.calibration._parameters import Array, rms
from slkit.calibration.left_out import Solver, left_out
from slkit.calibration.model import Model
from slkit.data import Calibration
from slkit.errors import CalibrationError

SETS = ((), ("k1",), ("k1", "k2"), ("k1", "k2", "p1", "p2"), ("k1", "k2", "p1", "p2", "k3"))
"""The sets that are compared, from the leanest to the richest."""
_SIGMAS, _NEAR = 2.0, 1.2


@dataclass(frozen=True)
class Candidate:
    """One distortion set of one device, and how well rigs with it predict views that were left out.

    left_out_px: rms over all views; worse: how much the logarithm of a view's squared error exceeds that with the best
    set, on the mean over the views and in 1 sigma of that mean.
    """

    device: str
    distortion: tuple[str, ...]
    left_out_px: float
    worse: float
    taken: bool


def select_distortion(
    calibration: Calibration,
    model: Model,
    solver: Callable[[Model], Solver],
    tell: Callable[[int, int], None] | None = None,
) -> tuple[Model, tuple[Candidate, ...]]:
    """Return the model with the distortion sets that predict best, and all that were compared.

    The camera's set is chosen first, then the projector's. Of sets that predict as well as the best within two sigma,
    and within a fifth of its error, the leanest is taken: what a coefficient adds without need it adds to the errors
    where no points were. solver: what makes rigs of some of the views with a model.
    Errors: CalibrationError where no view can be left out.
    """
    candidates: list[Candidate] = []
    for step, device in enumerate(("camera", "projector")):
        lens = getattr(model, device)
        models = [replace(model, **{device: replace(lens, distortion=chosen)}) for chosen in SETS]
        squares: list[dict[str, float]] = []
        rms_px: list[float] = []
        for index, tried in enumerate(models):
            if tell is not None:
                tell(step * len(SETS) + index, 2 * len(SETS))
            errors = left_out(calibration, solver(tried))
            squares.append({name: float((e**2).sum(axis=1).mean()) for name, e in errors.items()})
            rms_px.append(rms(np.concatenate([*errors.values(), np.empty((0, 2))])))
        if not squares[-1]:
            raise CalibrationError("there are too few views to leave one out: take more, or choose the model yourself")
        best = int(np.nanargmin(rms_px))
        worse = [_worse(s, squares[best]) for s in squares]
        near = [error <= _NEAR * rms_px[best] for error in rms_px]
        taken = next(i for i, w in enumerate(worse) if w <= _SIGMAS and near[i])
        candidates += [Candidate(device, chosen, rms_px[i], worse[i], i == taken) for i, chosen in enumerate(SETS)]
        model = models[taken]
    return model, tuple(candidates)


def _worse(squares: dict[str, float], best: dict[str, float]) -> float:
    """Return the mean logarithm of the ratio of squared errors over the views in 1 sigma of that mean.

    Ratios, because views differ: where one is predicted far worse than another the differences would drown in its own.
    """
    if not set(best) <= set(squares):
        return float("inf")
    ratio: Array = np.log([max(squares[name], 1e-300) / max(best[name], 1e-300) for name in best])
    spread = float(ratio.std(ddof=1)) / np.sqrt(len(ratio)) if len(ratio) > 1 else 0.0
    mean = float(ratio.mean())
    return 0.0 if mean <= 0 else float(mean / spread) if spread > 0 else float("inf")
