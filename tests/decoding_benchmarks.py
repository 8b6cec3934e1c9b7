"""What decoding, triangulating and scanning cost beside moving and reading the same bytes, as a table of ratios.

OPENBLAS_NUM_THREADS=1 python tests/decoding_benchmarks.py

All times are by the clock, the least of several, and each ratio is taken within this run. A copy moves the bytes that
the work beside it reads and writes, on one thread. --large adds pictures of 4096 x 3000 px; --others FILE adds what
`bench_others.py` measured; --page FILE puts what is printed into a page of the documentation.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from bench_pictures import LARGE, PROJECTOR, SMALL, least_seconds, pairs, rig_of, right, seen, with_columns_only
from bench_table import Row, heading, page
from scipy.spatial import KDTree

import slkit
from slkit.codecs.gray import Gray
from slkit.codecs.line_shift import LineShift
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.data import Correspondences, Frames, PointCloud
from slkit.files import read_image, write_png
from slkit.geometry import Rig
from slkit.triangulation import Filters, ray_plane, two_rays

FINE_PROJECTOR = (2048, 1536)
"""Gray code of both of its axes takes 46 pictures."""
ASKED = {
    "gray": ("2", "1.5"),
    "phase": ("3", "3"),
    "line": ("10", "10"),
    "plane": ("6", "4"),
    "scan": ("1.3, and 700 ms", "1.3"),
}
"""What issue 5 asks for, of small and of large pictures."""


def asked(name: str, rig: Rig) -> str:
    return ASKED[name][rig.camera.size == LARGE]


def sized(work: str, rig: Rig) -> str:
    width, height = rig.camera.size
    return f"{work}, {width} x {height}"


def copying(count: int) -> float:
    """Return the seconds that a copy of so many bytes takes."""
    source, target = np.ones(count, np.uint8), np.empty(count, np.uint8)
    return least_seconds(lambda: np.copyto(target, source), 10)


def bytes_of(frames: Frames, found: Correspondences) -> int:
    """Return how many bytes decoding reads and writes."""
    written = (found.camera_xy, found.projector_xy, found.sigma, found.confidence, found.color)
    # Grey is stored once, and shown as three channels.
    return sum(f.nbytes for f in frames) + sum(a.nbytes // (1 if a.strides[-1] else a.shape[-1]) for a in written)


def decoding(rig: Rig) -> Iterator[Row]:
    """Decoding, beside a copy of its bytes."""
    codecs = {
        "gray": Gray(PROJECTOR),
        "phase": PhaseShift(PROJECTOR, x=Fringes((64.0, 8.0, 1.0)), references=False),
        "line": LineShift(PROJECTOR),
    }
    works = {"gray": "Gray code, columns", "phase": "phase shift, 3 sets of 4 steps", "line": "line shift"}
    for name, codec in codecs.items():
        frames = seen(codec, rig)
        found = codec.decode(frames)
        assert right(found, rig)
        ours, work = least_seconds(lambda c=codec, f=frames: c.decode(f)), sized(f"decoding {works[name]}", rig)
        yield Row(work, ours, "memcpy", copying(bytes_of(frames, found)), "floor", asked(name, rig))


def triangulating(rig: Rig) -> Iterator[Row]:
    """Triangulating, beside a copy of its bytes, and the search for company beside a tree."""
    found, xyz = pairs(rig)
    # Two pixels and a sigma are read, a point, two sigmas and a residual written.
    copy = copying(len(found) * 4 * (2 + 2 + 2 + 3 + 3))
    columns = with_columns_only(found)
    assert near(ray_plane(columns, rig), xyz) and near(two_rays(found, rig), xyz)
    plane, rays = least_seconds(lambda: ray_plane(columns, rig)), least_seconds(lambda: two_rays(found, rig), 3)
    yield Row(sized("ray-plane, projector distortion", rig), plane, "memcpy", copy, "floor", asked("plane", rig))
    yield Row(sized("two rays, both lenses", rig), rays, "memcpy", copy, "floor")
    cloud = ray_plane(columns, rig)
    if rig.camera.size == SMALL:
        # A tree of a large picture's points would take most of the benchmark's time.
        filters = Filters(residual=False, sigma=False, depth=False)
        company = least_seconds(lambda: filters.apply(cloud), 2)
        tree = least_seconds(lambda: KDTree(cloud.xyz).query(cloud.xyz, k=11, workers=-1), 1)
        work = sized("points without company", rig)
        yield Row(work, company, "SciPy's KDTree, 10 neighbours, all cores", tree, "peer")
    yield from writing(cloud, rig)


def near(cloud: PointCloud, xyz: np.ndarray) -> bool:
    return bool(np.quantile(np.abs(cloud.xyz - xyz), 0.99) < 0.01)


def writing(cloud: PointCloud, rig: Rig) -> Iterator[Row]:
    """The file of a cloud, beside the writing of its bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path, raw = Path(folder) / "cloud.ply", Path(folder) / "raw"
        ours = least_seconds(lambda: slkit.write_cloud(path, cloud), 7)
        data = path.read_bytes()
        plain = least_seconds(lambda: write(raw, data), 7)
        yield Row(
            sized("a cloud's PLY, to the disk", rig), ours, "writing its bytes to the disk", plain, "floor", "1.2"
        )


