"""Files and folders wherever fsspec reaches: this disk, an object store, another machine, memory."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from slkit import files
from slkit.errors import FileError, InputError
from slkit.files import parts_of, read_bytes, write_bytes
from slkit.geometry import Rig
from slkit.protocols import FileContent

# What is put there appears whole or not at all.
_OBJECT_STORES = {"abfs", "az", "gcs", "gs", "memory", "s3", "s3a"}


@dataclass(frozen=True)
class Place:
    """A file or a folder. system: fsspec's file system; path: its path there; local: the same on this disk, or None."""

    system: Any
    path: str
    local: Path | None

    @classmethod
    def at(cls, url: str) -> Place:
        """Return the place that a URL or a plain path means.

        Errors: InputError for an unknown protocol; FileError where the package for it is not installed, or where the
        file system cannot be reached.
        """
        from fsspec.core import url_to_fs
        from fsspec.implementations.local import LocalFileSystem

        try:
            system, path = cast("tuple[Any, str]", url_to_fs(url))
        except ImportError as error:
            raise FileError(f"{url} cannot be reached: {_missing_package(url, error)}") from error
        except ValueError as error:
            raise InputError(f"{url} is no place that can be reached: {error}") from error
        # Every store has errors of its own: credentials, regions, networks.
        except Exception as error:
            raise FileError(f"{url} cannot be reached: {type(error).__name__}: {error}") from error
        return cls(system, path, Path(path) if isinstance(system, LocalFileSystem) else None)

    @property
    def url(self) -> str:
        """The place as text that `at` understands, on this machine and on another."""
        return str(self.local) if self.local is not None else str(self.system.unstrip_protocol(self.path))

    def child(self, name: str) -> Place:
        """Return the place of a file or folder below, whose parts are separated by "/"."""
        local = None if self.local is None else self.local / name
        return Place(self.system, f"{self.path.rstrip('/')}/{name}", local)

    def exists(self) -> bool:
        """Whether there is such a file or folder. Errors: FileError where that cannot be told."""
        with _told(self.url, "reached"):
            return bool(self.system.exists(self.path))

    def read(self) -> bytes:
        """Return the content of a file. Errors: FileError where it cannot be read."""
        if self.local is not None:
            return read_bytes(self.local)
        with _told(self.url, "read"):
            return cast("bytes", self.system.cat_file(self.path))

    def write(self, data: FileContent) -> None:
        """Write a file that appears whole or not at all. Errors: FileError where it cannot be written."""
        if self.local is not None:
            write_bytes(self.local, data)
            return
        # Outside: an error of what gives the parts is not one of writing.
        data = b"".join(parts_of(data))
        with _told(self.url, "written"):
            if _OBJECT_STORES & set(_protocols(self.system)):
                self.system.pipe_file(self.path, data)
                return
            folder, _, name = self.path.rpartition("/")
            temporary = f"{folder}/.{name}.{secrets.token_hex(6)}.part"
            self.system.makedirs(folder, exist_ok=True)
            self.system.pipe_file(temporary, data)
            self.system.mv(temporary, self.path)

    @contextmanager
    def as_folder(self) -> Generator[Path]:
        """Give a folder's path on this disk; one that lies elsewhere is fetched, and removed at the end.

        Errors: FileError where it cannot be fetched.
        """
        if self.local is not None:
            yield self.local
            return
        with tempfile.TemporaryDirectory(prefix="slkit-") as parent:
            # An empty folder, or none, is fetched as nothing.
            folder = Path(parent) / "capture"
            folder.mkdir()
            with _told(self.url, "fetched"):
                self.system.get(f"{self.path.rstrip('/')}/", f"{folder}/", recursive=True)
            yield folder

    def sweep(self) -> None:
        """Remove what killed processes left of unfinished writes below this folder; none may be under way."""
        if self.local is not None:
            for part in self.local.rglob(".*.part"):
                part.unlink(missing_ok=True)


def read_rig(url: str) -> Rig:
    """Return the rig of a path or URL. Errors: as `files.read_rig`; FileError where it cannot be fetched."""
    place = Place.at(url)
    if place.local is not None:
        return files.read_rig(place.local)
    with tempfile.TemporaryDirectory(prefix="slkit-") as folder:
        copy = Path(folder) / "rig.json"
        copy.write_bytes(place.read())
        try:
            return files.read_rig(copy)
        except FileError as error:
            raise FileError(str(error).replace(str(copy), url)) from error


def _protocols(system: Any) -> tuple[str, ...]:
    protocol: str | tuple[str, ...] = system.protocol
    return (protocol,) if isinstance(protocol, str) else tuple(protocol)


def _missing_package(url: str, error: ImportError) -> str:
    from fsspec.registry import known_implementations

    protocol = url.partition("://")[0]
    package = known_implementations.get(protocol, {}).get("class", "fsspec").partition(".")[0]
    return str(error) if package == "fsspec" else f"{protocol}:// needs the package {package}: pip install {package}"


@contextmanager
def _told(url: str, done: str) -> Generator[None]:
    """Turn whatever a file system raises into one sentence."""
    try:
        yield
    except FileError:
        raise
    except FileNotFoundError as error:
        raise FileError(f"{url} cannot be {done}: it does not exist") from error
    # Every store has errors of its own: credentials, regions, networks.
    except Exception as error:
        raise FileError(f"{url} cannot be {done}: {type(error).__name__}: {error}") from error
