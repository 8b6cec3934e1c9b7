"""The phase-shift codec: round trips, its physical limit, honest sigma, period counting, real board captures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit import registry
from slkit.calibration.detect import find_checkerboard, to_8bit
from slkit.codecs import _phase_rows
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.data import Frames
from slkit.errors import DecodeError, InputError

DATA = Path(os.environ.get("SLKIT_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data"))
BOARD = DATA / "phase_board_skull" / "calib"


def see(codec: PhaseShift, *, swing=100.0, dark=30.0, noise=2.0, gamma=1.0, blur=0.7, seed=0, texture=0.0) -> Frames:
    """A camera that sees the projector pixel for pixel; swing: white - black in grey levels."""
    rng = np.random.default_rng(seed)
    width, height = codec.projector
    # Spots some pixels wide, of the whole range: each pixel of this camera sees one point, where a real one would blur.
    spots = cv2.GaussianBlur(rng.random((height, width)), (0, 0), 4.0)
    albedo = 1 - texture * (spots - spots.min()) / np.ptp(spots)
    images = []
    for pattern in (patterns := codec.encode()):
        light = cv2.GaussianBlur((pattern / 255.0) ** gamma, (0, 0), blur)
        levels = dark + swing * albedo * light + rng.normal(0, noise, light.shape)
        images.append(np.clip(np.rint(levels), 0, 255).astype(np.uint8))
    return Frames.of(images, patterns.names)


def errors(codec: PhaseShift, frames: Frames, **arguments: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Errors and sigmas in px away from the image's rim, where blur shifts the phase, and the share decoded."""
    found = codec.decode(frames, **arguments)
    away = (found.camera_xy > 4).all(axis=1) & (found.camera_xy < np.array(codec.projector) - 5).all(axis=1)
    size = codec.projector[0] * codec.projector[1]
    return (found.projector_xy - found.camera_xy)[away], found.sigma[away], len(found) / size


def robust_std(values: np.ndarray) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def limit(codec: PhaseShift, swing: float, noise: float, blur: float = 0.7) -> float:
    """Methods 6.2 with the modulation that is left after the blur."""
    fringes = codec.fringes("x")
    pitch = codec.projector[0] / max(fringes.periods)
    modulation = swing / 2 * np.exp(-2 * (np.pi * blur / pitch) ** 2)
    return pitch / (2 * np.pi) * np.sqrt(2 / fringes.steps) * np.hypot(noise, 1 / np.sqrt(12)) / modulation


def test_the_patterns_are_those_of_the_formula() -> None:
    codec = PhaseShift((1824, 1140), "both", Fringes((16, 1), 3), Fringes((16, 1), 3), references=False)
    frames = codec.encode()
    assert frames.names[:6] == ("x_16_0", "x_16_1", "x_16_2", "x_1_0", "x_1_1", "x_1_2")
    assert [name[0] for name in frames.names] == ["x"] * 6 + ["y"] * 6
    expected = 127.5 * (1 + np.cos(2 * np.pi * np.arange(1824) / 114 - 2 * np.pi / 3))
    assert np.abs(frames[1].astype(float) - expected).max() <= 0.5
    expected = 127.5 * (1 + np.cos(2 * np.pi * np.arange(1140) / 1140 - 4 * np.pi / 3))
    assert np.abs(frames[11].astype(float) - expected[:, None]).max() <= 0.5


