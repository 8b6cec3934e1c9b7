"""What the figures of a report share: colours, sizes, numbers, axes over an image, and PNG bytes always the same.

A panel is five inches wide, so that its text stays legible on a phone.
"""

from __future__ import annotations

import io
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from slkit.geometry import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from slkit.geometry import Pinhole

NOTHING = "–"
INK, FAINT, RULE = "#1f2933", "#6b7683", "#cfd6dd"
CAMERA, PROJECTOR, REJECTED = "#0072b2", "#d55e00", "#c2187b"
DASHED = (0, (4, 3))
DEVICE_COLORS = {"camera": CAMERA, "projector": PROJECTOR}
# Okabe and Ito's colours, which colour-blind readers can tell apart.
_FEW = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d1f")
_WIDTH_IN, _MARGIN_IN, _DPI = 5.0, 0.06, 200
_STYLE: Any = {
    "font.size": 10.5,
    "axes.titlesize": 11,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": RULE,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "figure.facecolor": "white",
}


@dataclass(frozen=True)
class Panel:
    """One figure of a report: its file name without ending, what it shows in words, and its PNG.

    png: None where there is nothing to draw; the caption then says why.
    """

    name: str
    caption: str
    png: bytes | None


@contextmanager
def drawing_style() -> Generator[None]:
    """Draw in the report's style, whatever the user's own settings of matplotlib are; they come back afterwards."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def new_figure(height_over_width: float) -> Figure:
    """Return an empty figure of a panel's width."""
    from matplotlib.figure import Figure

    return Figure(figsize=(_WIDTH_IN, _WIDTH_IN * height_over_width), layout="constrained", dpi=_DPI)


def png_of(figure: Figure) -> bytes:
    """Return a figure as PNG bytes: the same figure always gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.transforms import Bbox

    canvas = FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    # White above and below is cut off; the width stays, so that text has one size in all panels.
    drawn = figure.get_tightbbox(canvas.get_renderer())
    inches = Bbox.from_extents(0, drawn.y0 - _MARGIN_IN, _WIDTH_IN, drawn.y1 + _MARGIN_IN)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", bbox_inches=inches, metadata={"Software": None})
    return buffer.getvalue()


def image_figure(lens: Pinhole, device: str, extra_xy: Floats | None = None) -> tuple[Figure, Axes]:
    """Return a figure and its axes in the pixels of a device's image, y down, with the image's outline.

    extra_xy (n, 2) px: points that must be inside the axes too, such as a principal point beyond the image.
    """
    corners = image_corners(lens)
    points = corners if extra_xy is None else np.concatenate([corners, extra_xy])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.02 * max(lens.size)
    low, high = low - margin, high + margin
    shape = (high[1] - low[1]) / (high[0] - low[0])
    figure = new_figure(float(np.clip(0.88 * shape + 0.16, 0.5, 1.5)))
    axes = figure.add_subplot()
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect="equal", xlabel="x px", ylabel="y px")
    axes.plot(*closed(image_corners(lens)).T, color=DEVICE_COLORS[device], linewidth=1.2, zorder=3)
    return figure, axes


def image_corners(lens: Pinhole) -> Floats:
    """Return the corners (4, 2) px of a device's image."""
    x, y = lens.size[0] - 0.5, lens.size[1] - 0.5
    return np.array([[-0.5, -0.5], [x, -0.5], [x, y], [-0.5, y]])


def arrows(axes: Axes, at_xy: Floats, step_xy: Floats, factor: float, color: str, width: float) -> None:
    """Draw steps (..., 2) at places (..., 2) magnified; width: of a shaft, as a part of the axes' width."""
    x, y = np.moveaxis(at_xy, -1, 0)
    u, v = factor * np.moveaxis(step_xy, -1, 0)
    axes.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=1, color=color, width=width, zorder=4)


def color_bar(figure: Figure, axes: Axes, mappable: Any, label: str, **options: Any) -> None:
    """Put a colour bar beside an image, as high as the image."""
    figure.colorbar(mappable, cax=axes.inset_axes((1.03, 0, 0.04, 1)), label=label, **options)


def closed(outline: Floats) -> Floats:
    """Return a polygon's corners (n, .) with the first one again at the end."""
    return np.concatenate([outline, outline[:1]])


def view_colors(count: int) -> list[Any]:
    """Return a colour for each of `count` views: apart for a few, along a colour map for many."""
    if count <= len(_FEW):
        return list(_FEW[:count])
    import matplotlib

    return [tuple(c) for c in matplotlib.colormaps["viridis"](np.linspace(0, 0.95, count))]


def number_views(figure: Figure, axes: Axes, numbers: Sequence[int]) -> None:
    """Say which colour of `view_colors` is which view: a legend for a few, a bar for many."""
    colors = view_colors(len(numbers))
    if len(numbers) <= len(_FEW):
        from matplotlib.lines import Line2D

        handles = [Line2D([], [], marker="o", linestyle="", markersize=4, color=c) for c in colors]
        style: Any = {"ncols": len(numbers), "handletextpad": 0.1, "columnspacing": 0.9, "title": "view"}
        figure.legend(handles, [str(n) for n in numbers], loc="outside lower center", **style)
        return
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.ticker import FixedFormatter

    mappable = ScalarMappable(Normalize(-0.5, len(numbers) - 0.5), ListedColormap(colors))
    ticks = np.unique(np.linspace(0, len(numbers) - 1, 6).round().astype(int))
    labels = FixedFormatter([str(numbers[t]) for t in ticks])
    color_bar(figure, axes, mappable, "view", ticks=list(ticks), format=labels)


def round_length(largest: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most `largest`, which is positive."""
    power = 10.0 ** np.floor(np.log10(largest))
    return float(power * max(n for n in (1, 2, 5) if n * power <= largest * (1 + 1e-9)))


def number(value: float, digits: int) -> str:
    """Return a number with so many digits after the point, a dash for what is not known."""
    return f"{value:.{digits}f}".replace("-", "−") if np.isfinite(value) else NOTHING


def significant(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits and no exponent, a dash for what is not known."""
    size = np.floor(np.log10(abs(value))) if np.isfinite(value) and value != 0 else digits
    return number(value, int(np.clip(digits - 1 - size, 0, 9)))
