"""The same work by slkit, in plain NumPy, by OpenCV, its contributed modules, and comimag's Fringes: pytest-benchmark.

`make bench` runs it and `make test` does not: the others bring an OpenCV of their own, and have an environment apart.
Every result is compared with the truth. A group is one piece of work; its times are the least of several rounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy_twins
import pytest
from bench_pictures import (
    LARGE,
    NOISE,
    PROJECTOR,
    SMALL,
    lines,
    lines_by_kernels,
    middle_of,
    pairs,
    rig_of,
    right,
    seen,
    seen_at,
    with_columns_only,
    within,
)

from slkit.codecs._cell_bits import BitRule, read_cells
from slkit.codecs._gray_code import CellCode
from slkit.codecs._masks import measure_light
from slkit.codecs.gray import Gray
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.data import Frames
from slkit.geometry import Rig
from slkit.triangulation import ray_plane, two_rays

PERIODS = (64.0, 8.0, 1.0)
PHASE = PhaseShift(PROJECTOR, x=Fringes(PERIODS, offset=-np.pi), references=False)
BOTH, COLUMNS = Gray(PROJECTOR, axes="both"), Gray(PROJECTOR)
GRAY_WORK, BOTH_WORK = "decoding Gray code, columns", "decoding Gray code, columns and rows"
CELLS_WORK = "cells of Gray code and their margins"
PHASE_WORK, LINES_WORK = "decoding phase shift, 3 sets of 4 steps", "lines of a picture, their centres and sigma"
PLANE_WORK, RAYS_WORK = "ray-plane, projector distortion, with sigma", "two rays, both lenses, with sigma"


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera, its rig and what it sees; pictures are drawn once for the tests that share them."""

    rig: Rig
    drawn: dict[str, Any]

    @property
    def size(self) -> tuple[int, int]:
        return self.rig.camera.size

    @property
    def true(self) -> np.ndarray:
        """The projector column (h, w) that each pixel sees."""
        return seen_at(self.rig)[0]

    def once(self, name: str, draw: Callable[[Rig], Any]) -> Any:
        if name not in self.drawn:
            # One set of large pictures at a time is enough.
            self.drawn.clear()
            self.drawn[name] = draw(self.rig)
        return self.drawn[name]

    def sees(self, codec: Any) -> Frames:
        return self.once(str(codec), partial(seen, codec))


@pytest.fixture(scope="module", params=[SMALL, LARGE], ids=lambda size: f"{size[0]}x{size[1]}")
def camera(request: Any) -> Camera:
    return Camera(rig_of(*request.param), {})


@pytest.fixture
def timed(benchmark: Any, camera: Camera) -> Callable[..., Any]:
    """Return a function that times work and gives its result.

    by: who does it; times: what the time is multiplied by, where only a part is done; asked: see `bench_table.Row`.
    """

    def run(group: str, by: str, work: Any, rounds: int = 5, times: float = 1, asked: str = "", warm: int = 1) -> Any:
        benchmark.group = f"{group}, {camera.size[0]} x {camera.size[1]}"
        benchmark.extra_info.update(by=by, times=times, asked=asked)
        return benchmark.pedantic(work, rounds=rounds, warmup_rounds=warm)

    return run


def test_gray_columns(timed, camera):
    frames = camera.sees(COLUMNS)
    found = timed(GRAY_WORK, "slkit", lambda: COLUMNS.decode(frames), 10)
    assert right(found, camera.rig)


def test_gray_columns_numpy(timed, camera):
    frames = list(camera.sees(COLUMNS))
    decode = partial(numpy_twins.gray_columns, frames, NOISE)
    assert right(timed(GRAY_WORK, "NumPy, noise given", decode, 3, asked="20"), camera.rig)


