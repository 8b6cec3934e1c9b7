"""The verdict: which grade follows from which findings, and in which order they are told."""

import numpy as np
import pytest

from slkit.calibration.verdict import judged, verdict_of
from slkit.data import BoardView, Calibration, Finding, Verdict, ViewResult

from . import synthetic

ENOUGH = 5
OF_A_VIEW = ("moved-board", "stale-frame", "exif-rotated", "other-size")
NAN = float("nan")


def result(name: str, used: bool = True, lit: bool = True, rms_joint: float = 0.1, reason: str = "") -> ViewResult:
    silent, seen = np.full((4, 2), np.nan), np.ones((4, 2))
    view = BoardView(name, (8, 6), seen, seen, seen if lit else silent, silent)
    return ViewResult(name, used, reason, rms_joint=rms_joint if used else NAN, view=view if used else None)


def results(count: int, prefix: str = "b", lit: bool = True) -> list[ViewResult]:
    return [result(f"{prefix}{i}", lit=lit) for i in range(count)]


def named(code: str, view: str = "", limit: str = "") -> Finding:
    return Finding(f"{code or 'a remark'} {view}", view, "do it again", code, limit)


def verdict(findings: list[Finding], views: list[ViewResult] | None = None, rms_joint: float = 0.1) -> Verdict:
    return verdict_of(rms_joint, results(9) if views is None else views, findings, ENOUGH)


def calibration(findings: list[Finding], views: list[ViewResult]) -> Calibration:
    own = verdict(findings, views)
    return Calibration(synthetic.paper_rig(), "planar", tuple(views), 0.1, 0.1, 0.1, None, own)


def test_nothing_found_is_good():
    assert verdict([]) == Verdict("good")


@pytest.mark.parametrize("code", OF_A_VIEW)
@pytest.mark.parametrize(("spoilt", "grade"), [(1, "usable"), (2, "usable"), (3, "bad"), (9, "bad")])
def test_views_that_are_spoilt_and_used_lower_the_grade(code: str, spoilt: int, grade: str):
    assert verdict([named(code, f"b{i}") for i in range(spoilt)]).grade == grade


def test_a_third_is_counted_over_views_that_locate_the_projector_each_once():
    side_a = results(9, "a", lit=False)
    of_three = [named("moved-board", "b0"), named("stale-frame", "b1"), named("moved-board", "b2")]
    assert verdict(of_three, side_a + results(9)).grade == "bad"
    of_two = [named("moved-board", "b0"), named("stale-frame", "b0"), named("stale-frame", "b1")]
    assert verdict(of_two, side_a + results(9)).grade == "usable"


@pytest.mark.parametrize("code", OF_A_VIEW)
def test_spoilt_views_that_were_left_out_do_no_harm(code: str):
    out = [result(f"out{i}", used=False, reason="too far out") for i in range(6)]
    findings = [named(code, v.name) for v in out]
    found = verdict(findings, results(6) + out)
    assert found == Verdict("good", tuple(findings))


@pytest.mark.parametrize(
    ("rms_joint", "grade"), [(0.5, "good"), (0.51, "usable"), (1.5, "usable"), (1.51, "bad"), (40.0, "bad")]
)
def test_the_joint_error_limits_the_grade_and_names_the_worst_view(rms_joint: float, grade: str):
    views = [result("silent", rms_joint=NAN), *results(6), result("worst", rms_joint=3.0), result("out", used=False)]
    found = verdict([], views, rms_joint)
    assert found.grade == grade
    remarks = [f for f in found.reasons if f.view == "worst"]
    assert len(remarks) == (grade != "good")
    for remark in remarks:
        assert f"{rms_joint:.2f} px" in remark.fault and "3.00 px" in remark.remedy


@pytest.mark.parametrize(("lit", "words"), [(4, "only 4 views locate the"), (1, "only 1 view locates the"), (5, "")])
def test_few_views_that_locate_the_projector_are_usable_at_best(lit: int, words: str):
    found = verdict([], results(9, "a", lit=False) + results(lit))
    assert found.grade == ("usable" if words else "good")
    assert [f.fault.startswith(words) for f in found.reasons] == [True] * bool(words)


