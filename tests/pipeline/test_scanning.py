import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.errors import DecodeError, FileError, InputError, PluginError
from slkit.files import read_image, write_png
from slkit.geometry import Rig
from slkit.simulation import paper_rig, random_rig


@pytest.fixture
def folder(gray_scan: Path, tmp_path: Path) -> Path:
    return shutil.copytree(gray_scan, tmp_path / "scan")


def frames_of(folder: Path) -> list[Path]:
    return sorted(folder.glob("0*.png"))


def test_scan_of_a_sphere_lies_on_the_sphere(gray_scan: Path, small_rig: Rig):
    told: list[tuple[str, int, int]] = []
    result = pipeline.scan(gray_scan, small_rig, progress=lambda *step: told.append(step))
    with np.load(gray_scan / "truth" / "object.npz") as truth:
        camera_xy, xyz_mm = truth["camera_xy"], truth["xyz_mm"]
    expected = {tuple(xy): xyz for xy, xyz in zip(camera_xy.astype(int).tolist(), xyz_mm, strict=True)}
    pairs = [
        (p, expected[key])
        for p, xy in zip(result.cloud.xyz, np.rint(result.cloud.camera_xy).astype(int).tolist(), strict=True)
        if (key := tuple(xy)) in expected
    ]
    assert len(pairs) > 0.9 * len(expected) > 500
    error = np.linalg.norm([a - b for a, b in pairs], axis=1)
    # Whole cells of two projector px: uniform errors, as sigma says.
    assert np.median(error / np.median(result.cloud.sigma_mm)) < 1.5
    assert set(result.seconds) == {"read", "decode", "triangulate"}
    assert set(result.removed) == {"residual", "sigma", "depth", "isolated"}
    assert told[-1][1] == told[-1][2]
    assert result.cloud.normals is None


def test_depth_bounds_and_normals(gray_scan: Path, small_rig: Rig):
    everything = pipeline.scan(gray_scan, small_rig).cloud
    near, far = np.percentile(everything.xyz[:, 2], [20, 60])
    result = pipeline.scan(gray_scan, small_rig, depth=(near, far), normals=True)
    z = result.cloud.xyz[:, 2]
    assert near <= z.min() and z.max() <= far
    assert 0.2 * len(everything) < len(z) < 0.6 * len(everything)
    assert result.cloud.normals is not None
    towards = (result.cloud.normals * result.cloud.xyz).sum(axis=1)
    assert (towards < 0).all()
    with pytest.raises(InputError, match="nearer first"):
        pipeline.scan(gray_scan, small_rig, depth=(far, near))
    with pytest.raises(DecodeError, match=r"scan"):
        pipeline.scan(gray_scan, small_rig, depth=(10, 20))


@pytest.mark.parametrize("seed", range(4))
def test_bounds_hold_every_point_of_the_depth_range(seed: int, rng: np.random.Generator, scaled):
    rig = scaled(random_rig(np.random.default_rng(seed)), 0.25)
    near, far = 500.0, 1800.0
    limits = pipeline.bounds(rig, (near, far))
    assert limits.shape == (rig.camera.size[1], rig.camera.size[0], 4) and limits.dtype == np.float32
    depth = rng.uniform(near, far, limits.shape[:2])
    xy = rig.to_projector(rig.camera.rays() * depth[..., None])
    lit = ((xy > 0) & (xy < np.array(rig.projector.size) - 1)).all(axis=-1)
    assert lit.sum() > 100
    low, high = limits[lit][:, [0, 2]], limits[lit][:, [1, 3]]
    # The bend of a ray's picture between the sampled depths stays far below a pixel.
    assert (xy[lit] >= low - 0.2).all() and (xy[lit] <= high + 0.2).all()
    ends = rig.to_projector(rig.camera.rays()[lit] * near)
    assert np.nanmax(np.min(np.abs(ends[:, None] - np.stack([low, high], axis=1)), axis=1)) < 0.2


def test_bounds_are_silent_where_no_light_can_be(small_rig: Rig):
    limits = pipeline.bounds(small_rig, (10.0, 12.0))
    assert np.isnan(limits).all()


def test_rig_of_other_devices_is_refused(gray_scan: Path, small_rig: Rig):
    big = paper_rig()
    with pytest.raises(InputError, match=r"rig is for a camera of 768 x 576 px, but .* taken with 192 x 144"):
        pipeline.scan(gray_scan, replace(small_rig, camera=big.camera))
    with pytest.raises(InputError, match=r"rig is for a projector of 1024 x 768 px, but .* 256 x 192"):
        pipeline.scan(gray_scan, replace(small_rig, projector=big.projector))


@pytest.mark.parametrize(("level", "message"), [(0, "lit"), (255, "saturated"), (120, "lit")])
def test_pictures_without_light_and_shade(folder: Path, small_rig: Rig, level: int, message: str):
    for path in frames_of(folder):
        write_png(path, np.full_like(read_image(path), level))
    with pytest.raises(DecodeError, match=f"scan.*{message}"):
        pipeline.scan(folder, small_rig)


def test_one_frame_is_missing(folder: Path, small_rig: Rig):
    count = len(frames_of(folder))
    frames_of(folder)[5].unlink()
    with pytest.raises(FileError, match=rf"has {count - 1} pictures, but gray needs {count}: missing 005_x_bit"):
        pipeline.scan(folder, small_rig)


def test_one_frame_is_truncated(folder: Path, small_rig: Rig):
    path = frames_of(folder)[7]
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(FileError, match=path.name):
        pipeline.scan(folder, small_rig)


def test_frames_of_two_sizes(folder: Path, small_rig: Rig):
    path = frames_of(folder)[7]
    write_png(path, read_image(path)[:-2])
    with pytest.raises(FileError, match=rf"{path.name} is 192 x 142 px .* 192 x 144"):
        pipeline.scan(folder, small_rig)


def test_parameters_go_before_the_file(folder: Path, small_rig: Rig):
    with pytest.raises(InputError, match=r"capture\.toml: stepp|'stepp' is no parameter"):
        pipeline.scan(folder, small_rig, {"stepp": 1})
    with pytest.raises(FileError, match="but gray needs"):
        pipeline.scan(folder, small_rig, {"step": 1})


def test_filters_by_name(gray_scan: Path, small_rig: Rig):
    assert set(pipeline.scan(gray_scan, small_rig, filters=pipeline.make_filters(["sigma"])).removed) == {
        "residual",
        "depth",
        "isolated",
    }
    with pytest.raises(InputError, match="no filter called 'noise'; there are: residual, sigma, depth, isolated"):
        pipeline.make_filters(["noise"])


def test_cloud_to_file_and_picture(gray_scan: Path, small_rig: Rig, tmp_path: Path):
    cloud = pipeline.scan(gray_scan, small_rig).cloud
    pipeline.write_cloud(tmp_path / "a.PLY", cloud)
    pipeline.view(tmp_path / "a.PLY", tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").std() > 5
    with pytest.raises(PluginError, match="no exporter called 'stl'; installed are: ply, xyz"):
        pipeline.write_cloud(tmp_path / "a.stl", cloud)
    with pytest.raises(PluginError, match="no exporter called ''"):
        pipeline.write_cloud(tmp_path / "a", cloud)
    with pytest.raises(FileError, match=r"none\.ply"):
        pipeline.view(tmp_path / "none.ply", tmp_path / "b.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.PLY", "a.png"]
