"""The figures of a comparison: clouds, errors and sections of all methods at one scale, and what patterns buy."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.report._canvas import (
    FAINT,
    INK,
    Panel,
    color_bar,
    drawing_style,
    new_figure,
    png_of,
    significant,
    view_colors,
)
from slkit.report._section_figures import section_panels
from slkit.report.calibration_figures import Section
from slkit.report.comparison import COLUMNS, Comparison, Method
from slkit.report.figures import View, draw_cloud

Float64s = npt.NDArray[np.float64]

_VIEW = View("", 10.0, 6.0)
_SIZE = (800, 640)
_FEW = 5000


def comparison_sections(comparison: Comparison) -> tuple[Section, ...]:
    """Return the figures of a comparison as PNGs with captions; what cannot be drawn is left out with a sentence.

    All clouds are drawn from one view at one scale, all errors in one colour scale. Source: Fernandez and Salvi (2011),
    figures 9 and 10.
    """
    methods = comparison.methods
    values, scale = _values(comparison)
    side = ", red nearer to the camera" if scale.low < 0 else ""
    frame = np.concatenate([m.cloud.xyz[:: max(len(m.cloud) // _FEW, 1)] for m in methods]).astype(np.float64)
    with drawing_style():
        return (
            Section("What patterns buy", (tradeoff_panel(comparison),)),
            Section("Clouds", tuple(_clay(m, frame) for m in methods), _CLOUDS),
            Section(
                "Clouds, coloured",
                tuple(_colored(m, v, scale, frame) for m, v in zip(methods, values, strict=True)),
                f"The same view; colour is the {scale.label}, on one scale that holds 95 % of all points{side}.",
            ),
            Section(
                "Over the camera's image",
                tuple(_map(comparison, m, v, scale) for m, v in zip(methods, values, strict=True)),
                "The same colours at the camera pixel of each point. White: nothing was measured.",
            ),
            Section("Sections", section_panels(comparison), _SECTIONS),
        )


_CLOUDS = "Every point that the default filters keep, from one view at one scale, shaded by its neighbours."
_SECTIONS = (
    "A cut along one row of the camera, where most methods have points: the whole of it, and a short part enlarged "
    "with the common curve taken off, one lane a method at one scale."
)


def tradeoff_panel(comparison: Comparison) -> Panel:
    """Return patterns against error, a mark a method; a ring is what the physics would allow."""
    from matplotlib.ticker import MaxNLocator, NullFormatter

    name = comparison.error
    known = [
        (m, color)
        for m, color in zip(comparison.methods, view_colors(len(comparison.methods)), strict=True)
        if m.numbers.get(name, np.nan) > 0
    ]
    if not known:
        return Panel("trade-off", "No error is known, so there is nothing to weigh against the patterns.", None)
    figure = new_figure(0.7)
    axes = figure.add_subplot(xscale="log", xlabel="patterns projected", ylabel=_heading(name))
    most = max(m.numbers["patterns"] for m, _ in known)
    for method, color in known:
        x, y = method.numbers["patterns"], method.numbers[name]
        axes.plot(x, y, "o", color=color, markersize=9, zorder=3)
        left = x > 2
        axes.annotate(
            method.name, (x, y), (-9 if left else 9, 6), textcoords="offset points", ha="right" if left else "left"
        )
        limit = method.numbers.get("limit_mm", np.nan)
        if np.isfinite(limit):
            axes.plot([x, x], [limit, y], color=FAINT, linewidth=0.8, zorder=1)
            axes.plot(x, limit, "o", color=color, markersize=7, markerfacecolor="white", zorder=2)
    highest = np.nanmax([m.numbers.get(n, np.nan) for m, _ in known for n in (name, "limit_mm")])
    axes.set(xlim=(0.7, 1.5 * most), ylim=(0, 1.15 * float(highest)))
    ticks = [t for t in (1, 2, 5, 10, 20, 50, 100, 200) if t <= 1.5 * most]
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.grid(True, which="major")
    caption = (
        f"Patterns against {_heading(name)}. Rings: the limit that the noise of the pictures sets, where one is known; "
        "that of a Gray code is for a pixel that sees one cell."
    )
    return Panel("trade-off", caption, png_of(figure))


def _heading(name: str) -> str:
    return COLUMNS[name].heading


@dataclass(frozen=True)
class _Scale:
    """What colours the points, in words, and the ends of its scale in mm; diverging where low is negative."""

    label: str
    low: float
    high: float

    @property
    def colors(self) -> str:
        return "coolwarm" if self.low < 0 else "cividis"

    def extend(self, values: Float64s) -> str:
        beyond = (bool(np.nanmin(values) < self.low), bool(np.nanmax(values) > self.high))
        return {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")


def _values(comparison: Comparison) -> tuple[list[Float64s], _Scale]:
    """Return what colours each cloud, and its common scale: the error, else the points' own sigma."""
    errors = [m.away_mm for m in comparison.methods]
    signed = any(np.isfinite(v).any() for v in errors)
    values = errors if signed else [m.cloud.sigma_mm.astype(np.float64) for m in comparison.methods]
    known = np.abs(np.concatenate([v[np.isfinite(v)] for v in values]))
    top = max(float(np.percentile(known, 95)) if len(known) else 1.0, 1e-6)
    return values, _Scale("distance to the reference, mm", -top, top) if signed else _Scale("stated sigma, mm", 0, top)