def test_default_fringes_count_down_to_one_period() -> None:
    assert PhaseShift((1024, 768)).fringes("x").periods == (64, 8, 1)
    # What is projected is what a capture.toml will say.
    assert registry.parameters_of(PhaseShift((1024, 768)))["x"]["periods"] == [64, 8, 1]
    assert PhaseShift((1024, 768)).y is None
    assert PhaseShift((1280, 800), "both").fringes("y").periods == (50, 7, 1)
    assert PhaseShift((20, 20)).fringes("x").periods == (1,)
    assert PhaseShift((1024, 768), order="gray").fringes("x").periods == (64,)
    assert len(PhaseShift((1024, 768), "both").encode()) == 2 + 2 * 12


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"axes": "both"},
        {"order": "gray"},
        {"order": "gray", "x": Fringes((32,), 7), "axes": "both"},
        {"references": False},
        {"x": Fringes((64, 8, 1), 8)},
        {"x": Fringes((1, 63.5, 9.3))},
        {"x": Fringes((60.5, 7.1, 0.9), 4, -1, 1.2)},
    ],
    ids=str,
)
def test_error_is_at_the_physical_limit_and_sigma_tells_it(parameters: dict[str, Any]) -> None:
    codec = PhaseShift((512, 128), **parameters)
    error, sigma, share = errors(codec, see(codec))
    assert share > 0.995
    assert np.sqrt(np.mean(error[:, 0] ** 2)) < 1.1 * limit(codec, 100, 2)
    for axis in range(2 if codec.axes == "both" else 1):
        assert 0.85 < robust_std(error[:, axis] / sigma[:, axis]) < 1.15
    silent = 1 if codec.axes == "x" else None
    assert silent is None or np.isnan(error[:, 1]).all()


@pytest.mark.parametrize(("noise", "texture"), [(0.5, 0.5), (1.0, 0.0), (1.0, 0.5), (4.0, 0.0), (4.0, 0.5)])
def test_sigma_is_honest_over_noise_and_texture(noise: float, texture: float) -> None:
    codec = PhaseShift((512, 128))
    error, sigma, share = errors(codec, see(codec, noise=noise, texture=texture, blur=0.01))
    assert share > 0.95
    assert 0.7 < robust_std(error[:, 0] / sigma[:, 0]) < 1.4


def test_four_steps_are_blind_to_a_gamma_that_three_are_not() -> None:
    bias = {}
    for steps in (3, 4):
        codec = PhaseShift((512, 96), x=Fringes((32, 16, 8, 4, 2, 1), steps))
        error, _, _ = errors(codec, see(codec, noise=0.5, gamma=2.2))
        bias[steps] = np.sqrt(np.mean(error.reshape(-1, 2)[:, 0] ** 2))
    assert bias[4] < 0.06 < 0.3 < bias[3]


def test_few_periods_are_counted_wrongly_and_the_doubtful_ones_are_dropped() -> None:
    """A ratio of 64 at a signal-to-noise ratio of 25 leaves the order open at most pixels."""
    codec = PhaseShift((1024, 64), x=Fringes((64, 1)))
    frames = see(codec)
    error, _, share = errors(codec, frames)
    wrong = np.mean(np.abs(error[:, 0]) > 8)
    assert share < 0.6
    assert wrong < 0.01
    careful = PhaseShift((1024, 64), x=Fringes((64, 8, 1)))
    error, _, share = errors(careful, see(careful))
    assert share > 0.99 and (np.abs(error[:, 0]) < 4).all()


def test_confidence_falls_with_noise() -> None:
    codec = PhaseShift((512, 64), x=Fringes((32, 2, 1)))
    good, bad = (codec.decode(see(codec, noise=noise)).confidence for noise in (1, 7))
    assert good.min() > 0.999
    assert bad.min() < 0.995 and np.median(bad) < np.median(good)


def test_the_ends_of_the_axis_are_not_mixed_up() -> None:
    codec = PhaseShift((512, 64))
    found = codec.decode(see(codec, noise=4))
    assert np.abs(found.projector_xy[:, 0] - found.camera_xy[:, 0]).max() < 4
    assert {0.0, 511.0} <= set(found.camera_xy[:, 0].tolist())


@pytest.mark.parametrize("order", ["temporal", "gray"])
def test_a_patch_that_saturates_in_one_frame_is_left_out(order: str) -> None:
    codec = PhaseShift((256, 96), order=order)
    frames = see(codec)
    images = [image.copy() for image in frames]
    fringe = next(i for i, n in enumerate(codec.encode().names) if n.startswith("x_") and "bit" not in n)
    images[fringe][40:60, 100:130] = 255
    found = codec.decode(Frames.of(images, frames.names)).as_map((96, 256))[..., 0]
    assert np.isnan(found[40:60, 100:130]).all()
    assert np.isfinite(found[:30]).mean() > 0.95


