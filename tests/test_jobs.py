import json
import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import fsspec
import numpy as np
import pytest
from fsspec.registry import known_implementations

import slkit
from slkit import jobs, pipeline
from slkit.errors import FileError, InputError, SlkitError
from slkit.files import read_image, read_rig, write_rig
from slkit.geometry import Rig
from slkit.jobs import _running
from slkit.jobs._manifest import Manifest
from slkit.jobs._scanning import Job, scan_one
from slkit.triangulation import Filters

Captures = Callable[..., None]
THREADS = jobs.Pool(lambda: ThreadPoolExecutor(2), 3)


@pytest.fixture
def root(tmp_path: Path, tiny_captures: Captures) -> Path:
    """A folder with the captures 1, 2, 10."""
    tiny_captures(tmp_path / "captures", "1", "2", "10")
    return tmp_path


@pytest.fixture
def recipe(tiny_rig: Rig) -> jobs.Recipe:
    return jobs.Recipe(tiny_rig)


@pytest.fixture
def memory() -> Iterator[None]:
    yield
    store = fsspec.filesystem("memory").store
    store.clear()


def lines(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "batch.jsonl").read_text("utf-8").splitlines()]


def scan(root: Path, recipe: jobs.Recipe, resume: bool = True, **options) -> jobs.BatchResult:
    return jobs.scan_all(f"{root}/captures/*", recipe, str(root / "clouds"), THREADS, resume, **options)


def expected(folder: Path, recipe: jobs.Recipe) -> bytes:
    """The cloud that a single scan writes."""
    return b"".join(pipeline.exporter("x.ply")(pipeline.scan(folder, recipe.rig).cloud))


def test_clouds_and_manifest(root: Path, recipe: jobs.Recipe):
    told = []
    result = scan(root, recipe, resume=False, progress=lambda *step: told.append(step))
    assert (result.captures, result.scanned, result.unchanged, result.failures) == (3, 3, 0, ())
    assert told == [("scan", n, 3) for n in (1, 2, 3)]
    assert {f.name for f in (root / "clouds").iterdir()} == {"1.ply", "2.ply", "10.ply", "batch.jsonl"}
    table = {line["capture"]: line for line in lines(root / "clouds")}
    assert set(table) == {"1", "2", "10"} and len({line["hash"] for line in table.values()}) == 3
    for name, line in table.items():
        assert (root / "clouds" / line["cloud"]).read_bytes() == expected(root / "captures" / name, recipe)
        assert line["cloud"] == f"{name}.ply" and line["status"] == "done" and line["error"] == ""
        assert line["seconds"] > 0 and len(line["hash"]) == 40
    assert sum(line["points"] for line in table.values()) == result.points > 300


def test_resume_repeats_exactly_what_it_must(root: Path, recipe: jobs.Recipe, tiny_captures: Captures):
    def repeated(recipe: jobs.Recipe = recipe) -> set[str]:
        before = len(lines(root / "clouds")) if (root / "clouds").exists() else 0
        result = scan(root, recipe)
        new = [line["capture"] for line in lines(root / "clouds")[before:]]
        assert len(new) == len(set(new)) == result.scanned + len(result.failures)
        assert result.unchanged == result.captures - len(new)
        return set(new)

    everything = {"1", "2", "10"}
    assert repeated() == everything
    assert repeated() == set()
    (root / "clouds" / "2.ply").unlink()
    assert repeated() == {"2"}
    tiny_captures(root / "new", "7")
    shutil.move(root / "new" / "7", root / "captures" / "7")
    assert repeated() == {"7"}
    frame = sorted((root / "captures" / "10").glob("*.png"))[3]
    good = frame.read_bytes()
    frame.write_bytes(good[:100])
    assert repeated() == {"10"}
    assert repeated() == {"10"}  # failed
    frame.write_bytes(good)
    assert repeated() == {"10"}
    (root / "captures" / "1" / ".DS_Store").write_bytes(b"x")
    assert repeated() == set()
    everything.add("7")
    moved = replace(recipe.rig.camera, distortion=np.array([-0.2, 0.001, 0, 0, 0]))
    for other in (
        {"rig": replace(recipe.rig, camera=moved)},
        {"parameters": {"robust": True}},
        {"depth": (100.0, 5000.0)},
        {"filters": Filters(isolated=False)},
        {"normals": True},
    ):
        assert repeated(replace(recipe, **other)) == everything
    assert repeated() == everything


