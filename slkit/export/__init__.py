"""Clouds as the bytes of a file, and back for viewing."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.device import one_ahead
from slkit.errors import FileError

_GREY = 0.7
_COLORS = "red", "green", "blue"
# Rows that are written at a time.
_PART = 1 << 16


def ply(cloud: PointCloud) -> Iterator[bytes | memoryview]:
    """Give, part by part, a binary little-endian PLY: x y z in mm, colours, both sigmas and the residual.

    float x y z, uchar red green blue, float sigma_mm sigma_cal_mm residual_px. A cloud with normals adds float
    nx ny nz. Points that are NaN are left out; a sigma or residual may be NaN.
    """
    from plyfile import PlyData, PlyElement

    cloud = cloud.select(cloud.finite)
    normals = () if cloud.normals is None else ("nx", "ny", "nz")
    names = *"xyz", *normals, *_COLORS, "sigma_mm", "sigma_cal_mm", "residual_px"
    row = np.dtype([(name, "u1" if name in _COLORS else "<f4") for name in names])
    vertex = PlyElement.describe(np.empty(0, dtype=row), "vertex")
    comments = ["units millimetres", "frame camera: x right, y down, z forward"]
    head = PlyData([vertex], text=False, byte_order="<", comments=comments).header
    yield head.replace("element vertex 0", f"element vertex {len(cloud)}").encode("ascii") + b"\n"
    # A part at a time: memory for all of a large cloud costs more time than its bytes.
    yield from one_ahead(_rows(cloud, start, row.itemsize) for start in range(0, len(cloud), _PART))


def _rows(cloud: PointCloud, start: int, width: int) -> memoryview:
    """Return xyz, normals, colour, sigmas and residual of a part of the points as rows of so many bytes."""
    from slkit.export._row_kernels import write_rows

    def part(column: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return np.ascontiguousarray(column[start : start + _PART])

    rows = np.empty((min(len(cloud) - start, _PART), width), dtype=np.uint8)
    write_rows(
        part(cloud.xyz),
        np.empty((0, 3), np.float32) if cloud.normals is None else part(cloud.normals),
        part(cloud.color),
        part(cloud.sigma_mm),
        part(cloud.sigma_cal_mm),
        part(cloud.residual_px),
        np.float32(_GREY),
        rows,
    )
    return rows.reshape(-1).data


def xyz(cloud: PointCloud) -> bytes:
    """Return a text file with one point a line, x y z in mm with four decimals; points that are NaN are left out."""
    there = cloud.xyz[cloud.finite]
    file = io.BytesIO()
    np.savetxt(file, there, fmt="%.4f")
    return file.getvalue()


def read_ply(data: bytes) -> PointCloud:
    """Return the cloud of a PLY file, one of slkit's or a stranger's, text or binary.

    It needs x y z; where there is no red green blue the points are grey, where there is no sigma_mm, sigma_cal_mm
    or residual_px they are NaN, as camera_xy always is. Points that are not finite are left out.
    Errors: FileError where the bytes are no PLY, are damaged, or hold no points with x y z.
    """
    vertices = _vertices(data)
    columns = _number_columns(vertices)
    if not {"x", "y", "z"} <= columns.keys():
        raise FileError("the PLY file has no vertices with x, y and z: it cannot be read as a point cloud")
    points = _together(columns, ("x", "y", "z"))
    count = len(points)
    nothing = np.full(count, np.nan, dtype=np.float32)
    color = np.full((count, 3), _GREY, dtype=np.float32)
    if {"red", "green", "blue"} <= columns.keys():
        color = np.stack([_fraction(columns[c]) for c in ("red", "green", "blue")], axis=1)
    cloud = PointCloud(
        points,
        color,
        columns.get("sigma_mm", nothing),
        columns.get("residual_px", nothing),
        np.full((count, 2), np.nan, dtype=np.float32),
        _together(columns, ("nx", "ny", "nz")) if {"nx", "ny", "nz"} <= columns.keys() else None,
        columns.get("sigma_cal_mm", nothing),
    )
    return cloud.select(cloud.finite)


def _vertices(data: bytes) -> npt.NDArray[Any]:
    from plyfile import PlyData

    if not data.startswith(b"ply"):
        raise FileError("this is not a PLY file: its first line is not `ply`")
    try:
        found: Any = PlyData.read(io.BytesIO(data))
        return np.asarray(found["vertex"].data)
    except KeyError as error:
        raise FileError("the PLY file has no vertices: it cannot be read as a point cloud") from error
    # A damaged header can ask for anything: plyfile answers with whatever NumPy raised.
    except Exception as error:
        raise FileError(f"the PLY file is damaged and cannot be read ({error}): write it again") from error


def _number_columns(vertices: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    names = vertices.dtype.names or ()
    return {n: vertices[n] for n in names if vertices[n].dtype.kind in "iuf"}


def _together(columns: dict[str, npt.NDArray[Any]], names: tuple[str, ...]) -> npt.NDArray[np.float32]:
    with np.errstate(over="ignore"):  # a double beyond float32 becomes infinite, and is left out
        return np.stack([columns[name].astype(np.float32) for name in names], axis=1)


def _fraction(values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Return colours 0 to 1: whole numbers are shares of their type's largest value."""
    scale = float(np.iinfo(values.dtype).max) if values.dtype.kind in "iu" else 1.0
    return np.clip(np.nan_to_num(values.astype(np.float64) / scale, nan=_GREY), 0, 1).astype(np.float32)
