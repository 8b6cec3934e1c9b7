import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slkit.data import Frames
from slkit.errors import FileError, InputError
from slkit.files import read_frames, read_image, reading_ahead, write_frames, write_png

PICTURE = np.random.default_rng(0).integers(0, 255, (40, 60, 3), dtype=np.uint8)


@settings(max_examples=25, deadline=None)
@given(
    picture=st.sampled_from([np.uint8, np.uint16]).flatmap(
        lambda kind: hnp.arrays(kind, st.sampled_from([(3, 5), (4, 2, 3), (1, 1)]))
    )
)
def test_png_keeps_every_value(tmp_path_factory: pytest.TempPathFactory, picture: np.ndarray):
    path = tmp_path_factory.mktemp("png") / "x.png"
    write_png(path, picture)
    again = read_image(path)
    assert again.dtype == picture.dtype
    np.testing.assert_array_equal(again, picture)


def test_colours_are_rgb(tmp_path):
    red = np.zeros((2, 2, 3), np.uint8)
    red[..., 0] = 200
    write_png(tmp_path / "red.png", red)
    assert cv2.imread(str(tmp_path / "red.png"))[0, 0].tolist() == [0, 0, 200]
    assert read_image(tmp_path / "red.png")[0, 0].tolist() == [200, 0, 0]


def test_alpha_is_dropped(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([PICTURE, np.full(PICTURE.shape[:2], 9, np.uint8)]))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), PICTURE[..., ::-1])


@pytest.mark.parametrize("ending", ["png", "tif", "bmp", "ppm"])
def test_formats_without_loss(tmp_path, ending):
    cv2.imwrite(str(tmp_path / f"x.{ending}"), PICTURE[..., ::-1])
    np.testing.assert_array_equal(read_image(tmp_path / f"x.{ending}"), PICTURE)


@pytest.mark.parametrize("ending", ["png", "tif", "bmp", "ppm", "jpg"])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.6, 0.99])
def test_truncated_picture_is_named(tmp_path, ending, share):
    path = tmp_path / f"broken.{ending}"
    data = cv2.imencode(f".{ending}", PICTURE)[1].tobytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FileError, match=f"broken.{ending}"):
        read_image(path)


def test_png_damaged_inside(tmp_path):
    data = bytearray(cv2.imencode(".png", PICTURE)[1].tobytes())
    data[len(data) // 2] ^= 0x10
    (tmp_path / "x.png").write_bytes(data)
    with pytest.raises(FileError, match="damaged or truncated PNG"):
        read_image(tmp_path / "x.png")


def test_png_without_its_end_mark(tmp_path):
    data = cv2.imencode(".png", PICTURE)[1].tobytes()
    (tmp_path / "x.png").write_bytes(data[:-12])
    with pytest.raises(FileError, match="damaged or truncated PNG"):
        read_image(tmp_path / "x.png")


def test_no_picture_at_all(tmp_path):
    (tmp_path / "text.png").write_text("this is no picture")
    with pytest.raises(FileError, match=r"text\.png cannot be read as a picture"):
        read_image(tmp_path / "text.png")
    with pytest.raises(FileError, match="absent"):
        read_image(tmp_path / "absent.png")


def test_floating_point_picture_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "x.tif"), np.zeros((4, 4), np.float32))
    with pytest.raises(FileError, match="float32"):
        read_image(tmp_path / "x.tif")


def test_frames_are_read_when_asked_for_and_compared_with_the_first(tmp_path):
    for name, shape in (("a", (4, 5)), ("b", (4, 6)), ("c", (4, 5))):
        write_png(tmp_path / f"{name}.png", np.zeros(shape, np.uint8))
    paths = [tmp_path / f"{name}.png" for name in "abc"] + [tmp_path / "absent.png"]
    frames = read_frames(paths, ["white", "black", "x_0", "x_1"])
    assert frames[2].shape == (4, 5)
    with pytest.raises(FileError, match=r"b\.png is 6 x 4 px grey 8-bit, but .*a\.png is 5 x 4"):
        frames[1]
    with pytest.raises(FileError, match="absent"):
        frames[3]
    with pytest.raises(InputError, match="names"):
        read_frames(paths, ["white"])


def test_write_frames_in_display_order(tmp_path):
    frames = Frames.of([np.full((2, 3), i, np.uint8) for i in range(12)], [f"x_{i}" for i in range(12)])
    told = []
    paths = write_frames(tmp_path / "new", frames, lambda *step: told.append(step))
    assert [p.name for p in paths[::11]] == ["000_x_0.png", "011_x_11.png"]
    assert [read_image(p)[0, 0] for p in paths] == list(range(12))
    assert told[-1] == ("write new", 12, 12)


def test_write_frames_does_not_mix_sets(tmp_path):
    write_frames(tmp_path, Frames.of([np.zeros((2, 2), np.uint8)] * 3, ["a", "b", "c"]))
    write_frames(tmp_path, Frames.of([np.ones((2, 2), np.uint8)] * 3, ["a", "b", "c"]))
    with pytest.raises(FileError, match=r"002_c\.png"):
        write_frames(tmp_path, Frames.of([np.zeros((2, 2), np.uint8)] * 2, ["a", "b"]))


def test_reading_ahead_gives_every_frame_and_reads_each_once() -> None:
    loads: list[int] = []

    def load(index: int) -> np.ndarray:
        loads.append(index)
        return np.full((2, 3), index, np.uint8)

    names = tuple(f"{i}" for i in range(20))
    with reading_ahead(Frames(names, load)) as ahead:
        assert ahead.names == names and not loads
        order = [0, 0, *range(1, 20)]
        assert [int(ahead[i][0, 0]) for i in order] == order
        assert sorted(loads) == list(range(20))
        assert int(ahead[5][0, 0]) == 5 and sorted(loads) == sorted([*range(20), 5])


def test_reading_ahead_tells_of_a_bad_frame_when_it_is_asked_for() -> None:
    def load(index: int) -> np.ndarray:
        if index == 3:
            raise FileError("3 is damaged")
        return np.zeros((2, 3), np.uint8)

    with reading_ahead(Frames(tuple("abcdef"), load)) as ahead:
        assert all(ahead[i].shape == (2, 3) for i in range(3))
        with pytest.raises(FileError, match="3 is damaged"):
            ahead[3]