def test_gray_columns_bare(timed, camera):
    """What is left of the work where nobody asks how sure a cell is."""
    frames = list(camera.sees(COLUMNS))
    found = timed(GRAY_WORK, "NumPy, bare cells, no sigma or doubt", lambda: numpy_twins.gray_cells(frames), 3)
    assert within(found, camera.true)


def read(camera: Camera, *on_bit: Any) -> Callable[[], Any]:
    """Return work that reads the cells of every pixel; with a function for every bit, `read_cells` is plain NumPy."""
    frames = camera.sees(COLUMNS)
    images = dict(zip(frames.names, frames, strict=True))
    light = measure_light(images["white"], images["black"], COLUMNS.min_snr)
    rule = BitRule(COLUMNS.bit_snr, COLUMNS.min_contrast, robust=False)
    code = CellCode("x", PROJECTOR[0], COLUMNS.step, COLUMNS.inverse)
    return lambda: read_cells(code, images.__getitem__, light, rule, *on_bit)


def test_cells(timed, camera):
    assert within(timed(CELLS_WORK, "slkit", read(camera), 10).lo, camera.true, 2)


def test_cells_numpy(timed, camera):
    found = timed(CELLS_WORK, "NumPy", read(camera, lambda *_: None), 2, asked="20")
    assert within(found.lo, camera.true, 2)


def test_gray_both(timed, camera):
    frames = camera.sees(BOTH)
    found = timed(BOTH_WORK, "slkit", lambda: BOTH.decode(frames), 10)
    assert right(found, camera.rig)


