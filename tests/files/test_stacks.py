import io
import pickle
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slkit.errors import FileError
from slkit.files import FrameSource, read_frames, read_image
from slkit.files.stacks import open_stack

RNG = np.random.default_rng(0)
GREY = RNG.integers(0, 256, (5, 6, 8), dtype=np.uint8)
DEEP = RNG.integers(0, 65536, (5, 6, 8), dtype=np.uint16)
COLOR = RNG.integers(0, 65536, (5, 6, 8, 3), dtype=np.uint16)
NAMES = ("white", "black", "x_bit1", "x_bit0", "y_bit0")


def saved(path: Path, stack: np.ndarray, kind: str) -> Path:
    """Write a stack of five pictures in one of the ways there are."""
    with path.open("wb") as file:
        if kind == "npy":
            np.save(file, stack)
        elif kind == "npz, one array":
            np.savez(file, stack)
        elif kind == "npz, one array, packed":
            np.savez_compressed(file, pictures=stack)
        else:
            np.savez(file, **{f"z{9 - i}": picture for i, picture in enumerate(stack)})
    return path


KINDS = ("npy", "npz, one array", "npz, one array, packed", "npz, an array a picture")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stack", [GREY, DEEP, COLOR, DEEP.astype(">u2"), COLOR.astype(">u2")])
def test_every_picture_comes_as_it_was_saved(tmp_path: Path, kind: str, stack: np.ndarray):
    file = saved(tmp_path / f"stack.{kind[:3]}", stack, kind)
    held = open_stack(file)
    assert held.count == 5
    for index in (0, 1, 2, 3, 4, 0, 4, 2, 2):
        picture = held.load(index)
        assert picture.dtype in (np.uint8, np.uint16) and picture.dtype.isnative
        assert picture.flags.c_contiguous and picture.flags.writeable
        np.testing.assert_array_equal(picture, stack[index])
    frames = FrameSource.of(tmp_path, file.name, "x.toml").frames(NAMES, "gray")
    assert frames.names == NAMES
    np.testing.assert_array_equal(frames.stack(), stack)


def test_an_array_in_fortran_order(tmp_path: Path):
    np.save(tmp_path / "a.npy", np.asfortranarray(COLOR))
    np.testing.assert_array_equal(open_stack(tmp_path / "a.npy").load(3), COLOR[3])
    np.savez(tmp_path / "a.npz", *(np.asfortranarray(picture) for picture in GREY))
    np.testing.assert_array_equal(open_stack(tmp_path / "a.npz").load(3), GREY[3])
    np.savez(tmp_path / "b.npz", np.asfortranarray(GREY))
    with pytest.raises(FileError, match=r"b\.npz: arr_0 is in Fortran order: save numpy\.ascontiguousarray"):
        open_stack(tmp_path / "b.npz")


@pytest.mark.parametrize("ending", ["npy", "npz"])
@pytest.mark.parametrize("picture", [GREY[0], COLOR[0]])
def test_one_picture_a_file(tmp_path: Path, ending: str, picture: np.ndarray):
    for number in range(3):
        with (tmp_path / f"{number}.{ending}").open("wb") as file:
            np.save(file, picture + number) if ending == "npy" else np.savez(file, picture + number)
    paths = [tmp_path / f"{n}.{ending}" for n in (2, 0, 1)]
    np.testing.assert_array_equal(read_frames(paths, ["a", "b", "c"])[0], picture + 2)
    frames = FrameSource.of(tmp_path, [p.name for p in paths], "x.toml").frames(["a", "b", "c"], "gray")
    np.testing.assert_array_equal(frames.stack(), [picture + 2, picture, picture + 1])
    np.testing.assert_array_equal(read_image(paths[2]), picture + 1)


