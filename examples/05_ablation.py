"""What each step of a calibration is worth: seven methods on the same poses of the same rig, points computed.

    python examples/05_ablation.py [--seeds N] [--tilt DEG] [--noise PX] [--json FILE]

A to C take the pose of side B from a small checkerboard in one corner, D to G from four marks at its corners. This rig
and these tilts are the second ones tried; with the first, of tests/calibration/synthetic.py, C came out below D. Their
order is not established: docs/methods/corner-board.md.
"""

import argparse
import json
from pathlib import Path

import numpy as np

import slkit
from slkit.calibration.corner_board import CornerBoard
from slkit.calibration.model import Model
from slkit.calibration.planar import Planar
from slkit.geometry import flat, homogeneous, intersect_plane
from slkit.report.measure import volume_error
from slkit.simulation import paper_rig
from slkit.targets import Checkerboard, CornerMarks, ProjectedCheckerboard
from slkit.triangulation import triangulate

SIZE, NEAR, FAR = (1024, 768), (420.0, 620.0), (1000.0, 1300.0)
DEPTHS_MM, SEQUENCE = np.linspace(*FAR, 5).tolist(), Model(refine=False)
SIDE_A, SMALL, PATTERN = Checkerboard((11, 8), 30), Checkerboard((7, 6), 25), ProjectedCheckerboard.for_projector(SIZE)
MARKS = CornerMarks(((-300, -200), (300, -200), (300, 200), (-300, 200)), 12)
CORNER, FOUR = (SIZE, SIDE_A, SMALL, PATTERN), (SIZE, SIDE_A, MARKS, PATTERN)
METHODS = {  # name: whether the pose comes from the small board, and the calibrator
    "A corner board as released": (True, CornerBoard(*CORNER, undistort=False, extrinsics="first-view")),
    "B undistorted": (True, CornerBoard(*CORNER, extrinsics="first-view")),
    "C and one projector pose": (True, CornerBoard(*CORNER, model=SEQUENCE)),
    # The steps of the corner board do not ask what gives the pose: here the marks do.
    "D marks, a pose a view": (False, CornerBoard(*CORNER, extrinsics="first-view")),
    "E marks, one pose: the paper": (False, Planar(*FOUR, SEQUENCE)),
    "F E, not undistorted": (False, CornerBoard(*CORNER, undistort=False)),
    "G joint adjustment": (False, Planar(*FOUR)),
}
COLUMNS = ("aligned_mm", "as_is_mm", "projector_px", "joint_px")


def drawn(rng: np.random.Generator, depths_mm: tuple[float, float], tilt_deg: float) -> slkit.Pose:
    """Return a random pose camera_from_board, tilted up to an angle about x and about y."""
    turn = np.radians(rng.uniform(-1, 1, 3) * [tilt_deg, tilt_deg, 10])
    return slkit.Pose.from_rotation_vector(turn, [rng.uniform(-30, 30), rng.uniform(-25, 25), rng.uniform(*depths_mm)])


def seen(rig: slkit.Rig, name: str, pose: slkit.Pose, printed: np.ndarray, lit: np.ndarray, noise: np.ndarray):
    """Return what the camera sees of a board: printed points (n, 2) mm, and projector pixels `lit` (m, 2) on it."""
    board = rig.projector_from_camera @ pose
    rays = homogeneous(rig.projector.normalize(lit))
    there = intersect_plane(rays, board.rotation[:, 2], float(board.rotation[:, 2] @ board.translation))
    xyz = [pose.apply(flat(printed)), rig.projector_from_camera.inverse().apply(there)]
    camera_xy = rig.camera.project(np.concatenate(xyz))
    board_xy, projector_xy = np.full_like(camera_xy, np.nan), np.full_like(camera_xy, np.nan)
    board_xy[: len(printed)], projector_xy[len(printed) :] = printed, lit
    camera_xy += noise[: len(camera_xy)]
    return slkit.BoardView(name, rig.camera.size, board_xy, camera_xy, projector_xy, 0 * projector_xy)


def views_of(rig: slkit.Rig, rng: np.random.Generator, noise_px: float, tilt_deg: float, poses: int = 10):
    """Return two sets of views that differ in what is printed on side B: the small board, or the marks."""
    noise, middle = noise_px * rng.normal(size=(12 + poses, 300, 2)), SIDE_A.points() - SIDE_A.points().mean(axis=0)
    side_a = [seen(rig, f"a{i}", drawn(rng, NEAR, 40), middle, np.empty((0, 2)), noise[i]) for i in range(12)]
    side_b = list(zip((drawn(rng, FAR, tilt_deg) for _ in range(poses)), noise[12:], strict=True))
    printed, lit = (SMALL.points() + [-275, -175], MARKS.points()), PATTERN.points()
    return [side_a + [seen(rig, f"b{i}", p, xy, lit, n) for i, (p, n) in enumerate(side_b)] for xy in printed]


def main(seeds: int = 16, noise_px: float = 0.1, tilt_deg: float = 30.0, rig: slkit.Rig | None = None) -> dict:
    """Print the table, means over the seeds, and return it; rig: default the paper's."""
    rig, table = rig or paper_rig(), {name: [] for name in METHODS}
    for seed in range(seeds):
        views = views_of(rig, np.random.default_rng(seed), noise_px, tilt_deg)
        for name, (corner, method) in METHODS.items():
            found = method.solve(views[not corner])
            error = volume_error(found.rig, rig, triangulate, DEPTHS_MM)
            table[name].append([error.aligned_mm, error.rms_mm, found.rms_projector, found.rms_joint])
    means = {name: dict(zip(COLUMNS, np.mean(rows, axis=0).tolist(), strict=True)) for name, rows in table.items()}
    print(f"{seeds} seeds, {noise_px} px of noise, tilt up to {tilt_deg} degrees")
    print(f"{'':30}" + "".join(f"{c:>14}" for c in COLUMNS))
    for name, row in means.items():
        print(f"{name:30}" + "".join(f"{row[c]:14.3f}" for c in COLUMNS))
    c, d = (np.array(table[name])[:, 0] for name in METHODS if name[0] in "CD")
    print(f"C - D: {(c - d).mean():.3f} mm, standard error {(c - d).std(ddof=1) / seeds**0.5:.3f}")
    return means


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for option, default in (("--seeds", 16), ("--tilt", 30.0), ("--noise", 0.1)):
        parser.add_argument(option, type=type(default), default=default)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    result = main(options.seeds, options.noise, options.tilt)
    if options.json:
        options.json.write_text(json.dumps(result, indent=1))
