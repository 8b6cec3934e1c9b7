import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import fsspec
import pytest
from distributed import LocalCluster

from slkit import jobs, pipeline
from slkit.export import read_ply
from slkit.files import write_rig
from slkit.geometry import Rig


@pytest.fixture
def rig_file(tiny_rig: Rig, tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", tiny_rig)
    return tmp_path / "rig.json"


@pytest.fixture
def command(tiny_captures: Callable[..., None], rig_file: Path, tmp_path: Path) -> tuple[object, ...]:
    """A batch of four captures, the third of which lacks a picture."""
    tiny_captures(tmp_path / "captures", "a", "b", "c", "d")
    sorted((tmp_path / "captures" / "c").glob("*.png"))[4].unlink()
    return ("batch", tmp_path / "captures" / "*", "--rig", rig_file, "-o", tmp_path / "clouds", "--workers", 1)


def lines(tmp_path: Path) -> list[dict]:
    return [json.loads(line) for line in (tmp_path / "clouds" / "batch.jsonl").read_bytes().splitlines()]


def test_some_fail(slkit, command: tuple[object, ...], tmp_path: Path):
    outcome = slkit(*command)
    assert (outcome.code, outcome.err) == (3, "")
    for words in ("captures a second", " c ", "missing 004_", f"clouds and batch.jsonl: {tmp_path / 'clouds'}"):
        assert words in outcome.out
    assert {f.name for f in (tmp_path / "clouds").iterdir()} == {"a.ply", "b.ply", "d.ply", "batch.jsonl"}
    before = (tmp_path / "clouds" / "batch.jsonl").read_bytes()
    refused = slkit(*command)
    assert (refused.code, refused.out) == (2, "") and "go on with --resume" in refused.err
    assert (tmp_path / "clouds" / "batch.jsonl").read_bytes() == before

    again = slkit(*command, "--resume", "--json")
    assert again.code == 3
    table = again.json
    assert {n: table[n] for n in ("captures", "scanned", "unchanged", "points")} == {
        "captures": 4,
        "scanned": 0,
        "unchanged": 3,
        "points": 0,
    }
    assert [failure["capture"] for failure in table["failures"]] == ["c"]
    assert set(table) == {
        "captures",
        "scanned",
        "unchanged",
        "failures",
        "noted",
        "points",
        "seconds",
        "captures_per_second",
        "folder",
    }
    assert "missing 004_" in table["failures"][0]["error"]


def test_jpeg_pictures_are_told_of(slkit, command: tuple[object, ...], tmp_path: Path, to_jpeg):
    folder = tmp_path / "captures" / "b"
    count = to_jpeg(folder)
    good = ("batch", *(tmp_path / "captures" / name for name in "ab"), *command[2:])
    note = f"{folder}: {count} of {count} pictures are JPEG, which changes grey levels and blurs edges"
    outcome = slkit(*good)
    assert outcome.code == 0 and outcome.out.count(f"note: {note}") == outcome.out.count("are JPEG") == 1
    assert [len(line["notes"]) for line in lines(tmp_path)] == [0, 1]
    assert lines(tmp_path)[1]["notes"][0].startswith(note)
    again = slkit(*good, "--resume", "--json").json
    (noted,) = again["noted"]
    assert again["unchanged"] == 2 and noted == {"capture": "b", "notes": lines(tmp_path)[1]["notes"]}


def test_jpeg_pictures_that_cannot_be_decoded_are_told_of(slkit, command: tuple[object, ...], tmp_path: Path, to_jpeg):
    """By a batch of several, and by a scan: they may be why."""
    for name in "ab":
        to_jpeg(tmp_path / "captures" / name, 0)
    outcome = slkit("batch", *(tmp_path / "captures" / name for name in "ab"), *command[2:])
    assert outcome.code == 3 and outcome.out.count("are JPEG") == 1
    assert "(and 1 more, in batch.jsonl)" in outcome.out
    assert [(line["status"], len(line["notes"])) for line in lines(tmp_path)] == 2 * [("failed", 1)]
    alone = slkit("scan", tmp_path / "captures" / "a", "--rig", command[3], "-o", tmp_path / "a.ply")
    sentence, note = alone.err.splitlines()
    assert alone.code == 2 and sentence.startswith("slkit: ") and "are JPEG" in note and "JPEG" not in sentence


def test_options_reach_the_scans(slkit, command: tuple[object, ...], tmp_path: Path):
    good = ("batch", *(tmp_path / "captures" / name for name in "ab"), *command[2:])
    options = ("--set", "robust=true", "--depth", 100, 5000, "--no-filter", "isolated", "--normals")
    assert slkit(*good, *options).code == 0
    cloud = pipeline.scan(
        tmp_path / "captures" / "a",
        jobs.read_rig(str(tmp_path / "rig.json")),
        {"robust": True},
        (100, 5000),
        pipeline.make_filters(["isolated"]),
        normals=True,
    ).cloud
    assert (tmp_path / "clouds" / "a.ply").read_bytes() == b"".join(pipeline.exporter("a.ply")(cloud))
    assert slkit(*good, *options, "--resume", "--json").json["unchanged"] == 2
    assert slkit(*good, *options[:-1], "--resume", "--json").json["scanned"] == 2


def test_refused(slkit, command: tuple[object, ...], tmp_path: Path):
    verb, captures, *rest = command
    before = sorted(tmp_path.rglob("*"))
    for arguments, words in (
        ((tmp_path / "none" / "*", *rest), "no folder matches"),
        ((tmp_path / "captures" / "[", *rest), "no folder matches"),
        ((tmp_path, *rest), "has a capture.toml"),
        ((captures, "--rig", tmp_path / "none.json", *rest[2:]), "none.json"),
        ((captures, "--rig", tmp_path / "captures" / "a" / "capture.toml", *rest[2:]), "not valid JSON"),
        ((captures, *rest, "--depth", 5, 3), "nearer first"),
        ((captures, *rest, "--no-filter", "x"), "no filter called 'x'"),
        ((captures, *rest, "--set", "x"), "key=value"),
        ((captures, *rest[:-1], 0), "at least 1 worker"),
        ((captures, *rest, "--scheduler", "tcp://localhost:1"), "leave it away"),
        ((captures, *rest[:2], "-o", tmp_path / "rig.json" / "clouds"), "cannot be"),
        (("s3://bucket/*", *rest), "needs the package s3fs"),
        (("far://bucket/*", *rest), "far"),
    ):
        outcome = slkit(verb, *arguments)
        assert (outcome.code, outcome.out) == (2, ""), arguments
        assert outcome.err.startswith("slkit: ") and outcome.err.count("\n") == 1 and words in outcome.err
    assert sorted(tmp_path.rglob("*")) == before


def test_from_memory_to_memory_on_a_cluster(slkit, command: tuple[object, ...], tmp_path: Path):
    store = fsspec.filesystem("memory")
    store.put(f"{tmp_path}/captures/", "/captures/", recursive=True)
    store.put(str(tmp_path / "rig.json"), "/rig.json")
    try:
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
        ) as cluster:
            arguments = ("memory://captures/*", "--rig", "memory://rig.json", "-o", "memory://clouds")
            outcome = slkit("batch", *arguments, "--scheduler", cluster.scheduler_address, "--json")
        assert outcome.code == 3 and outcome.json["scanned"] == 3
        assert outcome.json["failures"][0]["error"].startswith("memory:///captures/c has ")
        assert len(read_ply(store.cat_file("/clouds/d.ply"))) > 100
        assert store.cat_file("/clouds/batch.jsonl").count(b"\n") == 4
    finally:
        store.store.clear()


