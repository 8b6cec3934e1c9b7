import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.calibration.tags import find_charuco
from slkit.errors import FileError, InputError, PluginError
from slkit.files import read_calibration, read_capture, read_image
from slkit.registry import names, parameters_of
from slkit.targets import ProjectedCharuco, ProjectedCheckerboard


@pytest.mark.parametrize("name", names("slkit.codecs"))
def test_a_pattern_folder_says_how_to_read_pictures_of_it(tmp_path: Path, name: str):
    codec = pipeline.load_codec(name, (128, 96))
    paths = pipeline.patterns(name, codec, tmp_path)
    shown = codec.encode()
    assert [p.name for p in paths] == [f"{i:03d}_{n}.png" for i, n in enumerate(shown.names)]
    for path, pattern in zip(paths, shown, strict=True):
        np.testing.assert_array_equal(read_image(path), pattern)
    found = read_capture(tmp_path)
    again = pipeline.load_codec(found.codec, found.projector, found.parameters)
    assert again == codec
    assert found.source.paths(shown.names, name) == paths


def test_slideshow_names_the_patterns_and_nothing_outside(tmp_path: Path):
    paths = pipeline.patterns("gray", pipeline.load_codec("gray", (64, 48)), tmp_path)
    page = (tmp_path / "slideshow.html").read_text()
    for path in paths:
        assert f'"{path.name}"' in page
    assert "width = 64, height = 48" in page
    assert "image-rendering: pixelated" in page and "cursor: none" in page
    assert not re.search(r"https?:|__[A-Z]+__", page)


def test_projected_checkerboard(tmp_path: Path):
    pipeline.projected_checkerboard((256, 192), tmp_path)
    expected = ProjectedCheckerboard.for_projector((256, 192))
    np.testing.assert_array_equal(read_image(tmp_path / "checkerboard.png"), expected.draw((256, 192)))
    assert read_image(tmp_path / "white.png").min() == 255
    table = tomllib.loads((tmp_path / "calibration.toml").read_text())
    assert table["projected"].pop("images") == "side_b_pattern/*"
    assert table["projected"] == parameters_of(expected)
    for folder in ("side_a", "side_b_white", "side_b_pattern"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "IMG_1.JPG").write_bytes(b"")
    assert read_calibration(tmp_path).method == "planar"
    with pytest.raises(InputError, match="too small"):
        pipeline.projected_checkerboard((20, 10), tmp_path / "small")


def test_projected_charuco(tmp_path: Path):
    size = (480, 320)
    pipeline.projected_charuco(size, tmp_path)
    expected = ProjectedCharuco.for_projector(size)
    picture = read_image(tmp_path / "charuco.png")
    np.testing.assert_array_equal(picture, expected.draw(size))
    assert read_image(tmp_path / "white.png").min() == 255
    text = (tmp_path / "calibration.toml").read_text()
    assert "charuco.png projected" in text
    table = tomllib.loads(text)
    assert table["projected"].pop("images") == "side_b_pattern/*"
    assert table["projected"] == parameters_of(expected)
    for folder in ("side_a", "side_b_white", "side_b_pattern"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "IMG_1.JPG").write_bytes(b"")
    task = pipeline.load_calibration(tmp_path)
    # The table alone, as the calibration reads it, finds the pattern in the picture.
    pattern = task.calibrator.projected
    assert pattern == expected
    corners = find_charuco(picture, pattern)
    assert corners is not None
    np.testing.assert_allclose(corners.reshape(-1, 2), pattern.points(), atol=0.05)
    with pytest.raises(InputError, match="too small"):
        pipeline.projected_charuco((256, 192), tmp_path / "small")
    assert not (tmp_path / "small").exists()


def test_recipes(tmp_path: Path):
    recipe = tmp_path / "r.toml"
    recipe.write_text('codec = "gray"\nprojector = [64, 48]\nparameters = {axes = "y", step = 2}')
    name, codec = pipeline.recipe_codec(recipe)
    assert (name, parameters_of(codec)["axes"], codec.projector) == ("gray", "y", (64, 48))
    _, codec = pipeline.recipe_codec(recipe, (128, 96), {"step": 4})
    assert (codec.projector, parameters_of(codec)["step"], parameters_of(codec)["axes"]) == ((128, 96), 4, "y")
    recipe.write_text('codec = "gray"\nprojector = [64, 48]\nparameters = {stepp = 2}')
    with pytest.raises(InputError, match=r"r\.toml: 'stepp' is no parameter"):
        pipeline.recipe_codec(recipe)
    recipe.write_text("projector = [64, 48]")
    with pytest.raises(FileError, match="is no recipe"):
        pipeline.recipe_codec(recipe)


def test_unknown_codec():
    with pytest.raises(PluginError, match="no codec called 'grey'; installed are: .*gray"):
        pipeline.load_codec("grey", (64, 48))
    with pytest.raises(InputError, match="codec gray: step"):
        pipeline.load_codec("gray", (64, 48), {"step": float("nan")})