def test_a_stack_is_no_single_picture(tmp_path: Path):
    np.save(tmp_path / "a.npy", GREY)
    with pytest.raises(FileError, match=r"a\.npy is a stack of 5 pictures, but one picture is needed here"):
        read_image(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", GREY[:1])
    np.testing.assert_array_equal(read_image(tmp_path / "a.npy"), GREY[0])


@pytest.mark.parametrize("kind", ["npy", *KINDS[2:]])
def test_one_picture_is_in_memory_at_a_time(tmp_path: Path, kind: str):
    stack = np.zeros((5, 400, 1000), np.uint8)
    held = open_stack(saved(tmp_path / f"a.{kind[:3]}", stack, kind))
    tracemalloc.start()
    try:
        for index in range(5):
            assert held.load(index).shape == (400, 1000)
        # The picture, and its values on their way from the archive.
        assert tracemalloc.get_traced_memory()[1] < 3.5 * 400_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (GREY.astype(np.float32), "holds float32 values: save pictures as uint8 or uint16"),
        (GREY > 99, "holds bool values"),
        (GREY.astype(np.int64), "holds int64 values"),
        (GREY.astype(np.uint32), "holds uint32 values"),
        (np.array([{"a": 1}, None], dtype=object), "holds object values"),
        (np.zeros(7, np.uint8), r"has the shape \(7,\): a picture has \(h, w\)"),
        (np.zeros((2, 6, 8, 4), np.uint8), r"has the shape \(2, 6, 8, 4\)"),
        (np.zeros((2, 6, 8, 3, 1), np.uint8), r"has the shape"),
        (np.zeros((), np.uint8), r"has the shape \(\)"),
        (np.zeros((0, 6, 8), np.uint8), r"is empty: it has the shape \(0, 6, 8\)"),
        (np.zeros((2, 6, 0), np.uint8), "is empty"),
    ],
)
def test_arrays_that_are_no_pictures(tmp_path: Path, array: np.ndarray, words: str):
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(FileError, match=rf"a\.npy {words}"):
        open_stack(tmp_path / "a.npy")
    np.savez(tmp_path / "a.npz", first=array)
    with pytest.raises(FileError, match=rf"a\.npz: first {words}"):
        open_stack(tmp_path / "a.npz")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.99])
@pytest.mark.parametrize("kind", KINDS)
def test_truncated_files(tmp_path: Path, kind: str, share: float):
    file = saved(tmp_path / f"cut.{kind[:3]}", DEEP, kind)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FileError, match=rf"cut\.{kind[:3]} .*truncated"):
        open_stack(file)


@pytest.mark.parametrize("kind", KINDS[1:])
def test_damage_inside_an_archive(tmp_path: Path, kind: str):
    file = saved(tmp_path / "a.npz", DEEP, kind)
    data = bytearray(file.read_bytes())
    place = data.index(b"NUMPY") if kind != KINDS[2] else 60
    data[place + 150 : place + 154] = b"\xff\x00\xff\x00"
    file.write_bytes(data)
    with pytest.raises(FileError, match=r"a\.npz: \w+ cannot be read as pictures of NumPy"):
        held = open_stack(file)
        for index in range(held.count):
            held.load(index)


@pytest.mark.parametrize("ending", ["npy", "npz"])
def test_files_of_another_kind(tmp_path: Path, ending: str):
    file = tmp_path / f"a.{ending}"
    zipped = io.BytesIO()
    with zipfile.ZipFile(zipped, "w") as archive:
        archive.writestr("notes.txt", "no array")
    for content in (b"", b"this is a text", pickle.dumps({"a": [1, 2]}), pickle.dumps(GREY), zipped.getvalue()):
        file.write_bytes(content)
        with pytest.raises(FileError, match=rf"a\.{ending}.* cannot be read as pictures of NumPy"):
            open_stack(file)
    file.unlink()
    with pytest.raises(FileError, match=rf"a\.{ending} cannot be read: No such file"):
        open_stack(file)


def test_a_damaged_head_is_one_sentence(tmp_path: Path):
    file = tmp_path / "b.npy"
    file.write_bytes(b"\x93NUMPY\x01\x00\x10\x00" + 15 * b"(" + b"\n")
    with pytest.raises(FileError, match=r"b\.npy cannot be read as pictures of NumPy"):
        open_stack(file)


def test_archives_that_are_no_stack(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w"):
        pass
    with pytest.raises(FileError, match=r"a\.npz is empty: it holds no array"):
        open_stack(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", one=GREY[0], more=GREY)
    with pytest.raises(FileError, match=r"a\.npz: more is a stack: in a file of several arrays each must be one"):
        open_stack(tmp_path / "a.npz")


def test_nothing_of_a_pickle_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Trap:
        def __reduce__(self):
            return exec, ("raise SystemExit('a pickle was read')",)

    np.save(tmp_path / "a.npy", np.array([Trap()], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", np.array([Trap()], dtype=object))
    (tmp_path / "b.npy").write_bytes(pickle.dumps(Trap()))
    for name in ("a.npy", "a.npz", "b.npy"):
        with pytest.raises(FileError, match=name):
            open_stack(tmp_path / name)


def test_pictures_of_one_archive_that_differ(tmp_path: Path):
    np.savez(tmp_path / "a.npz", *GREY[:2], COLOR[0], GREY[3], GREY[4])
    frames = FrameSource.of(tmp_path, "a.npz", "x.toml").frames(NAMES, "gray")
    with pytest.raises(
        FileError, match=r"a\.npz, picture 2 is 8 x 6 px colour 16-bit, but .*picture 0 is 8 x 6 px grey"
    ):
        frames[2]
