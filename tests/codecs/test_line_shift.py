import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from slkit.codecs.line_shift import LineShift
from slkit.data import Correspondences, Frames
from slkit.errors import DecodeError, InputError
from slkit.registry import create

PAPER = {"period": 8, "width": 2}


def test_default_is_six_lines_after_nine_bits_and_their_inverses() -> None:
    frames = LineShift((1024, 768)).encode()
    assert len(frames) == 2 + 18 + 6
    assert frames.names[:4] == ("white", "black", "x_bit8", "x_bit8_inverse")
    assert frames.names[-6:] == tuple(f"x_line{s}" for s in range(6))
    assert len(LineShift((1024, 768), axes="both").encode()) == 50


@settings(max_examples=30, deadline=None)
@given(size=st.tuples(st.integers(16, 60), st.integers(16, 60)), period=st.integers(3, 12), data=st.data())
def test_shift_s_lights_the_columns_that_start_at_s(size: tuple[int, int], period: int, data: Any) -> None:
    width = data.draw(st.integers(1, period - 1))
    frames = LineShift(size, axes="y", period=period, width=width, cell=1).encode()
    lines = np.stack([f[:, 0] > 0 for f in frames][-period:])
    assert (lines.sum(axis=0) == width).all()
    for shift, lit in enumerate(lines):
        assert lit.tolist() == [(row - shift) % period < width for row in range(size[1])]


def lines_of(codec: LineShift, found: Correspondences, axis: int) -> bool:
    """Tell whether every value is the exact centre of a line."""
    centers = found.projector_xy[:, axis] - (codec.width - 1) / 2
    return bool((centers == np.rint(centers)).all())


def test_on_a_plane_lines_are_placed_within_a_tenth_of_a_pixel(flat: Any, spread: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size)
    found = codec.decode(flat.frames(codec))
    assert lines_of(codec, found, 0) and np.isnan(found.projector_xy[:, 1]).all()
    error, sigma = flat.errors(found, 0)
    assert np.sqrt(np.mean(error**2)) <= 0.10
    assert abs(np.mean(error)) < 0.005
    assert 0.7 <= spread(error / sigma) <= 1.4
    assert flat.completeness(found) > 0.98


def test_rows_are_found_as_columns_are(flat: Any, spread: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size, axes="y")
    found = codec.decode(flat.frames(codec))
    assert lines_of(codec, found, 1) and np.isnan(found.projector_xy[:, 0]).all()
    error, sigma = flat.errors(found, 1)
    assert np.sqrt(np.mean(error**2)) <= 0.10
    assert 0.7 <= spread(error / sigma) <= 1.4
    assert flat.completeness(found) > 0.98


def test_both_axes_meet_at_each_column(flat: Any, spread: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size, axes="both")
    found = codec.decode(flat.frames(codec))
    assert lines_of(codec, found, 0) and np.isfinite(found.projector_xy).all()
    for axis in (0, 1):
        error, sigma = flat.errors(found, axis)
        assert np.sqrt(np.mean(error**2)) <= 0.10
        assert 0.7 <= spread(error / sigma) <= 1.4
    assert flat.completeness(found) > 0.97


def test_temporal_peaks_give_a_value_for_each_pixel(flat: Any, spread: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size, axes="both", peaks="temporal")
    found = codec.decode(flat.frames(codec))
    assert len(found) > 0.98 * flat.lit.sum()  # all but the rim of the light
    assert (found.camera_xy == np.rint(found.camera_xy)).all()
    for axis in (0, 1):
        error, sigma = flat.errors(found, axis)
        assert np.sqrt(np.mean(error**2)) <= 0.12
        assert 0.7 <= spread(error / sigma) <= 1.4


@pytest.mark.parametrize("peaks", ["spatial", "temporal"])
def test_two_projector_pixels_a_camera_pixel(sculpture: Any, spread: Any, peaks: Any) -> None:
    codec = LineShift(sculpture.scanner.rig.projector.size, peaks=peaks, **PAPER)
    found = codec.decode(sculpture.frames(codec))
    error, sigma = sculpture.errors(found, 0)
    assert (np.abs(error) < codec.period / 2).mean() > 0.99
    assert np.median(np.abs(error)) < 0.1
    assert sculpture.completeness(found) > 0.9
    assert 0.7 <= spread(error / sigma) <= 1.4


def test_it_does_not_care_how_the_camera_is_turned_or_mirrored(flat: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size)
    frames = flat.frames(codec)
    found = codec.decode(frames)
    height, width = frames[0].shape
    views = {
        "turned": (np.rot90, lambda xy: np.stack([width - 1 - xy[:, 1], xy[:, 0]], axis=1)),
        "mirrored": (np.fliplr, lambda xy: np.stack([width - 1 - xy[:, 0], xy[:, 1]], axis=1)),
    }
    for turn, back in views.values():
        other = codec.decode(Frames.of([np.ascontiguousarray(turn(f)) for f in frames], frames.names))
        tree = cKDTree(back(other.camera_xy))
        away, partner = tree.query(found.camera_xy)
        near = away < 0.02
        assert near.mean() > 0.995
        np.testing.assert_array_equal(found.projector_xy[near, 0], other.projector_xy[partner[near], 0])


def test_a_line_cut_by_the_projectors_border_is_not_used() -> None:
    codec = LineShift((48, 32), **PAPER)
    frames = Frames.of([(40 + f * (170 / 255)).astype(np.uint8) for f in codec.encode()], codec.encode().names)
    found = codec.decode(frames)
    assert len(found) and found.projector_xy[:, 0].min() >= 0.5 and found.projector_xy[:, 0].max() <= 46.5


