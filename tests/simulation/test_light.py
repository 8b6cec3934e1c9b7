import numpy as np
import pytest

from slkit.geometry import Pinhole, Pose, Rig, intersect_plane
from slkit.simulation import Scene, plane, sphere
from slkit.simulation.light import Tracer


def small_rig() -> Rig:
    camera = Pinhole((96, 72), np.array([[112, 0, 48], [0, 112, 35.5], [0, 0, 1]]), np.array([-0.2, 0, 0, 0, 0]))
    projector = Pinhole((128, 96), np.array([[150, 0, 63], [0, 150, 80], [0, 0, 1]]), np.array([-0.03, 0, 0, 0, 0]))
    turn = Pose.from_rotation_vector([0.1, -0.25, 0], np.zeros(3))
    return Rig(camera, projector, turn @ Pose(np.eye(3), np.array([300.0, -20, 0])))


def test_rays_meet_a_tilted_plane_where_geometry_says() -> None:
    rig, scene = small_rig(), plane(1000.0, (20.0, -25.0), (300.0, 300.0))
    hits = Tracer(scene, rig, 3).centers()
    vertices, faces = scene.mesh()
    normal = np.cross(*(vertices[faces[0, 1:]] - vertices[faces[0, 0]]))
    expected = intersect_plane(rig.camera.rays().reshape(-1, 3), normal, float(normal @ vertices[0]))
    assert 300 < hits.seen.sum() < hits.seen.size / 2
    np.testing.assert_allclose(hits.xyz[hits.seen], expected[hits.seen], atol=1e-8)
    assert np.isnan(hits.xyz[~hits.seen]).all()


def test_light_follows_lambert_and_the_inverse_square() -> None:
    rig, scene = small_rig(), plane(1000.0, (20.0, -25.0), (300.0, 300.0))
    tracer = Tracer(scene, rig, 3)
    hits = tracer.centers()
    vertices, faces = scene.mesh()
    normal = np.cross(*(vertices[faces[0, 1:]] - vertices[faces[0, 0]]))
    normal /= np.linalg.norm(normal)
    towards = rig.projector_center - hits.xyz[hits.lit]
    distance = np.linalg.norm(towards, axis=1)
    expected = np.abs(towards @ normal) / distance * (tracer.reference_mm / distance) ** 2
    assert hits.lit.sum() > 300
    np.testing.assert_allclose(hits.light[hits.lit], expected, rtol=1e-6)


def test_a_sphere_is_shaded_smoothly() -> None:
    rig, center = small_rig(), np.array([0, 0, 1000.0])
    hits = Tracer(sphere(center, 120.0), rig, 3).centers()
    normal = (hits.xyz[hits.lit] - center) / 120
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-4)
    towards = rig.projector_center - hits.xyz[hits.lit]
    distance = np.linalg.norm(towards, axis=1)
    cosine = (normal * towards).sum(axis=1) / distance
    tracer = Tracer(sphere(center, 120.0), rig, 3)
    np.testing.assert_allclose(hits.light[hits.lit] * (distance / tracer.reference_mm) ** 2, cosine, atol=2e-3)


def test_a_screen_casts_its_shadow_where_geometry_says() -> None:
    rig = small_rig()
    wall, screen = plane(1200.0, size_mm=(700.0, 500.0)), plane(900.0, size_mm=(120.0, 90.0))
    hits = Tracer(Scene(wall.surfaces + screen.surfaces), rig, 3).centers()
    on_wall = hits.seen & (np.abs(hits.xyz[:, 2] - 1200) < 1)
    xyz, source = hits.xyz[on_wall], rig.projector_center
    crossing = source + (xyz - source) * ((900 - source[2]) / (xyz[:, 2] - source[2]))[:, None]
    outside = np.abs(crossing[:, :2]) - [60, 45]
    shaded, clear = (outside < -0.1).all(axis=1), (outside > 0.1).any(axis=1)
    light = hits.light[on_wall]
    assert 30 < shaded.sum() < 400
    assert (light[shaded] == 0).all() and not hits.lit[on_wall][shaded].any()
    x, y = rig.to_projector(xyz).T
    beam = (x > 0) & (x < 127) & (y > 0) & (y < 95)
    assert (light[clear & beam] > 0).all() and hits.lit[on_wall][clear & beam].all()
    assert not hits.lit[on_wall][(x < -0.6) | (x > 127.6) | (y < -0.6) | (y > 95.6)].any()


def test_a_sheet_seen_from_its_dark_side_is_dark() -> None:
    rig = small_rig()
    # The projector stands to the left: it reaches the left face of a sheet turned nearly edge-on, not the right one.
    for tilt, place, reached in ((75.0, 0.0, True), (-82.0, 40.0, False)):
        hits = Tracer(plane(1000.0, (0.0, tilt), (300, 300), (place, 0.0)), rig, 3).centers()
        assert hits.seen.sum() > 50
        assert hits.lit.any() == reached


@pytest.mark.parametrize("samples", [3, 4])
def test_the_field_is_the_mean_of_its_rays(samples: int) -> None:
    rig, scene = small_rig(), plane(1000.0, size_mm=(300.0, 300.0), albedo=(0.2, 0.5, 0.8))
    tracer = Tracer(scene, rig, samples)
    field, hits = tracer.field(), tracer.centers()
    assert field.weight.shape == (72, 96, samples**2, 3)
    middle = hits.lit.reshape(72, 96)[36, 48]
    assert middle
    light = hits.light.reshape(72, 96)[36, 48]
    np.testing.assert_allclose(field.weight[36, 48].sum(axis=0), light * np.array([0.2, 0.5, 0.8]), rtol=1e-3)
    np.testing.assert_allclose(field.albedo[36, 48], [0.2, 0.5, 0.8], rtol=1e-6)
    place = field.projector_xy[36, 48].mean(axis=0)
    np.testing.assert_allclose(place, hits.projector_xy.reshape(72, 96, 2)[36, 48], atol=1e-3)
