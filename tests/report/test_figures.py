"""Pictures of clouds: what is drawn where, not what is beautiful."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from slkit.data import PointCloud
from slkit.errors import InputError
from slkit.report.figures import View, draw_cloud

FRONT = (View("front", 0.0, 0.0),)


def cloud_of(xyz: np.ndarray, color=(0.5, 0.5, 0.5)) -> PointCloud:
    rows = len(xyz)
    nothing = np.full(rows, np.nan)
    return PointCloud(xyz, np.broadcast_to(np.float32(color), (rows, 3)), nothing, nothing, np.zeros((rows, 2)))


def sheet(step: float, z: float = 500.0, half: float = 50.0) -> np.ndarray:
    xy = np.stack(np.meshgrid(np.arange(-half, half, step), np.arange(-half, half, step)), -1).reshape(-1, 2)
    return np.column_stack([xy, np.full(len(xy), z)])


def painted(picture: np.ndarray) -> np.ndarray:
    """Mask of what differs from the empty picture, its captions left out."""
    empty = draw_cloud(cloud_of(np.empty((0, 3))), picture.shape[1::-1], FRONT)
    mask = (np.abs(picture.astype(int) - empty) > 8).any(axis=2)
    mask[:40, :150] = mask[-45:, :200] = False
    return mask


@pytest.mark.parametrize("step", [0.2, 1.0, 5.0])
def test_a_sheet_is_a_filled_square_however_dense_its_points(step):
    mask = painted(draw_cloud(cloud_of(sheet(step)), (400, 400), FRONT))
    rows, cols = (np.flatnonzero(mask.any(axis=a)) for a in (1, 0))
    assert mask[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1].mean() > 0.95
    assert 0.75 * 400 < len(rows) < 400
    assert abs(len(rows) - len(cols)) < 20


def test_the_nearer_surface_hides_the_farther_one():
    far, near = cloud_of(sheet(0.5, 520), (1, 0, 0)), cloud_of(sheet(0.5, 480, 20), (0, 0, 1))
    both = PointCloud(
        *(
            np.concatenate([getattr(near, n), getattr(far, n)])
            for n in ("xyz", "color", "sigma_mm", "residual_px", "camera_xy")
        )
    )
    picture = draw_cloud(both, (400, 400), FRONT, colored=True).astype(int)
    center, edge = picture[186, 200], picture[186, 70]
    assert center[2] > 100 > center[0]
    assert edge[0] > 100 > edge[2]


def test_x_is_right_and_y_is_down():
    corner = np.concatenate([sheet(0.5), sheet(0.5, 500.0, 10) + [70, 70, 0]])
    mask = painted(draw_cloud(cloud_of(corner), (500, 500), FRONT))
    rows, cols = np.nonzero(mask)
    assert mask[rows.max() - 10, cols.max() - 10]
    assert not mask[rows.min() + 10, cols.max() - 10]
    assert not mask[rows.max() - 10, cols.min() + 10]


def test_light_comes_from_above_so_that_a_ball_is_a_ball():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(60_000, 3))
    ball = 50 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    picture = draw_cloud(cloud_of(ball + [0, 0, 500]), (400, 400), FRONT).astype(float).mean(axis=2)
    center = (400 / 2 - 14, 200)
    above_left, below_right = picture[int(center[0]) - 70, 130], picture[int(center[0]) + 70, 270]
    assert above_left > below_right + 40


def test_views_turn_the_way_they_say():
    # A pole that sticks out towards the camera points left after a turn of +45 degrees, and down from above.
    pole = np.column_stack([np.zeros(400), np.zeros(400), np.linspace(300, 500, 400)])
    base = sheet(0.5, 500.0, 25)
    for view, axis in ((View("", 45.0, 0.0), 1), (View("", 0.0, 45.0), 0)):
        rows, cols = np.nonzero(painted(draw_cloud(cloud_of(np.concatenate([pole, base])), (500, 500), (view,))))
        place = (rows, cols)[axis]
        middle = (place.min() + place.max()) / 2
        heavy_on_low_side = np.median(place) < middle
        assert heavy_on_low_side == (axis == 0)


def test_strays_do_not_shrink_the_object():
    stray = np.concatenate([sheet(0.5), [[9000, 9000, 500], [0, -9000, 500]]])
    clean = painted(draw_cloud(cloud_of(sheet(0.5)), (400, 400), FRONT)).sum()
    assert painted(draw_cloud(cloud_of(stray), (400, 400), FRONT)).sum() > 0.9 * clean


@pytest.mark.parametrize("rows", [0, 1, 2, 3])
def test_clouds_of_next_to_nothing(rows):
    xyz = np.array([[0, 0, 500], [10, 0, 500], [np.nan] * 3])[:rows]
    picture = draw_cloud(cloud_of(xyz.reshape(-1, 3)), (640, 480))
    assert picture.shape == (480, 640, 3)
    assert picture.dtype == np.uint8


def test_three_panels_are_drawn():
    picture = draw_cloud(cloud_of(sheet(0.5)), (800, 600))
    empty = draw_cloud(cloud_of(np.empty((0, 3))), (800, 600))
    changed = (picture != empty).any(axis=2)
    for panel in (changed[:, :500], changed[:300, 500:], changed[300:, 500:]):
        assert panel.mean() > 0.1


def test_a_picture_too_small_is_refused():
    with pytest.raises(InputError, match="320 x 240"):
        draw_cloud(cloud_of(sheet(5)), (100, 100))


def test_importing_is_light():
    code = (
        "import sys, slkit.report.figures, slkit.report.measure; "
        "sys.exit(', '.join({'open3d', 'scipy'} & set(sys.modules)) or None)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