def test_saturated_and_unlit_pixels_are_left_out() -> None:
    codec = PhaseShift((256, 96))
    rng = np.random.default_rng(0)
    images = [image.copy() for image in see(codec)]
    for image in images:
        image[:30] = np.clip(np.rint(rng.normal(30, 2, (30, 256))), 0, 255)
        image[60:] = np.clip(image[60:].astype(float) * 2.6, 0, 255)
    found = codec.decode(Frames.of(images))
    rows = found.camera_xy[:, 1]
    assert np.count_nonzero(rows < 30) < 5
    # Two rows at either border are rims, of the light and of the saturated part.
    assert np.count_nonzero((rows >= 32) & (rows < 58)) > 0.99 * 26 * 256
    kept = [image[60:] for image in images[2:]]
    saturated = np.max(kept, axis=0) == 255
    assert saturated.mean() > 0.1
    col, row = found.camera_xy[rows >= 60].astype(int).T
    assert not saturated[row - 60, col].any()


@settings(max_examples=25, deadline=None)
@given(
    periods=st.floats(8, 30),
    ratio=st.floats(2, 7),
    fewest=st.floats(0.5, 0.95),
    steps=st.integers(3, 9),
    sign=st.sampled_from([1, -1]),
    offset=st.floats(-7, 7),
)
def test_any_fringes_come_back(
    periods: float, ratio: float, fewest: float, steps: int, sign: int, offset: float
) -> None:
    codec = PhaseShift((200, 24), x=Fringes((periods, periods / ratio, fewest), steps, sign, offset), references=False)
    error, _, share = errors(codec, see(codec, swing=190, noise=0.5))
    assert share > 0.95
    assert np.abs(error[:, 0]).max() < 0.2


def test_a_lone_periodic_set_needs_bounds_and_uses_them() -> None:
    codec = PhaseShift((512, 64), x=Fringes((32,)))
    frames = see(codec)
    with pytest.raises(InputError, match="x: the coarsest fringes have 32 periods"):
        codec.decode(frames)
    x = np.broadcast_to(np.arange(512, dtype=np.float32), (64, 512))
    bounds = np.stack([x - 5, x + 7, np.zeros_like(x), np.full_like(x, 63)], axis=-1)
    error, _, share = errors(codec, frames, bounds=bounds)
    assert share > 0.99 and np.abs(error[:, 0]).max() < 0.6
    wide = bounds + np.array([-20, 20, 0, 0], dtype=np.float32)
    with pytest.raises(DecodeError, match="period"):
        codec.decode(frames, wide)
    half = bounds.copy()
    half[:, 256:] = np.nan
    assert codec.decode(frames, half).camera_xy[:, 0].max() <= 255
    with pytest.raises(InputError, match=r"bounds must have the shape \(64, 512, 4\)"):
        codec.decode(frames, bounds[:10])


@pytest.mark.parametrize("order", ["temporal", "gray"])
def test_bounds_reject_what_lies_outside(order: Any) -> None:
    codec = PhaseShift((256, 48), order=order)
    frames = see(codec)
    everywhere = np.broadcast_to(np.array([-1, 300, -1, 300], dtype=np.float32), (48, 256, 4))
    assert len(codec.decode(frames, everywhere)) == len(codec.decode(frames))
    left = np.broadcast_to(np.array([0, 99, 0, 47], dtype=np.float32), (48, 256, 4))
    assert codec.decode(frames, left).projector_xy[:, 0].max() < 100.5


def test_lit_is_white_or_the_mean_of_the_first_set() -> None:
    codec = PhaseShift((256, 48))
    frames = see(codec)
    assert np.array_equal(codec.lit(frames), frames[0])
    bare = PhaseShift((256, 48), references=False)
    frames = see(bare)
    mean = np.mean(frames.stack()[:4], axis=0)
    assert np.abs(bare.lit(frames) - mean).max() <= 0.5
    colour = Frames.of([np.repeat(image[..., None], 3, axis=2) for image in frames], frames.names)
    assert np.array_equal(bare.lit(colour), bare.lit(frames))


