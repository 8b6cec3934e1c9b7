"""One method of a comparison: what is measured of its scan, and by which rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.geometry import Rig
from slkit.pipeline._comparing_limits import Taken, limit_of
from slkit.pipeline._comparing_references import Mask, Measured, Plate, Reference, bent_note
from slkit.pipeline._comparing_surface import Truth
from slkit.pipeline._scanning import ScanResult
from slkit.report.comparison import Method

_RATE_HZ = 60.0
_NEIGHBORS = 24
"""Points that a neighbourhood of the sparsest cloud has where its roughness is measured."""
_GAP = 60
"""Gaps up to this part of the picture's width lie inside what a method saw: lines are apart by less."""


@dataclass(frozen=True)
class Rules:
    """What is the same for all methods of a comparison.

    radius_mm: of the neighbourhoods of the roughness, None: as the sparsest cloud needs. blur_px: 1 sigma of the
    camera's lens in camera px and of the projector in projector px, for the physical limit. depth_mm: nearest and
    farthest depth that can occur, or None.
    """

    radius_mm: float | None = None
    blur_px: tuple[float, float] = (0.6, 0.6)
    depth_mm: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Scanned:
    """One folder: its scan, its pictures in memory, what it took, and the camera pixels (h, w) that it covers."""

    name: str
    folder: str
    kind: str
    parameters: Mapping[str, Any]
    result: ScanResult
    taken: Taken
    decode_s: float
    area: Mask


@dataclass(frozen=True, eq=False)
class Measure:
    """Everything that a cloud is measured with; common, union (h, w): what all methods saw, and what any saw."""

    reference: Reference
    rules: Rules
    rig: Rig
    true_rig: Rig | None
    radius_mm: float
    common: Mask
    union: Mask

    def method(self, one: Scanned) -> Method:
        """Return the numbers of one scan."""
        from slkit.triangulation import with_normals

        cloud = one.result.cloud
        count = len(one.taken.names)
        col, row = _pixels(cloud, self.rig.camera.size)
        measured = self.reference.measure(cloud, self.common[row, col], self.rig)
        rough = self._roughness(measured)
        limit = limit_of(one.kind, one.taken, with_normals(cloud), self.rig, self.rules.blur_px)
        numbers = {
            "patterns": count,
            "capture_s": count / _RATE_HZ,
            "points": len(cloud),
            "completeness_share": float(one.area.sum() / self.union.sum()),
            "roughness_mm": rough,
            "limit_mm": limit,
            "efficiency_ratio": rough / limit,
            "decode_s": one.decode_s,
        }
        numbers |= _sigmas(cloud) | dict(measured.numbers) | self._with_true_rig(one)
        notes = (*one.result.notes, *measured.notes)
        if isinstance(self.reference, Plate):
            noise = max(rough, numbers.get("sigma_decoding_mm", rough))
            notes = (*notes, *bent_note(measured.away_mm, noise))
        return Method(
            one.name, one.kind, one.folder, measured.cloud, measured.away_mm, numbers, dict(one.parameters), notes
        )

    def _roughness(self, measured: Measured) -> float:
        """Return the roughness of a cloud, without the relief of the object where the true shape is known."""
        from slkit.report.measure import roughness

        points = measured.cloud.xyz if measured.flat_xyz is None else measured.flat_xyz
        return roughness(points, self.radius_mm).sigma_mm

    def _with_true_rig(self, one: Scanned) -> dict[str, float]:
        """Return what the same correspondences give without the calibration's error."""
        from slkit.triangulation import Filters, triangulate

        if self.true_rig is None or not isinstance(self.reference, Truth):
            return {}
        cloud, _ = Filters().apply(triangulate(one.result.correspondences, self.true_rig), self.rules.depth_mm)
        own = replace(self.reference, also_aligned=False, align=False)
        measured = own.measure(cloud, np.zeros(len(cloud), dtype=bool), self.true_rig)
        return {
            "true_rig_rms_mm": measured.numbers["rms_mm"],
            "true_rig_roughness_mm": self._roughness(measured),
        }


def _sigmas(cloud: PointCloud) -> dict[str, float]:
    """Return the medians of the stated sigmas, and of the calibration's share of their square."""
    names = ("sigma_mm", "sigma_decoding_mm", "sigma_cal_mm")
    share = (cloud.sigma_cal_mm / np.maximum(cloud.sigma_mm, 1e-12)) ** 2
    values = {name: getattr(cloud, name) for name in names} | {"calibration_share": share}
    medians = {n: v[np.isfinite(v)] for n, v in values.items()}
    return {n: float(np.median(v)) for n, v in medians.items() if len(v)}


def radius(clouds: Sequence[PointCloud]) -> float:
    """Return the radius in mm at which half of the places of every cloud have 24 neighbours, two digits."""
    from scipy.spatial import KDTree

    radii = [1e-3]
    for cloud in clouds:
        places = cloud.xyz[:: max(len(cloud) // 2000, 1)]
        if len(cloud) > _NEIGHBORS:
            radii.append(float(np.median(KDTree(cloud.xyz).query(places, _NEIGHBORS + 1)[0][:, -1])))
    return float(f"{max(radii):.2g}")


def _pixels(cloud: PointCloud, size: tuple[int, int]) -> npt.NDArray[np.intp]:
    return np.rint(cloud.camera_xy).astype(np.intp).clip(0, np.array(size) - 1).T


def covered(cloud: PointCloud, size: tuple[int, int]) -> Mask:
    """Return the camera pixels (h, w) that a cloud covers, the gaps between its lines closed."""
    import cv2

    seen = np.zeros((size[1], size[0]), dtype=np.uint8)
    col, row = _pixels(cloud, size)
    seen[row, col] = 1
    reach = gap_px(size)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return cv2.morphologyEx(seen, cv2.MORPH_CLOSE, disc) > 0


def gap_px(size: tuple[int, int]) -> int:
    return max(round(size[0] / _GAP / 2), 1)
