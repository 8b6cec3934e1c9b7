"""A view that is wrong altogether is rejected and named, and spoils neither rig nor start."""

from dataclasses import replace

import numpy as np
import pytest

from slkit import registry
from slkit.data import BoardView, Frames
from slkit.errors import CalibrationError
from slkit.geometry import Rig
from slkit.pipeline import solve_views
from slkit.simulation import board_views, coded_session, paper_rig, random_rig, told_targets, views_with_fault


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


def coded_views(seed: int, count: int, fault: str | None = None):
    rng = np.random.default_rng(seed)
    told, views = views_with_fault(fault, "strong", paper_rig(), rng, "coded", count)
    return registry.create(registry.load("slkit.calibrators", "local-homography"), told, "test"), views


def test_however_many_views_are_wrong_all_are_rejected():
    calibrator, views = coded_views(1, 20)
    bad = [2, 5, 9, 12, 17]
    turns = np.exp(1j * np.arange(5))
    wrong = list(views)
    for i, turn in zip(bad, turns, strict=True):
        wrong[i] = replace(views[i], projector_xy=views[i].projector_xy + 8 * np.array([turn.real, turn.imag]))
    found = solve_views(calibrator, wrong)
    assert [v.name for v in found.views if not v.used] == [views[i].name for i in bad]
    assert found.rms_joint < 1.1 * solve_views(calibrator, views).rms_joint


@pytest.mark.parametrize("spoil", [mirrored_columns, wrong_columns, on_its_head])
def test_of_five_views_one_may_be_wrong(spoil):
    calibrator, views = coded_views(2, 5)
    found = solve_views(calibrator, [spoil(v, paper_rig()) if i == 3 else v for i, v in enumerate(views)])
    assert [v.name for v in found.views if not v.used] == [views[3].name]
    assert found.rms_joint < 0.3


@pytest.mark.parametrize("fault", ["bent-board", "keystone"])
def test_a_wrong_view_does_not_hide_another_mistake(fault: str):
    calibrator, views = coded_views(3, 8, fault)
    wrong = [replace(v, projector_xy=v.projector_xy + [60, -30]) if i == 4 else v for i, v in enumerate(views)]
    named = {(f.code, f.view) for f in solve_views(calibrator, wrong).verdict.reasons}
    assert {(fault, ""), ("stale-frame", views[4].name)} <= named


def test_views_without_light_are_refused():
    calibrator, views = coded_views(4, 4)
    dark = [replace(v, projector_xy=np.full_like(v.projector_xy, np.nan)) for v in views]
    with pytest.raises(CalibrationError, match="no view tells where the projector's light falls"):
        calibrator.solve(dark)