def test_gray_both_opencv_map(timed, camera):
    """The only way in Python to the projector pixel of each camera pixel."""
    pattern = cv2.structured_light.GrayCodePattern_create(*PROJECTOR)
    assert all(np.array_equal(*both) for both in zip(pattern.generate()[1], list(BOTH.encode())[2:], strict=True))
    pictures = list(camera.sees(BOTH))[2:]
    (width, height), step = camera.size, 4 if camera.size == SMALL else 16
    rows, cols = range(step // 2, height, step), range(step // 2, width, step)

    def decode() -> np.ndarray:
        return np.array([[pattern.getProjPixel(pictures, x, y)[1][0] for x in cols] for y in rows])

    by = f"OpenCV GrayCodePattern.getProjPixel, 1 of {step * step} pixels"
    found = timed(BOTH_WORK, by, decode, 2, step * step, "100", 0)
    assert within(found, camera.true[rows.start :: step, cols.start :: step])


def test_gray_both_opencv_disparity(timed, camera):
    """Compiled throughout, but wants two cameras, and gives nothing but the disparity; the second one is moved."""
    pattern = cv2.structured_light.GrayCodePattern_create(*PROJECTOR)
    white, black, *pictures = camera.sees(BOTH)
    moved = [np.roll(picture, 7, axis=1) for picture in (white, black, *pictures)]

    def decode() -> Any:
        return pattern.decode([pictures, moved[2:]], None, [black, moved[1]], [white, moved[0]])

    by = "OpenCV GrayCodePattern.decode, half of two cameras"
    _, found = timed(BOTH_WORK, by, decode, 1, 0.5, "100", 0)
    told = middle_of(found)[middle_of(found) != 0]
    # It leaves out what lies on the border of two projector pixels.
    assert told.size > 0.8 * middle_of(found).size and (told == 7).mean() > 0.98


def test_phase(timed, camera):
    frames = camera.sees(PHASE)
    found = timed(PHASE_WORK, "slkit", lambda: PHASE.decode(frames), 10)
    assert right(found, camera.rig)


def test_phase_numpy(timed, camera):
    frames = list(camera.sees(PHASE))
    decode = partial(numpy_twins.phase_columns, frames, NOISE, PERIODS, -np.pi, PROJECTOR[0])
    assert right(timed(PHASE_WORK, "NumPy, noise given", decode, 3, asked="20"), camera.rig)


def test_phase_fringes(timed, camera):
    fringes = pytest.importorskip("fringes").Fringes()
    fringes.X, fringes.Y, fringes.D, fringes.K, fringes.N = *PROJECTOR, 1, len(PERIODS), 4
    fringes.v = list(PERIODS)
    # Ours are rounded elsewhere by one level.
    shown = zip(fringes.encode()[..., 0], PHASE.encode(), strict=True)
    assert all(np.abs(theirs - ours.astype(int)).max() <= 1 for theirs, ours in shown)
    pictures = np.stack(list(camera.sees(PHASE)))[..., None]
    found = timed(PHASE_WORK, "comimag Fringes.decode", lambda: fringes.decode(pictures), 3, asked="20")
    assert within(found.x[0, ..., 0], camera.true)


def test_lines(timed, camera):
    picture, variance, true = camera.once("lines", lines)
    row, col, *_ = timed(LINES_WORK, "slkit", lambda: lines_by_kernels(picture, variance, 1.0, 6.0), 10)
    assert np.quantile(np.abs(col - true(row, col)), 0.98) < 0.05


def test_lines_numpy(timed, camera):
    picture, variance, true = camera.once("lines", lines)
    scale, spacing = np.ones_like(picture), np.full_like(picture, 6)
    found = timed(LINES_WORK, "NumPy", lambda: numpy_twins.lines(picture, variance, scale, spacing), 2, asked="20")
    assert np.quantile(np.abs(found["col"] - true(found["row"], found["col"])), 0.98) < 0.05


def share_of(camera: Camera, by: str) -> tuple[int, str]:
    """Return which share of the points the slow ones are given, as their time grows with the number; and who does."""
    return (1, by) if camera.size == SMALL else (8, f"{by}, 1 of 8 points")


def test_ray_plane(timed, camera):
    found, xyz = camera.once("pairs", pairs)
    columns, rig = with_columns_only(found), camera.rig
    cloud = timed(PLANE_WORK, "slkit", lambda: ray_plane(columns, rig), 10)
    assert np.quantile(np.abs(cloud.xyz - xyz), 0.99) < 0.01


def test_ray_plane_numpy(timed, camera):
    found, xyz = camera.once("pairs", pairs)
    (share, by), rig = share_of(camera, "NumPy, without sigma"), camera.rig
    given = found.camera_xy[::share], found.projector_xy[::share, 0]
    ours = timed(PLANE_WORK, by, lambda: numpy_twins.ray_plane(*given, rig), 2, share, "20")
    assert np.quantile(np.abs(ours - xyz[::share]), 0.99) < 0.01


def test_two_rays(timed, camera):
    found, xyz = camera.once("pairs", pairs)
    cloud = timed(RAYS_WORK, "slkit", lambda: two_rays(found, camera.rig), 5)
    assert np.quantile(np.abs(cloud.xyz - xyz), 0.99) < 0.01


def test_two_rays_opencv(timed, camera):
    found, xyz = camera.once("pairs", pairs)
    (share, by), rig = share_of(camera, "cv2.undistortPoints, cv2.triangulatePoints"), camera.rig
    seen_xy, lit_xy = (a[::share].astype(np.float64)[:, None] for a in (found.camera_xy, found.projector_xy))
    pose = np.column_stack([rig.projector_from_camera.rotation, rig.projector_from_camera.translation])

    def triangulated() -> np.ndarray:
        camera_xy = cv2.undistortPoints(seen_xy, rig.camera.K, rig.camera.distortion).reshape(-1, 2)
        projector_xy = cv2.undistortPoints(lit_xy, rig.projector.K, rig.projector.distortion).reshape(-1, 2)
        points = cv2.triangulatePoints(np.eye(3, 4), pose, camera_xy.T, projector_xy.T)
        return (points[:3] / points[3]).T

    theirs = timed(RAYS_WORK, by, triangulated, 2, share, "100")
    assert np.quantile(np.abs(theirs - xyz[::share]), 0.99) < 0.1
