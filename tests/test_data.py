import numpy as np
import pytest

from slkit.data import BoardView, Correspondences, Frames, PointCloud, check_image, describe_image
from slkit.errors import InputError


def images(count=3, shape=(4, 6), dtype=np.uint8):
    return [np.full(shape, i, dtype) for i in range(count)]


def test_frames_are_a_sequence_that_loads_lazily():
    loaded = []

    def load(index):
        loaded.append(index)
        return images()[index]

    frames = Frames(("a", "b", "c"), load)
    assert len(frames) == 3 and loaded == []
    assert frames[-1][0, 0] == 2 and loaded == [2]
    assert [int(f[0, 0]) for f in frames] == [0, 1, 2]
    chosen = frames.select([2, 0])
    assert chosen.names == ("c", "a") and int(chosen[0][0, 0]) == 2
    with pytest.raises(IndexError):
        frames[3]
    assert frames.stack().shape == (3, 4, 6)


def test_frames_that_do_not_fit_together_are_named():
    mixed = Frames.of([*images(2), np.zeros((5, 6), np.uint8)], ["one", "two", "odd"])
    with pytest.raises(InputError, match="frame odd is 6 x 5 px grey 8-bit, but one is 6 x 4"):
        mixed.stack()
    with pytest.raises(InputError, match="2 frames need as many names"):
        Frames.of(images(2), ["a"])


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((4, 4), np.float32), "8- or 16-bit"),
        (np.zeros((4, 4, 2), np.uint8), "shape"),
        (np.zeros((0, 4), np.uint8), "shape"),
        ("picture", "shape"),
    ],
)
def test_what_is_no_picture_is_refused(image, words):
    with pytest.raises(InputError, match=words):
        check_image(image, "x")


def test_pictures_are_described_in_words():
    assert describe_image(np.zeros((3, 5, 3), np.uint16)) == "5 x 3 px colour 16-bit"


def correspondences(xy) -> Correspondences:
    count = len(xy)
    value = np.arange(2 * count, dtype=np.float32).reshape(count, 2)
    return Correspondences(np.array(xy, np.float32), value, value, np.ones(count), np.ones((count, 3)))


def test_correspondences_make_a_map_and_leave_out_what_lies_outside():
    found = correspondences([(1.2, 0.4), (2.0, 1.0), (9.0, 0.0), (-0.6, 0.0)])
    picture = found.as_map((2, 4))
    assert picture.shape == (2, 4, 2)
    assert picture[0, 1].tolist() == [0, 1] and picture[1, 2].tolist() == [2, 3]
    assert np.isfinite(picture).sum() == 4
    assert len(found.select(np.array([True, False, True, False]))) == 2


def test_shapes_that_disagree_are_refused():
    with pytest.raises(InputError, match="sigma must have the shape"):
        Correspondences(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((2, 2)), np.zeros(3), np.zeros((3, 3)))
    with pytest.raises(InputError, match="xyz"):
        PointCloud(np.zeros((3, 2)), np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 2)))


def test_a_cloud_keeps_its_evidence_in_open3d():
    rng = np.random.default_rng(0)
    evidence = rng.random(5), rng.random(5), rng.random((5, 2))
    cloud = PointCloud(rng.random((5, 3)), rng.random((5, 3)), *evidence, sigma_cal_mm=rng.random(5))
    assert cloud.xyz.dtype == np.float32
    held = cloud.to_open3d()
    np.testing.assert_array_equal(held.point["positions"].numpy(), cloud.xyz)
    for name in ("sigma_mm", "sigma_cal_mm", "residual_px"):
        np.testing.assert_array_equal(held.point[name].numpy()[:, 0], getattr(cloud, name))
    assert "normals" not in held.point


def test_sigma_of_a_point_comes_apart_into_decoding_and_calibration():
    rows = np.zeros((4, 3)), np.zeros((4, 3)), np.float32([5, 5, np.nan, 3]), np.zeros(4), np.zeros((4, 2))
    cloud = PointCloud(*rows, sigma_cal_mm=np.float32([3, np.nan, 3, 3]))
    np.testing.assert_allclose(cloud.sigma_decoding_mm, [4, 5, np.nan, 0], rtol=1e-6)
    assert cloud.select(np.array([0, 3])).sigma_decoding_mm.tolist() == [4, 0]
    unknown = PointCloud(*rows)
    assert unknown.sigma_cal_mm.shape == (4,) and np.isnan(unknown.sigma_cal_mm).all()
    np.testing.assert_array_equal(unknown.sigma_decoding_mm, cloud.sigma_mm)
    with pytest.raises(InputError, match="sigma_cal_mm must have the shape"):
        PointCloud(*rows, sigma_cal_mm=np.zeros(3))


def test_a_view_knows_which_rows_are_printed_and_which_projected():
    nan = np.nan
    view = BoardView(
        "v",
        (10, 10),
        np.array([[0.0, 0], [nan, nan], [1, 1]]),
        np.ones((3, 2)),
        np.array([[nan, nan], [5.0, 5], [6, 6]]),
        np.zeros((3, 2)),
    )
    assert view.printed.tolist() == [True, False, True]
    assert view.projected.tolist() == [False, True, True]
    assert BoardView.unusable("w", (10, 10), "no board").problem == "no board"
