import numpy as np
import pytest

from slkit.errors import InputError
from slkit.geometry import Pose
from slkit.simulation import Print, Scene, Surface, board, plane
from slkit.simulation.surface import net_faces
from slkit.targets import INK, PAPER, Checkerboard

TRIANGLE = np.array([[0.0, 0, 1000], [100, 0, 1000], [0, 100, 1000]])
FACE = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("vertices", "faces", "albedo", "says"),
    [
        (TRIANGLE[:, :2], FACE, 0.5 * np.ones(3), "vertices must have the shape"),
        (TRIANGLE * np.nan, FACE, 0.5 * np.ones(3), "not finite"),
        (TRIANGLE, FACE + 1, 0.5 * np.ones(3), "outside 0 to 2"),
        (TRIANGLE, np.zeros((0, 3), int), 0.5 * np.ones(3), "faces must have"),
        (TRIANGLE, FACE, 1.5 * np.ones(3), "between 0 and 1"),
        (TRIANGLE, FACE, np.ones((2, 3)), "albedo must have the shape"),
    ],
)
def test_a_broken_surface_is_refused(vertices: np.ndarray, faces: np.ndarray, albedo: np.ndarray, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Surface(vertices, faces, albedo)


def test_a_scene_needs_a_surface() -> None:
    with pytest.raises(InputError, match="at least one"):
        Scene(())


def test_the_mesh_of_a_scene_holds_all_triangles() -> None:
    a, b = plane(1000.0), plane(1200.0)
    vertices, faces = Scene(a.surfaces + b.surfaces).mesh()
    assert faces.max() == len(vertices) - 1
    np.testing.assert_allclose(np.unique(vertices[faces][..., 2]), [1000, 1200])
    np.testing.assert_allclose(vertices[faces[:2]], a.mesh()[0][a.mesh()[1]])


def test_vertex_albedo_is_interpolated() -> None:
    surface = Surface(TRIANGLE, FACE, np.eye(3))
    uv = np.array([[0, 0], [1, 0], [0, 1], [0.2, 0.3]])
    seen = surface.reflectance(np.zeros((4, 3)), np.repeat(FACE, 4, axis=0), uv, 0.0)
    np.testing.assert_allclose(seen, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.2, 0.3]])
    assert surface.coloured and not Surface(TRIANGLE, FACE).coloured


def test_a_print_moves_with_its_board() -> None:
    target = Checkerboard((5, 4), 20.0)
    pose = Pose.from_rotation_vector([0.2, -0.3, 0.1], [5, 6, 900])
    scene = board(target, Pose.identity()).moved(pose)
    (surface,) = scene.surfaces
    assert isinstance(surface.albedo, Print)
    places = pose.apply([[-10, -10, 0], [10, -10, 0], [-30, -30, 0]])
    seen = surface.reflectance(places, np.zeros((3, 3), int), np.zeros((3, 2)), 0.1)
    np.testing.assert_allclose(seen, np.repeat([[INK], [PAPER], [PAPER]], 3, axis=1))


def test_a_net_covers_its_rectangle_once() -> None:
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    points = np.stack([x, y], axis=-1).reshape(-1, 2)
    corners = points[net_faces(3, 4)]
    e, f = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    np.testing.assert_allclose(area, 1.0)
    assert area.sum() / 2 == 6
