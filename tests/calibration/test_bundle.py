"""The joint adjustment: derivatives, exactness, weights, what it rejects, and the scatter that it predicts."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from slkit.calibration._hypotheses import Score
from slkit.calibration._residuals import block, len_shared, split
from slkit.calibration._state import State
from slkit.calibration.bundle import adjust
from slkit.calibration.local_homography import LocalHomography
from slkit.calibration.model import Lens, Model
from slkit.calibration.planar import Planar
from slkit.calibration.solve import board_pose
from slkit.calibration.surfaces import Sheet
from slkit.data import BoardView
from slkit.errors import InputError
from slkit.geometry import RIG_NAMES, Pose, Rig
from slkit.report.measure import volume_error
from slkit.targets import Checkerboard, ProjectedCheckerboard
from slkit.triangulation import triangulate

from . import synthetic

DEPTHS_MM = (1000.0, 1075.0, 1150.0, 1225.0, 1300.0)
PATTERN = ProjectedCheckerboard.for_projector((1024, 768))
BOTH = Lens(skew=True, distortion=("k1", "k2", "p1", "p2", "k3"))


def planar_views(rig: Rig, seed: int, noise_px: float, poses: int = 10) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    return synthetic.printed_views(rig, rng, 12, noise_px) + synthetic.white_views(rig, rng, poses, noise_px, PATTERN)


def planar(model: Model | None = None) -> Planar:
    return Planar((1024, 768), synthetic.PRINTED, synthetic.MARKS, PATTERN, model or Model())


def with_skew(rig: Rig, camera: float, projector: float) -> Rig:
    devices = []
    for device, skew in ((rig.camera, camera), (rig.projector, projector)):
        matrix = device.K.copy()
        matrix[0, 1] = skew
        devices.append(replace(device, K=matrix))
    return Rig(devices[0], devices[1], rig.projector_from_camera)


def poses_of(rig: Rig, views: list[BoardView]) -> list[Pose]:
    return [board_pose(rig.camera, v.board_xy[v.printed], v.camera_xy[v.printed])[0] for v in views]


def test_derivatives_agree_with_differences():
    """Every class of residuals over every parameter, with skew, bent boards and points out of place."""
    rng = np.random.default_rng(0)
    rig = with_skew(synthetic.paper_rig(rng), 1.0, 3.0)
    views = synthetic.printed_views(rig, rng, 2, 0.1) + synthetic.white_views(rig, rng, 2, 0.1, PATTERN)
    views += synthetic.coded_views(rig, rng, 2, 0.1)
    board = np.array([0, 0, 1, 1, 2, 2])
    parts, points = split(views, board.tolist())
    assert [p.name for p in parts] == ["printed", "marks", "projected", "decoded"]
    poses = poses_of(rig, views)
    state = State(
        rig,
        np.array([p.rotation for p in poses]),
        np.array([p.translation for p in poses]),
        tuple(replace(Sheet.flat(p), warp=3 * rng.normal(size=2)) for p in points),
        tuple(rng.normal(size=(len(p), 3)) for p in points),
    )
    shared, still = len_shared(state), np.zeros((len(views), 6))
    steps = np.where(np.isin(np.arange(shared), [*range(5, 10), *range(15, 23)]), 1e-6, 1e-3)
    for part in parts:
        found = block(part, state, board)

        def slope(step: np.ndarray, motions: np.ndarray, part=part) -> np.ndarray:
            ahead = block(part, state.moved(step, motions), board).error
            return (ahead - block(part, state.moved(-step, -motions), board).error) / 2

        for k in [*range(26), 26, 27, 28, 29, 30, 31, *rng.integers(32, shared, 6)]:
            step = np.where(np.arange(shared) == k, steps, 0)
            expected = slope(step, still) / steps[k]
            assert np.abs(expected - found.shared[:, :, k]).max() <= 1e-5 * max(np.abs(expected).max(), 1e-2)
        for k in range(6):
            motions = np.zeros((len(views), 6))
            motions[:, k] = 1e-6 if k < 3 else 1e-3
            expected = slope(np.zeros(shared), motions) / motions[0, k]
            assert np.abs(expected - found.pose[:, :, k]).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_exact_views_give_the_exact_rig_with_skew_and_every_coefficient(seed):
    rig = with_skew(synthetic.paper_rig(None if seed is None else np.random.default_rng(seed)), 1.5, 3.0)
    found = planar(Model(BOTH, BOTH)).solve(planar_views(rig, 5, 0.0)).rig
    for true, device in ((rig.camera, found.camera), (rig.projector, found.projector)):
        assert np.abs(device.K - true.K).max() < 1e-3
        assert np.abs(device.distortion - true.distortion).max() < 1e-4
    away = found.projector_from_camera.translation - rig.projector_from_camera.translation
    assert np.abs(away).max() < 1e-3


def test_joint_beats_the_sequence_on_the_papers_rig_and_on_random_ones():
    joint, sequence, drawn = [], [], []
    for seed in range(16):
        rig, views = synthetic.paper_rig(), planar_views(synthetic.paper_rig(), seed, 0.1)
        for errors, refine in ((joint, True), (sequence, False)):
            found = volume_error(planar(Model(refine=refine)).solve(views).rig, rig, triangulate, DEPTHS_MM)
            assert found.missing == 0
            errors.append(found.aligned_mm)
        rng = np.random.default_rng(1000 + seed)
        noise_px, poses = rng.uniform(0.05, 0.2), int(rng.integers(7, 15))
        rig = synthetic.paper_rig(rng)
        calibration = planar().solve(planar_views(rig, 2000 + seed, noise_px, poses))
        drawn.append(volume_error(calibration.rig, rig, triangulate, DEPTHS_MM).aligned_mm * 0.1 / noise_px)
    print(f"aligned 3D error, 16 seeds: sequence {np.mean(sequence):.3f}, joint {np.mean(joint):.3f} mm")
    print(f"rig, noise and poses at random, per 0.1 px of noise: joint {np.mean(drawn):.3f} mm")
    assert np.mean(joint) <= 0.11 < np.mean(sequence)
    assert np.mean(drawn) <= 0.12


def errors_of(found: Rig, rig: Rig) -> dict[str, float]:
    """Return what was found less the truth for every parameter of the rig; the pose as the motion in front of it."""
    a, b = found.projector_from_camera, rig.projector_from_camera
    turn = Pose(a.rotation @ b.rotation.T, np.zeros(3)).rotation_vector
    lenses = found.camera.parameters - rig.camera.parameters, found.projector.parameters - rig.projector.parameters
    return dict(zip(RIG_NAMES, np.concatenate([*lenses, turn, a.translation - b.translation]), strict=True))


def test_scatter_is_predicted_and_noise_recovered():
    """60 calibrations: observed against predicted 1 sigma of all 22 free parameters, and chi2 / dof a class."""
    rig, times = synthetic.paper_rig(), 60
    normalized, chi2 = [], []
    for seed in range(100, 100 + times):
        found = planar().solve(planar_views(rig, seed, 0.1, 8))
        names, error = found.covariance["parameters"], errors_of(found.rig, rig)
        free = [n for n in RIG_NAMES if n.split(".")[1] not in ("skew", "k3")]
        assert sorted(names) == sorted(free) and len(free) == 22
        normalized.append([error[n] for n in names] / np.sqrt(np.diag(found.covariance["matrix"])))
        chi2.append([(c.sigma_px / 0.1) ** 2 for c in found.classes.values()])
    spread = dict(zip(names, np.sqrt(np.mean(np.square(normalized), axis=0)), strict=True))
    together = np.sqrt(np.mean(np.square(normalized)))
    # The sum of the squares of one parameter has a chi-square distribution with a degree of freedom a calibration:
    # 99.9 % of all parameters lie between these bounds where the prediction is right.
    low, high = np.sqrt(scipy.stats.chi2.ppf([0.0005, 0.9995], times) / times)
    print("rms of error / sigma:", ", ".join(f"{n} {s:.2f}" for n, s in spread.items()))
    print(f"together {together:.3f}; bounds of one parameter {low:.2f} to {high:.2f}")
    print(f"chi2 / dof of printed, marks, projected: {np.round(np.mean(chi2, axis=0), 3)}")
    assert 0.85 < together < 1.15
    assert {n: s for n, s in spread.items() if not low < s < high} == {}
    assert np.all((np.mean(chi2, axis=0) > 0.9) & (np.mean(chi2, axis=0) < 1.1))


def test_skew_is_recovered_within_three_sigma():
    rig = with_skew(synthetic.paper_rig(), 0.0, 3.0)
    found = planar(Model(projector=Lens(skew=True))).solve(planar_views(rig, 3, 0.1))
    names = found.covariance["parameters"]
    sigma = np.sqrt(found.covariance["matrix"][(names.index("projector.skew"),) * 2])
    assert 0 < sigma < 1
    assert abs(found.rig.projector.K[0, 1] - 3) < 3 * sigma
    assert found.rig.camera.K[0, 1] == 0


def test_held_values_stay_and_priors_pull():
    rig, views = synthetic.paper_rig(), planar_views(synthetic.paper_rig(), 3, 0.1)
    lens = Lens(("k1",), aspect=1.003, principal_point=(512.0, 830.0))
    held = planar(Model(projector=lens)).solve(views).rig.projector
    assert held.K[1, 1] / held.K[0, 0] == pytest.approx(1.003, abs=1e-12)
    assert tuple(held.K[:2, 2]) == (512, 830)
    assert held.distortion[0] != 0 and not held.distortion[1:].any()
    priors = Lens(throw_ratio=(1900 / 1024 * 1.02, 1e-5), offset=((835 - 383.5) / 384, 1e-5))
    pulled = planar(Model(projector=priors)).solve(views).rig.projector
    assert pulled.K[0, 0] == pytest.approx(1900 * 1.02, abs=0.1)
    assert pulled.K[1, 2] == pytest.approx(835, abs=0.1)
    weak = Lens(throw_ratio=(1900 / 1024 * 1.02, 1.0), offset=((835 - 383.5) / 384, 1.0))
    assert abs(planar(Model(projector=weak)).solve(views).rig.projector.K[0, 0] - rig.projector.K[0, 0]) < 5


def test_a_corner_and_a_view_that_are_wrong_are_rejected_and_told():
    views = planar_views(synthetic.paper_rig(), 4, 0.1)
    wrong = views[3].camera_xy.copy()
    wrong[17] += (3.0, -2.0)
    views[3] = replace(views[3], camera_xy=wrong)
    moved = views[-1].camera_xy.copy()
    moved[views[-1].projected] += (4.0, 1.5)
    views[-1] = replace(views[-1], camera_xy=moved)
    found = planar().solve(views)
    by_name = {v.name: v for v in found.views}
    assert not by_name[views[3].name].kept[17] and by_name[views[3].name].kept.sum() == len(wrong) - 1
    assert "1 of 88 points" in by_name[views[3].name].reason
    assert not by_name[views[-1].name].used
    assert "times as far" in by_name[views[-1].name].reason
    clean = planar().solve([v for v in views if v is not views[-1]])
    assert np.abs(found.rig.projector.K - clean.rig.projector.K).max() < 1e-2
    assert found.classes["printed"].rejected >= 1
    everything = planar(Model(loss="squares")).solve(views)
    assert all(v.used and v.kept.all() for v in everything.views)


def test_clean_views_lose_no_view_and_hardly_a_corner():
    lost = 0
    for seed in range(20):
        found = planar().solve(planar_views(synthetic.paper_rig(np.random.default_rng(seed)), seed, 0.1))
        assert all(v.used for v in found.views)
        lost += sum(c.rejected for c in found.classes.values())
    # One row in a hundred captures and class is what the test allows: 0.6 on average.
    assert lost <= 4


def bent(views: list[BoardView], rig: Rig, warp: tuple[float, float], board: np.ndarray) -> list[BoardView]:
    """Coded views of a board bent by `warp`, without noise."""
    sheet = replace(Sheet.flat(board), warp=np.array(warp))
    xyz = sheet.place(board, np.zeros(len(board), dtype=np.intp))
    result = []
    for view, pose in zip(views, poses_of(rig, views), strict=True):
        points = pose.apply(xyz)
        result.append(replace(view, camera_xy=rig.camera.project(points), projector_xy=rig.to_projector(points)))
    return result


def test_a_bent_board_is_measured_and_no_longer_bends_the_rig():
    rig = synthetic.paper_rig()
    flat = synthetic.coded_views(rig, np.random.default_rng(2), 6, 0.0)
    views = bent(flat, rig, (2.0, -1.0), flat[0].board_xy)
    board = Checkerboard((9, 7), 40.0)
    stiff = LocalHomography((1024, 768), board).solve(views)
    found = LocalHomography((1024, 768), board, model=Model(warp=True)).solve(views)
    assert found.rms_joint < 1e-3 < 0.1 < stiff.rms_joint
    assert np.abs(found.rig.projector.K - rig.projector.K).max() < 1e-2
    names = found.covariance["parameters"]
    assert "board0.warp_x" in names and "board0.warp_y" in names


def test_points_that_are_printed_wrong_are_released():
    rig, rng = synthetic.paper_rig(), np.random.default_rng(6)
    views = synthetic.coded_views(rig, rng, 8, 0.0)
    shift = np.column_stack([rng.normal(scale=0.4, size=(63, 2)), np.zeros(63)])
    moved = []
    for view, pose in zip(views, poses_of(rig, views), strict=True):
        xyz = pose.apply(np.column_stack([view.board_xy, np.zeros(63)]) + shift)
        moved.append(replace(view, camera_xy=rig.camera.project(xyz), projector_xy=rig.to_projector(xyz)))
    board = Checkerboard((9, 7), 40.0)
    held = LocalHomography((1024, 768), board).solve(moved)
    free = LocalHomography((1024, 768), board, model=Model(release_mm=0.5)).solve(moved)
    assert free.rms_joint < 0.02 < 0.2 < held.rms_joint
    # The scale of the board is held by the mean of its points alone: 0.4 mm each over 63 points of a 320 mm board.
    assert free.rig.projector.K[0, 0] == pytest.approx(rig.projector.K[0, 0], rel=2e-3)


def test_a_model_that_cannot_be_is_refused():
    for change in ({"distortion": ("k4",)}, {"aspect": 0.0}, {"throw_ratio": (1.5, 0.0)}, {"offset": (1.0, -1.0)}):
        with pytest.raises(InputError):
            Lens(**change)
    with pytest.raises(InputError, match="release_mm"):
        Model(release_mm=0.0)


def test_too_few_rows_leave_no_covariance_but_do_not_fail():
    rig = synthetic.paper_rig()
    views = synthetic.coded_views(rig, np.random.default_rng(2), 3, 0.1)
    found = adjust(rig, poses_of(rig, views), views, Model())
    assert np.isfinite(found.covariance).all()
    assert (np.diag(found.covariance) > 0).all()


def chances(views: list[BoardView]) -> list[dict[str, float]]:
    """Return per view of `planar_views` and class how likely noise makes its residuals so large."""
    boards = [int(v.projected.any()) for v in views]
    poses = poses_of(synthetic.paper_rig(), views)
    score = Score(adjust(synthetic.paper_rig(), poses, views, Model(loss="squares"), boards))
    own = (("printed",), ("marks", "projected"))
    return [{name: score.by_chance(i, name) for name in own[board]} for i, board in enumerate(boards)]


def test_residuals_of_noise_are_likely_in_every_view():
    found: dict[str, list[float]] = {"printed": [], "marks": [], "projected": []}
    for seed in range(6):
        for of_view in chances(planar_views(synthetic.paper_rig(), seed, 0.1)):
            for name, chance in of_view.items():
                found[name].append(chance)
    for name, values in found.items():
        assert np.mean(np.array(values) > 1e-3) > 0.99, name
        spread = np.quantile(values, [0.1, 0.5, 0.9])
        assert (np.abs(spread - [0.1, 0.5, 0.9]) < 0.15).all(), (name, spread)


@pytest.mark.parametrize(("view", "name"), [(3, "printed"), (15, "projected")])
def test_a_view_of_five_times_the_noise_is_no_chance(view: int, name: str):
    for seed in range(2):
        views = planar_views(synthetic.paper_rig(), seed, 0.1)
        views[view] = planar_views(synthetic.paper_rig(), seed, 0.5)[view]
        found = chances(views)
        assert found[view][name] < 1e-6
        assert all(of_view.get(name, 1) > 1e-3 for i, of_view in enumerate(found) if i != view)
