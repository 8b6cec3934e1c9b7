"""A view that is wrong altogether is rejected and named, and spoils neither rig nor start."""

from dataclasses import replace

import numpy as np
import pytest

from slkit import registry
from slkit.data import BoardView, Frames
from slkit.geometry import Rig
from slkit.pipeline import solve_views
from slkit.simulation import board_views, coded_session, paper_rig, random_rig, told_targets


def mirrored_columns(view: BoardView, rig: Rig) -> BoardView:
    return replace(view, projector_xy=[rig.projector.size[0], 0] + view.projector_xy * [-1, 1])


def wrong_columns(view: BoardView, rig: Rig) -> BoardView:
    return replace(view, projector_xy=view.projector_xy * [2.3, 1] % rig.projector.size)


def on_its_head(view: BoardView, rig: Rig) -> BoardView:
    return replace(view, camera_xy=np.array(rig.camera.size) - 1 - view.camera_xy)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("spoil", "code"),
    [(mirrored_columns, "stale-frame"), (wrong_columns, "stale-frame"), (on_its_head, "exif-rotated")],
)
def test_one_wrong_view_is_rejected_and_named(spoil, code: str, seed: int):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng) if seed % 2 else paper_rig()
    session = coded_session(rig, 6, Frames.of([]), rng)
    views = board_views(session, rng)
    bad = int(rng.integers(6))
    calibrator = registry.create(registry.load("slkit.calibrators", "local-homography"), told_targets(session), "test")
    found = solve_views(calibrator, [spoil(v, rig) if i == bad else v for i, v in enumerate(views)])
    assert [v.name for v in found.views if not v.used] == [views[bad].name]
    assert [(f.code, f.view) for f in found.verdict.reasons if f.code] == [(code, views[bad].name)]
    others = solve_views(calibrator, [v for i, v in enumerate(views) if i != bad])
    np.testing.assert_allclose(found.rig.projector.K, others.rig.projector.K, rtol=1e-3, atol=0.5)
    assert found.rms_joint < 1.2 * others.rms_joint
