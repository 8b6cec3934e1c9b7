"""The rig and its boards in space, and the rays to the corners of one board."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slkit.data import Calibration
from slkit.geometry import Floats
from slkit.report._canvas import DASHED, FAINT, INK, Panel, new_figure, png_of
from slkit.report._evidence import Placed, placed_views
from slkit.report._rig_shapes import Device, board_colors, devices_of, frustum

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_RAYS = 160


def rig_panel(calibration: Calibration) -> Panel:
    """Return the rig with its boards from an angle. Source: Fernandez and Salvi (2011), figures 5, 6."""
    placed = placed_views(calibration)
    if not placed:
        return Panel("rig-3d", "No view has a pose, so the rig is not drawn.", None)
    both = sum(bool(p.view.projected.any()) for p in placed)
    boards = "1 board" if len(placed) == 1 else f"{len(placed)} boards"
    length = float(np.linalg.norm(calibration.rig.projector_from_camera.translation))
    caption = f"Camera (blue) and projector (orange), {length:.1f} mm apart, with {boards} at the poses found."
    if both < len(placed):
        caption += f" Grey boards ({len(placed) - both}) were seen by the camera alone."
    return Panel("rig-3d", caption, _draw_rig(calibration, placed))


def rays_panel(calibration: Calibration) -> Panel:
    """Return the rays of one view to its projected corners. Source: Fernandez and Salvi (2011), figure 3."""
    placed = [p for p in placed_views(calibration) if p.view.projected.any()]
    if not placed:
        return Panel("rays", "No view with projected points has a pose, so no rays are drawn.", None)
    chosen = max(placed, key=lambda p: int(p.view.projected.sum()))
    points = chosen.points_xyz[chosen.view.projected]
    points = points[np.isfinite(points).all(axis=1)]
    few = points[np.unique(np.linspace(0, max(len(points) - 1, 0), _MOST_RAYS).astype(int))[: len(points)]]
    figure, axes = _space()
    devices = devices_of(calibration)
    for device, point in itertools.product(devices, few):
        _line(axes, np.stack([device.center_xyz, point]), color=device.color, linewidth=0.35, alpha=0.45)
    _frusta(axes, devices, [chosen])
    _face(axes, chosen.outline_xyz, "#ffffff", FAINT, 0.55)
    axes.scatter(*_turned(few), s=5, color=INK, depthshade=False, zorder=5)
    _finish(axes, np.concatenate([chosen.outline_xyz, few, *(d.center_xyz[None] for d in devices)]))
    caption = (
        f"View {chosen.number}, {chosen.result.name}: where the rays of the camera (blue) meet the board, and the rays "
        f"of the projector (orange) to the same {len(few)} of {len(points)} corners."
    )
    return Panel("rays", caption, png_of(figure))


def _draw_rig(calibration: Calibration, placed: Sequence[Placed]) -> bytes:
    figure, axes = _space()
    devices = devices_of(calibration)
    for board, color in zip(placed, board_colors(placed), strict=True):
        _face(axes, board.outline_xyz, color, color, min(0.22, 1.6 / len(placed)))
        if not len(board.outline_xyz):
            axes.scatter(*_turned(board.points_xyz), s=3, color=color, depthshade=False)
    _frusta(axes, devices, placed)
    _finish(axes, np.concatenate([*(p.extent_xyz for p in placed), *(d.center_xyz[None] for d in devices)]))
    return png_of(figure)


def _space() -> tuple[Any, Any]:
    """Return a figure and its axes in space; depth goes into the page."""
    figure = new_figure(0.76)
    figure.set_layout_engine("none")
    axes: Any = figure.add_axes((-0.05, 0.0, 0.97, 1.0), projection="3d")
    axes.set_proj_type("persp", focal_length=1.6)
    axes.view_init(elev=24, azim=-62)
    return figure, axes


def _turned(xyz: Floats) -> Floats:
    """Return camera-frame points (n, 3) as the plot's coordinates (3, n): x, depth, and y, whose axis is inverted."""
    return xyz[:, [0, 2, 1]].T


def _line(axes: Axes, xyz: Floats, **style: Any) -> None:
    axes.plot(*_turned(xyz), **style)


def _face(axes: Any, xyz: Floats, face: Any, edge: Any, alpha: float) -> None:
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if not len(xyz):
        return
    axes.add_collection3d(
        Poly3DCollection(
            [_turned(xyz).T], facecolor=[to_rgba(face, alpha)], edgecolor=[to_rgba(edge, 0.9)], linewidth=0.8
        )
    )


def _frusta(axes: Any, devices: Sequence[Device], placed: Sequence[Placed]) -> None:
    for device in devices:
        corners = frustum(device, placed)
        for corner in corners:
            _line(axes, np.stack([device.center_xyz, corner]), color=device.color, linewidth=1.0)
        _face(axes, corners, device.color, device.color, 0.25)
    _line(axes, np.stack([d.center_xyz for d in devices]), color=INK, linewidth=0.9, linestyle=DASHED)


def _finish(axes: Any, xyz: Floats) -> None:
    """Give the axes equal scales around the points, quiet panes, and names in mm."""
    from matplotlib.ticker import MaxNLocator

    low, high = np.nanmin(xyz, axis=0), np.nanmax(xyz, axis=0)
    margin = 0.06 * (high - low).max()
    low, high = low - margin, high + margin
    axes.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]), zlim=(high[1], low[1]))
    axes.set_box_aspect((high - low)[[0, 2, 1]], zoom=1.12)
    axes.set_xlabel("x mm", labelpad=2)
    axes.set_ylabel("z mm (depth)", labelpad=8)
    axes.set_zlabel("y mm", labelpad=2)
    axes.tick_params(labelsize=8, pad=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.975, 0.98, 0.985, 1))
        axis.set_major_locator(MaxNLocator(5))
