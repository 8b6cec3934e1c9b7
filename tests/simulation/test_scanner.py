from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from slkit.data import Frames
from slkit.errors import InputError
from slkit.geometry import Pinhole, Pose, Rig
from slkit.protocols import Scanner
from slkit.simulation import Optics, SimulatedScanner, build, plane, sphere, working_volume

QUIET = Optics(read_noise=0, shot_noise=0, bits=16, ambient=0.0, black_level=0.0)
SHARP = replace(QUIET, projector_blur_px=0.0, camera_blur_px=0.0)
SIZE = (160, 120)


def small_rig(distortion: float = -0.2) -> Rig:
    lens = np.array([distortion, 0, 1e-3, -1e-3, 0])
    camera = Pinhole((96, 72), np.array([[140, 0, 48], [0, 140, 35.5], [0, 0, 1]]), lens)
    projector = Pinhole(SIZE, np.array([[280, 0, 79], [0, 280, 125], [0, 0, 1]]), 0.2 * lens)
    turn = Pose.from_rotation_vector([0.25, -0.25, 0.02], np.zeros(3))
    return Rig(camera, projector, turn @ Pose(np.eye(3), np.array([250.0, -20, 0])))


def facing(albedo: object = (0.8, 0.8, 0.8)) -> SimulatedScanner:
    return SimulatedScanner(plane(1000.0, size_mm=(900.0, 700.0), albedo=albedo), small_rig(), SHARP)


def flat(value: float, dtype: type = np.uint8) -> np.ndarray:
    return np.full(SIZE[::-1], value, dtype)


def shoot(scanner: SimulatedScanner, *patterns: np.ndarray) -> list[np.ndarray]:
    return [picture.astype(np.float64) for picture in scanner.capture(Frames.of(patterns))]


def interior(scanner: SimulatedScanner, margin: int = 3) -> np.ndarray:
    lit = scanner.truth().lit.astype(np.uint8)
    return cv2.erode(lit, np.ones((2 * margin + 1,) * 2, np.uint8), borderValue=0).astype(bool)


def test_it_is_a_scanner_that_renders_a_frame_when_it_is_asked_for() -> None:
    asked: list[int] = []

    def load(index: int) -> np.ndarray:
        asked.append(index)
        return flat(200)

    scanner = facing()
    assert isinstance(scanner, Scanner)
    frames = scanner.capture(Frames(("white", "x_bit3", "black"), load))
    assert frames.names == ("white", "x_bit3", "black") and not asked
    assert frames[1].shape == (72, 96)
    assert asked == [1]


def test_equal_seeds_give_equal_pictures_and_others_do_not() -> None:
    scanner = replace(facing(), optics=Optics(), seed=5)
    patterns = Frames.of([flat(200), flat(200)])
    first, again, other = (s.capture(patterns) for s in (scanner, replace(scanner), replace(scanner, seed=6)))
    np.testing.assert_array_equal(first[1], again[1])
    assert (first[1] != other[1]).mean() > 0.3
    assert (first[0] != first[1]).mean() > 0.3, "two frames do not share their noise"


@pytest.mark.parametrize("size", [(120, 161), (160, 120)])
def test_a_pattern_of_another_size_is_refused_by_name(size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"pattern x_0 .* the projector 160 x 120 px"):
        facing().capture(Frames.of([np.zeros(size, np.uint8)], ["x_0"]))[0]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("bits", 12),
        ("samples", 2),
        ("ambient", -0.1),
        ("read_noise", float("nan")),
        ("projector_gamma", 0.0),
        ("crosstalk", 0.6),
        ("crosstalk", ((1.0, 0.0), (0.0, 1.0))),
    ],
)
def test_impossible_optics_are_refused(field: str, value: object) -> None:
    with pytest.raises(InputError, match=field):
        Optics(**{field: value})


def test_a_ramp_tells_the_true_projector_column_and_row() -> None:
    scanner = facing()
    # Unblurred, the ramp is a staircase of projector pixels, not a ramp.
    optics = replace(SHARP, projector_blur_px=1.0)
    scanner = replace(scanner, scene=plane(1000.0, (15.0, 20.0), (900.0, 700.0)), optics=optics)
    column, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    pictures = shoot(scanner, flat(60000, np.uint16), *((300 * (a + 5)).astype(np.uint16) for a in (column, row)))
    inside, truth = interior(scanner, 4), scanner.truth()
    seen = np.stack([p / np.maximum(pictures[0], 1) * 200 - 5 for p in pictures[1:]], axis=-1)[truth.lit]
    error = (seen - truth.projector_xy)[inside[truth.lit]]
    assert inside.sum() > 1000
    # One grey level of 16 bits is 0.01 px here.
    assert np.abs(error.mean(axis=0)).max() < 0.002
    assert np.sqrt((error**2).mean()) < 0.01