def write(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def stored(folder: Path, pictures: Any, projector: tuple[int, int], axes: str) -> None:
    """Write a scan folder of Gray code."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, picture in enumerate(pictures):
        write_png(folder / f"{k:03d}.png", picture)
    text = f'codec = "gray"\nprojector = [{projector[0]}, {projector[1]}]\n[parameters]\naxes = "{axes}"\n'
    (folder / "capture.toml").write_text(text, encoding="utf-8")


def whole_scan(rig: Rig) -> Iterator[Row]:
    """The whole command `slkit scan` beside reading the same PNGs on two threads."""
    rig = rig_of(*rig.camera.size, FINE_PROJECTOR)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        stored(root, seen(Gray(FINE_PROJECTOR, axes="both"), rig), FINE_PROJECTOR, "both")
        slkit.write_rig(root / "rig.json", rig, {})
        files = sorted(root.glob("*.png"))

        def read() -> None:
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(read_image, files))

        given = "scan", folder, "--rig", str(root / "rig.json"), "-o", str(root / "cloud.ply")
        whole = least_seconds(lambda: command(*given), 2)
        work = sized(f"slkit scan of {len(files)} PNGs, whole", rig)
        yield Row(work, whole, "reading them with two threads", least_seconds(read, 3), "floor", asked("scan", rig))


def batches(captures: int = 160) -> Iterator[Row]:
    """The whole command `slkit batch` on small captures with one and with two workers, by turns."""
    with tempfile.TemporaryDirectory() as folder:
        root, rig = Path(folder), rig_of(*SMALL)
        pictures = list(seen(Gray(PROJECTOR), rig))
        for c in range(captures):
            stored(root / "captures" / f"{c:03d}", pictures, PROJECTOR, "x")
        slkit.write_rig(root / "rig.json", rig, {})
        # What waits to be written would be written during the first batch.
        os.sync()
        given = "batch", str(root / "captures" / "*"), "--rig", str(root / "rig.json")

        def seconds(workers: int, turn: int) -> float:
            started, clouds = time.perf_counter(), root / f"clouds{workers}_{turn}"
            command(*given, "-o", str(clouds), "--workers", str(workers))
            taken = time.perf_counter() - started
            assert len(list(clouds.glob("*.ply"))) == captures
            shutil.rmtree(clouds)
            return taken / captures

        one, two = np.min([[seconds(workers, turn) for workers in (1, 2)] for turn in range(2)], axis=0)
        work = sized(f"slkit batch of {captures}, two workers, a capture of {len(pictures)} PNGs", rig)
        yield Row(work, float(two), "one worker", float(one), "peer", "1.8")


def command(*arguments: str) -> None:
    """Run slkit as a user would."""
    program = "from slkit.cli import main; main()"
    subprocess.run([sys.executable, "-c", program, *arguments], check=True, stdout=subprocess.DEVNULL)


def others(path: Path) -> Iterator[Row]:
    """What `bench_others.py` measured, from the file that pytest-benchmark wrote."""
    groups: dict[str, list[Any]] = {}
    for one in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]:
        groups.setdefault(one["group"], []).append(one)
    for work, (ours, *rest) in groups.items():
        assert ours["extra_info"]["by"] == "slkit", work
        for one in rest:
            told = one["extra_info"]
            yield Row(
                work, ours["stats"]["min"], told["by"], one["stats"]["min"] * told["times"], "peer", told["asked"]
            )


def rows(arguments: list[str]) -> Iterator[Row]:
    rigs = [rig_of(*size) for size in (SMALL, LARGE)[: 1 + ("--large" in arguments)]]
    for part in (decoding, triangulating, whole_scan):
        for rig in rigs:
            yield from part(rig)
    yield from batches()
    if "--others" in arguments:
        yield from others(Path(arguments[arguments.index("--others") + 1]))


if __name__ == "__main__":
    told = [heading()]
    print(told[0])
    for row in rows(sys.argv):
        told.append(row.line())
        print(told[-1], flush=True)
    if "--page" in sys.argv:
        page(Path(sys.argv[sys.argv.index("--page") + 1]), told)
