"""The straight line, as functions a notebook would call: patterns, calibration, scan, simulation, view.

None of them prints. `progress`, where a function takes it, is told what is being done, how many steps are done, and how
many there are. Each is imported when it is first used, so that no command waits for what it does not need.
"""

from typing import TYPE_CHECKING

from slkit._first_use import at_first_use

if TYPE_CHECKING:
    from slkit.pipeline._boards import PAGES, write_board
    from slkit.pipeline._calibrating import calibrate, calibrate_captures, provenance, solve_views
    from slkit.pipeline._captures import CalibrationTask, decode_capture, load_calibration
    from slkit.pipeline._coloring import (
        add_photometry,
        measure_photometry,
        projected_color,
        simulate_color,
        with_photometry,
    )
    from slkit.pipeline._comparing import compare
    from slkit.pipeline._comparing_measures import Rules
    from slkit.pipeline._comparing_references import Balls, Plate
    from slkit.pipeline._comparing_simulated import compare_simulated
    from slkit.pipeline._comparing_surface import Truth
    from slkit.pipeline._comparing_writing import write_comparison
    from slkit.pipeline._layouts import BOARDS
    from slkit.pipeline._patterns import load_codec, patterns, projected_charuco, projected_checkerboard, recipe_codec
    from slkit.pipeline._reporting import write_report
    from slkit.pipeline._scanning import (
        ScanResult,
        bounds,
        check_depth,
        exporter,
        make_filters,
        scan,
        view,
        write_cloud,
    )
    from slkit.pipeline._sequence import SequenceResult, scan_sequence
    from slkit.pipeline._simulating import simulate_calibration, simulate_scan

__all__ = [
    "BOARDS",
    "Balls",
    "CalibrationTask",
    "PAGES",
    "Plate",
    "Rules",
    "ScanResult",
    "SequenceResult",
    "Truth",
    "add_photometry",
    "bounds",
    "calibrate",
    "calibrate_captures",
    "check_depth",
    "compare",
    "compare_simulated",
    "decode_capture",
    "exporter",
    "load_calibration",
    "load_codec",
    "make_filters",
    "measure_photometry",
    "patterns",
    "projected_charuco",
    "projected_checkerboard",
    "projected_color",
    "provenance",
    "recipe_codec",
    "scan",
    "scan_sequence",
    "simulate_calibration",
    "simulate_color",
    "simulate_scan",
    "solve_views",
    "view",
    "with_photometry",
    "write_board",
    "write_cloud",
    "write_comparison",
    "write_report",
]

_HOMES = {
    "slkit.pipeline._boards": ("PAGES", "write_board"),
    "slkit.pipeline._calibrating": ("calibrate", "calibrate_captures", "provenance", "solve_views"),
    "slkit.pipeline._captures": ("CalibrationTask", "decode_capture", "load_calibration"),
    "slkit.pipeline._coloring": (
        "add_photometry",
        "measure_photometry",
        "projected_color",
        "simulate_color",
        "with_photometry",
    ),
    "slkit.pipeline._comparing": ("compare",),
    "slkit.pipeline._comparing_measures": ("Rules",),
    "slkit.pipeline._comparing_references": ("Balls", "Plate"),
    "slkit.pipeline._comparing_simulated": ("compare_simulated",),
    "slkit.pipeline._comparing_surface": ("Truth",),
    "slkit.pipeline._comparing_writing": ("write_comparison",),
    "slkit.pipeline._layouts": ("BOARDS",),
    "slkit.pipeline._patterns": (
        "load_codec",
        "patterns",
        "projected_charuco",
        "projected_checkerboard",
        "recipe_codec",
    ),
    "slkit.pipeline._reporting": ("write_report",),
    "slkit.pipeline._scanning": (
        "ScanResult",
        "bounds",
        "check_depth",
        "exporter",
        "make_filters",
        "scan",
        "view",
        "write_cloud",
    ),
    "slkit.pipeline._sequence": ("SequenceResult", "scan_sequence"),
    "slkit.pipeline._simulating": ("simulate_calibration", "simulate_scan"),
}

if not TYPE_CHECKING:  # to a checker it would make every name one that exists
    __getattr__ = at_first_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
