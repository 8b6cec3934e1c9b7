"""What decoding yields, and what triangulation makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import _open3d
from slkit.errors import InputError

Float32s = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Pairs of a camera and a projector position, one a row; rows come in no particular order.

    camera_xy (m, 2) px, sub-pixel for line peaks; projector_xy (m, 2) px, NaN where the code is silent;
    sigma (m, 2): 1 sigma of projector_xy in projector px, the camera's share carried over by the local slope, NaN
    where the code is silent; confidence (m,) 0 to 1 that the label is right; color (m, 3) RGB 0 to 1.
    All float32. Errors: InputError where shapes disagree.
    """

    camera_xy: Float32s
    projector_xy: Float32s
    sigma: Float32s
    confidence: Float32s
    color: Float32s

    def __post_init__(self) -> None:
        _hold_float32(self, {"camera_xy": 2, "projector_xy": 2, "sigma": 2, "confidence": None, "color": 3})

    def __len__(self) -> int:
        return len(self.camera_xy)

    def select(self, keep: npt.NDArray[Any]) -> Correspondences:
        """Return the rows named by a mask (m,) or by indices."""
        return Correspondences(
            self.camera_xy[keep], self.projector_xy[keep], self.sigma[keep], self.confidence[keep], self.color[keep]
        )

    def as_map(self, shape: tuple[int, int]) -> Float32s:
        """Return projector_xy as a picture (h, w, 2) for display, NaN where nothing was decoded.

        shape (h, w). A row is written to the camera pixel nearest to it.
        """
        result = np.full((*shape, 2), np.nan, dtype=np.float32)
        nearest = np.rint(self.camera_xy).astype(np.intp)
        cols, rows = nearest[:, 0], nearest[:, 1]
        within = (nearest >= 0) & (nearest < np.array(shape[::-1]))
        inside: npt.NDArray[Any] = np.flatnonzero(within.all(axis=1))
        result[rows[inside], cols[inside]] = self.projector_xy[inside]
        return result


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in the camera frame with the evidence for each.

    xyz (m, 3) mm; color (m, 3) RGB 0 to 1; sigma_mm (m,): 1 sigma along the viewing ray, decoding and calibration
    together where both are known; residual_px (m,): reprojection residual, NaN where one coded axis leaves no
    redundancy; camera_xy (m, 2) px: where the camera saw the point; normals (m, 3), of length 1, or None;
    sigma_cal_mm (m,): the calibration's share of sigma_mm, which neighbours have in common, or NaN where it is not
    known: sigma_mm is then the decoding's alone. One number stands for all points. All float32.
    Errors: InputError where shapes disagree.
    """

    xyz: Float32s
    color: Float32s
    sigma_mm: Float32s
    residual_px: Float32s
    camera_xy: Float32s
    normals: Float32s | None = None
    sigma_cal_mm: Float32s = field(default_factory=lambda: np.array(np.nan, dtype=np.float32))

    def __post_init__(self) -> None:
        if np.ndim(self.sigma_cal_mm) == 0:
            object.__setattr__(self, "sigma_cal_mm", np.full(len(self.xyz), self.sigma_cal_mm, dtype=np.float32))
        widths = {"xyz": 3, "color": 3, "sigma_mm": None, "residual_px": None, "camera_xy": 2, "sigma_cal_mm": None}
        _hold_float32(self, widths | ({} if self.normals is None else {"normals": 3}))

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def finite(self) -> npt.NDArray[np.bool_]:
        """Mask (m,) of the points that exist: xyz is not NaN."""
        x, y, z = self.xyz.T
        return np.isfinite(x) & np.isfinite(y) & np.isfinite(z)

    @property
    def sigma_decoding_mm(self) -> Float32s:
        """The decoding's share (m,) of sigma_mm, which differs from point to point."""
        calibration = np.nan_to_num(self.sigma_cal_mm)
        # A difference of squares as a product: single precision is enough.
        with np.errstate(over="ignore"):
            square = self.sigma_mm - calibration
            square *= self.sigma_mm + calibration
        return np.sqrt(np.maximum(square, 0, out=square), out=square)

    def select(self, keep: npt.NDArray[Any]) -> PointCloud:
        """Return the points named by a mask (m,) or by indices; the cloud itself where a mask names all."""
        if keep.dtype == np.bool_ and keep.all():
            return self
        return PointCloud(
            self.xyz[keep],
            self.color[keep],
            self.sigma_mm[keep],
            self.residual_px[keep],
            self.camera_xy[keep],
            None if self.normals is None else self.normals[keep],
            self.sigma_cal_mm[keep],
        )

    def to_open3d(self) -> Any:
        """Return an `open3d.t.geometry.PointCloud` with positions, colors, sigmas, residual_px and normals kept."""
        o3d = _open3d.load()
        tensor = o3d.core.Tensor
        cloud = o3d.t.geometry.PointCloud(tensor(np.ascontiguousarray(self.xyz)))
        cloud.point["colors"] = tensor(np.ascontiguousarray(self.color))
        for name in ("sigma_mm", "sigma_cal_mm", "residual_px"):
            cloud.point[name] = tensor(getattr(self, name).reshape(-1, 1).copy())
        if self.normals is not None:
            cloud.point["normals"] = tensor(np.ascontiguousarray(self.normals))
        return cloud


def _hold_float32(owner: object, widths: Mapping[str, int | None]) -> None:
    rows: int | None = None
    for name, width in widths.items():
        array = np.asarray(getattr(owner, name), dtype=np.float32)
        rows = len(array) if rows is None and array.ndim else rows
        wanted = (rows,) if width is None else (rows, width)
        if array.shape != wanted:
            raise InputError(f"{name} must have the shape {wanted}, not {array.shape}")
        object.__setattr__(owner, name, array)
