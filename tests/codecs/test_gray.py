import itertools
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.codecs._cell_bits import BitRule, read_cells
from slkit.codecs._gray_code import CellCode
from slkit.codecs._masks import measure_light
from slkit.codecs.gray import Gray
from slkit.data import Frames
from slkit.errors import DecodeError, InputError
from slkit.registry import create

SIZE = (53, 37)


def dim(frames: Frames) -> Frames:
    return Frames.of([(40 + f * (170 / 255)).astype(np.uint8) for f in frames], frames.names)


def test_names_are_in_display_order() -> None:
    frames = Gray((6, 4), axes="both").encode()
    x = ("x_bit2", "x_bit2_inverse", "x_bit1", "x_bit1_inverse", "x_bit0", "x_bit0_inverse")
    y = ("y_bit1", "y_bit1_inverse", "y_bit0", "y_bit0_inverse")
    assert frames.names == ("white", "black", *x, *y)
    assert Gray((6, 4), references=False).encode().names == x


def test_patterns_are_the_reflected_binary_code() -> None:
    frames = Gray((1024, 3), inverse=False).encode()
    bits = np.stack([f[0] > 0 for f in frames][2:])
    code = np.arange(1024) ^ (np.arange(1024) >> 1)
    np.testing.assert_array_equal(bits, (code >> np.arange(9, -1, -1)[:, None]) & 1)
    assert (np.diff(bits.astype(int), axis=1) != 0).sum(axis=0).tolist() == [1] * 1023


@settings(max_examples=40, deadline=None)
@given(
    size=st.tuples(st.integers(4, 70), st.integers(4, 70)),
    axes=st.sampled_from(["x", "y", "both"]),
    inverse=st.booleans(),
    step=st.integers(1, 4),
)
def test_a_perfect_camera_reads_every_cell(size: tuple[int, int], axes: Any, inverse: bool, step: int) -> None:
    codec = Gray(size, axes=axes, inverse=inverse, step=step)
    found = codec.decode(dim(codec.encode()))
    assert len(found) == size[0] * size[1]
    for i, axis in enumerate("xy"):
        if axis in axes or axes == "both":
            cell = np.floor(found.camera_xy[:, i] / step)
            np.testing.assert_allclose(found.projector_xy[:, i], cell * step + (step - 1) / 2, atol=1e-4)
        else:
            assert np.isnan(found.projector_xy[:, i]).all() and np.isnan(found.sigma[:, i]).all()


@settings(max_examples=60, deadline=None)
@given(cell=st.integers(0, 63), unknown=st.sets(st.integers(0, 5)))
def test_unknown_bits_leave_the_hull_of_all_cells_they_allow(cell: int, unknown: set[int]) -> None:
    code = CellCode("x", 64, 1, inverse=True)
    white, black = np.full((5, 5), 200, np.uint8), np.full((5, 5), 20, np.uint8)
    light = measure_light(white, black, 5.0)

    def read(name: str) -> Any:
        bit = int(name.removeprefix("x_bit").removesuffix("_inverse"))
        one = bool((cell ^ (cell >> 1)) >> bit & 1) != name.endswith("_inverse")
        return np.full((5, 5), 110 if bit in unknown else (200 if one else 20), np.float32)

    cells = read_cells(code, read, light, BitRule(3.0, 0.05, robust=False))
    allowed: list[int] = []
    for choice in itertools.product([0, 1], repeat=len(unknown)):
        gray = cell ^ (cell >> 1)
        for bit, value in zip(sorted(unknown), choice, strict=True):
            gray = gray & ~(1 << bit) | value << bit
        number = 0
        for bit in range(6):
            number ^= gray >> bit
        allowed.append(number)
    assert (cells.lo == min(allowed)).all() and (cells.hi == max(allowed)).all()