def test_the_truth_fits_the_rig() -> None:
    rig = small_rig()
    truth = SimulatedScanner(build("sphere", rig), rig).truth()
    assert len(truth.xyz_mm) == truth.lit.sum() > 100
    np.testing.assert_allclose(rig.camera.project(truth.xyz_mm), truth.camera_xy, atol=1e-6)
    np.testing.assert_allclose(rig.to_projector(truth.xyz_mm), truth.projector_xy, atol=1e-9)
    rows, columns = np.nonzero(truth.lit)
    np.testing.assert_array_equal(truth.camera_xy, np.stack([columns, rows], axis=1))
    assert (truth.visible | ~truth.lit).all() and truth.visible.sum() > truth.lit.sum()


def test_grey_levels_follow_gamma_and_albedo() -> None:
    scanner = facing((0.4, 0.4, 0.4))
    inside = interior(scanner)
    linear = shoot(scanner, flat(255), flat(128))
    bent = shoot(replace(scanner, optics=replace(SHARP, projector_gamma=2.2)), flat(255), flat(128))
    assert linear[1][inside] / linear[0][inside] == pytest.approx(128 / 255, abs=1e-3)
    assert bent[1][inside] / bent[0][inside] == pytest.approx((128 / 255) ** 2.2, abs=1e-3)
    bright = shoot(facing((0.8, 0.8, 0.8)), flat(255))
    assert linear[0][inside] / bright[0][inside] == pytest.approx(0.5, abs=1e-3)


def test_white_reaches_its_level_where_a_surface_faces_the_projector() -> None:
    rig = small_rig()
    center, _ = working_volume(rig)
    scanner = SimulatedScanner(sphere(center, 50.0, (1.0, 1.0, 1.0)), rig, SHARP)
    distance = np.linalg.norm(center - rig.projector_center)
    expected = SHARP.white_level * (distance / (distance - 50)) ** 2
    assert shoot(scanner, flat(255))[0].max() / 65535 == pytest.approx(expected, rel=0.01)


def test_ambient_light_and_black_level_add_up() -> None:
    scanner = facing((0.5, 0.5, 0.5))
    optics = replace(SHARP, ambient=0.1, black_level=0.02)
    black, white = shoot(replace(scanner, optics=optics), flat(0), flat(255))
    inside = interior(scanner)
    assert black[inside] / 65535 == pytest.approx(0.1 * 0.5 + 0.02, abs=1e-4)
    np.testing.assert_allclose((white - black)[inside], shoot(scanner, flat(255))[0][inside], atol=1.01)


def test_nothing_but_black_level_where_there_is_no_surface() -> None:
    rig = small_rig()
    scanner = SimulatedScanner(sphere([0, 0, 1000], 60.0), rig, replace(SHARP, black_level=0.02, ambient=0.3))
    unseen = cv2.dilate(scanner.truth().visible.astype(np.uint8), np.ones((3, 3))) == 0
    assert unseen.sum() > 1000
    assert shoot(scanner, flat(255))[0][unseen] == pytest.approx(round(0.02 * 65535))


def test_a_photograph_needs_no_projector() -> None:
    scanner = facing((0.5, 0.5, 0.5))
    picture = scanner.photograph() / 65535
    assert picture[scanner.truth().visible].max() == pytest.approx(0.5 * SHARP.white_level, abs=1e-4)
    unlit = scanner.truth().visible & ~scanner.truth().lit
    assert unlit.sum() > 10 and np.median(picture[unlit]) == pytest.approx(0.5 * SHARP.white_level, abs=1e-4)


@pytest.mark.parametrize("level", [60, 220])
def test_noise_has_the_variance_asked_for(level: int) -> None:
    scanner = facing()
    optics = replace(SHARP, bits=8, read_noise=2.0, shot_noise=0.05)
    inside = interior(scanner)
    signal = 255 / 65535 * shoot(scanner, flat(level))[0][inside]
    stack = np.array(shoot(replace(scanner, optics=optics, seed=3), *[flat(level)] * 60))[:, inside]
    expected = 2.0**2 + 0.05 * signal + 1 / 12
    assert (stack.var(axis=0, ddof=1) / expected).mean() == pytest.approx(1, abs=0.02)
    assert (stack.mean(axis=0) - signal).mean() == pytest.approx(0, abs=0.02)
    between = np.corrcoef(stack[0] - signal, stack[1] - signal)[0, 1]
    assert abs(between) < 0.1


