"""Structured light with a camera and a projector: calibrate the pair, scan objects, trust the numbers.

The names below are the public ones; each is imported when it is first used, so that `import slkit` is quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from slkit._first_use import at_first_use

if TYPE_CHECKING:
    from slkit.calibration.solve import solve_projector
    from slkit.data import BoardView, Calibration, Capture, Correspondences, Frames, PointCloud
    from slkit.errors import SlkitError
    from slkit.files import read_frames, read_image, read_mesh, read_rig, write_rig
    from slkit.geometry import Pinhole, Pose, Rig
    from slkit.pipeline import (
        ScanResult,
        calibrate,
        load_codec,
        patterns,
        projected_checkerboard,
        provenance,
        scan,
        scan_sequence,
        simulate_calibration,
        simulate_scan,
        view,
        write_cloud,
    )
    from slkit.triangulation import triangulate

    __version__: str

__all__ = [
    "BoardView",
    "Calibration",
    "Capture",
    "Correspondences",
    "Frames",
    "Pinhole",
    "PointCloud",
    "Pose",
    "Rig",
    "ScanResult",
    "SlkitError",
    "calibrate",
    "load_codec",
    "patterns",
    "projected_checkerboard",
    "provenance",
    "read_frames",
    "read_image",
    "read_mesh",
    "read_rig",
    "scan",
    "scan_sequence",
    "simulate_calibration",
    "simulate_scan",
    "solve_projector",
    "triangulate",
    "view",
    "write_cloud",
    "write_rig",
]

_HOMES = {
    "slkit.calibration.solve": ("solve_projector",),
    "slkit.data": ("BoardView", "Calibration", "Capture", "Correspondences", "Frames", "PointCloud"),
    "slkit.errors": ("SlkitError",),
    "slkit.files": ("read_frames", "read_image", "read_mesh", "read_rig", "write_rig"),
    "slkit.geometry": ("Pinhole", "Pose", "Rig"),
    "slkit.pipeline": (
        "ScanResult",
        "calibrate",
        "load_codec",
        "patterns",
        "projected_checkerboard",
        "provenance",
        "scan",
        "scan_sequence",
        "simulate_calibration",
        "simulate_scan",
        "view",
        "write_cloud",
    ),
    "slkit.triangulation": ("triangulate",),
}

if not TYPE_CHECKING:  # to a checker it would make every name one that exists
    _named = at_first_use(__name__, _HOMES)

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            return version("slkit")
        return _named(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
