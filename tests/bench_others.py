"""The same work by slkit, by OpenCV's contributed modules and by comimag's Fringes, timed by pytest-benchmark.

`make bench` runs it and `make test` does not: both others bring an OpenCV of their own, and have an environment apart.
Pictures are seen by the camera of `decoding_benchmarks`; what each decodes is compared with the truth first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
from decoding_benchmarks import PROJECTOR, seen, seen_at

from slkit.codecs.gray import Gray
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.data import Frames

SIZES = [(1024, 768), (4096, 3000)]
PERIODS = (64.0, 8.0, 1.0)


@dataclass(frozen=True)
class Patterns:
    """Patterns (n, h, w) of a stranger, as a codec shows them."""

    pictures: Any

    def encode(self) -> Frames:
        return Frames.of(list(self.pictures))


def within(found: np.ndarray, true: np.ndarray, limit: float) -> float:
    """Return the share of positions that are right within a limit in px, of the lit middle of the picture."""
    height, width = true.shape
    middle = np.s_[height // 3 : -height // 3, width // 3 : -width // 3]
    return float((np.abs(found - true)[middle] <= limit).mean())


def slkit_map(found: Any, size: tuple[int, int]) -> np.ndarray:
    return found.as_map(size[::-1])[..., 0]


def timed(benchmark: Any, group: str, size: tuple[int, int], work: Any, rounds: int = 5) -> Any:
    benchmark.group = f"{group}, {size[0]} x {size[1]} px"
    return benchmark.pedantic(work, rounds=rounds, warmup_rounds=1)


@pytest.mark.parametrize("size", SIZES)
def test_gray_by_slkit(benchmark, size):
    codec = Gray(PROJECTOR, axes="both")
    frames = seen(codec, *size)
    found = timed(benchmark, "Gray code, both axes", size, lambda: codec.decode(frames))
    assert within(slkit_map(found, size), seen_at(*size)[0], 1.0) > 0.98


@pytest.mark.parametrize("size", SIZES)
def test_gray_by_opencv(benchmark, size):
    """`decode` wants two cameras: it is given the same pictures twice, so that half of its time is one camera's."""
    pattern = cv2.structured_light.GrayCodePattern_create(*PROJECTOR)
    _, shown = pattern.generate()
    black, white = np.zeros(PROJECTOR[::-1], np.uint8), np.full(PROJECTOR[::-1], 255, np.uint8)
    *pictures, dark, lit = seen(Patterns([*shown, black, white]), *size)
    rows, cols = size[1] // 2, range(size[0] // 3, size[0] // 2, 7)
    told = [pattern.getProjPixel(pictures, x, rows) for x in cols]
    assert np.mean([abs(at[0] - seen_at(*size)[0][rows, x]) <= 1 for x, (_, at) in zip(cols, told, strict=True)]) > 0.9
    timed(
        benchmark, "Gray code, both axes", size, lambda: pattern.decode([pictures] * 2, None, [dark] * 2, [lit] * 2), 1
    )


@pytest.mark.parametrize("size", SIZES)
def test_phase_by_slkit(benchmark, size):
    codec = PhaseShift(PROJECTOR, x=Fringes(PERIODS))
    frames = seen(codec, *size)
    found = timed(benchmark, "phase shift, three sets of four steps", size, lambda: codec.decode(frames))
    assert within(slkit_map(found, size), seen_at(*size)[0], 1.0) > 0.98


@pytest.mark.parametrize("size", SIZES)
def test_phase_by_fringes(benchmark, size):
    fringes = pytest.importorskip("fringes").Fringes()
    fringes.X, fringes.Y, fringes.D, fringes.K, fringes.N = *PROJECTOR, 1, len(PERIODS), 4
    fringes.v = list(PERIODS)
    shown = fringes.encode()
    pictures = np.stack(list(seen(Patterns(shown[..., 0]), *size)))[..., None]
    found = timed(benchmark, "phase shift, three sets of four steps", size, lambda: fringes.decode(pictures), 2)
    assert within(found.x[0, ..., 0], seen_at(*size)[0], 1.0) > 0.98
