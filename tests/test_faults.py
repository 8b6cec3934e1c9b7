"""Every mistake of docs/faults.md, one seed of each, is named; a clean calibration raises no alarm."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import rq

from slkit import pipeline
from slkit.data.faults import FAULT_CODES
from slkit.errors import CalibrationError
from slkit.simulation import FAULTS, with_fault

PAGE = Path(__file__).parent.parent / "docs" / "faults.md"
SEED = 2


def driver():
    spec = importlib.util.spec_from_file_location("faults", PAGE.with_suffix(".py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FAULTS_PY = driver()


@pytest.fixture(scope="module")
def bench():
    """Return a function that gives the bench of a method with pictures or without; each is made once."""
    made = {}

    def get(method: str, pictures: bool):
        if (method, pictures) not in made:
            made[method, pictures] = FAULTS_PY.Bench(SEED, method, pictures, poses=4 if pictures else 8)
        return made[method, pictures]

    return get


CASES = [(m, n) for m in ("planar", "coded") for n, f in FAULTS.items() if m in f.methods]
COMPUTED = [case for case in CASES if case[1] not in FAULTS_PY.RENDERED]
RENDERED = [case for case in CASES if case[1] in FAULTS_PY.RENDERED]


@pytest.mark.parametrize("strong", [False, True], ids=["mild", "strong"])
@pytest.mark.parametrize(("method", "name"), COMPUTED)
def test_a_mistake_of_geometry_is_named(bench, method: str, name: str, strong: bool):
    views = bench(method, False)
    assert name in views.codes(views.faulty(name, strong))


@pytest.mark.parametrize(("method", "name"), RENDERED)
def test_a_mistake_that_pictures_show_is_named(bench, method: str, name: str):
    pictures = bench(method, True)
    assert name in pictures.codes(pictures.faulty(name, strong=False))


@pytest.mark.parametrize("pictures", [False, True], ids=["computed", "rendered"])
@pytest.mark.parametrize("method", ["planar", "coded"])
def test_a_clean_calibration_raises_no_alarm(bench, method: str, pictures: bool):
    clean = bench(method, pictures)
    assert clean.codes(clean.clean) == set()


def test_a_wrong_square_does_not_change_the_rig_of_a_two_sided_board(bench):
    views = bench("planar", False)
    right, wrong = (views.calibrate(s).rig for s in (views.clean, views.faulty("wrong-square", True)))
    np.testing.assert_allclose(wrong.projector.K, right.projector.K, rtol=1e-4)
    np.testing.assert_allclose(
        wrong.projector_from_camera.translation, right.projector_from_camera.translation, rtol=1e-3
    )


def test_a_refusal_says_what_the_pictures_show(bench):
    pictures = bench("planar", True)
    with pytest.raises(CalibrationError, match="The pictures show: .*are exchanged") as caught:
        pictures.calibrate(pictures.faulty("swapped-pictures", True))
    assert {finding.code for finding in caught.value.findings} == {"swapped-pictures"}


def test_the_page_explains_every_code():
    text = PAGE.read_text(encoding="utf-8").replace("`", "")
    assert set(FAULTS) == set(FAULT_CODES) - {"camera-skew"}
    for name, fault in FAULTS.items():
        assert f"| {name} | {fault.sentence}" in text, name


def test_a_faulty_folder_is_written_and_read(tmp_path: Path, bench):
    rig = bench("planar", True).clean.rig
    pipeline.simulate_calibration(tmp_path, rig, 3, seed=1, fault="swapped-pictures", strength="strong")
    with pytest.raises(CalibrationError, match="are exchanged"):
        pipeline.calibrate(tmp_path)


@pytest.mark.parametrize("number", [0, 2])
def test_a_mark_misplaced_in_the_description_is_named_by_its_place(bench, number: int):
    views = bench("planar", False)
    places = views.clean.marks.points()
    places[number] += (10.0, -4.0)
    x, y = places[number]
    typed = replace(views.clean, told={"marks": {"xy_mm": tuple((float(x), float(y)) for x, y in places)}})
    (finding,) = (f for f in views.calibrate(typed).verdict.reasons if f.code)
    assert finding.code == "wrong-marks"
    assert finding.fault.startswith(f"the mark at ({x:g}, {y:g}) mm seems 1")


@pytest.mark.parametrize(("strength", "seed"), [("mild", 0), ("strong", 4)])
@pytest.mark.parametrize("method", ["planar", "coded"])
def test_keystone_alone_is_measured_and_drags_nothing_along(bench, method: str, strength: str, seed: int):
    """Without its lens the warped projector is another one with skew, and turned; with it, nearly so."""
    views = bench(method, False)
    keystone = with_fault(views.clean, "keystone", strength, np.random.default_rng(seed))
    upper = rq(np.linalg.inv(keystone.warp) @ keystone.rig.projector.K)[0]
    upper *= np.sign(np.diag(upper))
    first, *others = views.calibrate(keystone).verdict.reasons
    assert first.code == "keystone"
    told = float(first.fault.partition("skewed by ")[2].split()[0])
    assert told == pytest.approx(upper[0, 1] / upper[2, 2], rel=0.25, abs=2)
    assert [f.code for f in others if f.code] == []


def test_a_pattern_in_one_corner_of_the_projector_s_image_is_told_of_the_projector(bench):
    views = bench("planar", False)
    small = replace(views.clean, projected=replace(views.clean.projected, step_px=20.0))
    (finding,) = views.calibrate(small).verdict.reasons
    assert finding.code == "one-corner" and "of the projector's image" in finding.fault
    assert "larger pattern" in finding.remedy
