"""A codec of one's own: a column's number written in grey levels, with base-4 digits instead of bits.

    python examples/03_own_codec.py

Three methods are all. With `levels = "my_package:Levels"` under [project.entry-points."slkit.codecs"] in its package's
pyproject.toml, every command takes its name.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

import slkit
from slkit.codecs.gray import Gray
from slkit.errors import DecodeError, InputError
from slkit.report.measure import distances_to_mesh
from slkit.simulation import Optics, SimulatedScanner, build, one_to_one_rig
from slkit.testing import check_codec

BASE = 4


@dataclass(frozen=True)
class Levels:
    """Reflected code in base 4, `step` px a cell, for a projector of linear light; min_snr: least white - black."""

    projector: tuple[int, int]
    step: int = 2
    min_snr: float = 5.0

    def encode(self) -> slkit.Frames:
        """Return white, black and the digits, highest first; each is drawn when it is asked for."""
        (width, height), names = self.projector, self._names()

        def draw(index: int) -> np.ndarray:
            if index < 2:
                return np.full((height, width), 255 * (1 - index), np.uint8)
            ahead, digit = divmod(np.arange(width) // self.step // BASE ** (len(names) - 1 - index), BASE)
            # Every other run is reversed: neighbours differ in one digit by one level, so blur cannot jump.
            digit = np.where(ahead % 2 == 0, digit, BASE - 1 - digit)
            return np.tile(np.uint8(255 // (BASE - 1)) * digit.astype(np.uint8), (height, 1))

        return slkit.Frames(names, draw)

    def decode(self, frames: slkit.Frames, bounds: np.ndarray | None = None) -> slkit.Correspondences:
        """Return the column of every lit pixel; bounds rule out what they do not allow."""
        if len(frames) != len(self._names()):
            raise InputError(f"{len(self._names())} frames are needed, not {len(frames)}")
        pictures = frames.stack()
        scale, color = np.iinfo(pictures.dtype).max, pictures[0] / pictures[0].max(initial=1)
        white, black, *digits = pictures.mean(axis=3) if pictures.ndim == 4 else pictures.astype(float)
        # The noise of the dark picture, from differences of neighbours, never below one of 256 levels.
        noise = max(1.4826 * np.median(np.abs(np.diff(black))) / np.sqrt(2), scale / 255)
        keep = (white - black > self.min_snr * noise * np.sqrt(2)) & (white < scale)
        if not keep.any():
            raise DecodeError("no pixel is lit well above the noise, or all are saturated")
        span = np.maximum(white - black, 1) / (BASE - 1)
        cell, margin = np.zeros(white.shape, int), np.full(white.shape, 0.5)
        for picture in digits:
            level = (picture - black) / span
            digit = np.clip(np.rint(level), 0, BASE - 1).astype(int)
            margin = np.minimum(margin, 0.5 - np.clip(np.abs(level - digit), 0, 0.5))
            cell = cell * BASE + np.where(cell % 2 == 0, digit, BASE - 1 - digit)
        column = (cell + 0.5) * self.step - 0.5
        keep &= column <= self.projector[0] - 0.5
        if bounds is not None:
            keep &= (column >= bounds[..., 0] - self.step) & (column <= bounds[..., 1] + self.step)
        found = np.stack([column, np.full(column.shape, np.nan)], axis=-1)[keep]
        sigma = np.where(np.isfinite(found), self.step / np.sqrt(12), np.nan)
        color = (np.dstack([color] * 3) if color.ndim == 2 else color)[keep]
        certain = ndtr(margin * span / noise)[keep]
        return slkit.Correspondences(np.argwhere(keep)[:, ::-1], found, sigma, certain, color)

    def lit(self, frames: slkit.Frames) -> np.ndarray:
        """Return the white picture in grey."""
        white = frames[0]
        return white if white.ndim == 2 else np.rint(white.mean(axis=2)).astype(white.dtype)

    def _names(self) -> tuple[str, ...]:
        digits = next(n for n in range(1, 99) if BASE**n * self.step >= self.projector[0])
        return ("white", "black", *(f"x_digit{n}" for n in reversed(range(digits))))


def main(rig: slkit.Rig | None = None) -> None:
    """Try the codec on the conformance suite, then scan a sphere with it and with Gray code."""
    check_codec(Levels((160, 120)))
    print("check_codec: every promise kept")
    rig = rig or one_to_one_rig()
    scanner = SimulatedScanner(build("sphere", rig), rig, Optics(), seed=1)
    for codec in (Levels(rig.projector.size), Gray(rig.projector.size, step=2)):
        cloud = slkit.triangulate(codec.decode(scanner.capture(codec.encode())), rig)
        error = np.median(distances_to_mesh(cloud.xyz, *scanner.scene.mesh()))
        name, patterns = type(codec).__name__, len(codec.encode())
        print(f"{name}: {patterns} patterns, {len(cloud)} points, median error {error:.3f} mm")


if __name__ == "__main__":
    main()
