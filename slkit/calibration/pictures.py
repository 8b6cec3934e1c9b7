"""What the pictures themselves tell of mistakes, before and beside a calibration.

Nothing here raises for a bad picture: every mistake becomes a finding whose code `slkit.data.faults` explains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from slkit.calibration._exchanged import compare, exchange_findings, motion_finding
from slkit.calibration._exposure import Look, exposure_findings, look_at, spacing
from slkit.calibration._numbers import cell_ratio, continues, corners_finding, count_corners, marks_finding
from slkit.calibration._orientation import TURN_BACK, orientation_findings
from slkit.calibration._panel import panel_finding, panel_size
from slkit.calibration._ripple import Flatness, code_findings, flatness, undecoded
from slkit.calibration.detect import find_checkerboard, grey, homography, picture_size, to_8bit, usual_size, wrong_size
from slkit.calibration.marks import find_marks
from slkit.calibration.projected import find_projected
from slkit.calibration.solve import MIRRORED
from slkit.data import BoardView, Capture, Finding, Image
from slkit.geometry import Floats, Pinhole, transformed
from slkit.targets import Checkerboard, CornerMarks, Printable, ProjectedCheckerboard

_ROLES = ("printed", "marks", "projected", "lit")
_ASKED = 2
_CELLS = (0.85, 1.18, 0.5, 2.0, 0.4, 2.5, 0.67, 1.5)
_FEWEST = 6
_REACHED = 0.47
"""Half of the projector's image, as a share of its size; the outermost is dim and blurred."""
_ON_A_LINE = 0.1
"""Corners whose spread across is a smaller share of that along them say too little of where others are lit."""
_IN_SHADOW = 0.5
"""Corners darker than this share of the usual may well have no code."""


def picture_findings(captures: Sequence[Capture], views: Sequence[BoardView], calibrator: Any) -> tuple[Finding, ...]:
    """Return every mistake that the pictures of a calibration show, each once a view, those that spoil most first.

    views: what `calibrator.observe` made of the captures; further views are ignored. calibrator: its fields `printed`,
    `marks`, `projected` and `projector`, where it has them, say what should be in the pictures.
    """
    by_name = {view.name: view for view in views}
    seen = [c for c in captures if c.name in by_name]
    size, found = common_size(seen)
    fitting = [c for c in seen if all(picture_size(p) == size for _, p in pictures_of(c))]
    found += _exchanged(fitting, by_name, getattr(calibrator, "marks", None))
    light = exposure_findings(_looks(fitting, by_name))
    # Where bad light explains why a board was not found, its numbers are not to blame.
    explained = {f.view for f in (*found, *light)}
    found += _wrong_numbers([c for c in fitting if c.name not in explained], by_name, calibrator)
    clear = [c for c in fitting if c.name not in {f.view for f in light}]
    found += light + _coded(clear, by_name, calibrator)
    found += orientation_findings(list(by_name.values()))
    # A view with two pictures may show one mistake in both.
    return tuple({(f.code, f.view): f for f in reversed(found)}.values())[::-1]


def panel_findings(
    captures: Sequence[Capture], views: Sequence[BoardView], calibrator: Any, camera: Pinhole
) -> list[Finding]:
    """Return that the two sides of a board, each in its own mm, give it two sizes; camera: as calibrated."""
    by_name = {view.name: view for view in views if view.problem is None}
    sizes: list[list[Floats]] = []
    for role in ("printed", "marks"):
        target = getattr(calibrator, role, None)
        if not isinstance(target, Printable):
            return []
        mine = [(by_name[c.name], getattr(c, role)) for c in captures if c.name in by_name]
        sizes.append([panel_size(p, camera, view, target.ink().extent()) for view, p in mine if p is not None])
    return panel_finding(*sizes)


def pictures_of(capture: Capture) -> list[tuple[str, Image]]:
    """Return the pictures of a capture with their roles."""
    return [(role, p) for role in _ROLES if (p := getattr(capture, role)) is not None]


