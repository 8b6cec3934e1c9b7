"""A free-form object generated in code: a stylised head on a collar."""

from __future__ import annotations

import numpy as np

from slkit.simulation.surface import NEUTRAL, Doubles, Surface, net_faces

# Features of the face in the direction sphere: centre x, y (y down), widths x, y, and height in mm.
_FEATURES = (
    (0.00, 0.08, 0.10, 0.20, 24.0),  # nose
    (0.00, 0.23, 0.16, 0.07, 12.0),  # wings of the nose
    (0.00, -0.24, 0.48, 0.09, 9.0),  # brow
    (-0.31, -0.06, 0.17, 0.12, -15.0),  # eye sockets
    (0.31, -0.06, 0.17, 0.12, -15.0),
    (-0.31, -0.05, 0.10, 0.075, 10.0),  # eyes
    (0.31, -0.05, 0.10, 0.075, 10.0),
    (-0.42, 0.22, 0.20, 0.18, 8.0),  # cheeks
    (0.42, 0.22, 0.20, 0.18, 8.0),
    (0.00, 0.42, 0.21, 0.045, 9.0),  # lips
    (0.00, 0.52, 0.17, 0.045, 10.0),
    (0.00, 0.47, 0.25, 0.02, -5.0),
    (0.00, 0.74, 0.22, 0.14, 14.0),  # chin
    (-1.00, 0.00, 0.14, 0.26, 22.0),  # ears
    (1.00, 0.00, 0.14, 0.26, 22.0),
)


def sculpture(center_xyz: Doubles, scale: float, coloured: bool) -> tuple[Surface, ...]:
    """Return head and collar about a centre (3,) in mm, 308 mm across at scale 1, facing the camera."""
    # A head that looks straight at the camera hides nothing from it; a turned one does.
    turn = _rotation_y(np.radians(16.0))
    surfaces: list[Surface] = []
    for points in (_head(), _collar()):
        albedo = _colours(points) if coloured else np.array(NEUTRAL)
        vertices = (points.reshape(-1, 3) @ turn.T + [0.0, -22.0, 0.0]) * scale + center_xyz
        surfaces.append(Surface(vertices, net_faces(*points.shape[:2]), albedo))
    return tuple(surfaces)


def _head() -> Doubles:
    polar, around = np.meshgrid(np.linspace(0, np.pi, 451), np.linspace(0, 2 * np.pi, 721), indexing="ij")
    x, y, z = np.sin(polar) * np.sin(around), -np.cos(polar), -np.sin(polar) * np.cos(around)
    front = _smooth_step(-z, -0.25, 0.25)
    relief = np.zeros_like(x)
    for at_x, at_y, wide, high, height in _FEATURES:
        bump = height * np.exp(-(((x - at_x) / wide) ** 2) - ((y - at_y) / high) ** 2)
        relief += bump * (np.exp(-(((z - 0.1) / 0.16) ** 2)) if abs(at_x) == 1 else front)
    # Waves of hair above the hair line, and a chiselled skin: relief of 3 mm and of 0.35 mm.
    hair = _smooth_step(-y - 0.45 - 0.5 * (-z - 0.3) * (z < 0.3), 0.0, 0.12)
    hair = np.maximum(hair, _smooth_step(z, 0.15, 0.35) * _smooth_step(0.5 - y, 0, 0.2))
    # Around the poles the waves would be finer than the net.
    calm = np.clip(np.sin(polar) / 0.35, 0, 1) ** 2
    waves = np.sin(34 * around + 9 * np.sin(5 * polar)) * calm
    relief += hair * (6 + 3 * waves) + (1 - hair) * 0.35 * np.sin(58 * polar) * np.sin(70 * around) * calm
    radius = np.stack([92 + relief, 128 + relief, 104 + relief], axis=-1)
    jaw = 1 - 0.22 * _smooth_step(y, 0.1, 1.0)
    return np.stack([x * jaw, y, z], axis=-1) * radius


def _collar() -> Doubles:
    along, around = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(0, 2 * np.pi, 161), indexing="ij")
    thick = 26 + 2.5 * np.sin(36 * along + 3 * np.sin(2 * around))
    radius = 128 + thick * np.cos(around)
    ruffle = 9 * np.sin(5 * along)
    return np.stack(
        [radius * np.sin(along), 132 + ruffle + thick * np.sin(around), -0.75 * radius * np.cos(along)], axis=-1
    )


def _colours(points: Doubles) -> Doubles:
    """Return an albedo (n, 3) that varies smoothly over the object, every hue, none darker than 0.25."""
    p = points.reshape(-1, 3) / 55.0
    phase = np.stack([p[:, 0] + 0.6 * p[:, 1], p[:, 1] - 0.5 * p[:, 2] + 2.1, p[:, 0] - p[:, 1] + 4.2], axis=1)
    return 0.57 + 0.32 * np.sin(phase)


def _smooth_step(value: Doubles, low: float, high: float) -> Doubles:
    share = np.clip((value - low) / (high - low), 0, 1)
    return share * share * (3 - 2 * share)


def _rotation_y(angle: float) -> Doubles:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
