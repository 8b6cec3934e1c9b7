"""Methods beside each other: what was measured of each, and the same as JSON, CSV and tables."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.geometry import Rig
from slkit.report._canvas import NOTHING, number, significant
from slkit.report._tables import Table

Float64s = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Method:
    """One method: its cloud and what was measured of it.

    numbers: by the names of `COLUMNS`, what was not measured left out. away_mm (m,): signed distance of each
    point of the cloud to what it is compared with, NaN where there is nothing. parameters: of the codec. notes: what
    to know.
    """

    name: str
    codec: str
    folder: str
    cloud: PointCloud
    away_mm: Float64s
    numbers: Mapping[str, float]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def file_name(self) -> str:
        """The name as part of a file's."""
        return file_name(self.name)


def file_name(name: str) -> str:
    """Return a method's name as part of a file's: letters, digits, dashes."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name).strip("-")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Methods on one rig.

    error: the column that says how wrong a method is; reference: in words, what that is measured against; calibration:
    in words, where the rig comes from; verdict: grade and reasons as rig.json keeps them, {} where it has none.
    settings: the limits used, units in their names. truth_xyz (n, 3) mm: true points for the sections, or None.
    failed: folders that could not be compared, with the reason.
    """

    methods: tuple[Method, ...]
    rig: Rig
    error: str
    reference: str
    calibration: str
    verdict: Mapping[str, Any]
    settings: Mapping[str, float]
    cores: int
    truth_xyz: Float64s | None = None
    failed: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Column:
    """A number of a method: its heading, digits after the point (None: three significant), and the factor shown."""

    heading: str
    digits: int | None = None
    factor: float = 1.0


_PERCENT = 100.0
COLUMNS: dict[str, Column] = {
    "patterns": Column("patterns", 0),
    "capture_s": Column("capture at 60 Hz, s", 3),
    "points": Column("points", 0),
    "completeness_share": Column("complete, %", 1, _PERCENT),
    "rms_mm": Column("accuracy (rms), mm"),
    "median_mm": Column("median, mm"),
    "p95_mm": Column("95 %, mm"),
    "outliers_share": Column("outliers, %", 2, _PERCENT),
    "common_rms_mm": Column("rms where all saw, mm"),
    "aligned_rms_mm": Column("rms after rigid fit, mm"),
    "motion_mm": Column("moved by, mm"),
    "motion_deg": Column("turned by, deg"),
    "plane_rms_mm": Column("flatness rms of all its points, mm"),
    "plane_form95_mm": Column("flatness 95 % of all its points, mm"),
    "plane_form_mm": Column("flatness range of all its points, mm"),
    "common_plane_rms_mm": Column("flatness rms where all saw, mm"),
    "common_plane_form95_mm": Column("flatness 95 % where all saw, mm"),
    "common_plane_form_mm": Column("flatness range where all saw, mm"),
    "form95_1_mm": Column("form 95 % of ball 1, mm"),
    "form95_2_mm": Column("form 95 % of ball 2, mm"),
    "form_1_mm": Column("form of ball 1, mm"),
    "form_2_mm": Column("form of ball 2, mm"),
    "size_1_mm": Column("size error of ball 1, mm"),
    "size_2_mm": Column("size error of ball 2, mm"),
    "spacing_error_mm": Column("spacing error, mm"),
    "roughness_mm": Column("roughness, mm"),
    "limit_mm": Column("limit, mm"),
    "efficiency_ratio": Column("roughness / limit", 2),
    "decode_s": Column("decode, s"),
    "precision_share": Column("precision, %", 1, _PERCENT),
    "f_score": Column("F-score", 3),
    "sigma_decoding_mm": Column("own sigma, mm"),
    "sigma_cal_mm": Column("sigma of the calibration, mm"),
    "sigma_mm": Column("sigma of both, mm"),
    "calibration_share": Column("calibration's share of the variance, %", 0, _PERCENT),
    "true_rig_rms_mm": Column("rms with the true rig, mm"),
    "true_rig_roughness_mm": Column("roughness with the true rig, mm"),
}
"""Every number that a method can have, in the order of the tables; the unit is in the name."""