def recorded(tmp_path: Path) -> int:
    manifest = tmp_path / "clouds" / "batch.jsonl"
    return manifest.read_bytes().count(b"\n") if manifest.exists() else 0


def running(tmp_path: Path, rig_file: Path, *options: str) -> subprocess.Popen:
    """Start a batch as a process group of its own, as a terminal does, and wait until it has recorded some captures."""
    before = recorded(tmp_path)
    arguments = ["batch", f"{tmp_path}/captures/*", "--rig", rig_file, "-o", tmp_path / "clouds", "--workers", "2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "slkit.cli", *map(str, arguments), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until = time.monotonic() + 60
    while time.monotonic() < until and recorded(tmp_path) < before + 3:
        assert process.poll() is None
        time.sleep(0.005)
    return process


def test_interrupt_and_killed_parent(
    slkit, tmp_path: Path, rig_file: Path, tiny_captures: Callable[..., None], tiny_rig: Rig
):
    names = [f"s{i}" for i in range(150)]
    tiny_captures(tmp_path / "captures", *names)
    interrupted = running(tmp_path, rig_file)
    os.killpg(interrupted.pid, signal.SIGINT)
    out, err = interrupted.communicate(timeout=60)
    assert (interrupted.returncode, err) == (130, "")
    assert "which the same command with --resume scans" in out
    first = lines(tmp_path)
    assert 3 <= len(first) == len({line["capture"] for line in first}) < 150
    assert {f.stem for f in (tmp_path / "clouds").glob("*.ply")} == {line["capture"] for line in first}

    killed = running(tmp_path, rig_file, "--resume")
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate(timeout=60)  # returns when the workers, which share its pipes, are gone too

    assert len(first) + 3 <= recorded(tmp_path) < 150
    command = ("batch", tmp_path / "captures" / "*", "--rig", rig_file, "-o", tmp_path / "clouds", "--workers", 1)
    outcome = slkit(*command, "--resume", "--json")
    assert outcome.code == 0
    table = outcome.json
    assert table["unchanged"] >= len(first) and table["unchanged"] + table["scanned"] == 150
    assert {f.name for f in (tmp_path / "clouds").iterdir()} == {*(f"{n}.ply" for n in names), "batch.jsonl"}
    for name in names[:10]:
        cloud = pipeline.scan(tmp_path / "captures" / name, tiny_rig).cloud
        assert (tmp_path / "clouds" / f"{name}.ply").read_bytes() == b"".join(pipeline.exporter("x.ply")(cloud))
