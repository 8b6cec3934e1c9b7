"""Cuts through several clouds along one row of the camera."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.report._canvas import FAINT, RULE, Panel, new_figure, png_of, significant, view_colors
from slkit.report.comparison import Comparison

Float64s = npt.NDArray[np.float64]

_HALF_ROW_PX = 0.5
_SHARE = 0.1
"""Of the section's length, the part that is enlarged."""
_DEGREE = 4
_FEWEST = 16


def section_panels(comparison: Comparison) -> tuple[Panel, ...]:
    """Return the whole section of all methods, and a short part of it with the common curve taken off."""
    row = _row(comparison)
    cuts = [_cut(m.cloud.camera_xy, m.cloud.xyz, row) for m in comparison.methods]
    if sum(len(c) for c in cuts) < 20:
        return (Panel("section", "No row of the camera has points enough for a section.", None),)
    truth = np.empty((0, 2))
    if comparison.truth_xyz is not None:
        truth = _cut(comparison.rig.camera.project(comparison.truth_xyz), comparison.truth_xyz, row)
    return (_whole(comparison, cuts, truth, row), _part(comparison, cuts, truth, row))


def _row(comparison: Comparison) -> float:
    """Return the row (px) in which the method that has the smallest share of its best row has most."""
    height = comparison.rig.camera.size[1]
    counts = [
        np.bincount(np.rint(m.cloud.camera_xy[:, 1]).astype(np.intp).clip(0, height - 1), minlength=height)
        for m in comparison.methods
    ]
    fewest = np.array([c / max(int(c.max()), 1) for c in counts]).min(axis=0)
    return float(np.argmax(fewest))


def _cut(camera_xy: npt.ArrayLike, xyz: npt.ArrayLike, row: float) -> Float64s:
    """Return x and z (n, 2) mm of the points within half a pixel of a row, by x."""
    near = np.abs(np.asarray(camera_xy)[:, 1] - row) <= _HALF_ROW_PX
    points = np.asarray(xyz, dtype=np.float64)[near][:, [0, 2]]
    return points[np.argsort(points[:, 0])]


def _whole(comparison: Comparison, cuts: list[Float64s], truth: Float64s, row: float) -> Panel:
    figure = new_figure(0.7)
    axes = figure.add_subplot(xlabel="x, mm", ylabel="z, mm")
    colors = view_colors(len(cuts))
    if len(truth):
        axes.plot(*truth.T, ".", markersize=5, color=RULE, label="truth", zorder=1)
    most = max(len(cut) for cut in cuts)
    for method, cut, color in zip(comparison.methods, cuts, colors, strict=True):
        # Few points are drawn larger, and over many.
        few = 1 - len(cut) / most
        axes.plot(*cut.T, ".", markersize=2 + 4 * few, color=color, label=method.name, zorder=2 + few)
    every = np.concatenate([*cuts, truth])
    low, high = np.percentile(every[:, 1], [0.5, 99.5])
    margin = 0.1 * max(high - low, 1e-3)
    axes.set(ylim=(high + margin, low - margin))
    figure.legend(loc="outside lower center", ncols=4, markerscale=2)
    return Panel("section", f"Row {row:.0f} of the camera, nearer is higher.", png_of(figure))


def _part(comparison: Comparison, cuts: list[Float64s], truth: Float64s, row: float) -> Panel:
    """One lane a method: what is left of z when the truth, or a curve through all methods' points, is taken off."""
    low, high = _window(cuts)
    parts = [c[(c[:, 0] >= low) & (c[:, 0] <= high)] for c in (*cuts, truth)]
    every = np.concatenate(parts[:-1])
    middle, half = (low + high) / 2, max((high - low) / 2, 1e-6)
    known, curve = len(parts[-1]) > _FEWEST, _curve(every, middle, half)
    left = [
        p[:, 1] - (np.interp(p[:, 0], *parts[-1].T) if known else np.polyval(curve, (p[:, 0] - middle) / half))
        for p in parts[:-1]
    ]
    lane = 3 * float(np.percentile(np.abs(np.concatenate(left)), 95)) or 1.0
    figure = new_figure(0.32 + 0.16 * len(cuts))
    axes = figure.add_subplot(xlabel="x, mm", ylabel="z less the curve, mm")
    for i, (method, color) in enumerate(zip(comparison.methods, view_colors(len(cuts)), strict=True)):
        axes.axhline(i * lane, color=FAINT, linewidth=0.6)
        axes.plot(parts[i][:, 0], np.clip(left[i], -lane / 2, lane / 2) + i * lane, ".", markersize=3, color=color)
        axes.annotate(method.name, (0.01, i * lane + 0.33 * lane), xycoords=("axes fraction", "data"), color=color)
    size = float(f"{lane / 3:.1g}")
    axes.set_yticks(
        [i * lane + s for i in range(len(cuts)) for s in (-size, 0, size)],
        [f"{s:+g}" if s else "0" for _ in cuts for s in (-size, 0, size)],
    )
    axes.set(xlim=(low, high), ylim=((len(cuts) - 0.4) * lane, -0.6 * lane))
    of = "the truth" if known else "the curve through all methods' points"
    caption = f"{significant(high - low, 2)} mm of row {row:.0f}, less {of}; points beyond half a lane lie on its edge."
    return Panel("section-part", caption, png_of(figure))


def _window(cuts: list[Float64s]) -> tuple[float, float]:
    """Return the ends, mm, of the part of the section where the method with the fewest points has most of them."""
    x = np.concatenate([c[:, 0] for c in cuts])
    low, high = np.percentile(x, [1, 99])
    width = _SHARE * (high - low)
    starts = np.linspace(low, high - width, 40)
    counts = np.array([[((c[:, 0] >= s) & (c[:, 0] <= s + width)).sum() for s in starts] for c in cuts])
    best = (counts / np.maximum(counts.max(axis=1, keepdims=True), 1)).min(axis=0)
    start = float(starts[int(np.argmax(best))])
    return start, start + float(width)


def _curve(part: Float64s, middle: float, half: float) -> Float64s:
    """Return a polynomial of degree four in (x - middle) / half through points, twice, strays left out then."""
    x, z = (part[:, 0] - middle) / half, part[:, 1]
    keep = np.ones(len(x), dtype=bool)
    curve = np.zeros(1)
    for _ in range(3):
        degree = min(_DEGREE, max(int(keep.sum()) // 4, 0))
        curve = np.polyfit(x[keep], z[keep], degree) if keep.any() else np.zeros(1)
        away = np.abs(z - np.polyval(curve, x))
        keep = away <= 4 * 1.4826 * max(float(np.median(away[keep])) if keep.any() else 0.0, 1e-9)
    return curve
