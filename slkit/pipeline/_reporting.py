"""The evidence of a calibration as a page and pictures on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slkit.data import Calibration, Capture
from slkit.files import write_bytes, write_text


def write_report(
    folder: str | Path, calibration: Calibration, captures: Sequence[Capture] = (), title: str = ""
) -> Path:
    """Write report.html, which needs no other file, and its figures as PNGs into a folder; return the page.

    captures: the pictures of the views, such as `CalibrationTask.captures`; title: what was calibrated.
    Errors: FileError where a file cannot be written.
    """
    from slkit.report.html import calibration_report

    folder = Path(folder)
    report = calibration_report(calibration, captures, title)
    for name, png in report.pictures.items():
        write_bytes(folder / name, png)
    write_text(folder / "report.html", report.html)
    return folder / "report.html"