def _clay(method: Method, frame: Float64s) -> Panel:
    picture = draw_cloud(method.cloud, _SIZE, (_VIEW,), frame_xyz=frame)
    return Panel(f"cloud-{method.file_name}", f"{method.name}: {_counted(method)}.", _png(picture))


def _colored(method: Method, values: Float64s, scale: _Scale, frame: Float64s) -> Panel:
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    known = np.isfinite(values)
    name = f"error-cloud-{method.file_name}"
    if not known.any():
        return Panel(name, f"{method.name}: no point has a {scale.label.removesuffix(', mm')}.", None)
    paint = ScalarMappable(Normalize(scale.low, scale.high), matplotlib.colormaps[scale.colors])
    color = np.asarray(paint.to_rgba(values[known]))[:, :3].astype(np.float32)
    painted: PointCloud = dataclasses.replace(method.cloud.select(known), color=color)
    picture = draw_cloud(painted, _SIZE, (_VIEW,), colored=True, frame_xyz=frame)
    figure = new_figure(_SIZE[1] / _SIZE[0] * 0.7)
    axes = figure.add_subplot()
    axes.imshow(picture)
    axes.set_axis_off()
    color_bar(figure, axes, paint, scale.label, extend=scale.extend(values))
    return Panel(name, f"{method.name}: {_spread(values, scale.label)}.", png_of(figure))


def _map(comparison: Comparison, method: Method, values: Float64s, scale: _Scale) -> Panel:
    known = np.isfinite(values)
    name = f"error-map-{method.file_name}"
    if not known.any():
        return Panel(name, f"{method.name}: no point has a {scale.label.removesuffix(', mm')}.", None)
    width, height = comparison.rig.camera.size
    col, row = np.rint(method.cloud.camera_xy[known]).astype(np.intp).clip(0, [width - 1, height - 1]).T
    total, count = np.zeros((height, width)), np.zeros((height, width))
    np.add.at(total, (row, col), values[known])
    np.add.at(count, (row, col), 1)
    # Several pixels a cell, so that lines make an area.
    step = max(round(width / 256), 1)
    total, count = (_binned(v, step) for v in (total, count))
    image = np.ma.masked_invalid(np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0))
    low, high = _seen(comparison)
    figure = new_figure(float(np.clip(0.8 * (high[1] - low[1]) / (high[0] - low[0]) + 0.16, 0.3, 1.5)))
    axes = figure.add_subplot(xlabel="x px", ylabel="y px")
    extent = (-0.5, image.shape[1] * step - 0.5, image.shape[0] * step - 0.5, -0.5)
    ends: Any = {"vmin": scale.low, "vmax": scale.high}
    shown = axes.imshow(image, cmap=scale.colors, extent=extent, interpolation="nearest", **ends)
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]))
    color_bar(figure, axes, shown, scale.label, extend=scale.extend(values))
    axes.set_title(method.name, color=INK)
    return Panel(name, f"{method.name}: mean over cells of {step} px.", png_of(figure))


def _seen(comparison: Comparison) -> tuple[Float64s, Float64s]:
    """Return the corners (2,) px of the part of the image that any method saw, with a margin."""
    xy = np.concatenate([m.cloud.camera_xy for m in comparison.methods]).astype(np.float64)
    low, high = np.percentile(xy, [0.1, 99.9], axis=0)
    span = float((high - low).max())
    # A strip of points would leave no room for the axes.
    half = np.maximum((high - low) / 2, span / 6) + 0.04 * span + 1
    return (low + high) / 2 - half, (low + high) / 2 + half


def _binned(values: Float64s, step: int) -> Float64s:
    """Return sums over cells of step x step pixels."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % step), (0, -width % step)))
    return padded.reshape(-(-height // step), step, -(-width // step), step).sum(axis=(1, 3))


def _spread(values: Float64s, label: str) -> str:
    median, p95 = np.nanpercentile(np.abs(values), [50, 95]).tolist()
    return f"{label.removesuffix(', mm')} {significant(median)} mm (median), 95 % below {significant(p95)} mm"


def _counted(method: Method) -> str:
    patterns = int(method.numbers["patterns"])
    points = f"{len(method.cloud):,}".replace(",", " ")
    return f"{points} points from {patterns} pattern{'s' * (patterns > 1)}"


def _png(picture: npt.NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    return data.tobytes() if done else b""
