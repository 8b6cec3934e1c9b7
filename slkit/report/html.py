"""Reports: each one page that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any

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
from slkit.report.calibration_figures import Section, calibration_sections
from slkit.report.comparison import Comparison, calibration_table, details_table, methods_table, parameters_text

_GRADES = {
    "good": "The rig is fit to measure.",
    "usable": "The rig measures, but not as well as it could.",
    "bad": "Do not measure with this rig: mend the first reason, then calibrate again.",
}

_MEASURES = (
    "Roughness: 1 sigma of the points about a smooth surface through their neighbours within {roughness_radius_mm:g} "
    "mm, the same radius for all. The true shape is taken off first where it is known; otherwise the relief of the "
    "object that bends as narrowly is in it. Limit: the least 1 sigma across the surface that contrast and noise of "
    "the pictures allow this kind of code, median over the points; a dash for a codec whose limit is not known."
)
_BLUR = (
    "For the limits of lines and edges the blur is taken to be {camera_blur_px:g} camera px and {projector_blur_px:g} "
    "projector px."
)


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
    sections = calibration_sections(calibration, captures)
    return _report(
        "calibration.html",
        sections,
        title=title,
        calibration=calibration,
        grade_meaning=_GRADES.get(calibration.verdict.grade, ""),
        summary=summary_table(calibration),
        views=views_table(calibration),
        tables=[
            lenses_table(calibration),
            pose_table(calibration),
            geometry_table(calibration),
            classes_table(calibration),
            correlations_table(calibration),
        ],
        notes=_other_notes(calibration),
    )


def comparison_report(comparison: Comparison, title: str = "") -> Report:
    """Return the page that shows methods beside each other, with its figures.

    title: what was compared. The page holds its pictures, needs no network and no script, and prints.
    """
    from slkit.report.comparison_figures import comparison_sections

    settings = comparison.settings
    notes = [*comparison.notes, *(f"{m.name}: {note}." for m in comparison.methods for note in m.notes)]
    notes += [_MEASURES.format(**settings), _BLUR.format(**settings)]
    return _report(
        "comparison.html",
        comparison_sections(comparison),
        title=title,
        comparison=comparison,
        verdict={"grade": "", "reasons": ()} | dict(comparison.verdict),
        methods=methods_table(comparison),
        details=details_table(comparison),
        calibration=calibration_table(comparison),
        true_rig=any("true_rig_rms_mm" in m.numbers for m in comparison.methods),
        notes=notes,
    )


def _report(template: str, sections: Sequence[Section], **values: Any) -> Report:
    """Return a template's page with its figures in it."""
    import jinja2

    pictures = {f"{p.name}.png": p.png for s in sections for p in s.panels if p.png is not None}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("slkit.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(data_uri=_data_uri, sentence=_sentence, parameters=parameters_text)
    html = environment.get_template(template).render(version=metadata.version("slkit"), sections=sections, **values)
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
