import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import FileError, InputError
from slkit.files import read_opencv, read_provenance, read_rig, write_opencv, write_rig
from slkit.geometry import Rig
from slkit.simulation import paper_rig, random_rig


def assert_same(a: Rig, b: Rig) -> None:
    for one, other in ((a.camera, b.camera), (a.projector, b.projector)):
        assert one.size == other.size
        np.testing.assert_array_equal(one.K, other.K)
        np.testing.assert_array_equal(one.distortion, other.distortion)
    np.testing.assert_array_equal(a.projector_from_camera.rotation, b.projector_from_camera.rotation)
    np.testing.assert_array_equal(a.projector_from_camera.translation, b.projector_from_camera.translation)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, seed: int):
    folder, rig = tmp_path_factory.mktemp("rig"), random_rig(np.random.default_rng(seed))
    write_rig(folder / "rig.json", rig)
    assert_same(read_rig(folder / "rig.json"), rig)
    write_opencv(folder / "rig.yml", rig)
    assert_same(read_opencv(folder / "rig.yml"), rig)


def test_covariance_photometry_and_provenance(tmp_path: Path):
    covariance = {"parameters": ("fx", "fy"), "matrix": np.array([[2.0, 0.5], [0.5, 1.0]])}
    rig = replace(paper_rig(), covariance=covariance, photometry={"mixing": np.eye(3)})
    write_rig(tmp_path / "rig.json", rig, {"method": "planar", "rms_px": {"joint": np.float64(0.25)}})
    again = read_rig(tmp_path / "rig.json")
    assert again.covariance is not None and again.photometry is not None
    assert again.covariance["parameters"] == ("fx", "fy")
    np.testing.assert_array_equal(again.covariance["matrix"], covariance["matrix"])
    np.testing.assert_array_equal(again.photometry["mixing"], np.eye(3))
    assert read_provenance(tmp_path / "rig.json") == {"method": "planar", "rms_px": {"joint": 0.25}}


def test_layout_of_the_file(tmp_path: Path):
    write_rig(tmp_path / "rig.json", paper_rig())
    table = json.loads((tmp_path / "rig.json").read_text())
    assert (table["format"], table["version"], table["units"]) == ("slkit-rig", 1, "mm")
    assert table["camera"]["size"] == [768, 576]
    assert np.shape(table["projector"]["K"]) == (3, 3)
    assert np.shape(table["projector_from_camera"]["translation"]) == (3,)
    assert "covariance" not in table and "provenance" not in table
    assert read_provenance(tmp_path / "rig.json") == {}


def test_not_finite_is_refused_both_ways(tmp_path: Path):
    rig = replace(paper_rig(), covariance={"matrix": np.array([[np.nan]])})
    with pytest.raises(InputError, match="not finite"):
        write_rig(tmp_path / "rig.json", rig)
    assert not (tmp_path / "rig.json").exists()
    write_rig(tmp_path / "rig.json", paper_rig())
    text = (tmp_path / "rig.json").read_text().replace("900.0", "NaN", 1)
    (tmp_path / "rig.json").write_text(text)
    with pytest.raises(FileError, match="NaN"):
        read_rig(tmp_path / "rig.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "format is 'other'"),
        ({"version": 2}, "version is 2"),
        ({"units": "m"}, "units is 'm'"),
        ({"camera": {"size": [768, 576]}}, "camera.K"),
        ({"camera": {"size": [-1, 576], "K": np.eye(3).tolist(), "distortion": [0] * 5}}, "camera: size"),
        ({"projector_from_camera": {"rotation": np.ones((3, 3)).tolist(), "translation": [0, 0, 0]}}, "orthonormal"),
        ({"projector": 3}, "lacks"),
    ],
)
def test_faults_are_named(tmp_path: Path, change: dict, message: str):
    write_rig(tmp_path / "rig.json", paper_rig())
    table = json.loads((tmp_path / "rig.json").read_text()) | change
    (tmp_path / "rig.json").write_text(json.dumps(table))
    with pytest.raises(FileError, match=message) as caught:
        read_rig(tmp_path / "rig.json")
    assert "rig.json" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"\xff\xfe\x00"])
def test_other_files_are_no_rig(tmp_path: Path, content: bytes):
    (tmp_path / "rig.json").write_bytes(content)
    with pytest.raises(FileError, match=r"rig\.json"):
        read_rig(tmp_path / "rig.json")


def test_opencv_takes_four_coefficients_and_refuses_skew(tmp_path: Path):
    import cv2

    rig = paper_rig()
    write_opencv(tmp_path / "rig.yml", rig)
    storage = cv2.FileStorage(str(tmp_path / "rig.yml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("T").mat().ravel(), rig.projector_from_camera.translation)
    assert storage.getNode("camera_size").mat().ravel().tolist() == [768, 576]
    storage.release()
    text = (tmp_path / "rig.yml").read_text()
    head, rest = text.split("camera_distortion", 1)
    body, tail = rest.split("projector_size", 1)
    short = ": !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n   data: [ 0.1, 0.2, 0.3, 0.4 ]\n"
    (tmp_path / "four.yml").write_text(head + "camera_distortion" + short + "projector_size" + tail)
    assert read_opencv(tmp_path / "four.yml").camera.distortion.tolist() == [0.1, 0.2, 0.3, 0.4, 0.0]
    skewed = rig.camera.K.copy()
    skewed[0, 1] = 0.5
    with pytest.raises(InputError, match="skew"):
        write_opencv(tmp_path / "skew.yml", replace(rig, camera=replace(rig.camera, K=skewed)))
    assert not (tmp_path / "skew.yml").exists()


@pytest.mark.parametrize("content", ["", "hello\nworld", "%YAML:1.0\n---\nR: 5\n", '{"a": 1}'])
def test_other_files_are_no_opencv_rig(tmp_path: Path, content: str):
    (tmp_path / "x.yml").write_text(content)
    with pytest.raises(FileError, match=r"x\.yml"):
        read_opencv(tmp_path / "x.yml")
