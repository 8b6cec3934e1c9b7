"""What the covariance predicts of the 3D error, against the error of many simulated calibrations."""

from __future__ import annotations

import numpy as np
import pytest

from slkit.calibration.planar import Planar
from slkit.geometry import Rig
from slkit.report.measure import volume_error
from slkit.targets import ProjectedCheckerboard
from slkit.triangulation import ray_plane, uncertainty_map

from . import synthetic

CALIBRATIONS, NOISE_PX, STEP_PX = 50, 0.1, 64
DEPTHS_MM = (1000.0, 1150.0, 1300.0)
PATTERN = ProjectedCheckerboard.for_projector((1024, 768))


def errors(rig: Rig, seed: int) -> list[float]:
    """Observed over predicted 3D error over the volume of one calibration, as is and after alignment."""
    rng = np.random.default_rng(seed)
    views = synthetic.printed_views(rig, rng, 12, NOISE_PX) + synthetic.white_views(rig, rng, 10, NOISE_PX, PATTERN)
    found = Planar((1024, 768), synthetic.PRINTED, synthetic.MARKS, PATTERN).solve(views).rig
    observed = volume_error(found, rig, ray_plane, DEPTHS_MM, STEP_PX, axis=0)
    assert observed.missing == 0
    as_is, aligned = (uncertainty_map(found, DEPTHS_MM, a, 0, STEP_PX).rms_mm for a in (False, True))
    return [observed.rms_mm / as_is, observed.aligned_mm / aligned]


@pytest.mark.parametrize("drawn", [False, True], ids=["paper's rig", "rigs drawn at random"])
def test_the_3d_error_is_predicted(drawn):
    """50 calibrations: the root of the mean square of observed over predicted is 1 where the prediction is right."""
    ratios = [
        errors(synthetic.paper_rig(np.random.default_rng(7000 + seed) if drawn else None), 100 + seed)
        for seed in range(CALIBRATIONS)
    ]
    as_is, aligned = np.sqrt(np.mean(np.square(ratios), axis=0))
    low, high = np.percentile(ratios, [5, 95], axis=0).round(2).tolist()
    print(f"3D error, observed / predicted, {CALIBRATIONS} calibrations: as is {as_is:.3f}, aligned {aligned:.3f}")
    print(f"nine of ten single ones: as is {low[0]} to {high[0]}, aligned {low[1]} to {high[1]}")
    assert 0.8 < as_is < 1.2
    assert 0.8 < aligned < 1.2
