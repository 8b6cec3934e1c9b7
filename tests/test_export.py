"""Clouds to bytes and back; other programs can read them; damaged files are told from good ones."""

from __future__ import annotations

import io
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit import _open3d
from slkit.data import PointCloud
from slkit.errors import FileError
from slkit.export import ply, read_ply, xyz
from slkit.files import write_bytes


def some_cloud(rows: int = 50, normals: bool = False) -> PointCloud:
    rng = np.random.default_rng(rows)
    residual = rng.uniform(0, 1, rows)
    residual[::3] = np.nan
    return PointCloud(
        rng.normal(0, 300, (rows, 3)),
        rng.integers(0, 256, (rows, 3)) / 255,
        rng.uniform(0.01, 1, rows),
        residual,
        rng.uniform(0, 1000, (rows, 2)),
        rng.normal(size=(rows, 3)) if normals else None,
        rng.uniform(0, 0.01, rows),
    )


def written(cloud: PointCloud) -> bytes:
    return b"".join(ply(cloud))


@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("rows", [0, 1, 50])
def test_ply_round_trip(rows, normals):
    cloud = some_cloud(rows, normals)
    back = read_ply(written(cloud))
    for name in ("xyz", "color", "sigma_mm", "sigma_cal_mm", "residual_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(cloud, name))
    assert np.isnan(back.camera_xy).all()
    assert (back.normals is None) == (not normals)
    if normals:
        np.testing.assert_array_equal(back.normals, cloud.normals)


def test_the_header_is_what_formats_promises():
    header = written(some_cloud(normals=True)).split(b"end_header\n")[0].decode().splitlines()
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    properties = [line.split()[1:] for line in header if line.startswith("property")]
    names = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "sigma_mm", "sigma_cal_mm", "residual_px"]
    assert properties == [["uchar" if n in ("red", "green", "blue") else "float", n] for n in names]


