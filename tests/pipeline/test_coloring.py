import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.errors import CalibrationError, FileError, InputError
from slkit.files import read_image, read_provenance, read_rig, write_png, write_rig
from slkit.geometry import Rig
from slkit.simulation import Optics

OPTICS = Optics(crosstalk=0.12, projector_gamma=2.2)


@pytest.fixture(scope="module")
def colors(small_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated colour folder with intermediate levels; not to be changed by a test."""
    folder = tmp_path_factory.mktemp("colors")
    pipeline.simulate_color(folder, small_rig, {"levels": [64, 160]}, OPTICS, seed=1)
    return folder


def test_what_is_projected(tmp_path: Path):
    paths = pipeline.projected_color((32, 24), tmp_path, {"levels": [128, 7]})
    assert [p.name for p in paths][:8] == [
        *(f"{n}.png" for n in ("white", "black", "red", "green", "blue")),
        *(f"{n}_007.png" for n in ("red", "green", "blue")),
    ]
    for name, level in (
        ("white", (255, 255, 255)),
        ("black", (0, 0, 0)),
        ("green", (0, 255, 0)),
        ("blue_128", (0, 0, 128)),
    ):
        picture = read_image(tmp_path / f"{name}.png")
        assert picture.shape == (24, 32, 3) and (picture == level).all()
    page = (tmp_path / "slideshow.html").read_text()
    assert "width = 32, height = 24" in page and all(f'"{p.name}"' in page for p in paths)
    with pytest.raises(FileError, match=r"already holds .*blue_007"):
        pipeline.projected_color((32, 24), tmp_path)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [({"levels": [0]}, "color: levels must be from 1 to 254, not 0"), ({"level": 3}, "no parameter; there are")],
)
def test_wrong_parameters_leave_no_folder(tmp_path: Path, small_rig: Rig, parameters: dict, message: str):
    for make in (lambda f: pipeline.projected_color((32, 24), f, parameters),
                 lambda f: pipeline.simulate_color(f, small_rig, parameters)):  # fmt: skip
        with pytest.raises(InputError, match=message):
            make(tmp_path / "c")
        assert not (tmp_path / "c").exists()


def test_a_simulated_folder_gives_the_truth_beside_it(colors: Path):
    found, truth = pipeline.measure_photometry(colors), read_rig(colors / "truth" / "rig.json").photometry
    assert truth is not None
    sigma = np.max(found["evidence"]["mixing_sigma"])
    np.testing.assert_allclose(found["mixing"], truth["mixing"], atol=5 * sigma)
    np.testing.assert_allclose(found["ambient"], truth["ambient"], atol=1e-3)
    np.testing.assert_allclose(found["response"], truth["response"], atol=0.01)
    np.testing.assert_allclose(truth["response"], 2.2)
    assert found["evidence"]["neutral"] > 0.99 and not found["warnings"]


def test_everything_else_in_the_file_is_kept(tmp_path: Path, small_rig: Rig, colors: Path):
    covariance = {"parameters": ("camera.fx", "camera.fy"), "matrix": np.array([[2.0, 0.1], [0.1, 1.0]])}
    write_rig(
        tmp_path / "rig.json", replace(small_rig, covariance=covariance), {"method": "planar", "notes": [None, 1]}
    )
    before = json.loads((tmp_path / "rig.json").read_text()) | {"unknown": [1, None, {"a": 1e-300}]}
    (tmp_path / "rig.json").write_text(json.dumps(before))
    found = pipeline.add_photometry(tmp_path / "rig.json", colors, tmp_path / "new.json")
    assert json.loads((tmp_path / "rig.json").read_text()) == before
    after = json.loads((tmp_path / "new.json").read_text())
    assert after.pop("photometry") == found and after == before
    pipeline.add_photometry(tmp_path / "rig.json", colors)
    assert (tmp_path / "rig.json").read_text() == (tmp_path / "new.json").read_text()
    # Through memory and back.
    rig = read_rig(tmp_path / "rig.json")
    assert rig.photometry is not None
    np.testing.assert_array_equal(rig.photometry["mixing"], found["mixing"])
    write_rig(tmp_path / "again.json", rig, read_provenance(tmp_path / "rig.json"))
    assert json.loads((tmp_path / "again.json").read_text())["photometry"] == found


def test_folders_that_do_not_fit_are_refused(tmp_path: Path, small_rig: Rig, colors: Path):
    with pytest.raises(FileError, match="there is no folder"):
        pipeline.measure_photometry(tmp_path / "none")
    write_rig(tmp_path / "rig.json", replace(small_rig, camera=replace(small_rig.camera, size=(96, 72))))
    with pytest.raises(InputError, match="camera of 96 x 72 px, but the color pictures have 192 x 144 px"):
        pipeline.add_photometry(tmp_path / "rig.json", colors)
    assert read_rig(tmp_path / "rig.json").photometry is None
    for name in ("white", "black", "red", "green"):
        write_png(tmp_path / "c" / f"{name.upper()}.PNG", read_image(colors / f"{name}.png"))
    write_png(tmp_path / "c" / "IMG_1.png", np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match=f"{re.escape(str(tmp_path / 'c'))}: .* needs the picture blue"):
        pipeline.measure_photometry(tmp_path / "c")
    write_png(tmp_path / "c" / "blue.png", read_image(colors / "red.png"))
    with pytest.raises(CalibrationError, match="look nearly alike"):
        pipeline.measure_photometry(tmp_path / "c")
    write_png(tmp_path / "c" / "blue.png", read_image(colors / "blue.png"))
    assert "response" not in pipeline.measure_photometry(tmp_path / "c")
    write_png(tmp_path / "c" / "red.tif.png", np.zeros((4, 4), np.uint8))
    write_png(tmp_path / "c" / "red.bmp", read_image(colors / "red.png"))
    with pytest.raises(FileError, match="holds both RED.PNG and red.bmp: keep one"):
        pipeline.measure_photometry(tmp_path / "c")
