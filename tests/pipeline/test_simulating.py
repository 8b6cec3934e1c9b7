from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from slkit import pipeline, registry
from slkit.data import Frames
from slkit.errors import InputError
from slkit.files import read_capture, read_image, read_rig
from slkit.geometry import Pose, Rig
from slkit.pipeline._simulating import depth_axis
from slkit.simulation import Optics, paper_rig

QUIET = Optics(read_noise=0.0, shot_noise=0.0)


def test_scan_folder_and_truth(gray_scan: Path, small_rig: Rig):
    found = read_capture(gray_scan)
    assert (found.codec, found.projector, found.parameters["axes"]) == ("gray", (256, 192), "x")
    rig = read_rig(gray_scan / "truth" / "rig.json")
    with np.load(gray_scan / "truth" / "object.npz") as truth, np.load(gray_scan / "truth" / "object_mesh.npz") as mesh:
        np.testing.assert_allclose(rig.camera.project(truth["xyz_mm"]), truth["camera_xy"], atol=1e-6)
        np.testing.assert_allclose(rig.to_projector(truth["xyz_mm"]), truth["projector_xy"], atol=1e-6)
        assert mesh["faces"].max() < len(mesh["vertices_mm"])


def test_several_codecs_see_one_scene(tmp_path: Path, small_rig: Rig):
    recipe = tmp_path / "coarse.toml"
    recipe.write_text('codec = "gray"\nparameters = {step = 4}\nprojector = [1, 1]')
    folders = pipeline.simulate_scan(tmp_path / "s", small_rig, "plane", ["gray", str(recipe)], optics=QUIET)
    assert [f.name for f in folders] == ["gray", "coarse"]
    assert read_capture(folders[1]).parameters["step"] == 4
    one, other = (read_image(f / "000_white.png") for f in folders)
    np.testing.assert_array_equal(one, other)
    with pytest.raises(InputError, match="different names"):
        pipeline.simulate_scan(tmp_path / "t", small_rig, "plane", ["gray", "gray"])
    with pytest.raises(InputError, match="no scene called 'cube'; there are: plane"):
        pipeline.simulate_scan(tmp_path / "t", small_rig, "cube")


@dataclass(frozen=True)
class Bands:
    """A codec of coloured patterns, as far as a simulation asks for one."""

    projector: tuple[int, int]
    grey: bool = False

    def encode(self) -> Frames:
        pattern = np.zeros((self.projector[1], self.projector[0], 3), np.uint8)
        pattern[..., 0] = 255
        return Frames.of([pattern[..., 0] if self.grey else pattern], ["bands"])

    def decode(self, frames: Frames, bounds: object = None) -> NoReturn:
        raise AssertionError("a simulation decodes nothing")

    def lit(self, frames: Frames) -> NoReturn:
        raise AssertionError("a simulation asks for no lit picture")


@pytest.mark.parametrize("grey", [True, False])
def test_coloured_patterns_make_coloured_pictures(tmp_path: Path, small_rig: Rig, monkeypatch, grey: bool):
    monkeypatch.setattr(registry, "load", lambda group, name: Bands)
    optics = replace(QUIET, crosstalk=0.1, ambient=0.0, black_level=0.0)
    pipeline.simulate_scan(tmp_path / "s", small_rig, "plane", ["bands"], {"grey": grey}, optics)
    picture = read_image(tmp_path / "s" / "000_bands.png")
    assert picture.ndim == (2 if grey else 3)
    if not grey:
        red, green, blue = picture[picture[..., 0] > 60].astype(float).mean(axis=0)
        assert green / red == pytest.approx(1 / 8, abs=0.5 / red) and blue == green
    pipeline.simulate_scan(tmp_path / "t", small_rig, "plane", ["bands"], {"grey": grey}, replace(optics, color=True))
    assert read_image(tmp_path / "t" / "000_bands.png").ndim == 3


def test_a_mesh_file_is_a_scene(tmp_path: Path, small_rig: Rig):
    (tmp_path / "roof.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 0 1 .2\nv 0 0 .5\nf 1 2 3\nf 1 2 4\n")
    (folder,) = pipeline.simulate_scan(tmp_path / "s", small_rig, str(tmp_path / "roof.obj"), optics=QUIET)
    with np.load(folder / "truth" / "object.npz") as truth:
        assert len(truth["xyz_mm"]) > 300


def test_seed_and_noise(tmp_path: Path, small_rig: Rig):
    def white(name: str, optics: Optics, seed: int) -> np.ndarray:
        pipeline.simulate_scan(tmp_path / name, small_rig, "plane", ["gray"], {"step": 64}, optics, seed)
        return read_image(tmp_path / name / "000_white.png").astype(float)

    noisy = Optics(read_noise=2.0, shot_noise=0.0)
    a, b, c, quiet = white("a", noisy, 1), white("b", noisy, 1), white("c", noisy, 2), white("d", QUIET, 1)
    np.testing.assert_array_equal(a, b)
    assert 1.9 < np.std((a - quiet)[10:-10, 10:-10][quiet[10:-10, 10:-10] > 50]) < 2.1
    assert (a != c).mean() > 0.5


def test_depth_axis_follows_the_baseline():
    rig = paper_rig()
    assert depth_axis(rig) == "x"
    quarter = Pose.from_rotation_vector([0, 0, np.pi / 2], [0, 0, 0])
    turned = Rig(rig.camera, rig.projector, quarter @ rig.projector_from_camera)
    assert depth_axis(turned) == "y"


def test_no_poses(tmp_path: Path, small_rig: Rig):
    with pytest.raises(InputError, match="poses must be at least 1"):
        pipeline.simulate_calibration(tmp_path, small_rig, 0)
