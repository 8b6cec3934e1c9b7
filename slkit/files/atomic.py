"""Files appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from pathlib import Path

from slkit.errors import FileError
from slkit.protocols import FileContent


def write_bytes(path: str | Path, data: FileContent) -> None:
    """Write a file, given whole or part by part, so that a process killed at any moment leaves it whole or as before.

    A temporary file beside the target is flushed to the disk and renamed; missing folders are made.
    Errors: FileError where the file cannot be written; the temporary file is then removed.
    """
    path = Path(path)
    make_folder(path.parent)
    # The ending keeps what a killed process leaves behind out of every glob for pictures.
    temporary = path.parent / f".{path.name}.{secrets.token_hex(6)}.part"
    try:
        try:
            with open(temporary, "xb") as file:
                file.writelines(parts_of(data))
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _sync_folder(path.parent)
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror or error}") from error


def parts_of(data: FileContent) -> Iterable[bytes | bytearray | memoryview]:
    """Return the content of a file part by part; what is whole is one part."""
    return [data] if isinstance(data, (bytes, bytearray, memoryview)) else data


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file as `write_bytes` does. Errors: FileError where it cannot be written."""
    write_bytes(path, text.encode("utf-8"))


def make_folder(path: str | Path) -> Path:
    """Return the folder, made with its parents where it is missing. Errors: FileError where that is impossible."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"the folder {path} cannot be made: {error.strerror or error}") from error
    return path


def _sync_folder(folder: Path) -> None:
    """Make the rename itself last; systems that cannot open a folder for reading do without."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError:
        return
    finally:
        os.close(descriptor)
