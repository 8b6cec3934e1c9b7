import numpy as np
import pytest

from slkit.errors import InputError
from slkit.geometry import Pose, Rig
from slkit.simulation import (
    SCENES,
    SimulatedScanner,
    board,
    build,
    dumbbell,
    fitted_mesh,
    free_form,
    from_mesh,
    in_view,
    paper_rig,
    plane,
    random_rig,
    sphere,
    step_wedge,
)
from slkit.targets import CornerMarks


@pytest.mark.parametrize("rig", [paper_rig(), random_rig(np.random.default_rng(11))], ids=["paper", "random"])
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_lies_where_both_devices_look(name: str, rig: Rig) -> None:
    vertices, _ = build(name, rig).mesh()
    assert in_view(rig, vertices).mean() > 0.98
    assert np.ptp(rig.camera.project(vertices), axis=0).max() > 0.2 * max(rig.camera.size)


def test_an_unknown_scene_is_an_error_that_lists_the_known() -> None:
    with pytest.raises(InputError, match=r"'teapot'.*free-form"):
        build("teapot", paper_rig())


def test_the_free_form_object_has_the_size_and_relief_of_a_bust() -> None:
    vertices, faces = free_form([0, 0, 1100]).mesh()
    size = np.ptp(vertices, axis=0)
    assert 250 < size[:2].max() < 400
    edges = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1)
    assert np.median(edges) < 1.0, "the net is finer than a camera pixel, 1.2 mm on the paper's rig"
    np.testing.assert_allclose(np.ptp(free_form([0, 0, 1100], 0.5).mesh()[0], axis=0), size / 2)


def test_the_coloured_object_reflects_channels_differently() -> None:
    plain, coloured = free_form([0, 0, 1100]), free_form([0, 0, 1100], coloured=True)
    assert not any(s.coloured for s in plain.surfaces)
    albedo = np.concatenate([np.asarray(s.albedo) for s in coloured.surfaces])
    assert np.ptp(albedo, axis=1).max() > 0.4
    assert albedo.min() > 0.2 and albedo.max() < 0.95


def test_a_plane_has_the_distance_tilt_and_size_asked_for() -> None:
    vertices, faces = plane(900.0, (0.0, 30.0), (400.0, 200.0), (10.0, 20.0)).mesh()
    normal = np.cross(*(vertices[faces[0, 1:]] - vertices[faces[0, 0]]))
    assert abs(normal[2]) / np.linalg.norm(normal) == pytest.approx(np.cos(np.radians(30)))
    np.testing.assert_allclose(vertices.mean(axis=0), [10, 20, 900])
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [400 * np.cos(np.radians(30)), 200, 200])


def test_a_sphere_is_round() -> None:
    vertices, faces = sphere([1, 2, 800], 50.0).mesh()
    np.testing.assert_allclose(np.linalg.norm(vertices - [1, 2, 800], axis=1), 50)
    deepest = np.linalg.norm(vertices[faces].mean(axis=1) - [1, 2, 800], axis=1).min()
    assert 50 - deepest < 50 / 20_000
    with pytest.raises(InputError, match="radius_mm"):
        sphere([0, 0, 800], -1.0)


@pytest.mark.parametrize("bar", [0.0, 10.0])
def test_a_dumbbell_has_two_balls_at_the_spacing(bar: float) -> None:
    surfaces = dumbbell([0, 0, 900], 30.0, 150.0, (1, 1, 0), bar).surfaces
    middles = [(s.vertices.min(axis=0) + s.vertices.max(axis=0)) / 2 for s in surfaces[:2]]
    assert np.linalg.norm(middles[1] - middles[0]) == pytest.approx(150, abs=1e-6)
    assert len(surfaces) == (3 if bar else 2)


def test_a_step_wedge_has_equal_steps_and_its_risers() -> None:
    scene = step_wedge([0, 0, 1000], 12.0, 4)
    spans = np.array([np.ptp(s.vertices, axis=0) for s in scene.surfaces])
    treads = [s for s, span in zip(scene.surfaces, spans, strict=True) if span[2] == 0]
    np.testing.assert_allclose([s.vertices[0, 2] for s in treads], [1018, 1006, 994, 982])
    assert len(scene.surfaces) == 7 and (spans[:, 0] == 0).sum() == 3
    with pytest.raises(InputError, match="at least one step"):
        step_wedge([0, 0, 1000], 12.0, 0)


def test_the_rod_stands_free_hides_shades_and_reverses_the_order() -> None:
    rig = paper_rig()
    scanner = SimulatedScanner(build("rod", rig), rig)
    sheet, rod = (surface.vertices for surface in scanner.scene.surfaces)
    first, last = rod[0], rod[-1]
    along = (last - first) / np.linalg.norm(last - first)
    away = np.linalg.norm(np.cross(rod - first, along), axis=1)
    assert 2 * away.max() == pytest.approx(5, abs=0.01), "5 mm thick on the paper's rig, and closed at its ends"
    assert np.isclose(away, 0).any() and rod[:, 2].max() < sheet[:, 2].min() - 20
    truth = scanner.truth()
    column = np.full(truth.lit.shape, np.nan)
    depth = column.copy()
    x, y = truth.camera_xy.astype(int).T
    column[y, x], depth[y, x] = truth.projector_xy[:, 0], truth.xyz_mm[:, 2]
    front = depth < sheet[:, 2].min() - 20
    rows = np.flatnonzero(front.any(axis=1))
    assert len(rows) > 0.6 * np.ptp(y)
    shaded, shadows = truth.visible & ~truth.lit, 0
    for row in rows:
        here = np.flatnonzero(front[row])
        assert len(here) < 12, "the rod is thin"
        left, right = column[row, : here[0]], column[row, here[-1] + 1 :]
        assert np.isfinite(left).sum() > 20 and np.isfinite(right).sum() > 20, "plane, rod, plane"
        assert np.nanmin(right) < np.nanmax(column[row, here]) or np.nanmax(left) > np.nanmin(column[row, here])
        # The projector stands on the left: the shadow falls on the plane to the right of the rod.
        shadows += shaded[row, here[-1] + 10 : here[-1] + 80].sum() > 2
    assert shadows > 0.9 * len(rows)


def test_a_mesh_is_placed_and_fitted() -> None:
    vertices, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2], [0, 2, 3]])
    moved = from_mesh(vertices, faces, Pose(np.eye(3), np.array([0, 0, 700.0])))
    np.testing.assert_allclose(moved.mesh()[0][0], [0, 0, 700])
    rig = paper_rig()
    assert in_view(rig, fitted_mesh(rig, 1e-3 * vertices, faces).mesh()[0]).all()
    with pytest.raises(InputError, match="no extent"):
        fitted_mesh(rig, np.zeros((3, 3)), np.array([[0, 1, 2]]))


def test_a_board_is_as_large_as_its_target_or_the_sheet_given() -> None:
    marks = CornerMarks(((-100, -60), (100, -60), (100, 60), (-100, 60)), 10.0)
    pose = Pose(np.eye(3), np.array([0, 0, 800.0]))
    np.testing.assert_allclose(np.ptp(board(marks, pose).mesh()[0], axis=0), [260, 180, 0])
    np.testing.assert_allclose(np.ptp(board(marks, pose, (-200, -90, 150, 80)).mesh()[0], axis=0), [350, 170, 0])