def test_sixteen_bits_hold_what_eight_round_away() -> None:
    scanner = facing()
    inside = interior(scanner)
    deep = scanner.capture(Frames.of([flat(200)]))[0]
    shallow = replace(scanner, optics=replace(SHARP, bits=8)).capture(Frames.of([flat(200)]))[0]
    assert deep.dtype == np.uint16 and shallow.dtype == np.uint8
    np.testing.assert_allclose(deep[inside] / 257, shallow[inside], atol=0.51)
    assert len(np.unique(deep[inside])) > 5 * len(np.unique(shallow[inside]))


def test_too_much_light_saturates() -> None:
    scanner = replace(facing(), optics=replace(SHARP, white_level=3.0, bits=8))
    white = scanner.capture(Frames.of([flat(255)]))[0]
    assert (white[interior(scanner)] == 255).all()


def test_a_coloured_surface_under_coloured_light() -> None:
    albedo = np.array([0.9, 0.5, 0.2])
    scanner = replace(facing(albedo), optics=replace(SHARP, color=True))
    inside = interior(scanner)
    light = np.zeros((*SIZE[::-1], 3), np.uint8)
    light[:] = (255, 128, 64)
    white, coloured = shoot(scanner, flat(255), light)
    assert white.shape == (72, 96, 3)
    np.testing.assert_allclose(
        white[inside] / white[inside][:, :1], np.tile(albedo / 0.9, (inside.sum(), 1)), rtol=2e-3
    )
    ratio = coloured[inside] / white[inside]
    np.testing.assert_allclose(ratio, np.tile(np.array([255, 128, 64]) / 255, (len(ratio), 1)), rtol=2e-3)
    grey = shoot(replace(scanner, optics=SHARP), light)[0]
    np.testing.assert_allclose(grey[inside], coloured[inside].mean(axis=1), atol=1.01)


def test_crosstalk_mixes_channels_and_keeps_white() -> None:
    scanner = facing()
    inside = interior(scanner)
    red = np.zeros((*SIZE[::-1], 3), np.uint8)
    red[:, :, 0] = 255
    mixing = ((0.9, 0.2, 0.0), (0.1, 0.7, 0.3), (0.05, 0.1, 0.8))
    base = shoot(scanner, flat(255))[0][inside][:, None]
    for crosstalk, seen in ((0.1, (0.8, 0.1, 0.1)), (mixing, (0.9, 0.1, 0.05))):
        optics = replace(SHARP, color=True, crosstalk=crosstalk)
        pictures = shoot(replace(scanner, optics=optics), red, flat(255))
        np.testing.assert_allclose((pictures[0][inside] / base).mean(axis=0), seen, atol=1e-3)
        white = np.sum(optics.mixing(), axis=1)
        np.testing.assert_allclose((pictures[1][inside] / base).mean(axis=0), white, atol=1e-3)


@pytest.mark.parametrize(("projector_px", "camera_px"), [(0.6, 0.6), (1.5, 0.0), (0.0, 1.5), (1.0, 1.0)])
def test_an_edge_is_as_wide_as_both_blurs_make_it(projector_px: float, camera_px: float) -> None:
    scanner = facing()
    edge = flat(0)
    edge[:, 80:] = 255
    optics = replace(SHARP, projector_blur_px=projector_px, camera_blur_px=camera_px)
    white, picture = shoot(replace(scanner, optics=optics), flat(255), edge)
    truth, inside = scanner.truth(), interior(scanner, 6)
    column = np.full(inside.shape, np.nan)
    column[truth.lit] = truth.projector_xy[:, 0]
    # A camera pixel spreads over `scale` projector columns, a cell of the emitted picture over a third of one.
    scale = np.gradient(column, axis=1)[inside]
    sigma = np.sqrt(projector_px**2 + scale**2 * (camera_px**2 + 1 / 12) + 1 / 108)
    expected = norm.cdf((column[inside] - 79.5) / sigma)
    assert (np.abs(expected - 0.5) < 0.45).sum() > 30
    assert np.abs((picture / np.maximum(white, 1))[inside] - expected).max() < 0.03


def test_light_ends_at_the_border_of_the_projector_image() -> None:
    scanner = facing()
    white = shoot(scanner, flat(255))[0]
    truth = scanner.truth()
    dark = truth.visible & (cv2.dilate(truth.lit.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    assert dark.sum() > 50
    assert (white[dark] == 0).all() and (white[interior(scanner, 1)] > 0).all()
