import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from slkit.errors import FileError
from slkit.files import make_folder, write_bytes, write_text

_WRITER = """
import sys
from slkit.files.atomic import write_bytes
path, sizes = sys.argv[1], (3_000_000, 5_000_000)
print("ready", flush=True)
for turn in range(10_000):
    write_bytes(path, bytes([turn % 251]) * sizes[turn % 2])
"""


def test_content_and_parents(tmp_path: Path):
    write_bytes(tmp_path / "a" / "b.bin", b"one")
    write_bytes(tmp_path / "a" / "b.bin", b"two")
    write_text(tmp_path / "c.txt", "Gühring\n")
    assert (tmp_path / "a" / "b.bin").read_bytes() == b"two"
    assert (tmp_path / "c.txt").read_text(encoding="utf-8") == "Gühring\n"
    assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == ["b.bin", "c.txt"]


def test_mode_follows_umask(tmp_path: Path):
    write_bytes(tmp_path / "x", b"")
    umask = os.umask(0)
    os.umask(umask)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o666 & ~umask


def test_failed_rename_leaves_nothing(tmp_path: Path):
    (tmp_path / "folder" / "inside").mkdir(parents=True)
    with pytest.raises(FileError, match="folder cannot be written"):
        write_bytes(tmp_path / "folder", b"data")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_bytes(tmp_path / "x", b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError, match="No space left"):
        write_bytes(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["x"]


def test_folder_below_a_file(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be made"):
        make_folder(tmp_path / "file" / "below")
    with pytest.raises(FileError, match="cannot be made"):
        write_bytes(tmp_path / "file" / "x.bin", b"")


def test_killed_at_any_moment_a_file_is_whole_or_absent(tmp_path: Path):
    chance, seen = random.Random(1), 0
    for turn in range(12):
        target = tmp_path / f"{turn}.bin"
        writer = subprocess.Popen([sys.executable, "-c", _WRITER, str(target)], stdout=subprocess.PIPE)
        assert writer.stdout is not None and writer.stdout.readline() == b"ready\n"
        # Half of the kills fall into the first write, the others somewhere in a row of overwrites.
        time.sleep(chance.uniform(0, 0.01 if turn % 2 else 0.1))
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        if target.exists():
            seen += 1
            data = target.read_bytes()
            assert len(data) in (3_000_000, 5_000_000)
            assert data == data[:1] * len(data)
    assert seen > 0