def common_size(captures: Sequence[Capture]) -> tuple[tuple[int, int], list[Finding]]:
    """Return the size (w, h) px that most pictures have, and the views of another one."""
    pictures = {c.name: [p for _, p in pictures_of(c)] for c in captures}
    size = usual_size([p for mine in pictures.values() for p in mine])
    found: list[Finding] = []
    for name, mine in pictures.items():
        other = next((p for p in mine if picture_size(p) != size), None)
        if other is None:
            continue
        sentence = wrong_size(other, size)
        if picture_size(other) == size[::-1]:
            found.append(Finding(f"{sentence}: it is turned by 90 degrees", name, TURN_BACK, "exif-rotated"))
        else:
            remedy = "use the pictures as the camera wrote them, all at one size"
            found.append(Finding(sentence, name, remedy, "other-size"))
    return size, found


def _exchanged(captures: Sequence[Capture], views: Mapping[str, BoardView], marks: Any) -> list[Finding]:
    pairs = [(c.name, c.marks, c.projected) for c in captures if c.marks is not None and c.projected is not None]
    found = exchange_findings([compare(*pair) for pair in pairs])
    named = {f.view for f in found}
    for name, white, pattern in pairs:
        printed = views[name].printed
        if name not in named and printed.sum() >= 4 and isinstance(marks, CornerMarks):
            mm, px = views[name].board_xy[printed], views[name].camera_xy[printed]
            cell_px = marks.cell_mm * float(np.linalg.norm(np.std(px, axis=0)) / np.linalg.norm(np.std(mm, axis=0)))
            found += motion_finding(name, white, pattern, px, cell_px)
    return found


def _looks(captures: Sequence[Capture], views: Mapping[str, BoardView]) -> list[Look]:
    pictures = [(c.name, role, p) for c in captures for role, p in pictures_of(c)]
    full = 255.0
    if any(p.dtype != np.uint8 for _, _, p in pictures):
        full = max(float(p.max()) for _, _, p in pictures)
    return [look_at(name, role, p, _points(views[name], role), full) for name, role, p in pictures]


def _points(view: BoardView, role: str) -> Floats:
    """Return the points (n, 2) px around which a picture of that role has edges."""
    return view.camera_xy[view.projected if role == "projected" else view.printed]


def _wrong_numbers(captures: Sequence[Capture], views: Mapping[str, BoardView], calibrator: Any) -> list[Finding]:
    found: list[Finding] = []
    printed = getattr(calibrator, "printed", None)
    if isinstance(printed, Checkerboard):
        mine = [(views[c.name], p) for c in captures for role, p in pictures_of(c) if role in ("printed", "lit")]
        found += _counted(mine, printed)
    projected = getattr(calibrator, "projected", None)
    if isinstance(projected, ProjectedCheckerboard):
        found += _unread(captures, views, projected)
    marks = getattr(calibrator, "marks", None)
    if isinstance(marks, CornerMarks):
        found += marks_finding(_ratios([(views[c.name], c.marks) for c in captures if c.marks is not None], marks))
    return found


def _counted(pictures: Sequence[tuple[BoardView, Image]], printed: Checkerboard) -> list[Finding]:
    """Return that the printed checkerboard has another number of corners, where it was not found or goes on."""
    lost = [p for view, p in pictures if not view.printed.any()]
    larger = [
        p
        for view, p in pictures
        if continues(p, view.camera_xy[view.printed], np.rint(view.board_xy[view.printed] / printed.square_mm))
    ]
    suspect = larger if len(larger) > 1 else lost if 2 * len(lost) >= len(pictures) else []
    there = count_corners([to_8bit(p) for p in suspect[:_ASKED]], printed.corners) if suspect else None
    return corners_finding(there, printed.corners, "printed")


