"""Clouds as the bytes of a file, and back for viewing."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import PointCloud
from slkit.device import side_by_side, threads
from slkit.errors import FileError

_GREY = 0.7
_COLORS = "red", "green", "blue"
# Rows that are written at a time, and those that stay in the cache while their columns are filled.
_PART, _AT_ONCE = 1 << 17, 1 << 14


def ply(cloud: PointCloud) -> Iterator[bytes | memoryview]:
    """Give, part by part, a binary little-endian PLY: x y z in mm, colours, both sigmas and the residual.

    float x y z, uchar red green blue, float sigma_mm sigma_cal_mm residual_px. A cloud with normals adds float
    nx ny nz. Points that are NaN are left out; a sigma or residual may be NaN.
    """
    from plyfile import PlyData, PlyElement

    cloud = cloud.select(cloud.finite)
    columns: dict[str, npt.NDArray[Any]] = dict(zip("xyz", cloud.xyz.T, strict=True))
    if cloud.normals is not None:
        columns |= dict(zip(("nx", "ny", "nz"), cloud.normals.T, strict=True))
    columns |= dict(zip(_COLORS, cloud.color.T, strict=True))
    columns |= {n: getattr(cloud, n) for n in ("sigma_mm", "sigma_cal_mm", "residual_px")}
    kinds = [(name, "u1" if name in _COLORS else "<f4") for name in columns]
    vertex = PlyElement.describe(np.empty(0, dtype=kinds), "vertex")
    comments = ["units millimetres", "frame camera: x right, y down, z forward"]
    head = PlyData([vertex], text=False, byte_order="<", comments=comments).header
    yield head.replace("element vertex 0", f"element vertex {len(cloud)}").encode("ascii") + b"\n"
    # A part at a time: memory for all of a large cloud costs more time than its bytes.
    for start in range(0, len(cloud), _PART):
        yield _rows(columns, kinds, start, min(start + _PART, len(cloud))).view(np.uint8).data


def _rows(
    columns: Mapping[str, npt.NDArray[Any]], kinds: list[tuple[str, str]], start: int, stop: int
) -> npt.NDArray[Any]:
    """Return rows of columns as one record each."""
    rows = np.empty(stop - start, dtype=kinds)

    def fill(first: int, last: int) -> None:
        for row in range(first, last, _AT_ONCE):
            to = slice(row, min(row + _AT_ONCE, last))
            given = slice(start + to.start, start + to.stop)
            for (name, values), (_, kind) in zip(columns.items(), kinds, strict=True):
                rows[name][to] = _bytes(values[given]) if kind == "u1" else values[given]

    side_by_side(fill, np.linspace(0, len(rows), threads() + 1).astype(int).tolist())
    return rows


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


def _bytes(color: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    return np.rint(255 * np.clip(np.nan_to_num(color, nan=_GREY), 0, 1)).astype(np.uint8)
