"""A comparison on disk: numbers, page, pictures and clouds."""

from __future__ import annotations

import json
from pathlib import Path

from slkit.files import plain, write_bytes, write_text
from slkit.report.comparison import Comparison, comparison_csv, comparison_json


def write_comparison(folder: str | Path, comparison: Comparison, title: str = "") -> Path:
    """Write comparison.json, .csv and .html, the figures as PNGs and each cloud as PLY into a folder; return the page.

    Errors: FileError where a file cannot be written.
    """
    from slkit.pipeline._scanning import write_cloud
    from slkit.report.html import comparison_report

    folder = Path(folder)
    report = comparison_report(comparison, title)
    for name, png in report.pictures.items():
        write_bytes(folder / name, png)
    for method in comparison.methods:
        write_cloud(folder / f"{method.file_name}.ply", method.cloud)
    table = plain(comparison_json(comparison))
    write_text(folder / "comparison.json", json.dumps(table, indent=1, allow_nan=False) + "\n")
    write_text(folder / "comparison.csv", comparison_csv(comparison))
    write_text(folder / "comparison.html", report.html)
    return folder / "comparison.html"
