"""Tables: numbers with as many digits as they deserve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slkit.report._canvas import NOTHING, number, significant
from slkit.report._tables import _with_sigma as with_sigma
from slkit.report._tables import (
    classes_table,
    correlations_table,
    lenses_table,
    pose_table,
    summary_table,
    views_table,
)


def read(text: str) -> float:
    return float(text.replace("−", "-"))


@given(value=st.floats(-1e4, 1e4), sigma=st.floats(1e-6, 1e3))
def test_a_value_has_the_digits_that_its_sigma_allows(value, sigma):
    shown, spread = with_sigma(value, sigma)
    digits = len(shown.partition(".")[2])
    assert abs(read(shown) - value) <= 0.5 * 10.0**-digits + 1e-9
    assert read(spread) == pytest.approx(sigma, rel=0.051)


@pytest.mark.parametrize(
    ("sigma", "shown"),
    [(None, NOTHING), (0.0, "0"), (float("inf"), "not determined"), (float("nan"), "not determined")],
)
def test_sigmas_that_are_no_number(sigma, shown):
    assert with_sigma(-12.5, sigma) == ("−12.5000", shown)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_not_finite_is_a_dash(value):
    assert number(value, 3) == significant(value) == NOTHING


def test_the_lenses_stand_beside_each_other(calibration):
    rows = {row[0]: row[1:] for row in lenses_table(calibration).rows}
    assert rows["fx"] == ("900.00", "0.50", "1900.0", "1.5", "px")
    assert rows["k3"] == ("0", NOTHING, "0", NOTHING, "")
    assert list(rows) == ["fx", "fy", "cx", "cy", "skew", "k1", "k2", "p1", "p2", "k3"]


def test_the_pose_is_in_degrees_and_millimetres(calibration):
    rows = {row[0]: row[1:] for row in pose_table(calibration).rows}
    pose = calibration.rig.projector_from_camera
    assert read(rows["rotation vector y"][0]) == pytest.approx(np.degrees(pose.rotation_vector[1]), abs=1e-3)
    assert read(rows["rotation vector y"][1]) == pytest.approx(np.degrees(1e-3), abs=1e-3)
    assert rows["baseline"] == ("500.00", "0.20", "mm")


def test_the_baseline_knows_how_its_parts_move_together(calibration):
    names = [f"projector_from_camera.{n}" for n in ("tx", "ty", "tz")]
    t = calibration.rig.projector_from_camera.translation
    along = np.outer(t, t) / (t @ t)
    for matrix, sigma in ((0.09 * along, "0.30"), (0.09 * (np.eye(3) - along), "0")):
        changed = replace(calibration, covariance={"parameters": names, "matrix": matrix})
        shown = {row[0]: row[2] for row in pose_table(changed).rows}["baseline"]
        assert shown == sigma or (sigma == "0" and read(shown) < 1e-6)


def test_views_are_numbered_and_left_out_errors_are_theirs(calibration):
    rows = views_table(calibration).rows
    assert [row[0] for row in rows] == [str(n) for n in range(1, 9)]
    assert rows[0] == ("1", "side_a/00", "yes", "0.212", NOTHING, "0.212", "0.250", "1 of 63", NOTHING, NOTHING, "")
    assert rows[-1] == ("8", "side_b/lost", "no", *[NOTHING] * 7, "no marks were found")


def test_the_strongest_correlation_comes_first(calibration):
    assert calibration.diagnosis is not None
    pairs = (("a", "b", 0.991), ("c", "d", -0.999))
    changed = replace(calibration, diagnosis=replace(calibration.diagnosis, correlations=pairs))
    assert correlations_table(changed).rows == (("c", "d", "−0.9990"), ("a", "b", "0.9910"))


def test_the_summary_counts(calibration, bare):
    rows = {row[0]: row[1] for row in summary_table(calibration).rows}
    assert rows["Views used"] == "7 of 8"
    assert rows["Points rejected"] == "7 of 693"
    assert rows["3D uncertainty"].endswith(" mm")
    rows = {row[0]: row[1] for row in summary_table(bare).rows}
    assert rows["3D uncertainty"] == rows["Two halves of the views"] == rows["Points rejected"] == NOTHING


def test_kinds_of_residuals(calibration):
    assert classes_table(calibration).rows[1] == ("projected", "252", "4", "470.0", "0.149", "1.10")


@given(value=st.floats(-1e6, 1e6))
def test_significant_digits_survive_without_an_exponent(value):
    shown = significant(value)
    assert "e" not in shown
    assert read(shown) == pytest.approx(value, rel=0.0051, abs=1e-9)


@pytest.mark.parametrize(
    ("value", "shown"), [(0.0028, "0.00280"), (0.21, "0.210"), (12.345, "12.3"), (1234.5, "1234"), (0.0, "0")]
)
def test_significant_digits(value, shown):
    assert significant(value) == shown
