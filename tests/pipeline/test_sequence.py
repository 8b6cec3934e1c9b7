import shutil
from pathlib import Path

import numpy as np
import pytest

from slkit import pipeline
from slkit.codecs.gray import Gray
from slkit.errors import DecodeError, FileError
from slkit.export import read_ply
from slkit.files import write_png
from slkit.geometry import Rig
from slkit.pipeline import _sequence
from slkit.simulation import paper_rig


@pytest.fixture(scope="module")
def moving(gray_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scans with the same pictures, one after the other, and one picture too many."""
    folder = tmp_path_factory.mktemp("moving")
    frames = sorted(gray_scan.glob("0*.png"))
    for number in range(3 * len(frames) + 1):
        shutil.copy(frames[number % len(frames)], folder / f"{number:03d}.png")
    shutil.copy(gray_scan / "capture.toml", folder)
    return folder


def test_every_set_of_pictures_gives_the_cloud_of_a_scan(moving: Path, gray_scan: Path, small_rig: Rig, tmp_path: Path):
    told: list[tuple[str, int, int]] = []
    result = pipeline.scan_sequence(
        moving, small_rig, tmp_path / "clouds", depth=(300, 3000), progress=lambda *step: told.append(step)
    )
    alone = pipeline.scan(gray_scan, small_rig, depth=(300, 3000), filters=pipeline.make_filters(["isolated"]))
    files = sorted((tmp_path / "clouds").iterdir())
    assert [f.name for f in files] == ["000000.ply", "000001.ply", "000002.ply"]
    for file in files:
        np.testing.assert_array_equal(read_ply(file.read_bytes()).xyz, alone.cloud.xyz)
    assert (result.scans, result.clouds, result.points) == (3, 3, 3 * len(alone.cloud))
    assert result.first_failure == "" and result.seconds > 0
    assert told == [("scan", n, 3) for n in (1, 2, 3)]


def test_a_bad_picture_costs_its_own_cloud_only(moving: Path, gray_scan: Path, small_rig: Rig, tmp_path: Path):
    folder = shutil.copytree(moving, tmp_path / "moving")
    count = len(list(gray_scan.glob("0*.png")))
    (folder / f"{count + 1:03d}.png").write_bytes(b"torn")
    result = pipeline.scan_sequence(folder, small_rig, tmp_path / "clouds")
    assert (result.scans, result.clouds) == (3, 2)
    assert result.first_failure.startswith("000001: ") and f"{count + 1:03d}.png" in result.first_failure
    assert not list((tmp_path / "clouds").glob("000001*"))


def test_an_unreadable_first_picture_and_one_of_another_camera(
    moving: Path, gray_scan: Path, small_rig: Rig, tmp_path: Path
):
    folder = shutil.copytree(moving, tmp_path / "moving")
    count = len(list(gray_scan.glob("0*.png")))
    (folder / "000.png").write_bytes(b"torn")
    for number in range(count, 2 * count):
        write_png(folder / f"{number:03d}.png", np.zeros((100, 120), np.uint8))
    result = pipeline.scan_sequence(folder, small_rig, tmp_path / "clouds")
    assert (result.scans, result.clouds) == (3, 1)
    assert [f.name for f in (tmp_path / "clouds").iterdir()] == ["000002.ply"]


def test_refusals(moving: Path, small_rig: Rig, tmp_path: Path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "000007.ply").write_bytes(b"")
    with pytest.raises(FileError, match=r"already holds clouds \(000007.ply\)"):
        pipeline.scan_sequence(moving, small_rig, tmp_path / "old")
    with pytest.raises(DecodeError, match="no cloud from 3 scans: .*the rig is for a camera of 768 x 576"):
        pipeline.scan_sequence(moving, paper_rig(), tmp_path / "new")
    dark = tmp_path / "dark"
    dark.mkdir()
    shutil.copy(moving / "capture.toml", dark)
    with pytest.raises(FileError, match="no pictures"):
        pipeline.scan_sequence(dark, small_rig, tmp_path / "new")
    write_png(dark / "0.png", np.zeros((144, 192), np.uint8))
    with pytest.raises(DecodeError, match="too few pictures for one"):
        pipeline.scan_sequence(dark, small_rig, tmp_path / "new")


def test_memory_does_not_grow(small_rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """However long the sequence, no more pictures are held than are being worked on."""
    held, most = 0, 0

    class Picture:
        def __del__(self) -> None:
            nonlocal held
            held -= 1

    def loads():
        nonlocal held, most
        for _ in range(400):
            held += 1
            most = max(most, held)
            kept = Picture()
            yield [lambda kept=kept: np.zeros((144, 192), np.uint8)]

    monkeypatch.setattr(_sequence._Scan, "write", lambda _self, index, _loads, _limits: index)
    scan = _sequence._Scan(Gray(small_rig.projector.size), ("one",), small_rig, None, None, tmp_path, "here")
    assert sum(1 for _ in _sequence._in_order(loads(), scan)) == 400
    assert most < 20
