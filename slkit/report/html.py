"""The report of a calibration: one page that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata

from slkit.data import Calibration, Capture
from slkit.report._tables import (
    classes_table,
    correlations_table,
    geometry_table,
    lenses_table,
    pose_table,
    summary_table,
    views_table,
)
from slkit.report.calibration_figures import calibration_sections

_TEMPLATE = "calibration.html"
_GRADES = {
    "good": "The rig is fit to measure.",
    "usable": "The rig measures, but not as well as it could.",
    "bad": "Do not measure with this rig: mend the first reason, then calibrate again.",
}


@dataclass(frozen=True)
class Report:
    """html: one self-contained page. pictures: its figures, file name to PNG bytes."""

    html: str
    pictures: Mapping[str, bytes]


def calibration_report(calibration: Calibration, captures: Sequence[Capture] = (), title: str = "") -> Report:
    """Return the page that shows how good a calibration is and why, with its figures.

    captures: the pictures of the views by name, for the corners found; title: what was calibrated, such as the folder.
    The page holds its pictures, needs no network and no script, and prints. What a calibration lacks is left out with
    a sentence.
    """
    import jinja2

    sections = calibration_sections(calibration, captures)
    pictures = {f"{p.name}.png": p.png for s in sections for p in s.panels if p.png is not None}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("slkit.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(data_uri=_data_uri, sentence=_sentence)
    html = environment.get_template(_TEMPLATE).render(
        title=title,
        version=metadata.version("slkit"),
        calibration=calibration,
        grade_meaning=_GRADES.get(calibration.verdict.grade, ""),
        summary=summary_table(calibration),
        views=views_table(calibration),
        sections=sections,
        tables=[
            lenses_table(calibration),
            pose_table(calibration),
            geometry_table(calibration),
            classes_table(calibration),
            correlations_table(calibration),
        ],
        notes=_other_notes(calibration),
    )
    return Report(html, pictures)


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _sentence(text: str) -> str:
    """Return a message with a capital letter and a full stop."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _other_notes(calibration: Calibration) -> list[str]:
    """Return the notes that the table of views does not tell already."""
    told = {f"{view.name}: {view.reason}" for view in calibration.views}
    return [note for note in calibration.notes if note not in told]