@pytest.mark.parametrize("normals", [False, True])
def test_rows_are_those_of_numpy(normals: bool):
    cloud = some_cloud(70_000, normals)
    cloud.color[:9] = np.array([np.nan, -1, -0.0, 0.5, 1.5 / 255, 2.5 / 255, 1, np.inf, -np.inf])[:, None]
    columns = dict(zip("xyz", cloud.xyz.T, strict=True))
    if cloud.normals is not None:
        columns |= dict(zip(("nx", "ny", "nz"), cloud.normals.T, strict=True))
    shares = np.clip(np.where(np.isnan(cloud.color), np.float32(0.7), cloud.color), 0, 1)
    columns |= dict(zip("rgb", np.rint(255 * shares).astype(np.uint8).T, strict=True))
    columns |= {name: getattr(cloud, name) for name in ("sigma_mm", "sigma_cal_mm", "residual_px")}
    rows = np.empty(len(cloud), dtype=[(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    assert written(cloud).split(b"end_header\n", 1)[1] == rows.tobytes()


def test_open3d_and_trimesh_read_it(tmp_path):
    cloud, path = some_cloud(), tmp_path / "cloud.ply"
    path.write_bytes(written(cloud))
    read = _open3d.load().t.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(read.point.positions.numpy(), cloud.xyz)
    np.testing.assert_array_equal(read.point["sigma_mm"].numpy().ravel(), cloud.sigma_mm)
    np.testing.assert_array_equal(read.point.colors.numpy(), np.rint(255 * cloud.color))
    with path.open("rb") as file:
        loaded = trimesh.load(file, file_type="ply")
    np.testing.assert_array_equal(np.float32(loaded.vertices), cloud.xyz)
    np.testing.assert_array_equal(loaded.colors[:, :3], np.rint(255 * cloud.color))


def test_points_that_are_nan_are_left_out():
    cloud = some_cloud(10)
    holes = PointCloud(
        np.where(np.arange(10)[:, None] < 3, np.nan, cloud.xyz),
        np.full((10, 3), np.nan),
        cloud.sigma_mm,
        cloud.residual_px,
        cloud.camera_xy,
    )
    back = read_ply(written(holes))
    np.testing.assert_array_equal(back.xyz, cloud.xyz[3:])
    assert np.isfinite(back.color).all()
    assert xyz(holes).count(b"\n") == 7


def test_xyz_is_one_point_a_line():
    cloud = some_cloud(20)
    np.testing.assert_allclose(np.loadtxt(io.BytesIO(xyz(cloud))), cloud.xyz, atol=6e-5)
    assert xyz(some_cloud(0)) == b""


def ascii_ply(properties: str, rows: str, count: int, more: str = "") -> bytes:
    lines = "".join(f"property {p}\n" for p in properties.split(", "))
    return f"ply\nformat ascii 1.0\nelement vertex {count}\n{lines}{more}end_header\n{rows}".encode()


def test_a_strangers_ply():
    cloud = read_ply(ascii_ply("double x, double y, double z, int label", "1 2 3 7\n4 5 6 7\nnan 1 1 7\n", 3))
    np.testing.assert_array_equal(cloud.xyz, [[1, 2, 3], [4, 5, 6]])
    assert (cloud.color == cloud.color[0, 0]).all()
    for unknown in (cloud.sigma_mm, cloud.sigma_cal_mm, cloud.residual_px):
        assert np.isnan(unknown).all()
    assert cloud.normals is None


@pytest.mark.parametrize(("kind", "value"), [("uchar", 51), ("ushort", 13107), ("float", 0.2), ("double", 0.2)])
def test_colours_of_every_kind(kind, value):
    properties = f"float x, float y, float z, {kind} red, {kind} green, {kind} blue"
    cloud = read_ply(ascii_ply(properties, f"0 0 1 {value} 0 {value}\n", 1))
    np.testing.assert_allclose(cloud.color, [[0.2, 0, 0.2]], atol=1e-6)


def test_a_mesh_gives_its_vertices():
    more = "element face 1\nproperty list uchar int vertex_indices\n"
    cloud = read_ply(ascii_ply("float x, float y, float z", "0 0 1\n1 0 1\n0 1 1\n3 0 1 2\n", 3, more))
    assert len(cloud) == 3


def test_what_open3d_writes_is_read(tmp_path):
    o3d, cloud = _open3d.load(), some_cloud()
    for text in (False, True):
        path = str(tmp_path / "stranger.ply")
        o3d.io.write_point_cloud(path, cloud.to_open3d().to_legacy(), write_ascii=text)
        back = read_ply((tmp_path / "stranger.ply").read_bytes())
        np.testing.assert_allclose(back.xyz, cloud.xyz, rtol=1e-5)
        np.testing.assert_allclose(back.color, cloud.color, atol=1e-6)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a PLY"),
        (b"hello", "not a PLY"),
        (b"ply\n", "damaged"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999999999\nproperty float x\nend_header\n",
            "damaged",
        ),
        (written(some_cloud(50))[:-1], "damaged"),
        (written(some_cloud(50))[:120], "damaged"),
        (b"ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n", "no vertices"),
        (ascii_ply("float x, float y", "1 2\n", 1), "x, y and z"),
        (ascii_ply("list uchar float x, float y, float z", "1 1 2 3\n", 1), "x, y and z"),
    ],
)
def test_damaged_files_are_told(data, message):
    with pytest.raises(FileError, match=message):
        read_ply(data)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_no_damage_escapes_as_another_error(data):
    good = bytearray(written(some_cloud(5, normals=True)))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    try:
        cloud = read_ply(bytes(good))
    except FileError:
        return
    assert np.isfinite(cloud.xyz).all()


def test_importing_is_light():
    code = "import sys, slkit.export; sys.exit(', '.join({'plyfile', 'open3d', 'trimesh'} & set(sys.modules)) or None)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_a_large_cloud_comes_in_parts():
    cloud = some_cloud(300_000)
    parts = list(ply(cloud))
    assert len(parts) == 6
    back = read_ply(b"".join(parts))
    np.testing.assert_array_equal(back.xyz, cloud.xyz)
    np.testing.assert_array_equal(back.residual_px, cloud.residual_px)
    np.testing.assert_allclose(back.color, cloud.color, atol=1e-6)


@pytest.mark.parametrize("given", [b"abc", bytearray(b"abc"), memoryview(b"abc"), iter([b"a", memoryview(b"bc")])])
def test_what_an_exporter_may_return_is_written(given, tmp_path):
    write_bytes(tmp_path / "a.bin", given)
    assert (tmp_path / "a.bin").read_bytes() == b"abc"
