"""The figures of a calibration: what they count, where they draw, and that odd evidence breaks none of them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slkit.data import Capture, Diagnosis, VolumeMap
from slkit.geometry import Pinhole, Rig, ninths
from slkit.report._canvas import round_length
from slkit.report._evidence import DevicePoints, device_points
from slkit.report._lens_figures import coverage_panel, displacement, distortion_panel
from slkit.report._picture_figures import contact_sheet
from slkit.report._residual_figures import _cell_means as cell_means
from slkit.report._residual_figures import scatter_panel
from slkit.report._scene_figures import rays_panel, rig_panel
from slkit.report._volume_figures import volume_panels
from slkit.report.calibration_figures import calibration_sections


@pytest.fixture(scope="module")
def found(calibration) -> dict[str, str]:
    """Caption of every figure."""
    return {p.name: p.caption for s in calibration_sections(calibration) for p in s.panels}


def drawn(calibration) -> set[str]:
    return {p.name for s in calibration_sections(calibration) for p in s.panels if p.png is not None}


@given(largest=st.floats(1e-12, 1e12))
def test_a_round_length_is_the_largest_that_fits(largest):
    length = round_length(largest)
    assert length <= largest * (1 + 1e-9)
    assert length * 2.5 >= largest * (1 - 1e-9)
    mantissa = length / 10.0 ** np.floor(np.log10(length) + 1e-9)
    assert min(abs(mantissa - n) for n in (1, 2, 5)) < 1e-6


def test_ninths_are_counted_row_by_row_to_the_rim():
    size = (300, 90)
    xy = np.array([[-0.5, -0.5], [99.4, 0], [299.5, 0], [150, 45], [150, 46], [299.5, 89.5], [0, 89]])
    np.testing.assert_array_equal(ninths(xy, size), [[2, 0, 1], [0, 2, 0], [1, 0, 1]])


def test_the_coverage_counts_kept_points_only(found):
    assert found["coverage-camera"].startswith(f"Camera: {3 * 62 + 4 * 125} points")
    assert "outside the image, as with a lens shift" in found["coverage-projector"]
    assert "outside" not in found["coverage-camera"]


def test_a_lens_moves_its_image_by_its_distortion():
    lens = Pinhole((640, 480), [[600, 0, 300], [0, 610, 250], [0, 0, 1]], [-0.1, 0.02, 1e-3, -5e-4, 0])
    grid, shift = displacement(lens)
    x, y = np.moveaxis((grid - shift - lens.K[:2, 2]) / [600, 610], -1, 0)
    r2 = x * x + y * y
    radial = -0.1 * r2 + 0.02 * r2 * r2
    np.testing.assert_allclose(shift[..., 0], 600 * (x * radial + 2e-3 * x * y - 5e-4 * (r2 + 2 * x * x)), atol=1e-9)
    np.testing.assert_allclose(shift[..., 1], 610 * (y * radial + 1e-3 * (r2 + 2 * y * y) - 1e-3 * x * y), atol=1e-9)
    np.testing.assert_allclose(grid[[0, -1], [0, -1]], [[-0.5, -0.5], [639.5, 479.5]])


def test_the_scatter_tells_its_sigma_and_its_rejected(found):
    assert "686 residuals; the circle is 1 sigma of one coordinate, 0.1" in found["residuals-camera"]
    assert "7 rejected (crosses; diamonds on the rim stand for 7 beyond it)" in found["residuals-camera"]
    assert found["residuals-projector"].endswith("4 rejected (crosses).")


def test_the_mean_field_is_that_of_cells_with_enough_points():
    lens = Pinhole((1200, 900), [[1000, 0, 600], [0, 1000, 450], [0, 0, 1]], np.zeros(5))
    # Cells are 100 px wide: four points in the first, three in one further down, two in the last.
    seen = np.array(
        [[10, 10], [20, 30], [90, 90], [0, 0], [110, 310], [190, 390], [150, 350], [1150, 850], [1160, 860.0]]
    )
    error = np.array([[1, 0]] * 2 + [[3, 2]] * 2 + [[-1, 5]] * 3 + [[9, 9]] * 2, dtype=float)
    points = DevicePoints("camera", lens, seen, error, np.zeros(9, np.intp), np.ones(9, np.bool_))
    places, means = cell_means(points)
    np.testing.assert_allclose(places, [[30, 32.5], [150, 350]])
    np.testing.assert_allclose(means, [[2, 1], [-1, 5]])


def test_sigma_is_that_of_the_noise(make_calibration):
    caption = scatter_panel(device_points(make_calibration(10, 10), "camera")).caption
    assert float(caption.split(", ")[1].split(" px")[0]) == pytest.approx(0.15, rel=0.03)


def test_the_rays_are_those_of_the_view_with_the_most_corners(calibration):
    richest = calibration.views[5]
    others = [
        v
        if v is richest or v.view is None
        else replace(v, view=replace(v.view, projector_xy=half(v.view.projector_xy)))
        for v in calibration.views
    ]
    assert rays_panel(replace(calibration, views=tuple(others))).caption.startswith(f"View 6, {richest.name}:")


def half(xy: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(xy))[:, None] % 2, xy, np.nan)


def test_corners_are_drawn_where_they_were_found(calibration):
    width, height = calibration.rig.camera.size
    black = np.zeros((height, width), np.uint8)
    view = calibration.views[0]
    (panel,) = contact_sheet(replace(calibration, views=(view,)), [Capture(view.name, printed=black)]).panels
    picture = cv2.imdecode(np.frombuffer(panel.png or b"", np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert view.view is not None
    assert view.kept is not None
    place = (view.view.camera_xy + 0.5) * picture.shape[1] / width - 0.5
    reach = np.stack(np.meshgrid(np.arange(picture.shape[1]), np.arange(picture.shape[0])), axis=-1)
    painted = picture.max(axis=2) > 60
    away = np.linalg.norm(reach[:, :, None] - place, axis=-1).min(axis=-1)
    assert (away[painted] < 13).all()
    # The arms of a cross reach into the rings of close neighbours.
    clear = ~view.kept | (np.linalg.norm(place - place[~view.kept], axis=1) > 20)
    assert clear.sum() > 40
    for (x, y), kept in zip(place[clear], view.kept[clear], strict=True):
        near = picture[round(y) - 4 : round(y) + 5, round(x) - 4 : round(x) + 5].reshape(-1, 3)
        red, green = near[:, 0].max(), near[:, 1].max()
        assert (green > 120) == kept
        assert (red > 120) == (not kept)
    assert panel.caption == "side_a/00, printed board: 63 corners, 1 rejected"


@pytest.mark.parametrize("kind", ["16 bit", "colour", "portrait", "one grey", "tiny"])
def test_pictures_of_every_kind(calibration, kind):
    picture = {
        "16 bit": np.linspace(0, 900, 768 * 576).reshape(576, 768).astype(np.uint16),
        "colour": np.zeros((576, 768, 3), np.uint8),
        "portrait": np.full((768, 576), 9, np.uint8),
        "one grey": np.full((576, 768), 77, np.uint8),
        "tiny": np.zeros((1, 1), np.uint8),
    }[kind]
    sheet = contact_sheet(calibration, [Capture(calibration.views[0].name, printed=picture)])
    assert len(sheet.panels) == sheet.count == 1
    shown = cv2.imdecode(np.frombuffer(sheet.panels[0].png or b"", np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape[1] == min(440, picture.shape[1])


def test_of_many_pictures_the_telling_ones_are_shown(make_calibration):
    many = make_calibration(60, 0)
    views = list(many.views)
    views[17] = replace(views[17], rms_joint=3.0)
    picture = np.zeros((576, 768), np.uint8)
    sheet = contact_sheet(replace(many, views=tuple(views)), [Capture(v.name, printed=picture) for v in views])
    assert sheet.count == 61
    assert len(sheet.panels) == 36
    names = [p.caption.split(",")[0] for p in sheet.panels]
    assert {"side_a/17", "side_b/lost"} <= set(names)
    assert names == sorted(names)


def test_uncertainty_and_halves_share_their_scale(calibration):
    # A map on a common scale looks different once the larger map is not there to set the scale.
    assert calibration.diagnosis is not None
    x, y = np.meshgrid(np.linspace(0, 767, 4), np.linspace(0, 575, 3))
    small, large = (VolumeMap(np.array([1000.0]), np.stack([x, y], -1), v * np.ones((1, 3, 4))) for v in (0.1, 0.4))
    beside, alone = (
        volume_panels(replace(calibration, diagnosis=Diagnosis({}, uncertainty=small, cross_validation=other)))
        for other in (large, None)
    )
    assert beside["uncertainty"][0].png != alone["uncertainty"][0].png
    assert (
        beside["uncertainty"][0].caption
        == alone["uncertainty"][0].caption
        == ("At 1000 mm: rms 0.100 mm, largest 0.100 mm.")
    )


def test_the_three_depths_are_the_ends_and_the_middle(found):
    starts = [found[f"uncertainty-{n}"].split(":")[0] for n in (1, 2, 3)]
    assert starts == ["At 900 mm", "At 1100 mm", "At 1200 mm"]


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 2, 3), (2, 5, 1), (3, 8, 8)])
@pytest.mark.parametrize("value", [0.0, 0.2, np.nan])
def test_maps_of_every_shape(bare, shape, value):
    camera_xy = np.stack(np.meshgrid(np.linspace(0, 767, shape[2]), np.linspace(0, 575, shape[1])), axis=-1)
    volume = VolumeMap(1000.0 + np.arange(shape[0]), camera_xy, np.full(shape, value))
    panels = volume_panels(replace(bare, diagnosis=Diagnosis({}, uncertainty=volume)))["uncertainty"]
    assert sum(p.png is not None for p in panels) == (0 if np.isnan(value) else min(shape[0], 3))


@pytest.mark.parametrize(
    "change",
    [
        lambda v: replace(v, kept=np.zeros(len(v.kept), bool)),
        lambda v: replace(v, camera_xy_error=np.full_like(v.camera_xy_error, np.nan)),
        lambda v: replace(v, camera_xy_error=np.zeros_like(v.camera_xy_error)),
        lambda v: replace(v, camera_xy_error=1e6 * v.camera_xy_error),
        lambda v: replace(v, pose=None),
        lambda v: replace(v, view=None, kept=None),
        lambda v: replace(v, view=replace(v.view, board_xy=np.full_like(v.view.board_xy, np.nan))),
        lambda v: replace(v, view=replace(v.view, camera_xy=np.full_like(v.view.camera_xy, np.nan))),
    ],
)
def test_odd_views_leave_figures_out_or_are_drawn(calibration, change):
    views = tuple(change(v) if v.used else v for v in calibration.views[3:5])
    found = drawn(replace(calibration, views=views, diagnosis=None))
    assert {"distortion-camera", "distortion-projector"} <= found


def test_odd_lenses_are_drawn(calibration):
    straight = Pinhole((480, 640), [[500, 0, -900], [0, 500, 4000], [0, 0, 1]], np.zeros(5))
    folded = Pinhole((1024, 768), [[300, 20, 500], [0, 300, 380], [0, 0, 1]], [-0.9, 0.0, 0, 0, 0])
    rig = Rig(straight, folded, calibration.rig.projector_from_camera)
    camera, projector = (device_points(replace(calibration, rig=rig), d) for d in ("camera", "projector"))
    assert distortion_panel(camera).caption == "Camera: the lens has no distortion."
    assert distortion_panel(projector).caption.endswith("Where nothing is drawn the model folds over.")
    assert "(-900, 4000) px, outside the image" in coverage_panel(camera).caption
    assert rig_panel(replace(calibration, rig=rig)).png is not None