def _unread(
    captures: Sequence[Capture], views: Mapping[str, BoardView], projected: ProjectedCheckerboard
) -> list[Finding]:
    """Return why the projected checkerboard was found in few views: mirrored, or wrongly told."""
    pairs = [(c.projected, c.marks, c.name) for c in captures if c.marks is not None and c.projected is not None]
    lost = [(pattern, white) for pattern, white, name in pairs if not views[name].projected.any()]
    if 2 * len(lost) < len(pairs):
        return []
    nx, ny = projected.corners
    for pattern, white in lost[:_ASKED]:
        if not isinstance(find_projected(pattern[:, ::-1], white[:, ::-1], projected), str):
            return [MIRRORED]
        if nx != ny and not isinstance(find_projected(pattern, white, replace(projected, corners=(ny, nx))), str):
            fault = f"the projected checkerboard has {ny} x {nx} inner corners, not {nx} x {ny}"
            remedy = "give the corners under [projected] as columns, then rows"
            return [Finding(fault, "", remedy, "wrong-corners")]
    return []


def _ratios(whites: Sequence[tuple[BoardView, Image]], marks: CornerMarks) -> list[float]:
    """Return the `cell_ratio` of the views whose marks were found, and of a few others with other cells."""
    found = [
        cell_ratio(white, view.camera_xy[view.printed], view.board_xy[view.printed], marks.cell_mm)
        for view, white in whites
        if view.printed.sum() >= 4
    ]
    lost = [white for view, white in whites if view.printed.sum() < 4]
    for white in lost[:_ASKED]:
        for factor in _CELLS:
            other = replace(marks, cell_mm=factor * marks.cell_mm)
            centers = find_marks(to_8bit(white), other)
            if centers is not None:
                found.append(factor * cell_ratio(white, centers, marks.points(), other.cell_mm))
                break
    return found


def _coded(captures: Sequence[Capture], views: Mapping[str, BoardView], calibrator: Any) -> list[Finding]:
    """Return what decoded light tells; a view in which too little was decoded is looked at as well."""
    printed, projector = (getattr(calibrator, name, None) for name in ("printed", "projector"))
    maps: list[Flatness] = []
    found: list[Finding] = []
    for capture in captures:
        view = views[capture.name]
        corners = view.camera_xy[view.printed]
        if capture.lit is None:
            continue
        if len(corners) < _FEWEST and isinstance(printed, Checkerboard):
            again = find_checkerboard(to_8bit(capture.lit), printed.corners)
            corners = corners if again is None else again[np.isfinite(again).all(axis=-1)]
        if capture.correspondences is None:
            found.append(undecoded(view.name))
        elif len(corners) >= _FEWEST:
            lit = None if projector is None else _reached(view, projector, capture.lit)
            maps.append(flatness(view.name, corners, 0.45 * spacing(corners), capture.correspondences, lit))
    return code_findings(maps) + found


def _reached(view: BoardView, projector: tuple[int, int], picture: Image) -> npt.NDArray[np.bool_] | None:
    """Return which printed corners (n,) the projector's light reaches, by those whose code is known; None for few."""
    lit, printed, size = view.projected, view.printed, np.array(projector)
    if min(lit.sum(), printed.sum()) < _FEWEST:
        return None
    spread = np.linalg.svd(view.camera_xy[lit] - view.camera_xy[lit].mean(axis=0), compute_uv=False)
    if spread[1] < _ON_A_LINE * spread[0]:
        return None
    xy = transformed(homography(view.camera_xy[lit], view.projector_xy[lit]), view.camera_xy[printed])
    inside = (np.abs(xy - (size - 1) / 2) < _REACHED * size).all(axis=1)
    # A shadow or a hand is darker than the rest of the board; a wrong frame does not show in the lit picture.
    levels: Any = cv2.GaussianBlur(grey(picture), (0, 0), 0.3 * spacing(view.camera_xy[printed]))
    x, y = np.rint(view.camera_xy[printed]).astype(np.intp).T
    bright = levels[np.clip(y, 0, len(levels) - 1), np.clip(x, 0, levels.shape[1] - 1)]
    return np.asarray(inside & (bright > _IN_SHADOW * np.median(bright[lit[printed]])))
