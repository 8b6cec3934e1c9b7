"""The page: what it says, that it stands alone, and that nothing absent breaks it."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import matplotlib
import numpy as np
import pytest

from slkit.data import Calibration, Finding, Verdict, ViewResult
from slkit.report.html import Report, calibration_report

EXPECTED = {
    "rig-3d", "rig-from-above", "rig-from-the-side", "rays", "repeating-1",
    *(f"{kind}-{device}" for kind in ("residuals", "residual-field", "coverage", "distortion")
      for device in ("camera", "projector")),
    *(f"{kind}-{n}" for kind in ("uncertainty", "cross-validation") for n in (1, 2, 3)),
    *(f"corners-{n:02d}" for n in range(1, 14)),
}  # fmt: skip


class Page(HTMLParser):
    """Text, and what a page refers to; complains of tags that do not close."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += f"{data} "

    @property
    def words(self) -> str:
        return " ".join(self.text.split())


@pytest.fixture(scope="module")
def report(calibration: Calibration, pictures: list) -> Report:
    return calibration_report(calibration, pictures, "rig on the bench")


def test_every_figure_is_there_and_is_a_picture(report):
    assert set(report.pictures) == {f"{name}.png" for name in EXPECTED}
    for name, png in report.pictures.items():
        picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape[1] == (440 if name.startswith("corners") else 1000), name
        assert picture.std() > 5, name


def test_the_page_needs_nothing_else(report):
    page = Page(report.html)
    assert len(page.links) == len(report.pictures)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "@import" not in report.html
    assert "url(" not in report.html
    assert len(report.html) < 8e6


def test_the_verdict_comes_first(report):
    words = Page(report.html).words
    verdict = words.index("Verdict: usable")
    assert (
        verdict
        < words.index("The board is bent by 2 mm. Glue it to a flat plate.")
        < words.index("What the grade rests on")
    )
    assert "Joint reprojection error 0.212 px" in words
    assert "Left-one-view-out error 0.250 px" in words
    assert "Views used 7 of 8" in words
    assert "rig on the bench" in words


def test_reasons_keep_their_order(bare):
    reasons = tuple(Finding(f"fault {i}", "", f"remedy {i}") for i in range(5))
    words = Page(calibration_report(replace(bare, verdict=Verdict("bad", reasons))).html).words
    places = [words.index(f"Fault {i}. Remedy {i}.") for i in range(5)]
    assert places == sorted(places)
    assert "Do not measure with this rig" in words


def test_names_and_reasons_cannot_become_markup(bare):
    wicked = "<script>alert('x')</script> & $\\frac$ \"é漢"
    views = (ViewResult(wicked, False, wicked), *bare.views)
    verdict = Verdict("usable", (Finding(wicked, wicked, wicked),))
    page = Page(calibration_report(replace(bare, views=views, verdict=verdict, notes=(wicked,)), title=wicked).html)
    assert "script" not in page.tags
    assert page.text.count(wicked) == 8


def test_what_a_method_does_not_give_is_said(bare):
    report = calibration_report(bare)
    assert set(report.pictures) == {"distortion-camera.png", "distortion-projector.png"}
    words = Page(report.html).words
    for sentence in (
        "No view has a pose, so the rig is not drawn.",
        "Camera: no residuals are known.",
        "Projector: no points were used.",
        "No 3D uncertainty is known",
        "No cross-validation is known",
        "The pictures are not at hand",
        "The method gives no covariance",
        "The poses were not examined.",
    ):
        assert sentence in words
    assert "nan" not in words.lower().split()
    assert "None" not in words.split()


def test_no_views_at_all(bare):
    assert "There are no views." in Page(calibration_report(replace(bare, views=())).html).text


def test_numbers_that_are_not_known_are_dashes(bare):
    nan = float("nan")
    unknown = replace(bare, rms_camera=nan, rms_projector=nan, rms_joint=nan)
    assert "Joint reprojection error – both" in Page(calibration_report(unknown).html).words


def test_notes_are_told_once(bare):
    noted = replace(bare, notes=("side_b/lost: no marks were found", "k3 was kept at 0"))
    text = Page(calibration_report(noted).html).text
    assert text.count("no marks were found") == 1
    assert text.count("k3 was kept at 0") == 1


def test_a_hundred_views_make_a_page_of_moderate_size(make_calibration, pictures):
    many = make_calibration(40, 60)
    captures = [replace(pictures[-2], name=v.name) for v in many.views]
    report = calibration_report(many, captures)
    assert sum(name.startswith("corners") for name in report.pictures) == 36
    words = Page(report.html).words
    assert "36 of 202 pictures are shown" in words
    assert "side_b/59" in words
    assert len(report.html) < 12e6


def test_the_same_calibration_gives_the_same_bytes_whatever_matplotlib_is_set_to(calibration, pictures, report):
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "black", "savefig.dpi": 30, "lines.linewidth": 9}):
        again = calibration_report(calibration, pictures, "rig on the bench")
        assert matplotlib.rcParams["font.size"] == 30
    assert again.pictures == report.pictures
    assert again.html == report.html


def test_neither_importing_nor_drawing_wakes_what_it_does_not_need():
    code = (
        "import sys, slkit.report.html, slkit.pipeline; "
        "sys.exit(', '.join({'matplotlib', 'jinja2', 'open3d'} & set(sys.modules)) or None)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    code = (
        "import sys; from slkit.report._canvas import drawing_style, new_figure, png_of\n"
        "with drawing_style(): png_of(new_figure(1.0))\n"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