def test_a_camera_coarser_than_the_projector_keeps_its_pixels() -> None:
    codec = Gray((128, 96))
    frames = dim(codec.encode())
    coarse = Frames.of([cv2.resize(f, (32, 24), interpolation=cv2.INTER_AREA) for f in frames], frames.names)
    found = codec.decode(coarse)
    assert len(found) == 32 * 24
    error = found.projector_xy[:, 0] - (4 * found.camera_xy[:, 0] + 1.5)
    assert np.abs(error).max() <= 1.0
    assert (found.sigma[:, 0] >= np.abs(error)).all()
    assert len(Gray((128, 96), max_cells=1).decode(coarse)) < 32 * 24


def test_on_a_plane_the_error_is_that_of_the_cell_and_sigma_says_so(flat: Any, spread: Any) -> None:
    codec = Gray(flat.scanner.rig.projector.size, axes="both")
    found = codec.decode(flat.frames(codec))
    assert flat.completeness(found) > 0.99
    for axis in (0, 1):
        error, sigma = flat.errors(found, axis)
        assert np.sqrt(np.mean(error**2)) <= 1.15 / np.sqrt(12)
        assert np.abs(error).max() < 2
        assert 0.7 <= spread(error / sigma) <= 1.4
        assert 0.7 <= np.sqrt(np.mean((error / sigma) ** 2)) <= 1.4


def test_subpixel_borders_are_exact_in_the_projector_and_honest(flat: Any, spread: Any) -> None:
    codec = Gray(flat.scanner.rig.projector.size, subpixel=True)
    found = codec.decode(flat.frames(codec))
    np.testing.assert_allclose(found.projector_xy[:, 0] % 1, 0.5, atol=1e-4)
    error, sigma = flat.errors(found, 0)
    assert np.sqrt(np.mean(error**2)) < 0.10
    assert 0.7 <= spread(error / sigma) <= 1.4
    assert flat.completeness(found) > 0.97


def test_subpixel_borders_of_one_axis_carry_the_cell_of_the_other(flat: Any, spread: Any) -> None:
    codec = Gray(flat.scanner.rig.projector.size, axes="both", subpixel=True)
    found = codec.decode(flat.frames(codec))
    assert np.isfinite(found.projector_xy).all()
    for axis in (0, 1):
        error, sigma = flat.errors(found, axis)
        assert 0.7 <= spread(error / sigma) <= 1.4


def test_subpixel_does_not_care_how_the_camera_is_turned(flat: Any) -> None:
    codec = Gray(flat.scanner.rig.projector.size, subpixel=True)
    frames = flat.frames(codec)
    found = codec.decode(frames)
    turned = codec.decode(Frames.of([np.ascontiguousarray(np.rot90(f)) for f in frames], frames.names))
    width = frames[0].shape[1]
    back = np.stack([width - 1 - turned.camera_xy[:, 1], turned.camera_xy[:, 0]], axis=1)
    assert len(back) == len(found)
    order, other = (np.lexsort((xy[:, 0], np.rint(xy[:, 1]))) for xy in (found.camera_xy, back))
    np.testing.assert_allclose(found.camera_xy[order], back[other], atol=2e-3)
    np.testing.assert_allclose(found.projector_xy[order, 0], turned.projector_xy[other, 0])


def test_without_references_the_pairs_stand_in(flat: Any) -> None:
    size = flat.scanner.rig.projector.size
    frames = flat.frames(Gray(size))
    found = Gray(size).decode(frames).as_map(flat.lit.shape)[..., 0]
    bare = Gray(size, references=False)
    other = bare.decode(frames.select(range(2, len(frames)))).as_map(flat.lit.shape)[..., 0]
    both = np.isfinite(found) & np.isfinite(other)
    assert both.sum() > 0.99 * np.isfinite(found).sum()
    # What is lit differs by the noise of the references, so a few doubtful bits fall differently: half a cell.
    assert (found[both] == other[both]).mean() > 0.9
    assert np.abs(found[both] - other[both]).max() <= 1
    lit = bare.lit(frames.select(range(2, len(frames))))
    assert np.abs(lit[both].astype(float) - frames[0][both]).mean() < 5