@pytest.mark.parametrize("axes", ["x", "both"])
def test_a_large_picture_is_the_sum_of_its_bands(axes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    codec = PhaseShift((256, 96), axes)
    frames = see(codec, texture=0.5)
    whole = codec.decode(frames)
    for rows in (1, 7, 95):
        monkeypatch.setattr(_phase_rows, "_BAND_PX", rows * 256)
        bands = codec.decode(frames)
        for name in ("camera_xy", "projector_xy", "sigma", "confidence", "color"):
            assert np.array_equal(getattr(bands, name), getattr(whole, name), equal_nan=True)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"x": {"periods": []}}, "periods must hold one number or more"),
        ({"x": {"periods": [8, 8]}}, "all different"),
        ({"x": {"periods": [8, -1]}}, "periods must be positive"),
        ({"x": {"periods": [8, float("nan")]}}, "finite"),
        ({"x": {"periods": [8, 1], "steps": 2}}, "steps must be 3 or more, not 2"),
        ({"x": {"periods": [8, 1], "sign": 0}}, "must be one of 1, -1"),
        ({"x": {"periods": [200, 1]}}, "x: 200 periods are shorter than 3 px each"),
        ({"order": "gray", "x": {"periods": [16, 1]}}, "order 'gray' takes one number of periods, not 2"),
        ({"order": "gray", "references": False}, "set references = true"),
        ({"min_snr": 0}, "min_snr must be a positive number"),
        ({"max_period_distance": 0.5}, "max_period_distance must lie between 0 and 0.5"),
        ({"axes": "z"}, "must be one of 'x', 'y', 'both'"),
    ],
)
def test_parameters_that_cannot_be_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        registry.create(PhaseShift, {"projector": [256, 64]} | parameters, "test")


def test_contradicting_sets_are_an_error() -> None:
    codec = PhaseShift((256, 48), x=Fringes((16, 1)), references=False)
    rng = np.random.default_rng(0)
    shuffled = list(codec.encode().stack())
    mixed = rng.permutation(256)
    images = [np.ascontiguousarray(i[:, mixed]) if n < 4 else i for n, i in enumerate(shuffled)]
    with pytest.raises(DecodeError, match="contradict"):
        codec.decode(Frames.of(images))


@pytest.mark.skipif(not BOARD.is_dir(), reason=f"real captures are not at {BOARD}: set SLKIT_DATA")
@pytest.mark.parametrize(("pose", "share"), [("pose0", 0.995), ("pose2", 0.96)])
def test_real_board(pose: str, share: float) -> None:
    """Inside the printed corners nearly all is decoded, at the noise that sigma tells, and no order is wrong."""
    paths = sorted((BOARD / pose).glob("*.png"))
    frames = Frames(tuple(p.name for p in paths), lambda i: cv2.imread(str(paths[i]), cv2.IMREAD_GRAYSCALE))
    fringes = Fringes((16, 1), 3)
    codec = PhaseShift((1824, 1140), "both", fringes, fringes, references=False)
    found = codec.decode(frames)
    corners = find_checkerboard(to_8bit(codec.lit(frames)), (13, 9))
    assert corners is not None
    corners = corners.reshape(9, 13, 2)
    outline = np.rint(corners[[0, 0, -1, -1], [0, -1, -1, 0]]).astype(np.int32)
    board = cv2.fillConvexPoly(np.zeros(frames[0].shape, np.uint8), outline, 1).astype(bool)
    on_board = board[found.camera_xy[:, 1].astype(int), found.camera_xy[:, 0].astype(int)]
    assert on_board.sum() > share * board.sum()
    camera, projector = found.camera_xy[on_board], found.projector_xy[on_board]
    homography, _ = cv2.findHomography(camera, projector, cv2.RANSAC, 3.0)
    off = cv2.perspectiveTransform(camera[None], homography)[0] - projector
    # Half a period of 71 px is a wrong order; distortion and stray light bend the plane by far less.
    assert np.mean(np.abs(off) > 35) < 2e-4
    assert 0.7 < robust_std((off / found.sigma[on_board])[:, 1]) < 1.6
