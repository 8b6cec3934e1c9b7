import dataclasses
from dataclasses import replace

import cv2
import numpy as np
import pytest

from slkit.calibration._exchanged import compare, exchange_findings, mark_shifts, motion_finding
from slkit.calibration._exposure import exposure_findings, look_at, noise_of
from slkit.calibration._numbers import cell_ratio, continues, corners_finding, count_corners, marks_finding
from slkit.calibration._observe import observe_printed
from slkit.calibration._panel import panel_finding, panel_size
from slkit.calibration._ripple import Flatness, code_findings, flatness, ripple
from slkit.calibration.detect import to_8bit
from slkit.calibration.marks import find_marks
from slkit.calibration.pictures import common_size, orientation_findings, picture_findings
from slkit.data import BoardView, Capture, Correspondences
from slkit.files import read_image, read_rig
from slkit.targets import Checkerboard, CornerMarks

BOARD = Checkerboard((8, 6), 10.0)
MARKS = CornerMarks(((-60.0, -40.0), (60.0, -40.0), (60.0, 40.0), (-60.0, 40.0)), 6.0)
SCALE, SHIFT = 2.0, np.array([160.0, 120.0])


def picture(target, rng=None, sigma=1.0, level=200.0, blur=1.0, shift=(0.0, 0.0)) -> np.ndarray:
    """What a camera 2 px a mm sees of a target whose origin is at pixel (160, 120)."""
    xy = np.stack(np.meshgrid(np.arange(320), np.arange(240)), axis=-1)
    levels = level * target.reflectance((xy - SHIFT - shift) / SCALE, 1 / SCALE)
    if blur:
        levels = cv2.GaussianBlur(levels, (0, 0), blur)
    if rng is not None:
        levels = levels + sigma * rng.normal(size=levels.shape)
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def centred(board: Checkerboard):
    """A checkerboard whose middle is the origin."""

    class Centred:
        def reflectance(self, xy, footprint_mm):
            return board.reflectance(xy + board.points().mean(axis=0), footprint_mm)

    return Centred()


def corners_px(board: Checkerboard = BOARD) -> np.ndarray:
    return (board.points() - board.points().mean(axis=0)) * SCALE + SHIFT


def view(name: str, camera_xy, projector_xy=None, board_xy=None, problem=None) -> BoardView:
    silent = np.full_like(camera_xy, np.nan)
    return BoardView(
        name,
        (320, 240),
        silent if board_xy is None else board_xy,
        camera_xy,
        silent if projector_xy is None else projector_xy,
        silent,
        problem,
    )


def test_edges_noise_and_contrast_are_measured(rng: np.random.Generator):
    for blur in (1.0, 2.0, 3.0):
        look = look_at("a", "printed", picture(centred(BOARD), rng, 1.5, blur=blur), corners_px(), 255)
        assert look.edge_px == pytest.approx(np.hypot(blur, 0.29), rel=0.12)
        assert look.noise == pytest.approx(1.5, rel=0.15)
        assert 200 * 0.84 * (0.8 if blur > 2 else 0.9) < look.contrast < 200 * 0.84 * 1.1
        assert look.square_px == pytest.approx(20, abs=0.1)
    assert noise_of(np.full((50, 50), 100, np.float32)) == 0.29


def test_bad_light_and_bad_focus_are_told(rng: np.random.Generator):
    looks = [
        look_at(name, "printed", picture(centred(BOARD), rng, level=level, blur=blur), corners_px(), 255)
        for name, level, blur in (
            ("good", 200, 0.8),
            ("fine", 180, 0.8),
            ("bright", 500, 0.8),
            ("dark", 12, 0.8),
            ("soft", 200, 2.5),
        )
    ]
    found = [(f.view, f.code) for f in exposure_findings(looks)]
    assert found == [("bright", "saturated"), ("dark", "under-exposed"), ("soft", "blurred")]


def test_all_pictures_blurred(rng: np.random.Generator):
    looks = [look_at(n, "printed", picture(centred(BOARD), rng, blur=3.0), corners_px(), 255) for n in "abc"]
    assert [f.code for f in exposure_findings(looks)] == ["blurred"] * 3


