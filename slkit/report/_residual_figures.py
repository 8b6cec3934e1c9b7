"""How far prediction and observation are apart: as a cloud, as a field over the image, and where it repeats."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from slkit.data import Calibration
from slkit.geometry import Floats
from slkit.report._canvas import (
    FAINT,
    INK,
    REJECTED,
    RULE,
    Panel,
    arrows,
    image_figure,
    new_figure,
    number_views,
    png_of,
    round_length,
    significant,
    view_colors,
)
from slkit.report._evidence import DevicePoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CELLS = 12
"""Cells of the mean field along the longer side of the image."""
_MOST_ARROWS = 1500
_FEWEST = 3
"""Points that make a mean."""


def scatter_panel(points: DevicePoints) -> Panel:
    """Return the residuals of a device as points about zero. Source: Fernandez and Salvi (2011), figure 7."""
    from matplotlib.colors import to_rgba

    name, title = f"residuals-{points.device}", points.device.capitalize()
    points = points.with_error
    kept, rejected = points.select(points.kept), points.select(~points.kept)
    if not len(kept.seen_xy):
        return Panel(name, f"{title}: no residuals are known.", None)
    sigma = float(np.sqrt(np.mean(kept.error_xy**2)))
    limit = _scatter_limit(kept.error_xy, sigma)
    figure = new_figure(0.98)
    axes = figure.add_subplot()
    seen = np.unique(points.view)
    colors = np.array([to_rgba(c) for c in view_colors(len(seen))])[np.searchsorted(seen, kept.view)]
    # In the order of dx, so that no view hides the others.
    order = np.argsort(kept.error_xy[:, 0])
    axes.scatter(*kept.error_xy[order].T, s=5, c=colors[order], alpha=0.75, linewidths=0)
    inside = (np.abs(rejected.error_xy) <= limit).all(axis=1)
    axes.scatter(*rejected.error_xy[inside].T, s=26, marker="x", color=REJECTED, linewidths=1)
    beyond = np.clip(rejected.error_xy[~inside], -0.98 * limit, 0.98 * limit)
    axes.scatter(*beyond.T, s=30, marker="D", facecolor="none", edgecolor=REJECTED, linewidths=1)
    turn = np.linspace(0, 2 * np.pi, 181)
    axes.plot(sigma * np.cos(turn), sigma * np.sin(turn), color=INK, linewidth=1.3)
    axes.axhline(0, color=RULE, linewidth=0.7, zorder=0)
    axes.axvline(0, color=RULE, linewidth=0.7, zorder=0)
    axes.set(xlim=(-limit, limit), ylim=(limit, -limit), aspect="equal", xlabel="dx px", ylabel="dy px")
    number_views(figure, axes, [int(i) + 1 for i in seen])
    return Panel(name, f"{title}: {_told(len(kept.seen_xy), inside, sigma)}", png_of(figure))


def field_panel(points: DevicePoints) -> Panel:
    """Return the residuals of a device as magnified arrows over its image, and their means over cells."""
    name, title = f"residual-field-{points.device}", points.device.capitalize()
    points = points.with_error
    points = points.select(points.kept)
    if not len(points.seen_xy):
        return Panel(name, f"{title}: no residuals are known.", None)
    figure, axes = image_figure(points.lens, points.device)
    length = float(np.sqrt((points.error_xy**2).sum(axis=1).mean()))
    size = max(points.lens.size)
    factor = _magnification(length, size / 22)
    few = np.unique(np.linspace(0, len(points.seen_xy) - 1, _MOST_ARROWS).astype(int))
    arrows(axes, points.seen_xy[few], points.error_xy[few], factor, "#aab4bf", 0.0016)
    places, means = _cell_means(points)
    arrows(axes, places, means, factor, INK, 0.005)
    _key(axes, factor, size)
    axes.set_title(f"magnified {factor:g} x", loc="right", fontsize=9, color=FAINT)
    caption = (
        f"{title}: what the rig predicts minus what was seen, {factor:g} times magnified: {len(few)} of "
        f"{len(points.seen_xy)} points (grey), and means over cells with {_FEWEST} or more (dark). Dark arrows that "
        f"line up show that the model does not fit."
    )
    return Panel(name, caption, png_of(figure))


def repeating_panels(calibration: Calibration) -> list[Panel]:
    """Return for each kind of residuals the part that repeats at a board point over the views, as magnified arrows."""
    found = {} if calibration.diagnosis is None else calibration.diagnosis.repeating
    panels: list[Panel] = []
    for number, (kind, (board_xy, mean_xy, sigma)) in enumerate(found.items(), 1):
        known = np.isfinite(board_xy).all(axis=1) & np.isfinite(mean_xy).all(axis=1)
        length = np.linalg.norm(mean_xy, axis=1)
        if known.sum() < 2 or not length[known].any():
            continue
        clear = known & (length > 3 * sigma)
        figure = _board_field(board_xy[known], mean_xy[known], clear[known])
        caption = (
            f"{kind[:1].upper()}{kind[1:]}: mean residual of each point over the views; the arrow above is the scale; "
            f"{clear.sum()} of {known.sum()} exceed three times their own 1 sigma (dark)."
        )
        panels.append(Panel(f"repeating-{number}", caption, png_of(figure)))
    return panels


def _told(kept: int, rejected_inside: Any, sigma: float) -> str:
    text = f"{kept} residuals; the circle is 1 sigma of one coordinate, {significant(sigma)} px."
    if not len(rejected_inside):
        return f"{text} None was rejected."
    beyond = int((~rejected_inside).sum())
    text += f" {len(rejected_inside)} rejected (crosses"
    return text + (f"; diamonds on the rim stand for {beyond} beyond it)." if beyond else ").")


def _scatter_limit(error_xy: Floats, sigma: float) -> float:
    return max(1.08 * float(np.abs(error_xy).max()), 3.2 * sigma, 1e-6)


def _magnification(length_px: float, wanted_px: float) -> float:
    return round_length(wanted_px / max(length_px, 1e-9))


def _key(axes: Axes, factor: float, size: float) -> None:
    """Draw an arrow of a round length beside its length in px, above the axes."""
    length = round_length(size / 9 / factor)
    left, right = axes.get_xlim()
    share = length * factor / (right - left)
    arrow: Any = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (share, 1.045), (0, 1.045), xycoords="axes fraction", arrowprops=arrow, annotation_clip=False)
    axes.text(share + 0.02, 1.045, f"{length:g} px", transform=axes.transAxes, va="center")


def _cell_means(points: DevicePoints) -> tuple[Floats, Floats]:
    """Return the middles (n, 2) px and mean residuals (n, 2) px of square cells with enough points."""
    cell = max(points.lens.size) / _CELLS
    column, row = np.floor((points.seen_xy + 0.5) / cell).astype(int).T
    _, label, counts = np.unique(1000 * row + column, return_inverse=True, return_counts=True)
    mean = [
        np.stack([np.bincount(label, v) / counts for v in values.T], axis=1)
        for values in (points.seen_xy, points.error_xy)
    ]
    enough = counts >= _FEWEST
    return mean[0][enough], mean[1][enough]


def _board_field(board_xy: Floats, mean_xy: Floats, clear: Any) -> Figure:
    low, high = board_xy.min(axis=0), board_xy.max(axis=0)
    size = float((high - low).max())
    figure = new_figure(float(np.clip(0.88 * (high - low)[1] / max((high - low)[0], 1e-9) + 0.22, 0.5, 1.5)))
    axes = figure.add_subplot()
    margin = 0.1 * size
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(high[1] + margin, low[1] - margin), aspect="equal")
    axes.set(xlabel="x on the board (mm) or pattern (px)", ylabel="y")
    factor = _magnification(float(np.sqrt((mean_xy**2).sum(axis=1).mean())), size / 14)
    axes.scatter(*board_xy.T, s=3, color=FAINT)
    arrows(axes, board_xy[~clear], mean_xy[~clear], factor, "#aab4bf", 0.004)
    arrows(axes, board_xy[clear], mean_xy[clear], factor, INK, 0.005)
    _key(axes, factor, size)
    return figure
