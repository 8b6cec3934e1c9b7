"""From a folder of pictures and a rig to a cloud, and from a cloud to a file or a picture."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import registry
from slkit.data import Correspondences, Frames, Image, PointCloud
from slkit.errors import DecodeError, FileError, InputError, SlkitError
from slkit.files import Progress, merged, read_bytes, read_capture, reading_ahead, write_bytes, write_png
from slkit.geometry import Rig, homogeneous
from slkit.pipeline._patterns import load_codec
from slkit.protocols import Bounds, Codec

_DEPTH_SAMPLES = 9


@dataclass(frozen=True, eq=False)
class ScanResult:
    """A scan and its evidence.

    seconds: per stage; reading counts as far as decoding had to wait for it. removed: per filter, how many points it
    took. notes: sentences about the pictures, empty where there is nothing to tell.
    """

    cloud: PointCloud
    correspondences: Correspondences
    seconds: Mapping[str, float]
    removed: Mapping[str, int]
    notes: tuple[str, ...] = ()


def scan(
    folder: str | Path,
    rig: Rig,
    parameters: Mapping[str, Any] | None = None,
    depth: tuple[float, float] | None = None,
    filters: Any = None,
    normals: bool = False,
    progress: Progress | None = None,
) -> ScanResult:
    """Return the cloud, in the camera frame, of a folder with a capture.toml and the pictures, a stack or a video.

    parameters: fields of the codec, before what capture.toml says. depth: nearest and farthest depth in mm.
    filters: a `triangulation.Filters`, default all. normals: estimate them.
    Errors: FileError or InputError naming file and key; InputError where the rig belongs to another camera or
    projector; DecodeError where no point is found. They carry the notes on the pictures as their `__notes__`.
    """
    from slkit.triangulation import Filters, triangulate, with_normals

    found = read_capture(folder)
    given = merged(found.parameters, parameters or {})
    codec = with_rig_colors(load_codec(found.codec, found.projector, given, str(found.file)), rig)
    names = codec.encode().names
    notes = found.notes(names)
    with _noted(notes):
        with reading_ahead(found.frames(names)) as ahead:
            frames, waiting = _watched(ahead, progress)
            check_rig(rig, codec, frames[0], str(folder))
            limits = None if depth is None else bounds(rig, depth)
            started = time.perf_counter()
            correspondences = _decode(codec, frames, limits, str(folder))
        decoded = time.perf_counter()
        cloud, removed = triangulate(correspondences, rig), {}
        if len(cloud):
            cloud, removed = (filters or Filters()).apply(cloud, depth)
        if not len(cloud):
            raise DecodeError(_nothing_found(len(correspondences), str(folder)))
    cloud = with_normals(cloud) if normals else cloud
    finished = time.perf_counter()
    read = sum(waiting)
    seconds = {
        "read": read,
        "decode": max(decoded - started - sum(waiting[1:]), 0.0),
        "triangulate": finished - decoded,
    }
    return ScanResult(cloud, correspondences, seconds, dict(removed), notes)


def bounds(rig: Rig, depth: tuple[float, float]) -> Bounds:
    """Return for every camera pixel the projector columns and rows that a depth range in mm allows, (h, w, 4).

    Smallest and largest column, smallest and largest row, px; NaN where the range lies outside the projector image.
    Errors: InputError unless 0 < nearest < farthest.
    """
    check_depth(depth)
    near, far = depth
    rays = homogeneous(rig.camera.normalize(_pixels(rig.camera.size)))
    low = np.full((*rays.shape[:2], 2), np.inf)
    high = -low
    # Even steps of inverse depth are even steps along the ray's picture; the lens bends it, hence not only its ends.
    for inverse in np.linspace(1 / far, 1 / near, _DEPTH_SAMPLES):
        xy = rig.to_projector(rays / inverse)
        low, high = np.fmin(low, xy), np.fmax(high, xy)
    size = np.array(rig.projector.size)
    outside = ((high < -0.5) | (low > size - 0.5) | ~np.isfinite(low) | ~np.isfinite(high)).any(axis=-1)
    result = np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=-1).astype(np.float32)
    result[outside] = np.nan
    return result


def check_depth(depth: tuple[float, float] | None) -> None:
    """Refuse a range of depths in mm that is none. Errors: InputError unless 0 < nearest < farthest."""
    if depth is not None and not 0 < depth[0] < depth[1] < np.inf:
        raise InputError(f"depth must be two lengths in mm, the nearer first, not {depth[0]:g} and {depth[1]:g}")


def make_filters(off: Sequence[str] = ()) -> Any:
    """Return the filters of a scan without those named in `off`. Errors: InputError listing the names."""
    from slkit.triangulation import Filters

    switches = [f.name for f in dataclasses.fields(Filters) if isinstance(f.default, bool)]
    for name in off:
        if name not in switches:
            raise InputError(f"there is no filter called {name!r}; there are: {', '.join(switches)}")
    return Filters(**dict.fromkeys(off, False))


def exporter(path: str | Path) -> Any:
    """Return the exporter for a file's ending. Errors: PluginError listing the endings that are installed."""
    return registry.load("slkit.exporters", Path(path).suffix.lower().removeprefix("."))


