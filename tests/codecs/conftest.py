from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import map_coordinates

from slkit.data import Correspondences, Frames, Image
from slkit.geometry import Rig

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shot:
    """A simulated scene: what a codec's pictures look like, and the truth about them."""

    scanner: Any
    truth: Floats
    lit: npt.NDArray[np.bool_]

    def frames(self, codec: Any) -> Frames:
        seen = self.scanner.capture(codec.encode())
        return Frames.of([seen[i] for i in range(len(seen))], seen.names)

    def errors(self, found: Correspondences, axis: int) -> tuple[Floats, Floats]:
        """Return error and sigma in projector px where the truth is known."""
        true = map_coordinates(self.truth[..., axis], found.camera_xy.T[::-1], order=1, cval=np.nan)
        known = np.isfinite(true)
        return (found.projector_xy[:, axis] - true)[known], found.sigma[known, axis]

    def completeness(self, found: Correspondences) -> float:
        """Return the share of lit pixels that have a correspondence within one pixel."""
        got = np.zeros(self.lit.shape, np.uint8)
        cols, rows = np.rint(found.camera_xy).astype(int).T
        got[rows, cols] = 1
        return float(cv2.dilate(got, np.ones((3, 3), np.uint8))[self.lit].mean())


def shot(rig: Rig, scene: str, **optics: Any) -> Shot:
    from slkit.simulation import Optics, SimulatedScanner, build

    scanner = SimulatedScanner(build(scene, rig), rig, Optics(**optics), seed=1)
    truth = scanner.truth()
    map_xy = np.full((*truth.lit.shape, 2), np.nan, dtype=np.float32)
    map_xy[truth.lit] = truth.projector_xy
    return Shot(scanner, map_xy, truth.lit)


@pytest.fixture(scope="session")
def flat(scaled: Callable[[Rig, float], Rig]) -> Shot:
    """A plane at one projector pixel per camera pixel: 100 grey levels, noise 2, blur 0.7 px in all."""
    from slkit.simulation import one_to_one_rig

    levels = {"white_level": 100 / 255, "read_noise": 2.0, "shot_noise": 0.0}
    return shot(scaled(one_to_one_rig(), 0.35), "plane", **levels, projector_blur_px=0.5, camera_blur_px=0.5)


@pytest.fixture(scope="session")
def sculpture(scaled: Callable[[Rig, float], Rig]) -> Shot:
    """The free-form object with the paper's rig, half as large in pixels: two projector pixels per camera pixel."""
    from slkit.simulation import paper_rig

    return shot(scaled(paper_rig(), 0.5), "free-form")


@pytest.fixture(scope="session")
def dimmed() -> Callable[[Frames], Frames]:
    """Return a function that gives patterns as a perfect camera without noise sees them, 40 to 210 of 255."""
    return lambda patterns: Frames.of([dim(p) for p in patterns], patterns.names)


def dim(pattern: Image) -> Image:
    return (40 + pattern.astype(np.float32) * (170 / 255)).astype(np.uint8)


@pytest.fixture(scope="session")
def read_frames() -> Callable[[Path, str], Frames]:
    """Return a function that reads the pictures of a folder that fit a glob, in order of their names."""

    @cache
    def read(folder: Path, pattern: str) -> Frames:
        files = sorted(folder.glob(pattern))
        return Frames.of([cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files], [f.name for f in files])

    return read


def robust_spread(values: Floats) -> float:
    """Return 1.4826 times the median absolute deviation."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


@pytest.fixture(scope="session")
def spread() -> Callable[[Floats], float]:
    return robust_spread
