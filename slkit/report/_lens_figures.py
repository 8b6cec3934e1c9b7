"""What the views cover of each image, and how each lens bends it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from slkit.geometry import Floats, Pinhole, ninths
from slkit.report._canvas import (
    DASHED,
    DEVICE_COLORS,
    FAINT,
    INK,
    REJECTED,
    RULE,
    Panel,
    arrows,
    closed,
    color_bar,
    image_figure,
    png_of,
    round_length,
    significant,
)
from slkit.report._evidence import DevicePoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GRID = 61
"""Samples of a lens along the longer side of its image."""
_ARROWS_EVERY = 5


def coverage_panel(points: DevicePoints) -> Panel:
    """Return where the points of a device lie in its image, counted by ninths, with the principal point."""
    name, title = f"coverage-{points.device}", points.device.capitalize()
    kept = points.seen_xy[points.kept]
    if not len(kept):
        return Panel(name, f"{title}: no points were used.", None)
    center = points.lens.K[:2, 2]
    figure, axes = image_figure(points.lens, points.device, center[None])
    axes.scatter(*kept.T, s=2.5, color=DEVICE_COLORS[points.device], alpha=0.55, linewidths=0)
    rejected = points.seen_xy[~points.kept]
    axes.scatter(*rejected.T, s=22, marker="x", color=REJECTED, linewidths=1)
    counts = ninths(kept, points.lens.size)
    width, height = points.lens.size
    for row, column in np.ndindex(3, 3):
        place = ((column + 0.04) * width / 3 - 0.5, (row + 0.05) * height / 3 - 0.5)
        box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": RULE, "alpha": 0.92}
        text = str(counts[row, column])
        axes.text(*place, text, ha="left", va="top", fontweight="bold", bbox=box, zorder=6)
    for share in (1 / 3, 2 / 3):
        axes.plot([share * width - 0.5] * 2, [-0.5, height - 0.5], color=FAINT, linewidth=0.7, zorder=2)
        axes.plot([-0.5, width - 0.5], [share * height - 0.5] * 2, color=FAINT, linewidth=0.7, zorder=2)
    _principal_point(axes, center)
    outside = not _inside(center, points.lens.size)
    empty = int((counts == 0).sum())
    caption = f"{title}: {len(kept)} points, counted by ninths of the image{f', {empty} of them empty' * (empty > 0)}."
    caption += f" The cross is the principal point, ({center[0]:.0f}, {center[1]:.0f}) px"
    caption += ", outside the image, as with a lens shift." if outside else "."
    return Panel(name, caption, png_of(figure))


def distortion_panel(points: DevicePoints) -> Panel:
    """Return by how many px a lens moves each place of its image from where a straight lens would put it."""
    lens, title = points.lens, points.device.capitalize()
    name = f"distortion-{points.device}"
    if not lens.distortion.any():
        return Panel(name, f"{title}: the lens has no distortion.", None)
    grid, shift = displacement(lens)
    length = np.linalg.norm(shift, axis=-1)
    if not np.isfinite(length).any():
        return Panel(name, f"{title}: the distortion has no inverse anywhere in the image.", None)
    figure, axes = image_figure(lens, points.device)
    levels = _levels(float(np.nanmax(length)))
    filled = axes.contourf(*np.moveaxis(grid, -1, 0), np.ma.masked_invalid(length), levels, cmap="Blues")
    lines = axes.contour(*np.moveaxis(grid, -1, 0), np.ma.masked_invalid(length), levels, colors=INK, linewidths=0.5)
    axes.clabel(lines, fontsize=9, fmt="%g")
    sparse = np.s_[_ARROWS_EVERY // 2 :: _ARROWS_EVERY, _ARROWS_EVERY // 2 :: _ARROWS_EVERY]
    factor = round_length(max(lens.size) / 9 / float(np.nanmax(length)))
    arrows(axes, grid[sparse], shift[sparse], factor, INK, 0.003)
    _hull(axes, points)
    if _inside(lens.K[:2, 2], lens.size):
        _principal_point(axes, lens.K[:2, 2])
    color_bar(figure, axes, filled, "px")
    folded = int(np.isnan(length).sum())
    caption = (
        f"{title}: distance in px from where a lens without distortion would put each place, up to "
        f"{significant(float(np.nanmax(length)))} px; the arrows are {factor:g} times magnified. Outside the dashed "
        f"outline no point was seen, and the lens is extrapolated."
    )
    caption += " Where nothing is drawn the model folds over." if folded else ""
    return Panel(name, caption, png_of(figure))


def displacement(lens: Pinhole) -> tuple[Floats, Floats]:
    """Return a grid of pixels (r, c, 2) of an image and the shift (r, c, 2) px that distortion gives each, or NaN."""
    width, height = lens.size
    step = max(width, height) / (_GRID - 1)
    counts = [max(int(np.ceil(n / step)) + 1, 2) for n in (width, height)]
    x, y = (np.linspace(-0.5, n - 0.5, count) for n, count in zip((width, height), counts, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    straight = Pinhole(lens.size, lens.K, np.zeros(5)).from_normalized(lens.normalize(grid))
    return grid, grid - straight


def _levels(largest: float) -> Floats:
    from matplotlib.ticker import MaxNLocator

    return np.unique(np.maximum(MaxNLocator(8).tick_values(0, max(largest, 1e-6)), 0))


def _hull(axes: Axes, points: DevicePoints) -> None:
    import cv2

    xy = points.seen_xy[points.kept].astype(np.float32)
    if len(xy) < 3:
        return
    hull = np.asarray(cv2.convexHull(xy), dtype=np.float64).reshape(-1, 2)
    axes.plot(*closed(hull).T, color="white", linewidth=2.6, zorder=5)
    axes.plot(*closed(hull).T, color=INK, linewidth=1.3, linestyle=DASHED, zorder=5)


def _principal_point(axes: Axes, center: Floats) -> None:
    axes.plot(*center, marker="+", markersize=15, markeredgewidth=2.6, color="white", zorder=7)
    axes.plot(*center, marker="+", markersize=13, markeredgewidth=1.4, color=INK, zorder=8)


def _inside(xy: Floats, size: tuple[int, int]) -> bool:
    return bool((xy >= -0.5).all() and (xy <= np.array(size) - 0.5).all())