def test_saturated_and_unlit_pixels_are_left_out(flat: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size)
    frames = flat.frames(codec)
    rows, cols = np.nonzero(flat.lit)
    row, col = int(np.median(rows)), int(np.median(cols))
    images = [f.copy() for f in frames]
    images[0][row - 9 : row, col : col + 9] = 255
    images[0][row + 5 : row + 14, col : col + 9] = images[1][row + 5 : row + 14, col : col + 9]
    found = codec.decode(Frames.of(images, frames.names))
    at = found.camera_xy - [col, row]
    inside = (at[:, 0] >= 0) & (at[:, 0] <= 8)
    assert not (inside & (at[:, 1] >= -9) & (at[:, 1] < 0)).any()
    assert not (inside & (at[:, 1] >= 5) & (at[:, 1] < 14)).any()
    assert (inside & (at[:, 1] >= 0) & (at[:, 1] < 5)).any()


def test_ghosts_of_lines_that_do_not_fit_their_neighbours_are_dropped(flat: Any) -> None:
    codec = LineShift(flat.scanner.rig.projector.size)
    frames = flat.frames(codec)
    first = frames.names.index("x_line0")
    # Each line picture with a copy of the picture two shifts on, close enough for the coarse code: a second reflection.
    images = [f.astype(float) for f in frames]
    lines = images[first:]
    images[first:] = [0.65 * lines[s] + 0.35 * lines[(s + 2) % 6] for s in range(6)]
    found = codec.decode(Frames.of([np.rint(i).astype(np.uint8) for i in images], frames.names))
    error, _ = flat.errors(found, 0)
    assert (np.abs(error) > 1).mean() < 1e-3
    assert flat.completeness(found) > 0.95


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"period": 2}, "period"),
        ({"width": 6}, "width"),
        ({"width": 0}, "width"),
        ({"cell": 4}, "cell"),
        ({"cell": 0}, "cell"),
        ({"peaks": "best"}, "peaks"),
        ({"axes": "xy"}, "axes"),
        ({"min_snr": -1.0}, "min_snr"),
    ],
)
def test_a_parameter_out_of_range_is_named(parameters: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        create(LineShift, {"projector": (64, 48)} | parameters, "here")


def test_frames_that_cannot_be_decoded_are_refused() -> None:
    codec = LineShift((64, 48))
    count = len(codec.encode())
    with pytest.raises(InputError, match=f"{count} frames are needed"):
        codec.decode(codec.encode().select(range(count - 1)))
    with pytest.raises(DecodeError):
        codec.decode(Frames.of([np.zeros((48, 64), np.uint8)] * count))


@pytest.fixture(scope="module")
def rendered(captures: Any) -> Any:
    """The line-shift scan of an independent renderer, the rig it was made with, and where its object is lit."""
    folder = captures("planar_capture")
    truth = np.load(folder / "truth" / "object.npz")
    cols, rows = truth["camera_xy"].astype(int).T
    column = np.full((960, 1280), np.nan, dtype=np.float32)
    column[rows, cols] = truth["projector_xy"][:, 0]
    return folder, column


@pytest.mark.parametrize(("peaks", "least"), [("spatial", 0.98), ("temporal", 0.999)])
def test_labels_of_an_independently_rendered_capture(
    rendered: Any, read_frames: Any, spread: Any, peaks: Any, least: float
) -> None:
    folder, column = rendered
    found = LineShift((1280, 800), peaks=peaks).decode(read_frames(folder / "scan_line_shift", "*.png"))
    true = map_coordinates(column, found.camera_xy.T[::-1], order=1, cval=np.nan)
    known = np.isfinite(true)
    error, sigma = (found.projector_xy[:, 0] - true)[known], found.sigma[known, 0]
    # Beside an occluding edge the truth between two pixels is a mixture of both surfaces.
    assert (np.abs(error) < 3).mean() > 0.998
    assert np.median(np.abs(error)) < 0.02
    assert 0.7 <= spread(error / sigma) <= 1.4
    got = np.zeros(column.shape, dtype=bool)
    at = np.rint(found.camera_xy).astype(int)
    for shift in (-1, 0, 1):
        got[at[:, 1], np.clip(at[:, 0] + shift, 0, 1279)] = True
    assert got[np.isfinite(column)].mean() > least


def test_points_of_an_independently_rendered_capture(rendered: Any, read_frames: Any) -> None:
    from slkit import _open3d
    from slkit.geometry import Pinhole, Pose, Rig
    from slkit.triangulation.ray_plane import ray_plane

    folder, column = rendered
    table = json.loads((folder / "truth" / "rig.json").read_text())
    camera, projector = (Pinhole(**table[name]) for name in ("camera", "projector"))
    rig = Rig(camera, projector, Pose(**table["projector_from_camera"]))
    found = LineShift((1280, 800)).decode(read_frames(folder / "scan_line_shift", "*.png"))
    cols, rows = np.rint(found.camera_xy).astype(int).T
    xyz = ray_plane(found.select(np.isfinite(column[rows, cols])), rig).xyz
    o3d, mesh = _open3d.load(), np.load(folder / "truth" / "object_mesh.npz")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh["vertices_mm"].astype(np.float32), mesh["faces"].astype(np.uint32))
    distance = scene.compute_distance(np.ascontiguousarray(xyz)).numpy()
    assert (distance > 2).mean() <= 0.0005
    assert np.sqrt(np.mean(distance[distance <= 2] ** 2)) <= 0.08
    assert np.median(distance) <= 0.02
    true = np.load(folder / "truth" / "object.npz")["xyz_mm"]
    assert np.isfinite(cKDTree(xyz).query(true, distance_upper_bound=1.0)[0]).mean() >= 0.97
