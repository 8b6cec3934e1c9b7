"""Poses, lenses and rays in NumPy.

Pixel (0, 0) is the centre of the top-left pixel; x right, y down, z forward; millimetres. `docs/conventions.md` has
the whole list.
"""

from __future__ import annotations

from slkit.geometry.checks import Floats, as_floats, as_size
from slkit.geometry.derivatives import normalize_with_derivatives, project_with_derivatives
from slkit.geometry.lenses import DISTORTION_NAMES, LENS_NAMES, Pinhole
from slkit.geometry.poses import MOTION_NAMES, Pose
from slkit.geometry.rays import flat, homogeneous, intersect_plane, intersect_rays, transformed
from slkit.geometry.rigs import RIG_NAMES, Rig, sigmas_of
from slkit.geometry.volumes import ninths, pixel_grid, steeper_axis, working_volume

__all__ = [
    "DISTORTION_NAMES",
    "LENS_NAMES",
    "MOTION_NAMES",
    "RIG_NAMES",
    "Floats",
    "Pinhole",
    "Pose",
    "Rig",
    "as_floats",
    "as_size",
    "flat",
    "homogeneous",
    "intersect_plane",
    "intersect_rays",
    "ninths",
    "normalize_with_derivatives",
    "pixel_grid",
    "project_with_derivatives",
    "sigmas_of",
    "steeper_axis",
    "transformed",
    "working_volume",
]
