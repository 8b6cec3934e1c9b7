"""Pages of boards, rendered back to pixels: lengths against the resolution."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pypdfium2
import pytest

from slkit.calibration.detect import find_checkerboard
from slkit.errors import InputError
from slkit.report.sheets import CROSS_MM, RULER_MM, Sheet, render
from slkit.targets import Charuco, Checkerboard, CircleGrid

A4 = (297.0, 210.0)
DPI = 254
PX = DPI / 25.4
BOARD = Checkerboard((11, 8), 21.0)


def page(target=BOARD, size=A4, **more) -> Sheet:
    x0, y0, x1, y1 = target.ink().extent()
    return Sheet(size, target, ((size[0] - x0 - x1) / 2, (size[1] - y0 - y1) / 2), **more)


def pixels(pdf: bytes, number: int = 0) -> np.ndarray:
    """A page as grey levels (h, w) at DPI."""
    document = pypdfium2.PdfDocument(pdf)
    picture = document[number].render(scale=DPI / 72, grayscale=True).to_numpy()
    document.close()
    return np.ascontiguousarray(picture.reshape(picture.shape[:2]))


def ticks(darkness: np.ndarray) -> np.ndarray:
    """Middles of the runs of dark along a line, in px."""
    at = np.flatnonzero(darkness > 0.02)
    runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
    return np.array([np.average(run, weights=darkness[run]) for run in runs])


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    return pixels(render([page(lines=("a line of text", "and another"))], ".pdf"))


def test_the_page_has_its_size(seen: np.ndarray):
    # The renderer rounds up to whole pixels, and stretches the page by less than one.
    np.testing.assert_allclose(seen.shape, [210 * PX, 297 * PX], atol=1.01)


def test_rulers_are_true_to_a_thousandth(seen: np.ndarray):
    across = ticks(1 - seen[round((210 - 5.5 - 0.8) * PX), round(95 * PX) : round(200 * PX)] / 255)
    down = ticks(1 - seen[round(50 * PX) : round(160 * PX), round((5.5 + 0.8) * PX)] / 255)
    for found in (across, down):
        assert len(found) == 11
        assert found[-1] - found[0] == pytest.approx(RULER_MM * PX, rel=1e-3)
        np.testing.assert_allclose(np.diff(found), RULER_MM / 10 * PX, atol=0.5)


def test_squares_are_true_to_a_thousandth_and_in_the_middle(seen: np.ndarray):
    found = find_checkerboard(seen, BOARD.corners)
    assert found is not None
    assert np.linalg.norm(found[0, -1] - found[0, 0]) == pytest.approx(10 * 21 * PX, rel=1e-3)
    assert np.linalg.norm(found[-1, 0] - found[0, 0]) == pytest.approx(7 * 21 * PX, rel=1e-3)
    np.testing.assert_allclose(found.mean(axis=(0, 1)) + 0.5, np.array(seen.shape[::-1]) / 2, atol=0.2)


def test_touching_squares_show_no_seam():
    board = Charuco((5, 4), 30.0, 20.0)
    picture = pixels(render([page(board)], ".pdf"))
    # Through the first row of a marker's border, which is drawn as one black row above another of cells.
    x, y = (np.array(page(board).origin_mm) + [10.0, -25.0]) * PX
    column = picture[round(y + 0.2 * PX) : round(y + 2.5 * PX), round(x)]
    assert (column == 0).all()


def test_svg_draws_what_the_pdf_draws():
    sheet = page(CircleGrid((5, 4), 30.0, 20.0), crosses_mm=((CROSS_MM, CROSS_MM),))
    root = ElementTree.fromstring(render([sheet], ".svg"))
    assert root.get("width") == f"{297 * 72 / 25.4:.6f}pt" and root.get("height") == f"{210 * 72 / 25.4:.6f}pt"
    (path,) = root.findall(".//*[@id='patch_2']/{http://www.w3.org/2000/svg}path")
    outlines = [
        np.array(re.findall(r"-?[\d.]+", part), dtype=float).reshape(-1, 2) * 25.4 / 72
        for part in path.get("d").split("z")
        if part.strip()
    ]
    ink = sheet.ink()
    boxes = np.array([np.concatenate([o.min(axis=0), o.max(axis=0)]) for o in outlines])
    rings = np.concatenate([ink.discs[:, :2] - ink.discs[:, 2:], ink.discs[:, :2] + ink.discs[:, 2:]], axis=1)
    np.testing.assert_allclose(boxes, np.concatenate([ink.boxes, rings]), atol=1e-4)
    assert len(rings) == 20


def test_text_keeps_to_its_width():
    lines = ("x" * 300, "short")
    picture = pixels(render([page(lines=lines, text_mm=120.0)], ".pdf"))
    columns = np.flatnonzero((picture[: round(9.5 * PX)] < 128).any(axis=0)) / PX
    assert columns.min() > 148.5 - 62 and columns.max() < 148.5 + 62


def test_equal_boards_are_equal_files():
    for ending in (".pdf", ".svg"):
        assert render([page()], ending) == render([page()], ending)


def test_what_cannot_be_written_is_refused():
    with pytest.raises(InputError, match=r"as \.pdf or \.svg, not as \.png"):
        render([page()], ".png")
    with pytest.raises(InputError, match="a file without an ending"):
        render([page()], "")
    with pytest.raises(InputError, match="an SVG has one page"):
        render([page(), page()], ".svg")
