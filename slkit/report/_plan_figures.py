"""The rig and its boards in plan: from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slkit.data import Calibration
from slkit.geometry import Floats
from slkit.report._canvas import DASHED, INK, Panel, closed, new_figure, png_of
from slkit.report._evidence import Placed, placed_views
from slkit.report._rig_shapes import Device, board_colors, devices_of, frustum

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PLANS = (
    (0, "above", "The same from above, the depth to the right, in mm. Dashed: the baseline."),
    (1, "the-side", "The same from the camera's right side, the depth to the right, in mm."),
)


def plan_panels(calibration: Calibration) -> list[Panel]:
    """Return the rig with its boards from above and from the side; nothing where no view has a pose."""
    placed = placed_views(calibration)
    if not placed:
        return []
    return [Panel(f"rig-from-{side}", text, _draw_plan(calibration, placed, axis)) for axis, side, text in _PLANS]


def _draw_plan(calibration: Calibration, placed: Sequence[Placed], axis: int) -> bytes:
    """Draw depth to the right and x (axis 0) or y (axis 1) down."""
    seen = [2, axis]
    devices = devices_of(calibration)
    ends = np.stack([d.center_xyz for d in devices])
    frusta = [frustum(device, placed) for device in devices]
    drawn = np.concatenate([ends, *frusta, *(p.extent_xyz for p in placed)])
    span = np.nanmax(drawn, axis=0) - np.nanmin(drawn, axis=0)
    figure = new_figure(float(np.clip(0.9 * span[axis] / span[2] + 0.2, 0.4, 1.4)))
    axes = figure.add_subplot()
    for board, color in zip(placed, board_colors(placed), strict=True):
        outline = board.outline_xyz[:, seen]
        axes.fill(*outline.T, facecolor=color, alpha=0.3)
        axes.plot(*closed(outline).T, color=color, linewidth=0.8)
        if not len(outline):
            axes.scatter(*board.points_xyz[:, seen].T, s=3, color=color)
    camera_first = bool(ends[0, axis] <= ends[1, axis])
    for device, shape, above in zip(devices, frusta, (camera_first, not camera_first), strict=True):
        corners, apex = shape[:, seen], device.center_xyz[seen]
        for corner in corners:
            axes.plot(*np.stack([apex, corner]).T, color=device.color, linewidth=0.9)
        axes.plot(*closed(corners).T, color=device.color, linewidth=0.9)
        axes.plot(*apex, marker="o", color=device.color, markersize=5)
        _name(axes, apex, device, above)
    axes.plot(*ends[:, seen].T, color=INK, linewidth=0.9, linestyle=DASHED)
    axes.set(aspect="equal", xlabel="z mm (depth)", ylabel=f"{'xy'[axis]} mm")
    axes.margins(0.06, 0.14)
    axes.invert_yaxis()
    axes.grid(True)
    axes.set_axisbelow(True)
    return png_of(figure)


def _name(axes: Axes, place: Floats, device: Device, above: bool) -> None:
    """Write a device's name above or below its centre; the two names must not meet."""
    side: Any = "bottom" if above else "top"
    at, offset = (float(place[0]), float(place[1])), (0, 7 if above else -7)
    style: Any = {"textcoords": "offset points", "ha": "center", "va": side, "color": device.color}
    axes.annotate(device.name, at, offset, **style)
