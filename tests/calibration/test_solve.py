from functools import partial

import numpy as np
import pytest

from slkit.calibration.model import Model
from slkit.calibration.planar import Planar
from slkit.calibration.solve import board_pose, linear_projector, solve_projector
from slkit.errors import CalibrationError, InputError
from slkit.geometry import Pinhole, Pose, Rig
from slkit.report.measure import volume_error
from slkit.targets import ProjectedCheckerboard
from slkit.triangulation import triangulate

from . import synthetic

DEPTHS_MM = (1000.0, 1075.0, 1150.0, 1225.0, 1300.0)
PATTERN = ProjectedCheckerboard.for_projector((1024, 768))
rigs = pytest.mark.parametrize("seed", [None, 1, 2, 3], ids=["paper", "random-1", "random-2", "random-3"])


def rig_of(seed: int | None) -> Rig:
    return synthetic.paper_rig(None if seed is None else np.random.default_rng(seed))


def solved(rig: Rig, seed: int, noise_px: float, poses: int = 10, refine: bool = False):
    rng = np.random.default_rng(seed)
    views = synthetic.printed_views(rig, rng, 12, noise_px)
    views += synthetic.white_views(rig, rng, poses, noise_px, PATTERN)
    return Planar((1024, 768), synthetic.PRINTED, synthetic.MARKS, PATTERN, Model(refine=refine)).solve(views)


@rigs
def test_planar_is_exact_without_noise(seed):
    rig = rig_of(seed)
    result = solved(rig, 5, 0.0)
    assert result.rms_joint < 1e-5
    assert np.abs(result.rig.projector.K - rig.projector.K).max() < 1e-3
    assert np.abs(result.rig.projector.distortion - rig.projector.distortion).max() < 1e-5
    assert np.abs(result.rig.projector_from_camera.translation - rig.projector_from_camera.translation).max() < 1e-3


def aligned_error(rig: Rig, seed: int, noise_px: float, poses: int) -> float:
    found = volume_error(solved(rig, seed, noise_px, poses).rig, rig, triangulate, DEPTHS_MM)
    assert found.missing == 0
    return found.aligned_mm


def test_planar_error_in_the_working_volume_of_the_papers_rig():
    errors = [aligned_error(rig_of(None), seed, 0.1, 10) for seed in range(16)]
    print(f"aligned 3D error at 0.1 px, 10 poses, 16 seeds: mean {np.mean(errors):.3f} mm, worst {max(errors):.3f} mm")
    assert np.mean(errors) <= 0.18


def test_planar_error_in_the_working_volume_of_random_rigs():
    """Rigs of `synthetic.paper_rig(rng)`, noise of 0.05 to 0.2 px, 7 to 14 poses; the error per 0.1 px of noise."""
    errors = []
    for seed in range(16):
        rng = np.random.default_rng(1000 + seed)
        noise_px, poses = rng.uniform(0.05, 0.2), int(rng.integers(7, 15))
        errors.append(aligned_error(synthetic.paper_rig(rng), seed, noise_px, poses) * 0.1 / noise_px)
    print(f"drawn at random, per 0.1 px of noise: mean {np.mean(errors):.3f} mm, worst {max(errors):.3f} mm")
    assert np.mean(errors) <= 0.18


def test_two_views_of_each_side_suffice_for_the_solver():
    rig = rig_of(None)
    rng = np.random.default_rng(0)
    views = synthetic.printed_views(rig, rng, 2, 0.0) + synthetic.white_views(rig, rng, 2, 0.0, PATTERN)
    planar = Planar((1024, 768), synthetic.PRINTED, synthetic.MARKS, PATTERN)
    assert np.abs(planar.solve(views).rig.projector.K - rig.projector.K).max() < 0.1
    with pytest.raises(CalibrationError, match="side B"):
        planar.solve(views[:3])


