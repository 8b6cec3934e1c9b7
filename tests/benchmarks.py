"""Speeds as ratios within one run; `make bench` runs it. Each time is the least of several.

OPENBLAS_NUM_THREADS=1 python tests/benchmarks.py

Times are processor time: other programs of a busy machine do not count, threads that wait for each other would.
Pictures a second are by the clock.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import cv2
import numpy as np

from slkit.calibration.bundle import adjust
from slkit.calibration.model import Model
from slkit.codecs.color_stripes import ColorStripes
from slkit.data import BoardView, Frames
from slkit.geometry import Pinhole, Pose, Rig, homogeneous, intersect_plane
from slkit.simulation import Optics, SimulatedScanner, build
from slkit.targets import CornerMarks, ProjectedCheckerboard, grid
from slkit.triangulation import triangulate

VIEWS, CORNERS, SQUARE_MM, NOISE_PX = 30, (10, 10), 30.0, 0.1
LIMIT = 3.0
"""How many times as long as one cv2.calibrateCamera call the joint adjustment may take."""
BOARD = (grid(CORNERS) - 4.5) * SQUARE_MM
MARKS = CornerMarks(((-150, -150), (150, -150), (150, 150), (-150, 150)), 10).points()
PATTERN = ProjectedCheckerboard(CORNERS, (399.5, 199.5), 44.0).points()

Shares = list[tuple[np.ndarray, np.ndarray]]
"""What cv2.calibrateCamera gets: points (n, 2) mm on the board and pixels (n, 2) of every view."""


def least_seconds(work: Callable[[], object], times: int = 7) -> float:
    """Return the least processor time that a call takes."""
    seconds = []
    for _ in range(times):
        started = time.process_time()
        work()
        seconds.append(time.process_time() - started)
    return min(seconds)


def bench_rig() -> Rig:
    camera = Pinhole((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]], [-0.1, 0.05, 1e-3, -1e-3, 0])
    projector = Pinhole((1280, 800), [[1800, 0, 640], [0, 1800, 750], [0, 0, 1]], [-0.03, 0.02, 0, 0, 0])
    return Rig(camera, projector, Pose.from_rotation_vector([0, 0.3, 0], [-350, 0, 60]))


def drawn(rng: np.random.Generator) -> Pose:
    turn = rng.uniform(-0.5, 0.5, 3) * [1, 1, 0.3]
    return Pose.from_rotation_vector(turn, [*rng.uniform(-60, 60, 2), rng.uniform(800, 1100)])


def on(pose: Pose, board_xy: np.ndarray) -> np.ndarray:
    return pose.apply(np.pad(board_xy, ((0, 0), (0, 1))))


def decoded_view(rig: Rig, pose: Pose, rng: np.random.Generator) -> BoardView:
    """Return the view of a printed board under coded light: noise in both devices."""
    seen, lit = rig.camera.project(on(pose, BOARD)), rig.to_projector(on(pose, BOARD))
    noise = NOISE_PX * rng.normal(size=(2, *seen.shape))
    sigma = np.full_like(seen, NOISE_PX)
    return BoardView("decoded", rig.camera.size, BOARD, seen + noise[0], lit + noise[1], sigma)


def printed_view(rig: Rig, pose: Pose, rng: np.random.Generator) -> BoardView:
    """Return the view of side A of a two-sided board."""
    seen = rig.camera.project(on(pose, BOARD))
    silent = np.full_like(seen, np.nan)
    return BoardView("a", rig.camera.size, BOARD, seen + NOISE_PX * rng.normal(size=seen.shape), silent, silent)


def lit_places(rig: Rig, pose: Pose) -> np.ndarray:
    """Return where the corners of the projected pattern fall on the board, (n, 2) mm."""
    board = rig.projector_from_camera @ pose
    normal = board.rotation[:, 2]
    xyz = intersect_plane(homogeneous(rig.projector.normalize(PATTERN)), normal, float(normal @ board.translation))
    return board.inverse().apply(xyz)[:, :2]


def white_view(rig: Rig, pose: Pose, rng: np.random.Generator) -> BoardView:
    """Return the view of side B: four marks, and the corners of the projected pattern."""
    seen = rig.camera.project(on(pose, np.concatenate([MARKS, lit_places(rig, pose)])))
    board_xy, projector_xy = np.full_like(seen, np.nan), np.full_like(seen, np.nan)
    board_xy[: len(MARKS)], projector_xy[len(MARKS) :] = MARKS, PATTERN
    noisy = seen + NOISE_PX * rng.normal(size=seen.shape)
    return BoardView("b", rig.camera.size, board_xy, noisy, projector_xy, 0 * projector_xy)


def started_off(rig: Rig, poses: list[Pose], rng: np.random.Generator) -> tuple[Rig, list[Pose]]:
    """Return what a first guess is like: one per cent off in the lenses, millimetres and milliradians in the poses."""
    devices = [
        Pinhole(d.size, d.K * [[1.01, 1, 1.01], [1, 1.01, 1.01], [1, 1, 1]], np.zeros(5))
        for d in (rig.camera, rig.projector)
    ]
    moved = [Pose.from_rotation_vector(3e-3 * rng.normal(size=3), 3 * rng.normal(size=3)) @ p for p in poses]
    return Rig(*devices, rig.projector_from_camera), moved


def compare(
    title: str, rig: Rig, poses: list[Pose], views: Sequence[BoardView], camera: Shares, projector: Shares
) -> None:
    """Print the joint adjustment's time beside that of one cv2.calibrateCamera call on each device's share."""
    print(title)
    calls = {}
    for name, shares, size in (("camera", camera, rig.camera.size), ("projector", projector, rig.projector.size)):
        objects = [np.pad(board, ((0, 0), (0, 1))).astype(np.float32) for board, _ in shares]
        images = [pixels.astype(np.float32) for _, pixels in shares]
        call = partial(cv2.calibrateCamera, objects, images, size, None, None, flags=cv2.CALIB_FIX_K3)
        calls[name] = least_seconds(call)
        print(f"  cv2.calibrateCamera, {name}, {len(shares)} views: {1e3 * calls[name]:.0f} ms")
    rough, placed = started_off(rig, poses, np.random.default_rng(1))
    for loss in ("squares", "huber"):
        ours = least_seconds(partial(adjust, rough, placed, views, Model(loss=loss)))
        ratios = ", ".join(f"{ours / seconds:.1f} times the {name}'s call" for name, seconds in calls.items())
        print(f"  joint adjustment ({loss}), {len(views)} views: {1e3 * ours:.0f} ms, {ratios}; limit {LIMIT:g} times")


def decoded() -> None:
    """Coded light on a printed board: every view has both devices."""
    rig, rng = bench_rig(), np.random.default_rng(0)
    poses = [drawn(rng) for _ in range(VIEWS)]
    views = [decoded_view(rig, pose, rng) for pose in poses]
    camera, projector = ([(v.board_xy, getattr(v, xy)) for v in views] for xy in ("camera_xy", "projector_xy"))
    compare(f"decoded: {VIEWS} views of {len(BOARD)} corners", rig, poses, views, camera, projector)


def planar() -> None:
    """The two-sided board: half the views are side A, the other half marks and projected corners on side B."""
    rig, rng = bench_rig(), np.random.default_rng(0)
    poses, half = [drawn(rng) for _ in range(VIEWS)], VIEWS // 2
    views = [printed_view(rig, pose, rng) for pose in poses[:half]]
    views += [white_view(rig, pose, rng) for pose in poses[half:]]
    camera = [(v.board_xy, v.camera_xy) for v in views[:half]]
    # The places on the board carry the camera's noise in a calibration; for the time of a call that is all one.
    noise_mm = NOISE_PX * np.array([p.translation[2] for p in poses[half:]]) / rig.camera.K[0, 0]
    places = [
        lit_places(rig, p) + s * rng.normal(size=PATTERN.shape) for p, s in zip(poses[half:], noise_mm, strict=True)
    ]
    projector = [(xy, PATTERN) for xy in places]
    title = (
        f"planar: {half} views of {len(BOARD)} printed corners, {half} of 4 marks and {len(PATTERN)} projected corners"
    )
    compare(title, rig, poses, views, camera, projector)


def stripes() -> None:
    """A colour picture of the free-form object, 1280 x 960: what a frame costs beside the reading of its PNG."""
    rig = bench_rig()
    codec = ColorStripes(rig.projector.size)
    scanner = SimulatedScanner(build("free-form", rig), rig, Optics(color=True, read_noise=2.0, shot_noise=0.0))
    frames = Frames.of(list(scanner.capture(codec.encode())))
    found = codec.decode(frames)
    triangulate(found, rig)
    png = cv2.imencode(".png", frames[0])[1]
    reading = least_seconds(lambda: cv2.imdecode(png, cv2.IMREAD_UNCHANGED))
    decoding, points = least_seconds(lambda: codec.decode(frames)), least_seconds(lambda: triangulate(found, rig))
    print(f"color-stripes: {len(found)} points of {rig.camera.size[0]} x {rig.camera.size[1]} px")
    print(f"  decoding {decoding / reading:.1f}, triangulating {points / reading:.1f} times the decoding of its PNG")
    with ThreadPoolExecutor(2) as pool:
        started = time.perf_counter()
        list(pool.map(lambda _: triangulate(codec.decode(frames), rig), range(60)))
        print(f"  {60 / (time.perf_counter() - started):.1f} pictures a second on two threads, pictures in memory")


if __name__ == "__main__":
    decoded()
    planar()
    stripes()
