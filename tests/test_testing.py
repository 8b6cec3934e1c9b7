"""The conformance suites find the faults they are there for: each broken plug-in fails with its own sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from slkit.codecs.phase_shift import PhaseShift
from slkit.data import BoardView, Calibration, Capture, Correspondences, Frames, Verdict, ViewResult
from slkit.errors import CalibrationError, InputError
from slkit.geometry import Pinhole, Pose, Rig
from slkit.testing import check_calibrator, check_codec

SIZE = (96, 80)


@dataclass(frozen=True)
class Faulty:
    """A working codec with one fault, by name."""

    fault: str
    axes: str = "x"
    projector: tuple[int, int] = SIZE

    @property
    def _good(self) -> PhaseShift:
        return PhaseShift(self.projector)

    def encode(self) -> Frames:
        frames = self._good.encode()
        if self.fault == "eager":
            return Frames.of([*frames], frames.names)
        if self.fault == "names":
            return Frames(("white",) * len(frames), frames.load)
        if self.fault == "role":
            return Frames(("picture 1", *frames.names[1:]), frames.load)
        if self.fault == "float":
            return Frames(frames.names, lambda i: frames[i].astype(np.float32))
        return frames

    def decode(self, frames: Frames, bounds: Any = None) -> Any:
        if self.fault == "rereads":
            _ = frames[0]
        if self.fault == "modifies":
            frames = Frames.of([*frames], frames.names)
            frames[3][0, 0] ^= 1
        if self.fault == "few" and len(frames) < 14:
            raise ValueError("index out of range")
        try:
            found = self._good.decode(frames, None if self.fault == "bounds" else bounds)
        except InputError as error:
            if self.fault == "sizes":
                raise ValueError("could not broadcast") from error
            raise
        return self._spoil(found) if self.fault in SPOILT else found

    def _spoil(self, found: Correspondences) -> Correspondences:
        changes: dict[str, Any] = {
            "shifted": {"projector_xy": found.projector_xy + 2},
            "proud": {"sigma": found.sigma / 20},
            "negative": {"sigma": -found.sigma},
            "sure": {"confidence": found.confidence + 1},
            "noisy axis": {"projector_xy": np.nan_to_num(found.projector_xy)},
            "silent sigma": {"sigma": found.sigma * np.nan},
        }
        if self.fault == "sparse":
            return found.select(found.camera_xy[:, 0] < 0.4 * SIZE[0])
        return replace(found, **changes[self.fault])

    def lit(self, frames: Frames) -> Any:
        lit = self._good.lit(frames)
        return {"lit shape": lit[1:], "lit type": lit / 2.0, "lit black": frames[1]}.get(self.fault, lit)


SPOILT = ("shifted", "proud", "negative", "sure", "noisy axis", "silent sigma", "sparse")


def test_a_codec_without_fault_passes() -> None:
    check_codec(Faulty("none"))


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("eager", "draw a pattern when it is asked for"),
        ("names", "unique"),
        ("role", "'picture 1' must start with its role"),
        ("float", "must be uint8 or uint16, not float32"),
        ("rereads", "read each frame at most once; it read white"),
        ("modifies", "must not change the frames; it changed x_6_1"),
        ("few", "one frame too few must raise an SlkitError, not ValueError"),
        ("sizes", "must raise an SlkitError, not ValueError: could not broadcast"),
        ("bounds", r"bounds that allow no point \(NaN\) must leave nothing"),
        ("shifted", "the median error on x is 2"),
        ("proud", "lie within 5 sigma"),
        ("negative", "sigma must be positive"),
        ("sure", "confidence must lie between 0 and 1"),
        ("noisy axis", "sigma must be finite exactly where"),
        ("silent sigma", "sigma must be finite exactly where"),
        ("sparse", "of what is lit was decoded"),
        ("lit shape", r"lit\(\) must give a picture of shape"),
        ("lit type", r"lit\(\) must give uint8"),
        ("lit black", "as dark as the darkest"),
    ],
)
def test_each_fault_of_a_codec_is_told(fault: str, sentence: str) -> None:
    with pytest.raises(AssertionError, match=sentence):
        check_codec(Faulty(fault))


@dataclass
class Thawed:
    """A codec whose parameters can be changed."""

    projector: tuple[int, int] = SIZE

    def encode(self) -> Frames:
        return PhaseShift(self.projector).encode()

    def decode(self, frames: Frames, bounds: Any = None) -> Correspondences:
        return PhaseShift(self.projector).decode(frames, bounds)

    def lit(self, frames: Frames) -> Any:
        return PhaseShift(self.projector).lit(frames)


def test_a_codec_must_be_a_frozen_dataclass_with_its_methods() -> None:
    class Plain:
        encode = decode = lit = lambda self: None

    with pytest.raises(AssertionError, match="must be a dataclass"):
        check_codec(Plain())
    with pytest.raises(AssertionError, match="must be a frozen dataclass"):
        check_codec(Thawed())
    with pytest.raises(AssertionError, match="methods encode, decode and lit"):
        check_codec(object())  # type: ignore[arg-type]


TRUE_RIG = Rig(
    Pinhole((640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]], np.zeros(5)),
    Pinhole((640, 480), [[900, 0, 320], [0, 900, 500], [0, 0, 1]], np.zeros(5)),
    Pose.from_rotation_vector([0, 0.2, 0], [-200, 0, 20]),
)


def board_view(name: str, index: int) -> BoardView:
    """Exact corners of a board in one of three poses, with 0.1 px of noise on the camera's."""
    rng = np.random.default_rng(index)
    board = np.stack(np.meshgrid(np.arange(6), np.arange(5)), axis=-1).reshape(-1, 2) * 25.0
    tilt = [[0.3, 0.1, 0.0], [-0.2, 0.4, 0.1], [0.1, -0.3, 0.2]][index]
    xyz = Pose.from_rotation_vector(tilt, [-60, -50, 700 + 60 * index]).apply(np.pad(board, ((0, 0), (0, 1))))
    camera = TRUE_RIG.camera.project(xyz) + rng.normal(0, 0.1, board.shape)
    return BoardView(name, (640, 480), board, camera, TRUE_RIG.to_projector(xyz), np.full(board.shape, 0.1))


