"""Pictures in NumPy's files, .npy and .npz: each is read when it is asked for, and a pickle never."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from tokenize import TokenError
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from slkit.data import Image
from slkit.errors import FileError

STACK_ENDINGS = (".npy", ".npz")


@dataclass(frozen=True, eq=False)
class Pictures:
    """The pictures of one file.

    count: how many. load: gives one of them, by its number from 0, and reads it at that moment. in_turn: whether to
    read them in any other order than theirs means to begin anew.
    """

    count: int
    load: Callable[[int], Image]
    in_turn: bool = False


def open_stack(path: Path) -> Pictures:
    """Return the pictures of a .npy or .npz file: (h, w) grey or (h, w, 3) RGB, uint8 or uint16.

    A .npy file holds one of them or a stack, (n, h, w) or (n, h, w, 3); a .npz file one array of these, or several
    that are one picture each, in the order in which they were stored.
    Errors: FileError naming a file that is absent, damaged, truncated or empty, or holds anything else.
    """
    return _open_npy(path) if path.suffix.lower() == ".npy" else _open_npz(path)


def read_only_picture(path: Path) -> Image:
    """Return the picture of a .npy or .npz file that holds one. Errors: FileError, also where it holds several."""
    held = open_stack(path)
    if held.count != 1:
        raise FileError(f"{path} is a stack of {held.count} pictures, but one picture is needed here")
    return held.load(0)


@dataclass(frozen=True)
class _Array:
    """What the head of a stored array says. start: where its values begin, in bytes. where: what to call it."""

    where: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran: bool
    start: int

    @classmethod
    def of(cls, file: IO[bytes], where: str, size: int) -> _Array:
        """Return the head of the array in a file of `size` bytes. Errors: FileError where it holds no pictures."""
        with _told(where):
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, dtype = read(file)
            array = cls(where, shape, dtype, fortran, file.tell())
        array.check(size)
        return array

    def check(self, size: int) -> None:
        """Refuse what is no picture, no stack of them, or longer than its file of `size` bytes."""
        if self.dtype.kind != "u" or self.dtype.itemsize > 2:
            raise FileError(f"{self.where} holds {self.dtype} values: save pictures as uint8 or uint16")
        if len(self.shape) not in (2, 3) and not (len(self.shape) == 4 and self.shape[3] == 3):
            raise FileError(
                f"{self.where} has the shape {self.shape}: a picture has (h, w) or, in colour, (h, w, 3), "
                "and a stack (n, h, w) or (n, h, w, 3)"
            )
        if min(self.shape) < 1:
            raise FileError(f"{self.where} is empty: it has the shape {self.shape}")
        if size < self.start + math.prod(self.shape) * self.dtype.itemsize:
            raise FileError(f"{self.where} is truncated: copy or save it again")

    @property
    def stacked(self) -> bool:
        """Whether it is a stack: no picture is 3 px wide, so that three columns are three colours."""
        return len(self.shape) == 4 or (len(self.shape) == 3 and self.shape[2] != 3)


def _open_npy(path: Path) -> Pictures:
    with _told(str(path)), path.open("rb") as file:
        array = _Array.of(file, str(path), path.stat().st_size)

    def load(index: int) -> Image:
        # Mapped anew for each picture, so that what was read before does not count as memory of this process.
        with _told(str(path)):
            order = "F" if array.fortran else "C"
            mapped = np.memmap(path, array.dtype, "r", array.start, array.shape, order)
            return _held(mapped[index] if array.stacked else mapped)

    return Pictures(array.shape[0] if array.stacked else 1, load)


def _open_npz(path: Path) -> Pictures:
    arrays: dict[str, _Array] = {}
    with _told(str(path)), zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            with archive.open(info) as member:
                arrays[info.filename] = _Array.of(member, _named(path, info.filename), info.file_size)
    if not arrays:
        raise FileError(f"{path} is empty: it holds no array")
    stacks = [array for array in arrays.values() if array.stacked]
    if not stacks:
        names = list(arrays)
        return Pictures(len(names), lambda index: _read_member(path, names[index]))
    if len(arrays) > 1:
        raise FileError(f"{stacks[0].where} is a stack: in a file of several arrays each must be one picture")
    if stacks[0].fortran:
        raise FileError(f"{stacks[0].where} is in Fortran order: save numpy.ascontiguousarray of it")
    return Pictures(stacks[0].shape[0], _Member(path, next(iter(arrays)), stacks[0]).load, in_turn=True)


def _read_member(path: Path, name: str) -> Image:
    with _told(_named(path, name)), zipfile.ZipFile(path) as archive, archive.open(name) as member:
        return _held(np.lib.format.read_array(member, allow_pickle=False))


class _Member:
    """A stack in an archive, which can only be unpacked from its beginning on."""

    def __init__(self, path: Path, name: str, array: _Array) -> None:
        self._path, self._name, self._array, self._lock = path, name, array, Lock()
        self._member: IO[bytes] | None = None

    def load(self, index: int) -> Image:
        shape = self._array.shape[1:]
        size = math.prod(shape) * self._array.dtype.itemsize
        with self._lock, _told(self._array.where):
            if self._member is None:
                self._member = zipfile.ZipFile(self._path).open(self._name)
            self._member.seek(self._array.start + index * size)
            return _held(np.frombuffer(self._member.read(size), self._array.dtype).reshape(shape))


def _held(array: npt.NDArray[Any]) -> Image:
    """Return a copy in memory, in this machine's order of bytes."""
    return np.array(array, array.dtype.newbyteorder("="), order="C")


def _named(path: Path, member: str) -> str:
    return f"{path}: {member.removesuffix('.npy')}"


@contextmanager
def _told(where: str) -> Generator[None]:
    """Turn what NumPy and zipfile raise into one sentence."""
    try:
        yield
    except OSError as error:
        raise FileError(f"{where} cannot be read: {error.strerror or error}") from error
    # Encrypted members are a RuntimeError, a damaged head can be a SyntaxError or TokenError.
    except (ValueError, EOFError, RuntimeError, SyntaxError, TokenError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(
            f"{where} cannot be read as pictures of NumPy: it is empty, damaged, truncated, or something else"
        ) from error
