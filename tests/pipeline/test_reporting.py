"""The report on disk."""

from __future__ import annotations

import pytest

from slkit.data import Calibration, Verdict
from slkit.errors import FileError
from slkit.pipeline import write_report
from slkit.simulation import paper_rig


@pytest.fixture
def calibration() -> Calibration:
    nan = float("nan")
    return Calibration(paper_rig(), "planar", (), nan, nan, nan, None, Verdict("good"))


def test_the_page_and_its_pictures_are_written(calibration, tmp_path):
    page = write_report(tmp_path / "new" / "report", calibration, title="bench")
    assert page == tmp_path / "new" / "report" / "report.html"
    assert "bench" in page.read_text(encoding="utf-8")
    written = {p.name for p in page.parent.iterdir()}
    assert written == {"report.html", "distortion-camera.png", "distortion-projector.png"}
    assert (page.parent / "distortion-camera.png").read_bytes().startswith(b"\x89PNG")


def test_a_folder_that_is_a_file_is_refused(calibration, tmp_path):
    (tmp_path / "report").write_text("mine")
    with pytest.raises(FileError, match="report"):
        write_report(tmp_path / "report", calibration)
    assert (tmp_path / "report").read_text() == "mine"
