import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from slkit.calibration._fit import Drawing, fit_drawing, softened

MARK = Drawing(np.array([-1.0, 0, 1]), np.array([-1.0, 0, 1]), np.eye(2), reach=1.35)


def picture(homography: np.ndarray, blur_px: float, rng: np.random.Generator, noise: float = 0.0) -> np.ndarray:
    """A mark under a homography from cells to px, blurred along its own axes, dark towards one side, on 80 x 80 px."""
    xy = np.stack(np.meshgrid(np.arange(80.0), np.arange(80.0)), axis=-1)
    seen = np.concatenate([xy, np.ones((80, 80, 1))], axis=-1) @ np.linalg.inv(homography).T
    u, v = np.moveaxis(seen[..., :2] / seen[..., 2:], -1, 0)
    blur = blur_px / np.linalg.norm(homography[:2, :2], axis=0)
    first, second = (
        [ndtr((w - a) / b) - ndtr((w - a - 1) / b) for w, b in ((u, blur[0]), (v, blur[1]))] for a in (-1, 0)
    )
    ink = first[0] * first[1] + second[0] * second[1]
    shade = 120 + 0.8 * xy[..., 0]
    levels = shade * (1 - 0.9 * ink) + noise * rng.normal(size=ink.shape)
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    blur_px=st.floats(0.7, 2.0),
    start=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
)
def test_a_mark_is_found_from_a_start_that_is_a_little_wrong(seed: int, blur_px: float, start: tuple[float, float]):
    rng = np.random.default_rng(seed)
    turn, stretch = rng.uniform(-0.5, 0.5), rng.uniform(9, 16, 2)
    across = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) * stretch
    center = rng.uniform(36, 44, 2)
    homography = np.block([[across, center[:, None]], [rng.uniform(-0.01, 0.01, (1, 2)), np.ones((1, 1))]])
    wrong = homography.copy()
    wrong[:2, 2] += start
    wrong[:2, :2] *= rng.uniform(0.95, 1.05, (2, 2))
    found = fit_drawing(softened(picture(homography, blur_px, rng, noise=1.0)), MARK, wrong)
    assert found is not None
    assert np.linalg.norm(found[:2, 2] - center) < 0.06


def test_perspective_is_found_where_it_is_asked_for(rng: np.random.Generator):
    homography = np.array([[24.0, 1.0, 40], [-1.5, 23.0, 40], [0.04, -0.05, 1]])
    flat = homography.copy()
    flat[2, :2] = 0
    whole = Drawing(MARK.x, MARK.y, MARK.ink, MARK.reach, perspective=True)
    corners = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])

    def outline(matrix: np.ndarray) -> np.ndarray:
        seen = corners @ matrix.T
        return seen[:, :2] / seen[:, 2:]

    seen = softened(picture(homography, 1.0, rng))
    found = [np.abs(outline(fit_drawing(seen, drawing, flat)) - outline(homography)).max() for drawing in (whole, MARK)]
    assert found[0] < 0.1
    assert found[1] > 0.3


def test_what_does_not_look_like_the_drawing_is_refused(rng: np.random.Generator):
    start = np.array([[12.0, 0, 40], [0, 12.0, 40], [0, 0, 1]])
    noise = rng.integers(0, 255, (80, 80)).astype(np.uint8)
    assert fit_drawing(softened(noise), MARK, start) is None
    blank = np.full((80, 80), 128, np.uint8)
    assert fit_drawing(softened(blank), MARK, start) is None
    away = start + np.array([[0, 0, 300.0], [0, 0, 0], [0, 0, 0]])
    assert fit_drawing(softened(noise), MARK, away) is None


@pytest.mark.parametrize("blur_px", [0.0, 0.3])
def test_a_sharp_picture_is_no_harder(blur_px: float, rng: np.random.Generator):
    homography = np.array([[12.3, 1.0, 40.37], [-0.8, 11.1, 39.81], [0, 0, 1]])
    found = fit_drawing(softened(picture(homography, max(blur_px, 1e-3), rng)), MARK, homography)
    assert found is not None
    # Point samples of a sharp edge tell its place to a part of a pixel only.
    assert np.linalg.norm(found[:2, 2] - [40.37, 39.81]) < 0.1
