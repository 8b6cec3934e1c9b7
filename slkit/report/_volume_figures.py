"""Millimetres over the working volume: what the covariance predicts, and what two halves of the views disagree on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slkit.data import Calibration, VolumeMap
from slkit.report._canvas import INK, Panel, color_bar, image_figure, png_of, significant

_KINDS = {
    "uncertainty": ("1 sigma", "No 3D uncertainty is known: it needs the covariance of the solver."),
    "cross-validation": ("Halves apart", "No cross-validation is known: it needs six views or more."),
}


def volume_panels(calibration: Calibration) -> dict[str, list[Panel]]:
    """Return the maps of uncertainty and of cross-validation, each at up to three depths, all on one colour scale."""
    diagnosis = calibration.diagnosis
    found = (None, None) if diagnosis is None else (diagnosis.uncertainty, diagnosis.cross_validation)
    maps = dict(zip(_KINDS, found, strict=True))
    largest = _largest([m for m in maps.values() if m is not None])
    return {kind: _panels(calibration, kind, m, largest) for kind, m in maps.items()}


def _largest(maps: Sequence[VolumeMap]) -> float:
    """Return the end of the common colour scale: all but the worst hundredth of the values."""
    values = np.concatenate([np.empty(0), *(m.value_mm[np.isfinite(m.value_mm)] for m in maps)])
    return float(np.percentile(values, 99)) if len(values) else float("nan")


def _panels(calibration: Calibration, kind: str, volume: VolumeMap | None, largest: float) -> list[Panel]:
    title, missing = _KINDS[kind]
    if volume is None or not np.isfinite(volume.value_mm).any():
        return [Panel(kind, missing, None)]
    depths = np.unique(np.linspace(0, len(volume.depths_mm) - 1, 3).round().astype(int))
    return [_panel(calibration, f"{kind}-{n}", volume, int(depth), title, largest) for n, depth in enumerate(depths, 1)]


def _panel(calibration: Calibration, name: str, volume: VolumeMap, index: int, title: str, largest: float) -> Panel:
    depth, values = float(volume.depths_mm[index]), np.ma.masked_invalid(volume.value_mm[index])
    if not values.count():
        return Panel(name, f"At {depth:.0f} mm camera and projector share no part of the image.", None)
    figure, axes = image_figure(calibration.rig.camera, "camera")
    x, y = np.moveaxis(volume.camera_xy, -1, 0)
    top = max(largest, 1e-9)
    mesh = axes.pcolormesh(x, y, values, cmap="cividis", vmin=0, vmax=top, shading="nearest")
    if min(values.shape) > 2 and values.max() > values.min():
        lines = axes.contour(x, y, values, 5, colors="white", linewidths=0.9)
        for text in axes.clabel(lines, fontsize=9, fmt="%.3g"):
            text.set_bbox({"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.85})
            text.set_color(INK)
    color_bar(figure, axes, mesh, "mm", extend="max" if values.max() > top else "neither")
    axes.set_title(f"{title} at {depth:.0f} mm")
    rms = float(np.sqrt(np.mean(values.compressed() ** 2)))
    return Panel(
        name,
        f"At {depth:.0f} mm: rms {significant(rms)} mm, largest {significant(float(values.max()))} mm.",
        png_of(figure),
    )