def test_exchanged_stale_and_mixed_pictures(rng: np.random.Generator):
    white = np.clip(150 + rng.normal(0, 1, (240, 320)), 0, 255).astype(np.uint8)
    pattern = picture(centred(BOARD), rng, level=165.0)
    mixed = ((white.astype(int) + pattern) // 2).astype(np.uint8)
    pairs = [compare(n, white, pattern) for n in "abc"]
    assert exchange_findings(pairs) == []
    pairs += [compare("swapped", pattern, white), compare("stale", white, white), compare("mixed", white, mixed)]
    found = {f.view: f.code for f in exchange_findings(pairs)}
    assert found == {"swapped": "swapped-pictures", "stale": "stale-frame", "mixed": "stale-frame"}


@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.5, -1.25), (-9.0, 6.0)])
def test_marks_that_moved_between_two_pictures(rng: np.random.Generator, shift: tuple[float, float]):
    white, later = picture(MARKS, rng), picture(MARKS, rng, level=60.0, shift=shift)
    marks = MARKS.points() * SCALE + SHIFT
    shifts = mark_shifts(white.astype(np.float32), later.astype(np.float32), marks, 12.0)
    assert len(shifts) == 4
    np.testing.assert_allclose(shifts, np.tile(shift, (4, 1)), atol=0.1)
    found = motion_finding("v", white, later, marks, 12.0)
    assert [f.code for f in found] == (["moved-board"] if any(shift) else [])


def test_marks_of_another_size_than_told(rng: np.random.Generator):
    white, marks = picture(MARKS, rng, blur=0.7), MARKS.points() * SCALE + SHIFT
    for factor in (0.6, 1.0, 1.2, 1.8):
        ratio = cell_ratio(white, marks, MARKS.points(), MARKS.cell_mm / factor)
        assert ratio == pytest.approx(factor, rel=0.03)
        assert bool(marks_finding([ratio] * 3)) == (factor != 1)
    assert marks_finding([]) == [] and marks_finding([np.nan]) == []


def test_a_checkerboard_that_goes_on_is_noticed(rng: np.random.Generator):
    seen, points = picture(centred(BOARD), rng), corners_px()
    places = np.rint(BOARD.points() / BOARD.square_mm)
    assert not continues(seen, points, places)
    for part in (places[:, 0] < 7, places[:, 0] > 0, places[:, 1] < 5, places[:, 1] > 0):
        assert continues(seen, points[part], places[part])


@pytest.mark.parametrize("told", [(7, 6), (8, 7), (9, 6), (8, 5), (10, 8), (6, 8)])
def test_corners_are_counted(rng: np.random.Generator, told: tuple[int, int]):
    there = count_corners([picture(centred(BOARD), rng)] * 2, told)
    assert there is not None and sorted(there) == [6, 8]
    assert len(corners_finding(there, told, "printed")) == (sorted(told) != [6, 8])
    assert corners_finding(None, told, "printed") == []


def test_pictures_of_another_size_or_turned():
    def capture(name: str, shape: tuple[int, int]) -> Capture:
        return Capture(name, printed=np.zeros(shape, np.uint8))

    captures = [capture("odd", (320, 240)), *(capture(n, (240, 320)) for n in "abc"), capture("small", (120, 160))]
    size, found = common_size(captures)
    assert size == (320, 240)
    assert [(f.view, f.code) for f in found] == [("odd", "exif-rotated"), ("small", "other-size")]
    assert common_size([]) == ((1, 1), [])


def test_mirrored_and_turned_light():
    camera_xy = corners_px()
    for matrix, codes in (
        (np.diag([2.0, 2.1]), []),
        (np.diag([-2.0, 2.1]), ["mirrored"]),
        (np.diag([2.0, -2.1]), ["mirrored"]),
        (-2 * np.eye(2), ["turned"]),
        (np.array([[0.2, -2.0], [2.0, 0.1]]), ["turned"]),
        (2 * np.array([[0.9, -0.4], [0.4, 0.9]]), []),
    ):
        views = [view(n, camera_xy, camera_xy @ matrix.T) for n in "ab"]
        assert [f.code for f in orientation_findings(views)] == codes
    assert orientation_findings([view("a", camera_xy)]) == []


def decoded(rng: np.random.Generator, wave_px: float = 0.0, wrong: float = 0.0) -> Correspondences:
    """What phase shift with a sigma of 0.05 px says of every pixel of a tilted board, with a wave of 5.3 px."""
    camera_xy = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), axis=-1).reshape(-1, 2)
    x, y = camera_xy.T
    exact = np.stack([1.9 * x + 0.1 * y, 2.1 * y - 0.1 * x], axis=1) / (1 + 1e-4 * x)[:, None] + 40
    noise = 0.05 * rng.normal(size=exact.shape) + wave_px * np.sin(2 * np.pi * exact / 5.3)
    noise[rng.random(len(noise)) < wrong] += 16
    count = len(camera_xy)
    return Correspondences(camera_xy, exact + noise, np.full((count, 2), 0.05), np.ones(count), np.ones((count, 3)))