def test_a_stack_counts_as_its_pictures(root: Path, recipe: jobs.Recipe):
    clouds = {name: expected(root / "captures" / name, recipe) for name in ("1", "2", "10")}
    for name in clouds:
        folder = root / "captures" / name
        files = sorted(folder.glob("*.png"))
        np.save(folder / "stack.npy", np.stack([read_image(file) for file in files]))
        for file in files:
            file.unlink()
        toml = folder / "capture.toml"
        toml.write_text("\n".join(line for line in toml.read_text().splitlines() if not line.startswith("frames")))
    assert scan(root, recipe).scanned == 3
    assert {name: (root / "clouds" / f"{name}.ply").read_bytes() for name in clouds} == clouds
    assert scan(root, recipe).unchanged == 3
    stack = np.load(root / "captures" / "2" / "stack.npy")
    stack[0, 0, 0] ^= 1
    np.save(root / "captures" / "2" / "stack.npy", stack)
    assert scan(root, recipe).scanned == 1


def test_another_version_repeats(root: Path, recipe: jobs.Recipe, monkeypatch: pytest.MonkeyPatch):
    scan(root, recipe)
    monkeypatch.setattr(slkit, "__version__", "0.0", raising=False)
    assert scan(root, recipe).scanned == 3


def test_pictures_outside_the_folder_count(root: Path, recipe: jobs.Recipe):
    capture, pictures = root / "captures" / "1", root / "pictures"
    pictures.mkdir()
    for file in capture.glob("*.png"):
        shutil.move(file, pictures)
    text = (capture / "capture.toml").read_text()
    (capture / "capture.toml").write_text(f'root = "{pictures}"\n{text}')
    assert scan(root, recipe).scanned == 3
    assert scan(root, recipe).unchanged == 3
    (pictures / "note.txt").write_text("changed")
    assert scan(root, recipe).scanned == 1


def test_a_bad_capture_stops_nothing(root: Path, recipe: jobs.Recipe, monkeypatch: pytest.MonkeyPatch):
    (root / "captures" / "2" / "capture.toml").unlink()
    result = scan(root, recipe)
    assert (result.scanned, [r.capture for r in result.failures]) == (2, ["2"])
    assert "has no capture.toml" in result.failures[0].error
    assert {line["capture"]: line["status"] for line in lines(root / "clouds")}["2"] == "failed"

    def broken(*_):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(pipeline, "scan", broken)
    result = scan(root, recipe)
    assert (result.unchanged, len(result.failures)) == (2, 1)
    assert "/captures/2: internal error, please report it: RuntimeError: two lines" in result.failures[0].error


def test_a_manifest_with_a_torn_line(root: Path, recipe: jobs.Recipe):
    scan(root, recipe)
    manifest = root / "clouds" / "batch.jsonl"
    whole = manifest.read_bytes()
    for torn in (whole[:-1], whole[:-30], whole + b'{"capture": "1", "ha', whole + b"\0\0\0"):
        manifest.write_bytes(torn)
        (root / "clouds" / ".1.ply.0123456789ab.part").write_bytes(b"half a cloud")
        scan(root, recipe)
        assert {line["capture"] for line in lines(root / "clouds")} == {"1", "2", "10"}
        assert not list((root / "clouds").glob(".*"))
    for no_record in (whole.replace(b"{", b"[", 1), b"[1, 2]\n" + whole, b'{"capture": "1"}\n' + whole):
        manifest.write_bytes(no_record)
        with pytest.raises(FileError, match="batch.jsonl, line 1, is no record"):
            scan(root, recipe)
    # As an earlier version wrote it.
    manifest.write_bytes(whole.replace(b', "notes": []', b""))
    assert b"notes" not in manifest.read_bytes() and scan(root, recipe).unchanged == 3