_CALIBRATION = ("sigma_decoding_mm", "sigma_cal_mm", "sigma_mm", "calibration_share")
_TRUE_RIG = ("rms_mm", "aligned_rms_mm", "true_rig_rms_mm", "roughness_mm", "true_rig_roughness_mm")
_DETAILS = (
    "median_mm",
    "common_rms_mm",
    "aligned_rms_mm",
    "motion_mm",
    "motion_deg",
    "plane_rms_mm",
    "plane_form95_mm",
    "plane_form_mm",
    "form_1_mm",
    "form_2_mm",
    "limit_mm",
)
_ONLY_IN_FILES = ("precision_share", "f_score", "true_rig_rms_mm", "true_rig_roughness_mm", *_CALIBRATION)


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """Return all numbers of a comparison as plain dicts, lists and numbers; None where one is not finite."""
    return {
        "slkit": metadata.version("slkit"),
        "cores": comparison.cores,
        "reference": comparison.reference,
        "error": comparison.error,
        "calibration": comparison.calibration,
        "verdict": dict(comparison.verdict) or None,
        "settings": dict(comparison.settings),
        "methods": [
            {"name": m.name, "codec": m.codec, "folder": m.folder, "cloud": f"{m.file_name}.ply"}
            | {"parameters": dict(m.parameters)}
            | {name: _known(m.numbers[name]) for name in COLUMNS if name in m.numbers}
            | {"notes": list(m.notes)}
            for m in comparison.methods
        ],
        "failed": [{"folder": folder, "reason": reason} for folder, reason in comparison.failed.items()],
        "notes": list(comparison.notes),
    }


def comparison_csv(comparison: Comparison) -> str:
    """Return one line a method, the names of `COLUMNS` above; empty where a number is not known."""
    names = _measured(comparison)
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["method", "codec", *names])
    for method in comparison.methods:
        known = [_known(method.numbers.get(name, math.nan)) for name in names]
        writer.writerow([method.name, method.codec, *("" if v is None else f"{v:.9g}" for v in known)])
    return buffer.getvalue()


def methods_table(comparison: Comparison) -> Table:
    """Return one line a method: what it costs, how much it sees, and how well."""
    left_out = (*_DETAILS, *_ONLY_IN_FILES)
    return _table("Methods", comparison, [n for n in _measured(comparison) if n not in left_out])


def details_table(comparison: Comparison) -> Table:
    """Return one line a method: the same errors measured in other ways, and the physical limit."""
    return _table("Details", comparison, [n for n in _measured(comparison) if n in _DETAILS])


def calibration_table(comparison: Comparison) -> Table:
    """Return one line a method: its own error beside that of the calibration, predicted and, where known, true."""
    measured = _measured(comparison)
    true = _TRUE_RIG if "true_rig_rms_mm" in measured else ()
    names = [n for n in (*_CALIBRATION, *true) if n in measured]
    missing = "The rig has no covariance, so what the calibration does to the points is not known."
    known = [m for m in comparison.methods if math.isfinite(m.numbers.get("sigma_cal_mm", math.nan)) or true]
    return _table("The calibration's part", comparison, names if known else [], missing)


def parameters_text(method: Method) -> str:
    """Return the parameters of a method's codec as one line."""
    return ", ".join(f"{name} = {value}" for name, value in method.parameters.items()) or "defaults"


def cell(name: str, value: float) -> str:
    """Return a number of the column `name` as the tables show it."""
    column = COLUMNS[name]
    shown = column.factor * value
    return significant(shown) if column.digits is None else number(shown, column.digits)


def _table(title: str, comparison: Comparison, names: Sequence[str], missing: str = "") -> Table:
    rows = tuple(
        (m.name, *(cell(n, m.numbers[n]) if n in m.numbers else NOTHING for n in names))
        for m in (comparison.methods if names else ())
    )
    return Table(title, ("method", *(COLUMNS[n].heading for n in names)), rows, (0,), missing=missing)


def _measured(comparison: Comparison) -> list[str]:
    """Return the columns that any method has a number for."""
    return [name for name in COLUMNS if any(name in m.numbers for m in comparison.methods)]


def _known(value: float) -> float | int | None:
    if not math.isfinite(value):
        return None
    return int(value) if float(value).is_integer() and abs(value) < 1e15 else float(value)
