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
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard

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
    assert len(RECIPES) == 4 * len(script.CODECS)


def test_stored_files_are_what_slkit_writes(fresh: Path):
    for stored in PATTERNS.iterdir():
        if stored.suffix == ".png":
            assert np.array_equal(read_image(stored), read_image(fresh / stored.name)), stored.name
        elif stored.suffix == ".svg":
            # Another release of the drawing library may write the same page in other words.
            np.testing.assert_allclose(drawn(stored.name), drawn(fresh / stored.name), atol=1e-3, err_msg=stored.name)
            assert texts(stored) == texts(fresh / stored.name), f"{stored.name}: run `make patterns`"
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


@pytest.mark.parametrize("page", script.PAGES)
@pytest.mark.parametrize(("side", "table"), [("a", "printed"), ("b", "marks")])
def test_drawings_are_the_boards_of_the_readme(page: str, side: str, table: str):
    target = described(page, table)
    width, height = pipeline.PAGES[page]
    outlines = drawn(f"board-{page.lower()}-side-{side}.svg")
    assert outlines.min() > 0 and (outlines < [width, height]).all()
    boxes = np.concatenate([outlines.min(axis=1), outlines.max(axis=1)], axis=1)
    x0, y0, x1, y1 = target.ink().extent()
    expected = target.ink().boxes + np.tile([(width - x0 - x1) / 2, (height - y0 - y1) / 2], 2)
    missing = np.abs(boxes[:, None] - expected).max(axis=2).min(axis=0)
    assert missing.max() < 1e-4
    # All else are the two rulers: a line and eleven ticks each, 100 mm from end to end.
    rulers = boxes[np.abs(boxes[:, None] - expected).max(axis=2).min(axis=1) > 1e-4]
    assert len(rulers) == 24
    spans = (rulers[:, 2:] - rulers[:, :2]).max(axis=1)
    np.testing.assert_allclose(np.sort(spans)[-2:], 100.2, atol=1e-4)


@pytest.mark.parametrize("page", script.PAGES)
def test_drawings_are_found(page: str):
    width, height = pipeline.PAGES[page]
    for side, table in (("a", "printed"), ("b", "marks")):
        target = described(page, table)
        picture = raster(f"board-{page.lower()}-side-{side}.svg", (width, height))
        found = find_marks(picture, target) if side == "b" else find_checkerboard(picture, target.corners)
        assert found is not None
        middle = (target.points().min(axis=0) + target.points().max(axis=0)) / 2
        there = (found.reshape(-1, 2) + 0.5) / PX_PER_MM - np.array([width, height]) / 2 + middle
        assert np.abs(there - target.points()).max() < 0.05
        span = np.ptp(found.reshape(-1, 2), axis=0)
        np.testing.assert_allclose(span, np.ptp(target.points(), axis=0) * PX_PER_MM, rtol=1e-3)


def described(page: str, table: str):
    """The target that README.md describes."""
    blocks = re.findall(r"```toml\n(.*?)```", (PATTERNS / "README.md").read_text(), re.DOTALL)
    tables = tomllib.loads(blocks[script.PAGES.index(page)])
    return registry.create({"printed": Checkerboard, "marks": CornerMarks}[table], tables[table], "README.md")


def drawn(name: str | Path) -> np.ndarray:
    """The black outlines (n, 5, 2) of a drawing, in mm from the upper left corner of the page."""
    drawing = ElementTree.parse(PATTERNS / name).getroot()
    (path,) = drawing.findall(".//*[@id='patch_2']/{http://www.w3.org/2000/svg}path")
    numbers = [re.findall(r"-?[\d.]+", part) for part in path.get("d").split("z") if part.strip()]
    return np.array(numbers, dtype=float).reshape(len(numbers), -1, 2) * 25.4 / 72


def texts(drawing: Path) -> list[str]:
    """The lines of text of a drawing, which stand above their outlines as comments."""
    return re.findall(r"<!-- (.*?) -->", drawing.read_text())


def raster(name: str, size: tuple[float, float]) -> np.ndarray:
    """A drawing as a slightly blurred picture."""
    picture = np.full((round(size[1] * PX_PER_MM), round(size[0] * PX_PER_MM)), 255, np.uint8)
    for outline in drawn(name):
        (x0, y0), (x1, y1) = np.rint(np.array([outline.min(axis=0), outline.max(axis=0)]) * PX_PER_MM).astype(int)
        picture[y0:y1, x0:x1] = 0
    return cv2.GaussianBlur(picture, (0, 0), 1.0)