def test_refused(root: Path, recipe: jobs.Recipe):
    with pytest.raises(InputError, match="nearer first"):
        scan(root, replace(recipe, depth=(5.0, 3.0)))
    for pattern, words in (
        (f"{root}/none/*", "no folder matches"),
        (f"{root}/captures/1/*.png", "no folder matches"),
        (f"{root}/*", "has a capture.toml"),
        ("memory://", "has a capture.toml"),
        ("nonsense://x", "nonsense"),
    ):
        with pytest.raises(SlkitError, match=words):
            jobs.scan_all(pattern, recipe, str(root / "clouds"), THREADS)
    with pytest.raises(InputError, match="several file systems"):
        jobs.find_captures([str(root), "memory://x"])
    assert not (root / "clouds").exists()
    scan(root, recipe)
    with pytest.raises(FileError, match="already holds a batch.jsonl: go on with --resume"):
        scan(root, recipe, resume=False)
    with pytest.raises(InputError, match="at least 1 worker"), jobs.local_pool(0):
        pass


def test_a_protocol_whose_package_is_missing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(known_implementations, "far", {"class": "farfs.FarFileSystem", "err": "x"})
    with pytest.raises(FileError, match=r"far://b/\* cannot be reached: far:// needs the package farfs: pip install"):
        jobs.find_captures(["far://b/*"])


def test_names(root: Path, tiny_captures: Captures, monkeypatch: pytest.MonkeyPatch):
    def names(*patterns: str) -> list[str]:
        return list(jobs.find_captures(patterns))

    tiny_captures(root, "a/x", "b/x", "b/[1]/y")
    monkeypatch.chdir(root)
    assert names("captures/*") == names(f"{root}/captures/*") == ["1", "2", "10"]
    assert names("captures/1", "captures/2", "captures/10") == ["1", "2", "10"]
    assert names("*/x") == names("a/x", "b/x") == names("a/*", "b/x") == ["a/x", "b/x"]
    assert names("a/x") == ["x"] and names("b/x", "b/x/") == ["x"]
    assert names("b/[1]/y") == ["y"]
    with pytest.raises(FileError, match="no folder matches"):
        names("b/[1]/*")
    assert names("b/**") == ["[1]", "[1]/y", "x"]
    (root / "captures" / ".hidden").mkdir()
    (root / "captures" / "link").symlink_to(root / "a" / "x", target_is_directory=True)
    assert names("captures/*") == ["1", "2", "10", "link"]


def test_names_that_would_collide(root: Path, recipe: jobs.Recipe, tiny_captures: Captures):
    tiny_captures(root, "a/x", "b/x")
    jobs.scan_all(f"{root}/[ab]/x", recipe, str(root / "clouds"), THREADS)
    for name in ("a/x", "b/x"):
        assert (root / "clouds" / f"{name}.ply").read_bytes() == expected(root / name, recipe)


def test_in_memory(root: Path, recipe: jobs.Recipe, memory: None):
    store = fsspec.filesystem("memory")
    store.put(f"{root}/captures/", "/in/", recursive=True)
    store.rm("/in/2/capture.toml")
    result = jobs.scan_all("memory://in/*", recipe, "memory://out/clouds", THREADS)
    assert result.failures[0].error.startswith("memory:///in/2 has no capture.toml")
    for name in ("1", "10"):
        assert store.cat_file(f"/out/clouds/{name}.ply") == expected(root / "captures" / name, recipe)
    assert set(store.ls("/out/clouds", detail=False)) == {
        f"/out/clouds/{n}" for n in ("1.ply", "10.ply", "batch.jsonl")
    }
    with pytest.raises(FileError, match="memory:///out/clouds already holds"):
        jobs.scan_all("memory://in/*", recipe, "memory://out/clouds", THREADS)
    again = jobs.scan_all("memory://in/*", recipe, "memory://out/clouds", THREADS, resume=True)
    assert (again.scanned, again.unchanged, len(again.failures)) == (0, 2, 1)
    assert store.cat_file("/out/clouds/batch.jsonl").count(b"\n") == 4