def test_a_part_of_the_board_that_is_lit_and_has_no_code_is_told():
    found = decoded(np.random.default_rng(1))
    corners = corners_px()
    left = corners[:, 0] < np.median(corners[:, 0])
    known = found.camera_xy[:, 0] > np.median(corners[:, 0])
    half = Correspondences(*(getattr(found, f.name)[known] for f in dataclasses.fields(Correspondences)))
    whole = flatness("whole", corners, 9.0, found, np.ones(len(corners), dtype=bool))
    assert code_findings([whole, flatness("v", corners, 9.0, half, ~left)]) == []
    told = code_findings([whole, flatness("v", corners, 9.0, half, np.ones(len(corners), dtype=bool))])
    assert [(f.code, f.view) for f in told] == [("stale-frame", "v")]


def test_a_ripple_is_measured_and_blamed(rng: np.random.Generator):
    def maps(*waves: float) -> list[Flatness]:
        return [flatness(f"v{i}", corners_px(), 9.0, decoded(rng, wave)) for i, wave in enumerate(waves)]

    wave = ripple(maps(0.2, 0.2), 0)
    assert wave.amplitude == pytest.approx(0.2, rel=0.1)
    assert wave.period == pytest.approx(5.3, rel=0.02)
    assert [(f.code, f.view) for f in code_findings(maps(0.2, 0.25, 0.2))] == [("gamma", "")]
    assert [(f.code, f.view) for f in code_findings(maps(0.0, 0.25, 0.0))] == [("stale-frame", "v1")]
    assert code_findings(maps(0.0, 0.0, 0.02)) == []
    assert code_findings([]) == []


def test_pixels_that_contradict_their_neighbours(rng: np.random.Generator):
    maps = [flatness(n, corners_px(), 9.0, decoded(rng, wrong=w)) for n, w in (("a", 0.0), ("b", 0.3), ("c", 0.02))]
    assert maps[0].agreeing > 0.99 and maps[1].agreeing == pytest.approx(0.7, abs=0.03)
    half = decoded(rng).select(rng.random(320 * 240) < 0.3)
    maps.append(flatness("d", corners_px(), 9.0, half))
    assert [(f.code, f.view) for f in code_findings(maps)] == [("stale-frame", "b"), ("stale-frame", "d")]


def test_findings_of_a_capture_are_told_once_a_view(rng: np.random.Generator):
    class Calibrator:
        printed = Checkerboard((8, 6), 10.0)

    captures = [Capture(n, printed=picture(centred(BOARD), rng, level=v)) for n, v in (("a", 200), ("b", 12))]
    views = [view(c.name, corners_px(), board_xy=BOARD.points()) for c in captures]
    assert [(f.code, f.view) for f in picture_findings(captures, views, Calibrator())] == [("under-exposed", "b")]
    assert picture_findings([], [], Calibrator()) == ()


def test_a_mistyped_square_shows_in_the_outline_of_the_panel(captures):
    folder = captures("planar_capture")
    camera = read_rig(folder / "truth" / "rig.json").camera
    printed, corners = Checkerboard((11, 8), 30.0), ((-185, -125), (185, -125), (185, 125), (-185, 125))
    marks = CornerMarks(corners, 12.0)
    side_a = [read_image(folder / "side_a" / f"{i:02d}.png") for i in (0, 1, 3)]
    side_b = [read_image(folder / "side_b_white" / f"{i:02d}.png") for i in (0, 1)]
    views_a = [observe_printed("a", picture, printed) for picture in side_a]
    silent = np.full((4, 2), np.nan)
    found = [find_marks(to_8bit(picture), marks) for picture in side_b]
    views_b = [BoardView("b", (1280, 960), marks.points(), xy, silent, silent) for xy in found]

    def findings(factor: float):
        scaled = [replace(v, board_xy=factor * v.board_xy) for v in views_a]
        ink = tuple(factor * v for v in printed.ink().extent())
        a = [panel_size(p, camera, v, ink) for p, v in zip(side_a, scaled, strict=True)]
        b = [panel_size(p, camera, v, marks.ink().extent()) for p, v in zip(side_b, views_b, strict=True)]
        np.testing.assert_allclose(b, [[420, 297]] * 2, atol=1.5)
        return panel_finding(a, b)

    assert findings(1.0) == []
    for factor in (1 / 2.54, 1 / 1.1, 1.1, 2.54):
        (finding,) = findings(factor)
        assert finding.code == "wrong-square" and f"{factor:.2f} times" in finding.fault
    # A3 on one side, A4 on the other.
    assert findings(np.sqrt(2)) == []
