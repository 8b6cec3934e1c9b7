"""The corners found on each picture, as a contact sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from slkit.data import Calibration, Capture, Image, ViewResult
from slkit.report._canvas import Panel
from slkit.report._evidence import Mask, kept_rows

_WIDTH_PX = 440
_MOST = 36
_SHIFT = 4
_FOUND, _REJECTED = (0, 170, 255), (255, 0, 130)
_KINDS = (("printed", "printed board"), ("marks", "white light"), ("lit", "fully lit"), ("projected", "pattern"))


@dataclass(frozen=True)
class ContactSheet:
    """Pictures with their corners. count: how many pictures there are, of which `panels` shows the more telling."""

    panels: tuple[Panel, ...]
    count: int


def contact_sheet(calibration: Calibration, captures: Sequence[Capture]) -> ContactSheet:
    """Return the pictures of all views with the corners found. Source: Fernandez and Salvi (2011), figure 4.

    Of many pictures those of unused views and of the largest errors are shown, in the order of the views.
    """
    by_name = {c.name: c for c in captures}
    shown = [
        (result, field, label, picture)
        for result in calibration.views
        for field, label in _KINDS
        if result.name in by_name and (picture := getattr(by_name[result.name], field)) is not None
    ]
    weights = [np.inf if not r.used else float(np.nan_to_num(r.rms_joint, nan=-1)) for r, *_ in shown]
    first = sorted(sorted(range(len(shown)), key=lambda i: -weights[i])[:_MOST])
    panels: list[Panel] = []
    for number, i in enumerate(first, 1):
        result, field, label, picture = shown[i]
        panels.append(Panel(f"corners-{number:02d}", _caption(result, field, label), _png(result, field, picture)))
    return ContactSheet(tuple(panels), len(shown))


def _rows(result: ViewResult, field: str) -> Mask:
    """Return the mask of a view's rows that were found on the picture of a kind."""
    if result.view is None:
        return np.empty(0, np.bool_)
    return ~result.view.printed if field == "projected" else result.view.printed


def _caption(result: ViewResult, field: str, label: str) -> str:
    name = f"{result.name}, {label}"
    if not result.used:
        return f"{name}: not used" + (f": {result.reason}" if result.reason else "")
    if result.view is None:
        return name
    rows = _rows(result, field)
    rejected = int((rows & ~kept_rows(result)).sum())
    return f"{name}: {rows.sum()} {'marks' if field == 'marks' else 'corners'}" + (
        f", {rejected} rejected" if rejected else ""
    )


def _png(result: ViewResult, field: str, picture: Image) -> bytes:
    height, width = picture.shape[:2]
    scale = min(_WIDTH_PX / width, 1.0)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    canvas = cv2.resize(_visible(picture), size, interpolation=cv2.INTER_AREA)
    view = result.view
    if view is not None and view.image_size == (width, height):
        xy = (view.camera_xy + 0.5) * scale - 0.5
        rows, kept = _rows(result, field) & np.isfinite(xy).all(axis=1), kept_rows(result)
        for point in xy[rows & kept]:
            cv2.circle(canvas, *_place(point, 4), _FOUND, 2, cv2.LINE_AA, _SHIFT)
        for point in xy[rows & ~kept]:
            (x, y), _ = _place(point, 0)
            arm = 7 << _SHIFT
            for sign in (-1, 1):
                ends = (x - arm, y - sign * arm), (x + arm, y + sign * arm)
                cv2.line(canvas, *ends, _REJECTED, 3, cv2.LINE_AA, _SHIFT)
    return cv2.imencode(".png", canvas[..., ::-1])[1].tobytes()


def _place(xy: npt.NDArray[np.float64], radius: float) -> tuple[tuple[int, int], int]:
    """Return a place and a radius in the fractions of a pixel that OpenCV draws with."""
    x, y = np.rint(xy * (1 << _SHIFT)).astype(int)
    return (int(x), int(y)), round(radius * (1 << _SHIFT))


def _visible(picture: Image) -> npt.NDArray[np.uint8]:
    """Return a picture as RGB bytes (h, w, 3), stretched from its darkest to its brightest hundredth."""
    low, high = np.percentile(picture, (1, 99))
    stretched = np.clip((picture - low) * (255 / max(high - low, 1)), 0, 255).astype(np.uint8)
    return stretched if stretched.ndim == 3 else np.repeat(stretched[..., None], 3, axis=2)
