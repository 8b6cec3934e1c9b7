"""Boards as they come out of the printer: rendered, read back by the detectors, described by their own table."""

import re
from pathlib import Path

import numpy as np
import pypdfium2
import pytest

from slkit import pipeline, registry
from slkit.calibration._observe import find_points
from slkit.calibration.planar import Planar
from slkit.errors import InputError
from slkit.targets import Checkerboard, ProjectedCheckerboard

PX = 3.5
PATTERN = registry.parameters_of(ProjectedCheckerboard.for_projector((640, 480)))


def pages(path: Path) -> list[np.ndarray]:
    """The pages of a PDF as grey levels (h, w), PX to the mm."""
    document = pypdfium2.PdfDocument(path)
    pictures = [page.render(scale=PX * 25.4 / 72, grayscale=True).to_numpy() for page in document]
    document.close()
    return [np.ascontiguousarray(p.reshape(p.shape[:2])) for p in pictures]


def target_of(table: dict, side: str):
    """The target that a table of calibration.toml means to the calibrations by two-sided boards."""
    if side == "corner_board":
        return registry.create(Checkerboard, table, "board")
    sides = {
        "printed": {"corners": [3, 3], "square_mm": 1},
        "marks": {"kind": "border", "size_mm": [9, 9], "cell_mm": 1},
    }
    parameters = {"projector": [640, 480], "projected": PATTERN} | sides | {side: table}
    return getattr(registry.create(Planar, parameters, "calibration.toml"), side)


def check_found(picture: np.ndarray, size: tuple[float, float], table: dict, side: str) -> np.ndarray:
    """Find a board in its own drawing on a page of size (w, h) mm; return its points (n, 2) in mm on the page."""
    target = target_of(table, side)
    found = find_points(picture, target)
    assert found is not None and np.isfinite(found).all()
    # The renderer rounds up to whole pixels, and stretches the page by less than one.
    on_page = (found + 0.5) * size / np.array(picture.shape[::-1])
    shift = (on_page - target.points()).mean(axis=0)
    # True scale, upright, in the target's own order.
    assert np.abs(on_page - target.points() - shift).max() < 0.05
    return on_page


@pytest.mark.parametrize("kind", pipeline.BOARDS)
@pytest.mark.parametrize(("page", "landscape"), [("A4", True), ("Letter", False)])
def test_every_board_is_found_in_its_drawing(kind: str, page: str, landscape: bool, tmp_path: Path):
    tables = pipeline.write_board(tmp_path / "b.pdf", kind, page, landscape=landscape)
    ((side, table),) = tables.items()
    (picture,) = pages(tmp_path / "b.pdf")
    size = pipeline.PAGES[page] if landscape else pipeline.PAGES[page][::-1]
    np.testing.assert_allclose(picture.shape[::-1], np.array(size) * PX, atol=1.01)
    on_page = check_found(picture, size, table, side)
    if kind != "corner-board":
        middle = (on_page.min(axis=0) + on_page.max(axis=0)) / 2
        np.testing.assert_allclose(middle, np.array(size) / 2, atol=0.15)


@pytest.mark.parametrize("landscape", [True, False])
def test_two_sides_register_when_the_sheet_is_turned_about_its_long_edge(landscape: bool, tmp_path: Path):
    tables = pipeline.write_board(tmp_path / "b.pdf", "marks", "A4", landscape=landscape, two_sided=True)
    assert list(tables) == ["printed", "marks"]
    front, back = pages(tmp_path / "b.pdf")
    size = (297.0, 210.0) if landscape else (210.0, 297.0)
    check_found(front, size, tables["printed"], "printed")
    check_found(back, size, tables["marks"], "marks")
    turned = back[::-1] if landscape else back[:, ::-1]
    wrong = back[:, ::-1] if landscape else back[::-1]
    edge = round(10 * PX)
    corners = [np.s_[:edge, :edge], np.s_[:edge, -edge:], np.s_[-edge:, :edge], np.s_[-edge:, -edge:]]
    crossed = [front[c].min() < 128 for c in corners]
    assert sum(crossed) == 3
    for corner, there in zip(corners, crossed, strict=True):
        assert (turned[corner].min() < 128) == there
        if there:
            middles = [np.argwhere(side[corner] < 128).mean(axis=0) for side in (front, turned)]
            np.testing.assert_allclose(*middles, atol=1.0)
    assert [wrong[c].min() < 128 for c in corners] != crossed


