"""A view whose light is wrong altogether is rejected and named, and spoils neither rig nor start."""

from dataclasses import replace

import numpy as np
import pytest

from slkit import registry
from slkit.data import Frames
from slkit.pipeline import solve_views
from slkit.simulation import board_views, coded_session, paper_rig, random_rig, told_targets


@pytest.mark.parametrize("seed", range(8))
def test_one_view_with_a_wrong_frame_is_rejected(seed: int):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng) if seed % 2 else paper_rig()
    session = coded_session(rig, 6, Frames.of([]), rng)
    views = board_views(session, rng)
    bad = int(rng.integers(6))
    # A bit of the code that is read wrongly: columns are told from the other end, or far beside where they are.
    xy = views[bad].projector_xy.copy()
    xy[:, 0] = rig.projector.size[0] - xy[:, 0] if seed < 4 else (2.3 * xy[:, 0]) % rig.projector.size[0]
    wrong = [replace(v, projector_xy=xy) if i == bad else v for i, v in enumerate(views)]
    calibrator = registry.create(registry.load("slkit.calibrators", "local-homography"), told_targets(session), "test")
    found = solve_views(calibrator, wrong)
    assert [v.name for v in found.views if not v.used] == [views[bad].name]
    assert ("stale-frame", views[bad].name) in [(f.code, f.view) for f in found.verdict.reasons]
    others = solve_views(calibrator, [v for i, v in enumerate(views) if i != bad])
    np.testing.assert_allclose(found.rig.projector.K, others.rig.projector.K, rtol=1e-3, atol=0.5)
    assert found.rms_joint < 1.2 * others.rms_joint
