"""Numbers: shapes through points, a scan against its truth, a rig against the true rig, and what physics allows.

`docs/methods/measuring.md` says what each of them means.
"""

from __future__ import annotations

from slkit.report.measure._acceptance import (
    Flatness,
    ProbingError,
    SpacingError,
    flatness,
    probing_error,
    sphere_spacing,
)
from slkit.report.measure._alignment import rigid_alignment
from slkit.report.measure._clouds import (
    CloudError,
    ScanError,
    cloud_against_truth,
    compare_to_mesh,
    compare_to_points,
    distances_to_mesh,
    mesh_samples,
)
from slkit.report.measure._labels import LabelError, label_error
from slkit.report.measure._limits import (
    Signal,
    color_line_limit_px,
    edge_crossing_px,
    edge_limit_px,
    efficiency,
    gray_limit_px,
    limit_mm,
    line_limit_px,
    phase_limit_px,
)
from slkit.report.measure._rigs import VolumeError, volume_difference, volume_error
from slkit.report.measure._roughness import Roughness, roughness
from slkit.report.measure._shapes import SphereFit, plane_fit, sphere_fit
from slkit.report.measure._spheres import find_spheres, points_on_sphere

__all__ = [
    "CloudError",
    "Flatness",
    "LabelError",
    "ProbingError",
    "Roughness",
    "ScanError",
    "Signal",
    "SpacingError",
    "SphereFit",
    "VolumeError",
    "cloud_against_truth",
    "color_line_limit_px",
    "compare_to_mesh",
    "compare_to_points",
    "distances_to_mesh",
    "edge_crossing_px",
    "edge_limit_px",
    "efficiency",
    "find_spheres",
    "flatness",
    "gray_limit_px",
    "label_error",
    "limit_mm",
    "line_limit_px",
    "mesh_samples",
    "phase_limit_px",
    "plane_fit",
    "points_on_sphere",
    "probing_error",
    "rigid_alignment",
    "roughness",
    "sphere_fit",
    "sphere_spacing",
    "volume_difference",
    "volume_error",
]
