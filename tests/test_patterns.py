import importlib.util
import re
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import numpy as np
import pytest

from slkit import pipeline, registry
from slkit.calibration.detect import find_checkerboard
from slkit.calibration.marks import find_marks
from slkit.files import read_image
from slkit.targets import ProjectedCheckerboard

HERE = Path(__file__).parent
PATTERNS = HERE.parent / "patterns"
RECIPES = sorted(PATTERNS.glob("*.toml"))
PX_PER_MM = 4


def load_script():
    spec = importlib.util.spec_from_file_location("regenerate_patterns", HERE / "regenerate_patterns.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


script = load_script()


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("patterns")
    script.regenerate(folder)
    return folder


def test_nothing_is_missing_or_left_over(fresh: Path):
    assert {p.name for p in PATTERNS.iterdir()} == {p.name for p in fresh.iterdir()} | {"README.md"}
    assert len(RECIPES) == 12


def test_stored_files_are_what_slkit_writes(fresh: Path):
    for stored in PATTERNS.iterdir():
        if stored.suffix == ".png":
            assert np.array_equal(read_image(stored), read_image(fresh / stored.name)), stored.name
        elif stored.name != "README.md":
            assert stored.read_bytes() == (fresh / stored.name).read_bytes(), f"{stored.name}: run `make patterns`"


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda p: p.stem)
def test_recipe_is_the_codec_of_its_name(recipe: Path):
    name, codec = pipeline.recipe_codec(recipe)
    size = recipe.stem.removeprefix(f"{name}-")
    patterns = codec.encode()
    assert size == f"{patterns[0].shape[1]}x{patterns[0].shape[0]}"
    assert f"# {len(patterns)} patterns" in recipe.read_text()
    # What the recipe spells out are the codec's own choices, not others.
    plain = pipeline.load_codec(name, codec.projector, script.CODECS[name])
    for index in range(len(patterns)):
        assert np.array_equal(patterns[index], plain.encode()[index]), patterns.names[index]


@pytest.mark.parametrize("name", sorted(script.CODECS))
def test_command_takes_a_recipe(name: str, tmp_path: Path):
    command = [sys.executable, "-m", "slkit.cli", "patterns", PATTERNS / f"{name}-1024x768.toml", "-o", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    written = sorted(tmp_path.glob("*.png"))
    codec = pipeline.recipe_codec(PATTERNS / f"{name}-1024x768.toml")[1]
    assert len(written) == len(codec.encode())
    assert (tmp_path / "slideshow.html").is_file() and (tmp_path / "capture.toml").is_file()


def test_projected_checkerboards_are_those_of_the_command(tmp_path: Path):
    for width, height in script.PROJECTORS:
        stored = read_image(PATTERNS / f"checkerboard-{width}x{height}.png")
        pipeline.projected_checkerboard((width, height), tmp_path / f"{width}")
        assert np.array_equal(stored, read_image(tmp_path / f"{width}" / "checkerboard.png"))
        # A picture of the pattern itself is a picture of the board: it must be found where it is said to be.
        pattern = ProjectedCheckerboard.for_projector((width, height))
        found = find_checkerboard(stored, pattern.corners)
        assert found is not None
        away = np.linalg.norm(found.reshape(-1, 1, 2) - pattern.points(), axis=2).min(axis=0)
        assert away.max() < 0.1


@pytest.mark.parametrize("name", sorted(script.BOARDS))
def test_drawings_are_the_boards(name: str, rng: np.random.Generator):
    (width, height), printed, marks = script.board(name)
    for side, target in (("a", printed), ("b", marks)):
        drawing = ElementTree.parse(PATTERNS / f"board-{name}-side-{side}.svg").getroot()
        left, top, w, h = (float(v) for v in drawing.get("viewBox").split())
        assert (drawing.get("width"), drawing.get("height")) == (f"{width}mm", f"{height}mm")
        assert (w, h) == (width, height)
        boxes = boxes_of(drawing)
        assert (boxes[:, :2] > [left, top]).all() and (boxes[:, 2:] < [left + w, top + h]).all()
        points = rng.uniform([left, top], [left + w, top + h], (20_000, 2))
        inside = ((points[:, None] > boxes[:, :2]) & (points[:, None] < boxes[:, 2:])).all(axis=2).any(axis=1)
        assert np.array_equal(inside, target.reflectance(points, 1e-9) < 0.5)


@pytest.mark.parametrize("name", sorted(script.BOARDS))
def test_drawings_are_found(name: str):
    _, printed, marks = script.board(name)
    picture, corner = raster(f"board-{name}-side-a.svg")
    found = find_checkerboard(picture, printed.corners)
    assert found is not None
    there = (found.reshape(-1, 2) + 0.5) / PX_PER_MM + corner
    assert np.linalg.norm(there[:, None] - printed.points(), axis=2).min(axis=1).max() < 0.05
    picture, corner = raster(f"board-{name}-side-b.svg")
    found = find_marks(picture, marks)
    assert found is not None
    assert np.abs((found + 0.5) / PX_PER_MM + corner - marks.points()).max() < 0.05


def test_readme_describes_the_boards():
    blocks = re.findall(r"```toml\n(.*?)```", (PATTERNS / "README.md").read_text(), re.DOTALL)
    for block, name in zip(blocks, ("a3", "a4"), strict=True):
        _, printed, marks = script.board(name)
        expected = {"printed": registry.parameters_of(printed), "marks": registry.parameters_of(marks)}
        assert tomllib.loads(block) == expected


def boxes_of(drawing: ElementTree.Element) -> np.ndarray:
    """Return the rectangles (n, 4) of a drawing: x min, y min, x max, y max in mm."""
    rects = [
        [float(r.get(key)) for key in ("x", "y", "width", "height")]
        for r in drawing.iter("{http://www.w3.org/2000/svg}rect")
    ]
    found = np.array(rects)
    return np.concatenate([found[:, :2], found[:, :2] + found[:, 2:]], axis=1)


def raster(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the rectangles of a drawing as a slightly blurred picture, and its upper left corner (2,) in mm."""
    drawing = ElementTree.parse(PATTERNS / name).getroot()
    left, top, w, h = (float(v) for v in drawing.get("viewBox").split())
    picture = np.full((round(h * PX_PER_MM), round(w * PX_PER_MM)), 255, np.uint8)
    for x0, y0, x1, y1 in np.rint((boxes_of(drawing) - [left, top] * 2) * PX_PER_MM).astype(int):
        picture[y0:y1, x0:x1] = 0
    return cv2.GaussianBlur(picture, (0, 0), 1.0), np.array([left, top])