def test_the_robust_rule_drops_pixels_that_see_mostly_scattered_light(rng: np.random.Generator) -> None:
    codec, size = Gray((256, 64)), (64, 256)
    share = np.linspace(0, 1, 256)
    seen = []
    for pattern in codec.encode():
        direct, mirrored = pattern.astype(float), pattern[:, ::-1].astype(float)
        scattered = cv2.blur(mirrored, (41, 41))
        seen.append(10 + 0.5 * ((1 - share) * direct + share * scattered) + rng.normal(0, 1, size))
    frames = Frames.of([np.clip(s, 0, 255).astype(np.uint8) for s in seen], codec.encode().names)
    wrong = {}
    for robust in (False, True):
        found = Gray((256, 64), robust=robust).decode(frames)
        error = np.abs(found.projector_xy[:, 0] - found.camera_xy[:, 0])
        right = error <= 2
        wrong[robust] = (~right).sum(), right.sum()
    assert wrong[True][0] < 0.5 * wrong[False][0]
    assert wrong[True][1] > 0.7 * wrong[False][1]


def test_depth_and_colour_do_not_matter(flat: Any) -> None:
    codec = Gray(flat.scanner.rig.projector.size)
    frames = flat.frames(codec)
    found = codec.decode(frames)
    for changed in ([f.astype(np.uint16) * 200 for f in frames], [np.stack([f] * 3, axis=2) for f in frames]):
        other = codec.decode(Frames.of(changed, frames.names))
        np.testing.assert_array_equal(other.camera_xy, found.camera_xy)
        np.testing.assert_allclose(other.projector_xy, found.projector_xy)


def test_saturated_pixels_are_left_out(dimmed: Callable[[Frames], Frames]) -> None:
    codec = Gray(SIZE)
    images = [f.copy() for f in dimmed(codec.encode())]
    images[0][10:15, 20:30] = 255
    found = codec.decode(Frames.of(images, codec.encode().names)).as_map((SIZE[1], SIZE[0]))[..., 0]
    assert np.isnan(found[10:15, 20:30]).all()
    found[9:16, 19:31] = 0  # a ring around them may go too, nothing else
    assert np.isfinite(found).all()


