"""What decoding, triangulating and scanning cost beside moving and reading the same bytes; `make bench` runs it.

OPENBLAS_NUM_THREADS=1 python tests/decoding_benchmarks.py

All times are by the clock, the least of several, and each ratio is taken within this run. A copy moves the bytes that
the work beside it reads and writes, on one thread. --large adds pictures of 4096 x 3000 px; --others FILE adds what
`bench_others.py` measured; --page FILE puts what is printed into a page of the documentation.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import KDTree

import slkit
from slkit import jobs
from slkit.codecs._gray_code import BitRule, CellCode, read_cells
from slkit.codecs._masks import measure_light
from slkit.codecs.gray import Gray
from slkit.codecs.line_shift import LineShift
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.data import Correspondences, Frames
from slkit.files import read_image, write_png
from slkit.geometry import Pinhole, Pose, Rig
from slkit.triangulation import Filters, triangulate

PROJECTOR = (1024, 768)
START, END = "<!-- measured -->", "<!-- /measured -->"


def least_seconds(work: Callable[[], object], times: int = 5) -> float:
    """Return the least time by the clock that a call takes, after one that does not count."""
    work()
    seconds: list[float] = []
    for _ in range(times):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def rig_of(width: int, height: int) -> Rig:
    """Return a rig with projector distortion whose devices see the same square metre."""
    scale = width / 1024
    camera = np.array([[1300 * scale, 0, width / 2], [0, 1300 * scale, height / 2], [0, 0, 1]])
    projector = np.array([[1300.0, 0, 512], [0, 1300, 384], [0, 0, 1]])
    pose = Pose.from_rotation_vector([0, 0.25, 0], [-250, 0, 30])
    return Rig(
        Pinhole((width, height), camera, np.array([-0.1, 0.02, 0, 0, 0])),
        Pinhole(PROJECTOR, projector, np.array([-0.05, 0.01, 0, 0, 0])),
        pose,
    )


def seen_at(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the projector column and row (h, w) that each pixel of the camera sees, on a gently waved wall."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    to_x = (0.05 + 0.9 * x / width) * PROJECTOR[0] + 3 * np.sin(20 * y / height)
    return to_x, (0.05 + 0.9 * y / height) * PROJECTOR[1]


def seen(codec: Any, width: int, height: int) -> Frames:
    """Return what a camera sees of a codec's patterns on an ellipse of that wall, with noise of 2 levels."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    to_x, to_y = seen_at(width, height)
    lit = ((x / width - 0.5) / 0.46) ** 2 + ((y / height - 0.5) / 0.46) ** 2 < 1
    paint = np.where(lit, 0.5 + 0.25 * np.sin(9 * x / width) * np.cos(7 * y / height), 0)
    noise = [rng.normal(10, 2, (height, width)).astype(np.float32) for _ in range(3)]
    pictures = []
    for k, pattern in enumerate(codec.encode()):
        light = cv2.remap(pattern.astype(np.float32), to_x, to_y, cv2.INTER_LINEAR)
        level = cv2.GaussianBlur(light, (0, 0), 0.7) * paint + noise[k % 3]
        pictures.append(np.clip(np.rint(level), 0, 255).astype(np.uint8))
    return Frames.of(pictures, codec.encode().names)


def cells_in_numpy(codec: Gray, frames: Frames) -> tuple[float, float]:
    """Return the seconds that the cells of every pixel and their margins take in NumPy, and in compiled loops."""
    images = dict(zip(frames.names, frames, strict=True))
    light = measure_light(images["white"], images["black"], codec.min_snr)
    code = CellCode("x", PROJECTOR[0], codec.step, codec.inverse)
    rule = BitRule(codec.bit_snr, codec.min_contrast, robust=False)
    plain = least_seconds(lambda: read_cells(code, images.__getitem__, light, rule, lambda *_: None), 2)
    return plain, least_seconds(lambda: read_cells(code, images.__getitem__, light, rule), 3)


def bytes_of(frames: Frames, found: Correspondences) -> int:
    """Return how many bytes decoding reads and writes."""
    written = (found.camera_xy, found.projector_xy, found.sigma, found.confidence, found.color)
    return sum(f.nbytes for f in frames) + sum(a.nbytes for a in written)


def copying(count: int) -> float:
    """Return the seconds that a copy of so many bytes takes."""
    source, target = np.ones(count, np.uint8), np.empty(count, np.uint8)
    return least_seconds(lambda: np.copyto(target, source))


def decoders(width: int, height: int) -> Iterator[str]:
    """Decoding beside a copy of its bytes, and the cells of Gray code in NumPy."""
    yield f"decoding, {width} x {height} px"
    codecs = {
        "gray": Gray(PROJECTOR),
        "phase-shift, 4 steps": PhaseShift(PROJECTOR, x=Fringes((64.0, 8.0, 1.0))),
        "line-shift": LineShift(PROJECTOR),
    }
    for name, codec in codecs.items():
        frames = seen(codec, width, height)
        found = codec.decode(frames)
        ours, copy = least_seconds(lambda c=codec, f=frames: c.decode(f), 3), copying(bytes_of(frames, found))
        told = f"{1e3 * ours:.1f} ms, {ours / copy:.1f} times a copy"
        yield f"  {name}, {len(frames)} pictures, {len(found)} points: {told}"
        if name == "gray":
            plain, compiled = cells_in_numpy(codec, frames)
            yield f"  gray cells and margins in NumPy: {plain / compiled:.1f} times as long"
            yield from points(found, rig_of(width, height))