def points_in_space(rig: Rig, rng: np.random.Generator, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    xyz = np.array([0, -140, 1130]) + rng.uniform(-150, 150, (count, 3))
    return xyz, rig.to_projector(xyz)


@rigs
def test_linear_projector_finds_a_principal_point_outside_the_image(seed):
    rig = rig_of(seed)
    lens = Pinhole(rig.projector.size, rig.projector.K, np.zeros(5))
    rig = Rig(rig.camera, lens, rig.projector_from_camera)
    xyz, pixels = points_in_space(rig, np.random.default_rng(1))
    found = linear_projector(xyz, pixels, (1024, 768))
    assert lens.K[1, 2] > 740
    assert np.abs(found.projector.K - lens.K).max() < 1e-4
    assert np.abs(found.projector_from_camera.rotation - rig.projector_from_camera.rotation).max() < 1e-8


def test_solve_projector_leaves_out_rows_with_nan():
    rig = rig_of(None)
    xyz, pixels = points_in_space(rig, np.random.default_rng(1))
    pixels[::7] = np.nan
    found = solve_projector(xyz, pixels, (1024, 768), ("k1", "k2", "p1", "p2"))
    assert found.rms < 1e-6
    assert np.isfinite(pixels[:, 0]).sum() == len(found.residual_xy)
    assert np.abs(found.projector.K - rig.projector.K).max() < 1e-3


def test_solve_projector_covariance_predicts_the_scatter():
    rig = rig_of(None)
    xyz, pixels = points_in_space(rig, np.random.default_rng(1), 300)
    rng = np.random.default_rng(2)
    fit = partial(solve_projector, xyz, size=(1024, 768), distortion=("k1", "k2", "p1", "p2"))
    found = [fit(projector_xy=pixels + 0.2 * rng.normal(size=pixels.shape)) for _ in range(60)]
    scatter = np.std([[f.projector.K[0, 0], f.projector.K[1, 2]] for f in found], axis=0)
    names = found[0].parameters
    predicted = np.mean([np.sqrt(np.diag(f.covariance)) for f in found], axis=0)
    expected = predicted[[names.index("projector.fx"), names.index("projector.cy")]]
    assert np.all(np.abs(scatter / expected - 1) < 0.3), (scatter, expected)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda xyz, px: (xyz[:7], px[:7]), CalibrationError, "eight points"),
        (lambda xyz, px: (xyz * [1, 1, 0] + [0, 0, 1000], px), CalibrationError, "one plane"),
        (lambda xyz, px: (xyz, px * [-1, 1]), CalibrationError, "mirrored"),
        (lambda xyz, px: (xyz, px[:-1]), InputError, "199"),
    ],
)
def test_solve_projector_refuses_what_determines_no_projector(change, error, words):
    xyz, pixels = change(*points_in_space(rig_of(None), np.random.default_rng(1)))
    with pytest.raises(error, match=words):
        solve_projector(xyz, pixels, (1024, 768))


def test_distortion_names_are_checked():
    xyz, pixels = points_in_space(rig_of(None), np.random.default_rng(1))
    with pytest.raises(InputError, match="k4"):
        solve_projector(xyz, pixels, (1024, 768), ("k4",))


def test_planar_correspondences_reach_the_published_points(captures):
    """980 real correspondences: RMS, principal point below the image, and leave-one-pose-out error."""
    held = np.load(captures("planar_correspondences") / "projected_corners.npz", allow_pickle=False)
    xyz, pixels = held["camera_xyz_mm"], held["projector_xy"]
    fit = solve_projector(xyz, pixels, (1024, 768), ("k1", "k2"))
    left_out = []
    for i in range(len(xyz)):
        others = np.arange(len(xyz)) != i
        part = solve_projector(xyz[others], pixels[others], (1024, 768), ("k1", "k2"))
        left_out.append(part.projector.project(part.projector_from_camera.apply(xyz[i])) - pixels[i])
    out_rms = float(np.sqrt((np.concatenate(left_out) ** 2).sum(axis=1).mean()))
    print(f"RMS {fit.rms:.3f} px, cy {fit.projector.K[1, 2]:.1f}, leave-one-pose-out {out_rms:.3f} px")
    assert fit.rms <= 0.55
    assert abs(fit.projector.K[1, 2] - 925) <= 5
    assert out_rms <= 0.62


def test_board_pose_keeps_the_better_solution_and_tells_an_ambiguous_one():
    camera = rig_of(None).camera
    board = synthetic.MARKS.points()
    tilted = Pose.from_rotation_vector([0.5, 0.3, 0.1], [20, -30, 1100])
    seen = camera.project(tilted.apply(np.pad(board, ((0, 0), (0, 1)))))
    pose, error, ratio = board_pose(camera, board, seen)
    assert np.abs(pose.rotation - tilted.rotation).max() < 1e-6
    assert error < 1e-5
    assert ratio > 10
    # A small board far away is nearly orthographic: its mirror solution fits almost as well under a little noise.
    far = Pose.from_rotation_vector([0.25, 0, 0], [0, 0, 30000])
    noisy = camera.project(far.apply(np.pad(board, ((0, 0), (0, 1))))) + np.random.default_rng(0).normal(size=(4, 2))
    assert board_pose(camera, board, noisy)[2] < 3


def test_planar_covariance_predicts_the_scatter_of_the_whole_rig():
    """24 calibrations of one rig: the spread of camera and projector against what each says of itself."""
    rig = rig_of(None)
    found = [solved(rig, 300 + seed, 0.1, 8) for seed in range(24)]
    names = found[0].covariance["parameters"]
    chosen = [names.index(n) for n in ("camera.fx", "camera.cx", "projector.fx", "projector.fy", "projector.cy")]
    truth = [rig.camera.K[0, 0], rig.camera.K[0, 2], *(rig.projector.K[i] for i in ((0, 0), (1, 1), (1, 2)))]
    normalized = []
    for result in found:
        c, p = result.rig.camera.K, result.rig.projector.K
        error = np.array([c[0, 0], c[0, 2], p[0, 0], p[1, 1], p[1, 2]]) - truth
        normalized.append(error / np.sqrt(np.diag(result.covariance["matrix"]))[chosen])
    spread = np.sqrt(np.mean(np.square(normalized), axis=0))
    print(f"rms of error / sigma over 24 rigs: {np.round(spread, 2)}")
    assert np.all((spread > 0.6) & (spread < 1.5)), spread