def test_unused_views_are_told_once_and_do_not_lower_the_grade():
    lost = [result("lost", used=False, reason="no board"), result("moved", used=False, reason="too far out")]
    found = verdict([named("moved-board", "moved")], results(6) + lost)
    assert found.grade == "good"
    assert [(f.view, f.code) for f in found.reasons] == [("moved", "moved-board"), ("lost", "")]
    assert found.reasons[1].fault == "no board"


@pytest.mark.parametrize(
    ("grade", "codes"),
    [
        ("bad", ("zoomed", "wrong-marks", "wrong-corners", "mirrored", "swapped-pictures")),
        ("usable", ("keystone", "bent-board", "wrong-square", "blurred", "one-corner")),
        ("good", ("turned",)),
    ],
)
def test_a_code_limits_the_grade_unless_the_finding_says_its_limit(grade: str, codes: tuple[str, ...]):
    for code in codes:
        assert verdict([named(code)]).grade == grade, code
        for limit in ("good", "usable", "bad"):
            assert verdict([named(code, limit=limit)]).grade == limit, code


def test_a_limit_goes_before_what_the_view_says():
    assert verdict([named("moved-board", f"b{i}", "good") for i in range(9)]).grade == "good"
    assert verdict([named("moved-board", "not used", "bad")]).grade == "bad"


def test_reasons_that_limit_most_come_first_and_names_before_remarks():
    findings = [
        named("", limit="good"),
        named("turned"),
        named("", limit="usable"),
        named("keystone"),
        named("blurred", "b1"),
        named("", limit="bad"),
        named("mirrored"),
    ]
    told = [f.code or f.limit for f in verdict(findings).reasons]
    assert told == ["mirrored", "bad", "keystone", "blurred", "usable", "turned", "good"]


def test_what_is_found_later_joins_the_calibration_s_own_reasons():
    views = [*results(9), result("lost", used=False, reason="no board")]
    before = calibration([named("keystone")], views)
    found = judged(before, [named("mirrored"), named("turned")])
    assert found.grade == "bad"
    assert [f.code or f.view for f in found.reasons] == ["mirrored", "keystone", "turned", "lost"]
    assert judged(before, []) == before.verdict


def test_a_mistake_of_a_view_is_not_told_twice_but_remarks_are():
    own = [named("zoomed", "b0"), named("zoomed", "b1"), named("", limit="good"), named("mirrored")]
    later = [Finding("as the pictures show", "b0", "leave it alone", "zoomed"), named("mirrored"), named("")]
    told = judged(calibration(own, results(9)), later).reasons
    assert [(f.code, f.view) for f in told if f.code] == [("zoomed", "b0"), ("mirrored", ""), ("zoomed", "b1")]
    assert told[0].fault == "as the pictures show"
    assert sum(not f.code for f in told) == 2


def test_what_the_pictures_tell_of_a_view_replaces_what_its_residuals_suggest():
    own = [named("zoomed", "b0"), named("moved-board", "b0"), named("stale-frame", "b1"), named("moved-board", "b2")]
    later = [named("exif-rotated", "b0"), named("blurred", "b1"), named("swapped-pictures", "b2"), named("turned")]
    told = judged(calibration(own, results(12)), later).reasons
    assert [(f.code, f.view) for f in told] == [
        ("swapped-pictures", "b2"),
        ("zoomed", "b0"),
        ("exif-rotated", "b0"),
        ("blurred", "b1"),
        ("stale-frame", "b1"),
        ("turned", ""),
    ]


def test_what_is_found_later_never_raises_the_grade():
    own = [named("moved-board", f"b{i}") for i in range(3)]
    before = calibration(own, results(9))
    for code in ("blurred", "saturated", "exif-rotated", "stale-frame"):
        assert judged(before, [named(code, f"b{i}") for i in range(3)]).grade == before.verdict.grade == "bad"


def test_a_view_that_is_not_used_and_named_later_is_told_once():
    before = calibration([], [*results(9), result("lost", used=False, reason="no board")])
    told = judged(before, [named("saturated", "lost")]).reasons
    assert [(f.code, f.view) for f in told] == [("saturated", "lost")]


def test_spoilt_views_are_counted_over_what_was_found_before_and_later():
    before = calibration([named("moved-board", "b0"), named("moved-board", "b1")], results(9))
    assert before.verdict.grade == "usable"
    assert judged(before, [named("stale-frame", "b1")]).grade == "usable"
    assert judged(before, [named("stale-frame", "b2")]).grade == "bad"
