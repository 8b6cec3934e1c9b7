import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slkit.targets import (
    INK,
    PAPER,
    AprilTags,
    BorderMarks,
    Charuco,
    Checkerboard,
    CircleGrid,
    CornerMarks,
    Printable,
    TagMarks,
)
from slkit.targets._drawing import Cells

PRINTABLES = [
    Checkerboard((5, 4), 20.0),
    Charuco((5, 4), 20.0, 15.0),
    AprilTags((3, 2), 25.0, 6.0),
    TagMarks(((-70.0, -40.0), (65.0, -41.0), (70.0, 40.0)), 20.0, "4x4_50"),
    CircleGrid((5, 4), 20.0, 12.0),
    CircleGrid((3, 5), 20.0, 25.0, asymmetric=True),
    CornerMarks(((-50, -30), (50, -30), (50, 30), (-50, 30)), 4.0),
    BorderMarks((200.0, 150.0), 7.0),
]


@pytest.mark.parametrize("target", PRINTABLES, ids=lambda t: type(t).__name__)
def test_the_printer_blackens_what_the_camera_sees_black(target: Printable, rng: np.random.Generator):
    assert isinstance(target, Printable)
    ink, (x0, y0, x1, y1) = target.ink(), target.extent()
    places = rng.uniform([x0 - 5, y0 - 5], [x1 + 5, y1 + 5], (20_000, 2))
    boxed = ((places[:, None] > ink.boxes[:, :2]) & (places[:, None] < ink.boxes[:, 2:])).all(axis=2).any(axis=1)
    ringed = (np.linalg.norm(places[:, None] - ink.discs[:, :2], axis=2) < ink.discs[:, 2]).any(axis=1)
    seen = target.reflectance(places, 0.01)
    clear = (seen < INK + 0.01) | (seen > PAPER - 0.01)
    assert clear.mean() > 0.98
    assert np.array_equal((boxed | ringed)[clear], seen[clear] < 0.5)
    assert 0.005 < (boxed | ringed).mean() < 0.7
    left, top, right, bottom = ink.extent()
    assert x0 < left and y0 < top and right < x1 and bottom < y1


@pytest.mark.parametrize("target", PRINTABLES, ids=lambda t: type(t).__name__)
def test_reflectance_stays_between_ink_and_paper(target: Printable, rng: np.random.Generator):
    x0, y0, x1, y1 = target.extent()
    places = rng.uniform([x0, y0], [x1, y1], (40, 50, 2))
    for footprint in (1e-9, 0.5, 8.0):
        values = target.reflectance(places, footprint)
        assert values.shape == (40, 50)
        assert values.min() >= INK - 1e-9 and values.max() <= PAPER + 1e-9


@given(
    seed=st.integers(0, 2**32 - 1),
    footprint=st.floats(0.05, 5.0),
    at=st.tuples(st.floats(-3.0, 12.0), st.floats(-3.0, 12.0)),
)
def test_cells_average_exactly(seed: int, footprint: float, at: tuple[float, float]):
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.uniform(0.3, 2.0, 6)), np.cumsum(rng.uniform(0.3, 2.0, 5))
    ink = rng.integers(0, 2, (4, 5)).astype(float)
    lows = np.array(at) - footprint / 2
    across, down = (
        np.clip(np.minimum(v[1:], low + footprint) - np.maximum(v[:-1], low), 0, None)
        for v, low in zip((x, y), lows, strict=True)
    )
    expected = down @ ink @ across / footprint**2
    assert Cells(x, y, ink).mean(np.array(at), footprint) == pytest.approx(expected, abs=1e-9)


def test_cells_far_away_are_white():
    cells = Cells(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0]), np.array([[1.0, 1.0]]))
    at = cells.mean([[-5.0, 0.5], [9.0, 0.5], [1.0, -4.0], [1.0, 7.0], [1.0, 0.5]], 0.1)
    assert at.tolist() == [0, 0, 0, 0, 1]
    assert cells.boxes().tolist() == [[0, 0, 2, 1]]
