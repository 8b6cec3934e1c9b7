"""How the projected image stands in the camera's: mirrored, turned, or in single views on its head."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.calibration.solve import MIRRORED
from slkit.data import BoardView, Finding
from slkit.geometry import Floats

TURN_BACK = "turn it back, or copy it again with a program that leaves pictures as they are"


def orientation_findings(views: Sequence[BoardView]) -> list[Finding]:
    """Return that the projected image is mirrored, or turned against the camera's, as most views say.

    And the views in which it stands on its head for the others: those pictures were turned.
    """
    names: list[str] = []
    angles: list[float] = []
    mirrored = 0
    for view in views:
        lit = view.projected
        if lit.sum() < 6:
            continue
        matrix = _affine(view.camera_xy[lit], view.projector_xy[lit])
        if np.linalg.det(matrix) < 0:
            mirrored += 1
            continue
        names.append(view.name)
        angles.append(float(np.degrees(np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1]))))
    if mirrored > len(angles):
        return [MIRRORED]
    if not angles:
        return []
    alike = np.cos(np.radians(np.subtract.outer(angles, angles))) > 0
    usual = alike[alike.sum(axis=1).argmax()]
    found = [_on_its_head(name) for name, same in zip(names, usual, strict=True) if not same]
    middle = float(np.median(np.abs(np.array(angles)[usual])))
    turn = 90 * round(middle / 90)
    if not turn:
        return found
    fault = f"the projected image is turned by {turn} degrees against the camera's"
    remedy = (
        "this does no harm while projector, desktop and camera stay as they are; "
        "if you did not mean it, switch off the projector's setting for the ceiling"
    )
    return [*found, Finding(fault, "", remedy, "turned")]


def _on_its_head(view: str) -> Finding:
    return Finding("its picture is turned against the others", view, TURN_BACK, "exif-rotated")


def _affine(start: Floats, end: Floats) -> Floats:
    """Return the linear part (2, 2) of the affine map that fits best."""
    terms = start - start.mean(axis=0)
    return np.linalg.lstsq(terms, end - end.mean(axis=0))[0].T