@dataclass(frozen=True)
class Oracle:
    """A calibrator that knows the rig, with one fault, by name; a capture's picture holds the number of its pose."""

    fault: str = "none"

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        views = [self._observe(c) for c in captures]
        return views[::-1] if self.fault == "order" else views

    def _observe(self, capture: Capture) -> BoardView:
        assert capture.printed is not None
        value = int(capture.printed.max())
        if value == 0 and self.fault == "raises":
            raise IndexError("no corners")
        if value == 0 and self.fault != "credulous":
            return BoardView.unusable(capture.name, (640, 480), "no board was found")
        view = board_view(capture.name, max(value - 1, 0))
        return replace(view, face=np.zeros(3, dtype=np.intp)) if self.fault == "faceless" else view

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        used = [v for v in views if v.problem is None]
        if len(used) < 2 and self.fault != "bold":
            raise CalibrationError(f"{len(used)} usable views")
        rms = 0.001 if self.fault == "flattering" else 0.15
        results = [
            ViewResult(v.name, v.problem is None, v.problem or "", 0.14, 0.1, rms)
            for v in (used if self.fault == "forgetful" else views)
        ]
        return Calibration(TRUE_RIG, "oracle", tuple(results), 0.14, 0.1, rms, None, Verdict("good"))


def captures() -> list[Capture]:
    return [Capture(f"pose{i}", printed=np.full((8, 8), i + 1, dtype=np.uint8)) for i in range(3)]


def test_a_calibrator_without_fault_passes() -> None:
    check_calibrator(Oracle(), captures())


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("order", "one view a capture, in order"),
        ("credulous", "a blank capture must become a view whose problem"),
        ("bold", "from 0 views, too few of them usable, must raise an SlkitError"),
        ("flattering", "reports a joint rms of 0.001 px, but with that rig no pose"),
        ("forgetful", "must tell of every view"),
        ("raises", "a blank capture must not make observe"),
        ("faceless", "face needs one number a row"),
    ],
)
def test_each_fault_of_a_calibrator_is_told(fault: str, sentence: str) -> None:
    with pytest.raises(AssertionError, match=sentence):
        check_calibrator(Oracle(fault), captures())