def points(found: Correspondences, rig: Rig) -> Iterator[str]:
    """Triangulating, beside a copy of its bytes and OpenCV's two views; and the search for company beside a tree."""
    cloud = triangulate(found, rig)
    ours = least_seconds(lambda: triangulate(found, rig), 3)
    copy = copying(len(found) * 4 * (2 + 2 + 2 + 3 + 3))
    some = found.select(np.arange(0, len(found), 16))
    pair = [np.ascontiguousarray(np.nan_to_num(a).T, dtype=np.float64) for a in (some.camera_xy, some.projector_xy)]
    views = [rig.camera.K @ np.eye(3, 4), rig.projector.K @ np.eye(3, 4)]
    theirs = 16 * least_seconds(lambda: cv2.triangulatePoints(*views, *pair), 2)
    told = f"{ours / copy:.1f} times a copy; cv2.triangulatePoints {theirs / ours:.1f} times as long"
    yield f"  triangulating with both lenses, sigma of {len(found)} points: {1e3 * ours:.1f} ms, {told}"
    cloud = cloud.select(cloud.finite)
    filters = Filters(residual=False, sigma=False, depth=False)
    company = least_seconds(lambda: filters.apply(cloud), 2)
    tree = least_seconds(lambda: KDTree(cloud.xyz).query(cloud.xyz, k=11, workers=-1), 1)
    yield f"  points without company: {1e3 * company:.1f} ms; a KDTree's neighbours {tree / company:.1f} times as long"


def whole_scan(width: int, height: int) -> Iterator[str]:
    """The whole command `slkit scan` beside reading the same PNGs on two threads."""
    codec = Gray(PROJECTOR)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for k, (name, picture) in enumerate(zip(codec.encode().names, seen(codec, width, height), strict=True)):
            write_png(root / f"{k:03d}_{name}.png", picture)
        text = f'codec = "gray"\nprojector = [{PROJECTOR[0]}, {PROJECTOR[1]}]\n'
        (root / "capture.toml").write_text(text, encoding="utf-8")
        slkit.write_rig(root / "rig.json", rig_of(width, height), {})
        files = sorted(root.glob("*.png"))

        def read() -> None:
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(read_image, files))

        program = "from slkit.cli import main; main()"
        command = [sys.executable, "-c", program, "scan", folder, "--rig", str(root / "rig.json"), "-o"]
        whole = least_seconds(lambda: subprocess.run([*command, str(root / "cloud.ply")], check=True, stdout=-3), 3)
        reading = least_seconds(read, 3)
        told = f"{whole:.2f} s, {whole / reading:.2f} times reading them ({reading:.2f} s)"
        yield f"slkit scan of {len(files)} PNGs of {width} x {height} px, with start and cloud: {told}"


def batches(captures: int = 24) -> Iterator[str]:
    """One and two workers on the same small captures, once each has warmed up."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        codec = Gray(PROJECTOR)
        pictures = list(seen(codec, 1024, 768))
        for c in range(captures):
            place = root / "captures" / f"{c:02d}"
            place.mkdir(parents=True)
            for k, picture in enumerate(pictures):
                write_png(place / f"{k:03d}.png", picture)
            text = f'codec = "gray"\nprojector = [{PROJECTOR[0]}, {PROJECTOR[1]}]\n'
            (place / "capture.toml").write_text(text, encoding="utf-8")
        recipe = jobs.Recipe(rig_of(1024, 768))
        rates = []
        for workers in (1, 2):
            with jobs.local_pool(workers) as pool:
                started = time.perf_counter()
                jobs.scan_all(str(root / "captures" / "*"), recipe, str(root / f"clouds{workers}"), pool)
                rates.append(captures / (time.perf_counter() - started))
        told = f"{rates[0]:.2f} captures a second with one worker, {rates[1] / rates[0]:.2f} times as many with two"
        yield f"slkit batch, {captures} captures of {len(pictures)} PNGs of 1024 x 768 px: {told}"


def others(path: Path) -> Iterator[str]:
    """What `bench_others.py` measured, from the file that pytest-benchmark wrote."""
    least: dict[str, dict[str, float]] = {}
    for one in json.loads(path.read_text(encoding="utf-8"))["benchmarks"]:
        by = one["name"].split("_by_")[1].split("[")[0]
        least.setdefault(one["group"], {})[by] = one["stats"]["min"]
    for group, seconds in least.items():
        ours = seconds.pop("slkit")
        for by, theirs in seconds.items():
            cameras = ", of two cameras" if by == "opencv" else ""
            told = f"{by} {1e3 * theirs:.0f} ms{cameras}, {theirs / ours:.1f} times as long"
            yield f"{group}: slkit {1e3 * ours:.1f} ms; {told}"


def page(path: Path, lines: list[str]) -> None:
    """Put lines between the marks of a page."""
    head, rest = path.read_text(encoding="utf-8").split(START)
    tail = rest.split(END)[1]
    text = "\n".join(["", "", "```text", *lines, "```", "", ""])
    path.write_text(head + START + text + END + tail, encoding="utf-8")


if __name__ == "__main__":
    large = "--large" in sys.argv
    sizes = [(1024, 768)] + ([(4096, 3000)] if large else [])
    told: list[str] = []
    parts = [*(decoders(*s) for s in sizes), *(whole_scan(*s) for s in sizes), batches()]
    if "--others" in sys.argv:
        parts.append(others(Path(sys.argv[sys.argv.index("--others") + 1])))
    for part in parts:
        for line in part:
            print(line, flush=True)
            told.append(line)
    if "--page" in sys.argv:
        page(Path(sys.argv[sys.argv.index("--page") + 1]), told)