def test_rig_from_anywhere(tmp_path: Path, tiny_rig: Rig, memory: None):
    write_rig(tmp_path / "rig.json", tiny_rig)
    fsspec.filesystem("memory").pipe_file("/rig.json", (tmp_path / "rig.json").read_bytes())
    fsspec.filesystem("memory").pipe_file("/bad.json", b"{}")
    assert jobs.read_rig("memory://rig.json").camera.size == read_rig(tmp_path / "rig.json").camera.size
    with pytest.raises(FileError, match="^memory://bad.json is not a rig"):
        jobs.read_rig("memory://bad.json")
    with pytest.raises(FileError, match="memory:///none.json cannot be read: it does not exist"):
        jobs.read_rig("memory://none.json")


def test_a_cloud_that_cannot_be_written_fails(root: Path, recipe: jobs.Recipe):
    (root / "clouds" / "1.ply").mkdir(parents=True)
    result = scan(root, recipe)
    assert result.scanned == 2 and "1.ply cannot be written" in result.failures[0].error


def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path, recipe: jobs.Recipe, tiny_captures: Captures):
    names = [str(i) for i in range(40)]
    tiny_captures(tmp_path / "captures", *names)
    killed: list[int] = []

    def kill(_: str, done: int, total: int) -> None:
        assert total == 40
        if done >= 15 and not killed:
            killed.append(multiprocessing.active_children()[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    with jobs.local_pool(2) as pool:
        result = jobs.scan_all(f"{tmp_path}/captures/*", recipe, str(tmp_path / "clouds"), pool, progress=kill)
    assert len(killed) == 1 and killed[0] != os.getpid()
    assert (result.captures, result.scanned, result.failures) == (40, 40, ())
    written = {f.relative_to(tmp_path / "clouds").as_posix() for f in (tmp_path / "clouds").rglob("*")}
    assert written == {*(f"{name}.ply" for name in names), "batch.jsonl"}
    for name in names:
        cloud = (tmp_path / "clouds" / f"{name}.ply").read_bytes()
        assert cloud == expected(tmp_path / "captures" / name, recipe)
    told = lines(tmp_path / "clouds")
    assert sorted(line["capture"] for line in told) == sorted(names)
    assert {line["status"] for line in told} == {"done"}


class Deadly:
    """An executor that works at once, and breaks for good at certain captures."""

    def __init__(self, deadly: set[str], deaths: list[str]) -> None:
        self.deadly, self.deaths, self.broken = deadly, deaths, False

    def submit(self, work, *arguments):
        if self.broken:
            raise BrokenExecutor
        future: Future = Future()
        if arguments and arguments[0].capture in self.deadly:
            self.broken = True
            self.deaths.append(arguments[0].capture)
            future.set_exception(BrokenExecutor())
        else:
            future.set_result(work(*arguments))
        return future

    def shutdown(self, **_):
        pass

    __enter__ = lambda self: self  # noqa: E731
    __exit__ = lambda self, *_: None  # noqa: E731


def test_a_capture_that_kills_its_worker_fails_after_a_few_tries(root: Path, recipe: jobs.Recipe):
    deaths: list[str] = []
    pool = jobs.Pool(lambda: Deadly({"2"}, deaths), 3)
    result = jobs.scan_all(f"{root}/captures/*", recipe, str(root / "clouds"), pool)
    assert result.scanned == 2 and "killed 3 times" in result.failures[0].error
    assert deaths == ["2"] * 4  # once among others, then alone
    assert scan(root, recipe).scanned == 1


def test_workers_have_one_thread_each(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with jobs.local_pool(1) as pool, pool.open() as executor:
        assert executor.submit(cv2.getNumThreads).result() == 1
        assert executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    assert os.environ["OMP_NUM_THREADS"] == "3" and "OPENCV_FOR_THREADS_NUM" not in os.environ


def test_workers_that_cannot_start(root: Path, recipe: jobs.Recipe):
    class Dead(Deadly):
        def submit(self, *_):
            raise BrokenExecutor

    with pytest.raises(SlkitError, match="no worker process can be started"):
        jobs.scan_all(f"{root}/captures/*", recipe, str(root / "clouds"), jobs.Pool(lambda: Dead(set(), []), 3))
    assert scan(root, recipe).scanned == 3


def test_an_interrupt_keeps_what_is_finished(root: Path, recipe: jobs.Recipe):
    def interrupt(_: str, done: int, __: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    pool = jobs.Pool(lambda: ThreadPoolExecutor(1), 2)
    with pytest.raises(jobs.Interrupted) as stopped:
        jobs.scan_all(f"{root}/captures/*", recipe, str(root / "clouds"), pool, progress=interrupt)
    done = stopped.value.result.scanned
    assert 1 <= done <= 2
    assert len({line["capture"] for line in lines(root / "clouds")}) == len(lines(root / "clouds")) == done
    result = scan(root, recipe)
    assert (result.unchanged, result.scanned) == (done, 3 - done)


def test_an_interrupt_while_a_record_is_written(root: Path, recipe: jobs.Recipe, monkeypatch: pytest.MonkeyPatch):
    append = Manifest.append

    def interrupted(manifest: Manifest, record: jobs.Record) -> None:
        monkeypatch.setattr(Manifest, "append", append)
        append(manifest, record)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Manifest, "append", interrupted)
    with pytest.raises(jobs.Interrupted) as stopped:
        scan(root, recipe)
    recorded = [line["capture"] for line in lines(root / "clouds")]
    assert len(recorded) == len(set(recorded)) == stopped.value.result.scanned >= 1
    assert {f.stem for f in (root / "clouds").glob("*.ply")} == set(recorded)


def test_a_worker_that_raises(root: Path, recipe: jobs.Recipe):
    def failing(job: Job) -> jobs.Record:
        if job.capture == "2":
            raise OSError("lost\nit")
        return scan_one(job, recipe)

    found: list[jobs.Record] = []
    clouds = root / "clouds"
    every = [Job(n, f"{root}/captures/{n}", f"{n}.ply", f"{clouds}/{n}.ply", "") for n in ("1", "2", "10")]
    assert _running.run(every, failing, THREADS, found.append) == 0
    errors = {record.capture: record.error for record in found}
    assert errors == {"1": "", "10": "", "2": f"{root}/captures/2: its worker failed: OSError: lost it"}


def test_a_cluster(root: Path, recipe: jobs.Recipe):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as local:
        with jobs.cluster(local.scheduler_address) as pool:
            result = jobs.scan_all(f"{root}/captures/*", recipe, str(root / "clouds"), pool)
    assert result.scanned == 3
    for name in ("1", "2", "10"):
        assert (root / "clouds" / f"{name}.ply").read_bytes() == expected(root / "captures" / name, recipe)


def test_no_cluster(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(SlkitError, match="no Dask scheduler answers at nonsense"), jobs.cluster("nonsense://x"):
        pass
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(SlkitError, match=r"pip install 'slkit\[dask\]'"), jobs.cluster("tcp://localhost:1"):
        pass


def test_an_output_folder_is_no_capture_and_lies_in_none(tiny_captures: Captures, recipe: jobs.Recipe, tmp_path: Path):
    tiny_captures(tmp_path, "a", "b")
    pattern, inside = str(tmp_path / "*"), str(tmp_path / "clouds")
    pool = jobs.Pool(lambda: ThreadPoolExecutor(1), ahead=2)
    first = jobs.scan_all(pattern, recipe, inside, pool)
    again = jobs.scan_all(pattern, recipe, inside, pool, resume=True)
    assert first.captures == first.scanned == again.captures == again.unchanged == 2 and not again.failures
    with pytest.raises(InputError, match="lies inside the capture"):
        jobs.scan_all(pattern, recipe, str(tmp_path / "a" / "clouds"), pool)
