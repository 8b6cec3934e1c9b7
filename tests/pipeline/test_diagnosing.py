"""What a diagnosis adds to a verdict: uncertain points, two halves, an inexact print, views that were left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from slkit.calibration.local_homography import LocalHomography
from slkit.calibration.model import Model
from slkit.calibration.solve import board_pose
from slkit.data import BoardView, Calibration, Capture, Finding
from slkit.geometry import Pinhole, Rig
from slkit.pipeline._diagnosing import diagnose
from slkit.simulation import paper_rig, views_with_fault

Task = tuple[LocalHomography, list[BoardView]]
UNCERTAIN, HALVES, PRINT, LEFT_OUT = "points are uncertain by", "two halves of", "printed points lie", "is left out is"


def coded(seed: int, poses: int = 10, fault: str | None = None, noise_px: float = 0.1) -> Task:
    """Return a calibrator and its views under coded light, no picture taken."""
    rng = np.random.default_rng(seed)
    told, views = views_with_fault(fault, "strong", paper_rig(), rng, "coded", poses, noise_px)
    return LocalHomography(**told), views


def diagnosed(calibrator: LocalHomography, views: Sequence[BoardView]) -> Calibration:
    return diagnose(calibrator.solve(views), calibrator)


def told(calibration: Calibration, words: str) -> list[Finding]:
    return [f for f in calibration.verdict.reasons if words in f.fault]


def test_a_clean_calibration_is_good_and_nothing_is_told():
    calibration = diagnosed(*coded(seed=1))
    assert calibration.verdict.grade == "good" and calibration.verdict.reasons == ()
    found = calibration.diagnosis
    assert found is not None and found.uncertainty is not None and found.cross_validation is not None
    assert len(found.left_out_px) == 10 and found.repeating


@pytest.mark.parametrize(
    ("grade", "seed", "poses", "fault"), [("usable", 3, 6, None), ("bad", 3, 10, "one-corner")], ids=["usable", "bad"]
)
def test_points_are_uncertain_after_weak_views(grade: str, seed: int, poses: int, fault: str | None):
    found = diagnosed(*coded(seed, poses, fault))
    assert found.diagnosis is not None and found.diagnosis.uncertainty is not None
    (finding,) = told(found, UNCERTAIN)
    assert found.verdict.grade == finding.limit == grade
    assert f"uncertain by {found.diagnosis.uncertainty.rms_mm:.2g} mm" in finding.fault


@dataclass(frozen=True)
class TwoHalves:
    """A calibrator that finds one rig from the first half of the views, and another from the second."""

    calibration: Calibration
    rigs: Iterator[Rig]

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        return []

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        return replace(self.calibration, rig=next(self.rigs))


def apart(calibration: Calibration, stretch: float) -> tuple[Calibration, float]:
    """Return the diagnosis where the halves' focal lengths differ by a share, and their distance over the noise."""
    rig, projector = calibration.rig, calibration.rig.projector
    matrix = projector.K * [[1 + stretch, 1, 1], [1, 1 + stretch, 1], [1, 1, 1]]
    other = replace(rig, projector=Pinhole(projector.size, matrix, projector.distortion))
    found = diagnose(calibration, TwoHalves(calibration, iter((rig, other))))
    assert found.diagnosis is not None and found.diagnosis.cross_validation
    return found, found.diagnosis.cross_validation.rms_mm / found.diagnosis.cross_validation_noise_mm


@pytest.mark.parametrize(
    ("ratio", "noise_px", "limit"),
    [(2.5, 0.02, None), (4, 0.02, "usable"), (15, 0.02, "usable"), (24, 0.02, "bad"), (10, 0.1, "bad")],
)
def test_halves_are_compared_with_their_noise_and_with_the_depth(ratio: float, noise_px: float, limit: str | None):
    """Ten times what the noise of the noisier views lets expect is almost 1 % of their depth."""
    calibrator, views = coded(seed=1, noise_px=noise_px)
    calibration = calibrator.solve(views)
    _, once = apart(calibration, 1e-4)
    found, reached = apart(calibration, 1e-4 * ratio / once)
    assert reached == pytest.approx(ratio, rel=0.2)
    assert [f.limit for f in told(found, HALVES)] == ([limit] if limit else [])
    assert found.verdict.grade == (limit or "good")


def test_halves_of_a_bent_board_differ():
    found = diagnosed(*coded(seed=0, poses=12, fault="bent-board"))
    (finding,) = told(found, HALVES)
    assert finding.limit != "good" and found.verdict.grade != "good"
    assert told(diagnosed(*coded(seed=0, poses=12)), HALVES) == []


def test_no_halves_of_few_views():
    found = diagnosed(*coded(seed=1, poses=5))
    assert found.diagnosis is not None and found.diagnosis.cross_validation is None
    assert told(found, HALVES) == []


@pytest.mark.parametrize(("off_mm", "noise_px", "is_told"), [(0.3, 0.1, True), (0.05, 0.01, False)])
def test_a_print_that_is_visibly_inexact_is_told_without_lowering_the_grade(
    rng: np.random.Generator, off_mm: float, noise_px: float, is_told: bool
):
    """What is clearly beyond the noise, but below a tenth of a pixel, does no harm."""
    calibrator, views = coded(seed=1, noise_px=noise_px)
    shift = off_mm * rng.normal(size=views[0].board_xy.shape)
    found = told(diagnosed(calibrator, [replace(v, board_xy=v.board_xy + shift) for v in views]), PRINT)
    assert [f.limit for f in found] == ["good"] * is_told
    for finding in found:
        off, _, of, *_ = finding.fault.split()
        assert int(of) == len(shift) and int(off) > 0.7 * len(shift)


@pytest.mark.parametrize(
    ("model", "rel"), [(Model(refine=False), 1e-3), (Model(loss="squares"), 0.01)], ids=["sequence", "joint"]
)
def test_left_out_views_are_predicted_by_what_the_method_itself_solves(model: Model, rel: float):
    calibrator, views = coded(seed=1, poses=6)
    calibrator = replace(calibrator, model=model)
    expected: dict[str, float] = {}
    for view in views:
        rig = calibrator.solve([other for other in views if other is not view]).rig
        pose, _, _ = board_pose(rig.camera, view.board_xy, view.camera_xy)
        error = rig.to_projector(pose.apply(np.pad(view.board_xy, ((0, 0), (0, 1))))) - view.projector_xy
        expected[view.name] = float(np.sqrt((error**2).sum(axis=1).mean()))
    found = diagnosed(calibrator, views).diagnosis
    assert found is not None
    assert found.left_out_px == pytest.approx(expected, rel=rel)
    assert found.left_out_rms_px == pytest.approx(np.sqrt(np.mean(np.square(list(expected.values())))), rel=rel)


def test_a_left_out_error_far_above_the_joint_one_is_told():
    found = diagnosed(*coded(seed=0, poses=3))
    assert found.diagnosis is not None and found.diagnosis.left_out_rms_px > 10 * found.rms_joint
    (finding,) = told(found, LEFT_OUT)
    assert finding.limit == "usable"
    assert f"{found.diagnosis.left_out_rms_px:.2f} px" in finding.fault and f"{found.rms_joint:.2f} px" in finding.fault