def test_sizes_can_be_chosen(tmp_path: Path):
    tables = pipeline.write_board(tmp_path / "b.svg", "checkerboard", "a3", corners=(6, 5), square_mm=25.0)
    assert tables == {"printed": {"corners": [6, 5], "square_mm": 25.0}}
    tables = pipeline.write_board(tmp_path / "c.svg", "charuco", "A4", corners=(6, 5))
    assert tables["printed"]["squares"] == [7, 6] and tables["printed"]["dictionary"] == "4x4_50"
    assert pipeline.write_board(tmp_path / "d.svg", "marks", square_mm=15.0)["marks"]["cell_mm"] == 15.0


SQUARES = r"--square-mm must be ([\d.]+) to ([\d.]+) for (\S+) on A4 (\w+), not \S+"


def write(path: Path, kind: str, landscape: bool, square_mm: float) -> dict:
    return pipeline.write_board(path, kind, "A4", landscape=landscape, square_mm=square_mm)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"kind": "chessboard"}, "no board called 'chessboard'; there are: checkerboard, charuco"),
        ({"kind": "marks", "page": "A9"}, "page must be one of A1, .*Tabloid, not 'A9'"),
        (
            {"kind": "checkerboard", "corners": (3000, 9)},
            "no room for checkerboard with --corners 3000x9 on A3 landscape",
        ),
        ({"kind": "checkerboard", "corners": (2, 2)}, "3 x 3"),
        ({"kind": "charuco", "corners": (70, 50)}, "dictionary"),
        ({"kind": "marks", "corners": (4, 4)}, "leave --corners away"),
    ],
)
def test_what_cannot_be_is_refused(arguments: dict, words: str, tmp_path: Path):
    with pytest.raises(InputError, match=words):
        pipeline.write_board(tmp_path / "b.pdf", **arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", pipeline.BOARDS)
@pytest.mark.parametrize("square_mm", [1000.0, 100.0, 0.1, 0.0, -3.0, float("nan"), float("inf")])
@pytest.mark.parametrize("landscape", [True, False])
def test_squares_that_do_not_suit_the_page_are_told_with_those_that_do(
    kind: str, square_mm: float, landscape: bool, tmp_path: Path
):
    with pytest.raises(InputError) as refused:
        write(tmp_path / "b.svg", kind, landscape, square_mm)
    told = re.fullmatch(SQUARES, str(refused.value))
    assert told and told.group(3, 4) == (kind, "landscape" if landscape else "portrait")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", pipeline.BOARDS)
@pytest.mark.parametrize("landscape", [True, False])
def test_the_smallest_and_the_largest_squares_that_are_told_do_fit(kind: str, landscape: bool, tmp_path: Path):
    with pytest.raises(InputError) as refused:
        write(tmp_path / "b.svg", kind, landscape, 1000.0)
    smallest, largest = (float(n) for n in re.fullmatch(SQUARES, str(refused.value)).group(1, 2))
    assert smallest <= 1 and largest >= 15
    for square_mm in (smallest, largest):
        write(tmp_path / "b.svg", kind, landscape, square_mm)
    for square_mm in (smallest - 0.1, largest + 0.1):
        with pytest.raises(InputError, match="--square-mm"):
            write(tmp_path / "b.svg", kind, landscape, square_mm)
    # Printed as large as that, nothing is cut off or covered by text.
    ((side, table),) = write(tmp_path / "b.pdf", kind, landscape, largest).items()
    (picture,) = pages(tmp_path / "b.pdf")
    found = find_points(picture, target_of(table, side))
    assert found is not None and np.isfinite(found).all()
