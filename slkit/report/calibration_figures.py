"""The figures of a calibration, in the order of the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from slkit.data import Calibration, Capture
from slkit.report._canvas import Panel, drawing_style
from slkit.report._evidence import device_points
from slkit.report._lens_figures import coverage_panel, distortion_panel
from slkit.report._picture_figures import contact_sheet
from slkit.report._plan_figures import plan_panels
from slkit.report._residual_figures import field_panel, repeating_panels, scatter_panel
from slkit.report._scene_figures import rays_panel, rig_panel
from slkit.report._volume_figures import volume_panels

__all__ = ["Panel", "Section", "calibration_sections"]


@dataclass(frozen=True)
class Section:
    """Figures under one heading. layout: `pair` for two beside each other, `row` for three, `tiles` for many."""

    title: str
    panels: tuple[Panel, ...]
    note: str = ""
    layout: str = "pair"


def calibration_sections(calibration: Calibration, captures: Sequence[Capture] = ()) -> tuple[Section, ...]:
    """Return the figures of a calibration as PNGs with captions.

    captures: the pictures of the views by name; without them the contact sheet is left out. What a calibration lacks
    is said in the caption of a panel without a PNG. Source: Fernandez and Salvi (2011), figures 3 to 7.
    """
    with drawing_style():
        points = [device_points(calibration, device) for device in ("camera", "projector")]
        volume = volume_panels(calibration)
        repeating = repeating_panels(calibration)
        sections = [
            Section("The rig", (rig_panel(calibration), rays_panel(calibration), *plan_panels(calibration))),
            Section("Residuals", tuple(scatter_panel(p) for p in points), _RESIDUALS),
            Section("Residuals over the image", tuple(field_panel(p) for p in points)),
            Section("Residuals that repeat", tuple(repeating), _REPEATING),
            Section("Coverage", tuple(coverage_panel(p) for p in points), _COVERAGE),
            Section("Distortion", tuple(distortion_panel(p) for p in points)),
            Section("3D uncertainty", tuple(volume["uncertainty"]), _UNCERTAINTY, "row"),
            Section("Cross-validation", tuple(volume["cross-validation"]), _HALVES, "row"),
            _pictures(calibration, captures),
        ]
    return tuple(s for s in sections if s.panels)


_REPEATING = (
    "A residual that repeats at one point of the board or pattern is no noise: the print or its numbers are wrong."
)
_RESIDUALS = "What the rig predicts minus what was seen, coloured by view; the table of views has the numbers."
_COVERAGE = "A lens is known only where points were seen. Fill the empty ninths."
_UNCERTAINTY = (
    "1 sigma of the 3D error that the covariance predicts, over the camera's image at three depths: what the noise of "
    "the corners leaves open. It does not see a wrong model."
)
_HALVES = (
    "Distance between the points of two rigs, each from half of the views, after rigid alignment; on the colour scale "
    "of the uncertainty. Where it is far above the uncertainty, the model is wrong or the board moved."
)


def _pictures(calibration: Calibration, captures: Sequence[Capture]) -> Section:
    sheet = contact_sheet(calibration, captures)
    title = "Corners found"
    if not sheet.panels:
        return Section(
            title, (Panel("corners", "The pictures are not at hand, so no corners are drawn on them.", None),)
        )
    note = "Rings are corners that were used, crosses corners that were rejected. The contrast is stretched."
    if len(sheet.panels) < sheet.count:
        note += f" {len(sheet.panels)} of {sheet.count} pictures are shown: unused views, and the largest errors."
    return Section(title, sheet.panels, note, "tiles")