def test_bounds_rule_out_wrong_cells_and_narrow_doubtful_ones(dimmed: Callable[[Frames], Frames]) -> None:
    codec = Gray(SIZE)
    frames = dimmed(codec.encode())
    images = [f.copy() for f in frames]
    top = frames.names.index("x_bit5")
    # A bit that cannot be read leaves cells 0 to 63: too many, until geometry says where to look.
    images[top][:] = images[top + 1][:] = 120
    spoilt = Frames.of(images, frames.names)
    cols = np.arange(SIZE[0], dtype=np.float32)
    bounds = np.broadcast_to(np.stack([cols - 1, cols + 1, 0 * cols, 0 * cols + 99], axis=1), (SIZE[1], SIZE[0], 4))
    # Next to the middle the two readings are neighbours, with or without bounds.
    assert len(codec.decode(spoilt)) < 0.2 * SIZE[0] * SIZE[1]
    wide = Gray(SIZE, max_cells=6)
    found = wide.decode(spoilt, bounds)
    assert len(found) == SIZE[0] * SIZE[1]
    assert np.abs(found.projector_xy[:, 0] - found.camera_xy[:, 0]).max() <= 2
    assert len(codec.decode(frames, bounds)) == SIZE[0] * SIZE[1]
    assert len(codec.decode(frames, bounds + np.float32(10))) == 0
    assert len(codec.decode(frames, np.full_like(bounds, np.nan))) == 0
    with pytest.raises(InputError, match="bounds"):
        codec.decode(frames, bounds[:5])


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"axes": "z"}, "axes"),
        ({"step": 0}, "step"),
        ({"step": 60}, "step"),
        ({"references": False, "inverse": False}, "references"),
        ({"min_snr": 0}, "min_snr"),
        ({"bit_snr": float("nan")}, "bit_snr"),
        ({"min_contrast": 1.0}, "min_contrast"),
        ({"max_cells": 0}, "max_cells"),
        ({"projector": (0, 5)}, "projector"),
    ],
)
def test_a_parameter_out_of_range_is_named(parameters: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        create(Gray, {"projector": SIZE} | parameters, "here")


def test_frames_that_do_not_fit_are_named(dimmed: Callable[[Frames], Frames]) -> None:
    codec = Gray(SIZE)
    frames = dimmed(codec.encode())
    with pytest.raises(InputError, match="14 frames are needed.*13"):
        codec.decode(frames.select(range(len(frames) - 1)))
    images = list(frames)
    images[7] = images[7][:, 1:]
    with pytest.raises(InputError, match=frames.names[7]):
        codec.decode(Frames.of(images, frames.names))
    with pytest.raises(DecodeError, match="saturated"):
        codec.decode(Frames.of([np.full((20, 20), 255, np.uint8)] * 14))
    with pytest.raises(DecodeError, match="lit"):
        codec.decode(Frames.of([np.zeros((20, 20), np.uint8)] * 14))


@pytest.mark.parametrize("pose", ["pose0", "pose1", "pose2"])
def test_real_board_pictures(pose: str, captures: Any, read_frames: Any) -> None:
    frames = read_frames(captures("gray_board") / pose, "*.png")
    codec = Gray((1024, 768), axes="both")
    found = codec.decode(frames.select([40, 41, *range(40)]))
    # Its README counts 48 to 60 % of the frame as decodable when uncertain bits are not resolved.
    assert len(found) > 0.6 * 1280 * 1024
    value = found.as_map((1024, 1280))
    for i, size in enumerate((1024, 768)):
        smooth = cv2.medianBlur(np.nan_to_num(value[..., i], nan=-1), 5)
        known = np.isfinite(value[..., i]) & (smooth >= 0)
        assert (np.abs(value[..., i] - smooth)[known] > 6).mean() < 1e-3
        assert np.nanmin(value[..., i]) >= 0 and np.nanmax(value[..., i]) <= size - 1


def test_real_skull_without_inverse(captures: Any, read_frames: Any) -> None:
    frames = read_frames(captures("phase_board_skull") / "scan_gray", "*.png")
    found = Gray((1824, 1140), inverse=False, step=2).decode(frames)
    assert len(found) >= 380_000
    value = found.projector_xy[:, 0]
    assert np.quantile(value, 1e-3) > 2 * 10 and np.quantile(value, 1 - 1e-3) < 2 * 834


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), inverse=st.booleans(), kind=st.sampled_from([np.uint8, np.uint16]))
def test_compiled_loops_read_the_same_cells_as_numpy(seed: int, inverse: bool, kind: Any) -> None:
    """NumPy is what `robust` and `subpixel` use; a lambda for every bit asks for it without changing anything."""
    rng = np.random.default_rng(seed)
    code, full = CellCode("x", 100, 1, inverse), int(np.iinfo(kind).max)
    shape = int(rng.integers(3, 70)), int(rng.integers(3, 70))
    white = rng.integers(full // 2, full, shape).astype(kind)
    black = rng.integers(0, full // 3, shape).astype(kind)
    light = measure_light(white, black, 0.01)
    images = {name: rng.integers(0, full, shape).astype(kind) for name in code.names()}
    rule = BitRule(float(rng.uniform(0.1, 3)), float(rng.uniform(0, 0.3)), robust=False)
    compiled = read_cells(code, images.__getitem__, light, rule)
    plain = read_cells(code, images.__getitem__, light, rule, lambda *_: None)
    # What lies within rounding of a threshold may be decided otherwise.
    same = (compiled.lo == plain.lo) & (compiled.hi == plain.hi)
    assert same.mean() > 0.995
    np.testing.assert_allclose(np.sqrt(compiled.square[same]), np.sqrt(plain.square[same]), rtol=1e-4)


@pytest.mark.parametrize("size", [(1, 30), (30, 1), (1, 1)])
def test_borders_in_a_picture_of_one_column_or_row(size: tuple[int, int], dimmed: Any) -> None:
    codec = Gray((64, 64), subpixel=True)
    patterns = dimmed(codec.encode())
    frames = Frames.of([p[: size[1], : size[0]].copy() for p in patterns], patterns.names)
    found = codec.decode(frames)
    # Columns are told apart along a row only.
    assert (len(found) > 0) == (size[0] > 1)
    assert np.isfinite(found.camera_xy).all()