def write_cloud(path: str | Path, cloud: PointCloud) -> None:
    """Write a cloud, in mm, in the format of the file's ending, atomically.

    Errors: PluginError for an unknown ending, FileError where the file cannot be written.
    """
    write_bytes(path, exporter(path)(cloud))


def view(cloud_file: str | Path, picture: str | Path) -> None:
    """Draw a PLY file into a PNG. Errors: FileError where one cannot be read or the other not be written."""
    from slkit.export import read_ply
    from slkit.report.figures import draw_cloud

    if Path(picture).suffix.lower() != ".png":
        raise InputError(f"{picture}: a picture is written as PNG, name it so")
    data = read_bytes(cloud_file)
    try:
        cloud = read_ply(data)
    except FileError as error:
        raise FileError(f"{cloud_file}: {error}") from error
    write_png(picture, draw_cloud(cloud))


@contextmanager
def _noted(notes: Sequence[str]) -> Generator[None]:
    """Add what is to be told of the pictures to an error: it may be why they cannot be decoded."""
    try:
        yield
    except SlkitError as error:
        for note in notes:
            error.add_note(note)
        raise


def _decode(codec: Codec, frames: Frames, limits: Bounds | None, folder: str) -> Correspondences:
    try:
        return codec.decode(frames, limits)
    except DecodeError as error:
        raise DecodeError(f"{folder}: {error}") from error


def _watched(frames: Frames, progress: Progress | None) -> tuple[Frames, list[float]]:
    """Return frames that note the seconds of each load and report it."""
    seconds: list[float] = []

    def load(index: int) -> Image:
        started = time.perf_counter()
        image = frames[index]
        seconds.append(time.perf_counter() - started)
        if progress is not None:
            progress("decode", min(len(seconds), len(frames)), len(frames))
        return image

    return Frames(frames.names, load), seconds


def with_rig_colors(codec: Any, rig: Rig) -> Any:
    """Return the codec with the rig's `photometry`, where it asks for one and has none of its own."""
    if rig.photometry is None or getattr(codec, "photometry", ...) is not None:
        return codec
    return dataclasses.replace(codec, photometry=rig.photometry)


def check_rig(rig: Rig, codec: Any, picture: Image, folder: str) -> None:
    """Refuse a rig of other devices: its cloud would look right and be wrong.

    Errors: InputError where the picture's size or the codec's projector is not the rig's.
    """
    size = (picture.shape[1], picture.shape[0])
    for name, has, wants in (("camera", size, rig.camera.size), ("projector", codec.projector, rig.projector.size)):
        if tuple(has) != wants:
            raise InputError(
                f"the rig is for a {name} of {wants[0]} x {wants[1]} px, but {folder} was taken with {has[0]} x "
                f"{has[1]} px: use the rig that was calibrated with these devices"
            )


def _nothing_found(matches: int, folder: str) -> str:
    if matches:
        return f"{folder}: none of {matches} decoded positions gives a point: is it this rig, and this depth range?"
    return f"{folder}: nothing is decoded: are these the pictures of this codec, in display order?"


def _pixels(size: tuple[int, int]) -> npt.NDArray[np.int64]:
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)
