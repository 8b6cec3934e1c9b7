"""The same pictures through every format that keeps them give the same cloud; those that do not are told of."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from slkit import pipeline
from slkit.errors import FileError
from slkit.files import read_image, read_sequence, write_png
from slkit.geometry import Rig
from slkit.simulation import Optics

Pictures = Sequence[np.ndarray]


def as_files(ending: str) -> Callable[[Path, Pictures], str]:
    """Return a function that writes one picture a file and returns what `frames` in capture.toml is to say."""

    def write(folder: Path, pictures: Pictures) -> str:
        for number, picture in enumerate(pictures):
            file = str(folder / f"{number}.{ending}")
            if ending == "npy":
                np.save(file, picture)
            else:
                assert cv2.imwrite(file, picture[..., ::-1] if picture.ndim == 3 else picture)
        return f"*.{ending}"

    return write


def as_stack(folder: Path, pictures: Pictures) -> str:
    np.save(folder / "stack.npy", np.stack(pictures))
    return "stack.npy"


def as_archive(folder: Path, pictures: Pictures) -> str:
    np.savez_compressed(folder / "stack.npz", np.stack(pictures))
    return "stack.npz"


def as_arrays(folder: Path, pictures: Pictures) -> str:
    np.savez(folder / "stack.npz", *pictures)
    return "stack.npz"


def as_video(code: str, ending: str = "avi") -> Callable[[Path, Pictures], str]:
    """Return a function that writes a video and returns its name."""

    def write(folder: Path, pictures: Pictures) -> str:
        height, width = pictures[0].shape[:2]
        settings = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(pictures[0].ndim == 3)]
        settings += [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U] if pictures[0].dtype == np.uint16 else []
        file = str(folder / f"video.{ending}")
        writer = cv2.VideoWriter(file, cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), 25, (width, height), settings)
        for picture in pictures:
            writer.write(picture[..., ::-1] if picture.ndim == 3 else picture)
        writer.release()
        return f"video.{ending}"

    return write


DEPTHS = {"8-bit": np.uint8, "16-bit": np.uint16}
GREY = {e: as_files(e) for e in ("tif", "bmp", "pgm", "npy")}
COLOR = {e: as_files(e) for e in ("tif", "bmp", "ppm", "npy")}
SEVERAL = {"stack": as_stack, "archive": as_archive, "arrays": as_arrays, "ffv1": as_video("FFV1", "mkv")}
SHALLOW = ("bmp",)


def recorded(folder: Path, scan: Path, frames: str | None) -> Path:
    """Put the capture.toml of a scan into a folder. frames: what it is to say of them."""
    text = "\n".join(line for line in (scan / "capture.toml").read_text().splitlines() if not line.startswith("frames"))
    (folder / "capture.toml").write_text(f'frames = "{frames}"\n{text}' if frames else text)
    return folder


def same(one: pipeline.ScanResult, other: pipeline.ScanResult) -> None:
    """Compare every number of two scans."""
    for kind in ("correspondences", "cloud"):
        mine, theirs = getattr(one, kind), getattr(other, kind)
        for field in fields(mine):
            np.testing.assert_array_equal(getattr(mine, field.name), getattr(theirs, field.name))
    assert one.removed == other.removed and len(one.cloud) > 500


@pytest.fixture(scope="module")
def scans(gray_scan: Path, small_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Scan folders of two codecs: one that reads its frames in their order, and one that jumps."""
    folder = tmp_path_factory.mktemp("phase_scan")
    optics = Optics(read_noise=0.5, shot_noise=0.0)
    pipeline.simulate_scan(folder, small_rig, "sphere", ["phase-shift"], optics=optics, seed=3)
    return {"gray": gray_scan, "phase-shift": folder}


@pytest.fixture(scope="module")
def wanted(scans: dict[str, Path], small_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Return a function that gives a scan's pictures, of a depth and kind, and what they give as PNG."""
    known: dict[tuple[str, str, bool], tuple[Path, list[np.ndarray], pipeline.ScanResult]] = {}

    def get(codec: str, depth: str, color: bool) -> tuple[Path, list[np.ndarray], pipeline.ScanResult]:
        if (codec, depth, color) not in known:
            scan, top = scans[codec], np.iinfo(DEPTHS[depth]).max
            pictures = [read_image(file) * (top / 255) for file in sorted(scan.glob("0*.png"))]
            if color:
                pictures = [np.dstack([p, 0.9 * p, 0.7 * p]) for p in pictures]
            pictures = [np.rint(p).astype(DEPTHS[depth]) for p in pictures]
            folder = tmp_path_factory.mktemp("png")
            for number, picture in enumerate(pictures):
                write_png(folder / f"{number}.png", picture)
            recorded(folder, scan, None)
            known[codec, depth, color] = scan, pictures, pipeline.scan(folder, small_rig)
        return known[codec, depth, color]

    return get


@pytest.mark.parametrize(
    ("depth", "color", "form", "write"),
    [
        (depth, color, form, write)
        for depth in DEPTHS
        for color in (False, True)
        for form, write in ((COLOR if color else GREY) | SEVERAL).items()
        # These hold 8 bits only: BMP by its nature, colour videos by OpenCV's.
        if depth == "8-bit" or not (form in SHALLOW or (form == "ffv1" and color))
    ],
)
@pytest.mark.parametrize("codec", ["gray", "phase-shift"])
def test_the_same_cloud_through_every_format(
    wanted: Any, small_rig: Rig, tmp_path: Path, codec: str, depth: str, color: bool, form: str, write: Any
):
    scan, pictures, expected = wanted(codec, depth, color)
    found = pipeline.scan(recorded(tmp_path, scan, write(tmp_path, pictures)), small_rig)
    same(found, expected)
    assert found.notes == ()


@pytest.mark.parametrize("write", SEVERAL.values())
def test_one_file_and_no_pictures_need_no_name(wanted: Any, small_rig: Rig, tmp_path: Path, write: Any):
    scan, pictures, expected = wanted("gray", "8-bit", False)
    name = write(tmp_path, pictures)
    same(pipeline.scan(recorded(tmp_path, scan, None), small_rig), expected)
    same(pipeline.scan(tmp_path / name, small_rig), expected)
    shutil.copy(tmp_path / name, tmp_path / f"second.{name[-3:]}")
    with pytest.raises(
        FileError, match="has 0 pictures, but gray needs .* has to be named as `frames` where there are"
    ):
        pipeline.scan(tmp_path, small_rig)
    (tmp_path / f"second.{name[-3:]}").unlink()
    # Pictures go before a stack.
    write_png(tmp_path / "0.png", pictures[0])
    with pytest.raises(FileError, match="has 1 pictures, but gray needs"):
        pipeline.scan(tmp_path, small_rig)


def test_roles_in_different_formats(wanted: Any, small_rig: Rig, tmp_path: Path):
    scan, pictures, expected = wanted("gray", "8-bit", False)
    np.save(tmp_path / "white.npy", pictures[0])
    write_png(tmp_path / "black.png", pictures[1])
    as_video("FFV1")(tmp_path, pictures[2:])
    folder = recorded(tmp_path, scan, None)
    text = (folder / "capture.toml").read_text()
    roles = 'frames = {white = "white.npy", black = ["black.png"], x = "video.avi"}\n'
    (folder / "capture.toml").write_text(roles + text)
    same(pipeline.scan(folder, small_rig), expected)
    np.save(tmp_path / "white.npy", np.stack(pictures[:2]))
    with pytest.raises(FileError, match=r"white\.npy has 2 white pictures, but gray needs 1"):
        pipeline.scan(folder, small_rig)


@pytest.mark.parametrize("write", SEVERAL.values())
@pytest.mark.parametrize("change", [-1, 1])
def test_another_number_of_pictures(wanted: Any, small_rig: Rig, tmp_path: Path, write: Any, change: int):
    scan, pictures, _ = wanted("gray", "8-bit", False)
    name = write(tmp_path, pictures[:-1] if change < 0 else [*pictures, pictures[0]])
    count = len(pictures)
    with pytest.raises(FileError, match=rf"{name} has {count + change} pictures, but gray needs {count}: needed are"):
        pipeline.scan(recorded(tmp_path, scan, name), small_rig)


def test_a_sequence_from_a_stack(wanted: Any, small_rig: Rig, tmp_path: Path):
    scan, pictures, expected = wanted("gray", "8-bit", False)
    for number, write in enumerate(SEVERAL.values()):
        folder = tmp_path / f"{number}"
        folder.mkdir()
        name = write(folder, [*pictures, *pictures])
        recorded(folder, scan, name)
        assert read_sequence(folder).count == (None if name.startswith("video") else 2 * len(pictures))
        result = pipeline.scan_sequence(
            folder, small_rig, tmp_path / f"{number}_clouds", filters=pipeline.make_filters()
        )
        assert (result.scans, result.clouds, result.points) == (2, 2, 2 * len(expected.cloud))
        assert result.notes == ()


def test_loss_is_told_once_a_capture(wanted: Any, small_rig: Rig, tmp_path: Path):
    scan, pictures, _ = wanted("gray", "8-bit", False)
    folder = recorded(tmp_path, scan, as_files("jpg")(tmp_path, pictures))
    count = len(pictures)
    (note,) = pipeline.scan(folder, small_rig).notes
    assert note.startswith(f"{tmp_path}: {count} of {count} pictures are JPEG, which changes grey levels and blurs")
    recorded(tmp_path, scan, as_video("MJPG")(tmp_path, pictures))
    (note,) = pipeline.scan(folder, small_rig).notes
    assert "video.avi is compressed with loss (MJPG)" in note
    assert pipeline.scan_sequence(folder, small_rig, tmp_path / "clouds").notes == (note,)
