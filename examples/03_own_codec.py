"""A codec of one's own: a column's number written in grey levels, with base-4 digits instead of bits.

    python examples/03_own_codec.py

A class with three methods is all; it inherits nothing. Registered in its own package's pyproject.toml,

    [project.entry-points."slkit.codecs"]
    levels = "my_package:Levels"

it answers to `slkit patterns levels`, `slkit scan`, and everything else that takes a codec's name.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

import slkit
from slkit.codecs.gray import Gray
from slkit.data import check_image, describe_image
from slkit.errors import DecodeError, InputError
from slkit.report.measure import distances_to_mesh
from slkit.simulation import Optics, SimulatedScanner, build, one_to_one_rig
from slkit.testing import check_codec


@dataclass(frozen=True)
class Levels:
    """Reflected code in base `levels`, `step` px a cell. It wants a projector whose light is linear, as Gray does not.

    min_snr: white - black in units of the noise, below it a pixel is unlit.
    """

    projector: tuple[int, int]
    levels: int = 4
    step: int = 2
    min_snr: float = 5.0

    def encode(self) -> slkit.Frames:
        width, height = self.projector
        cell = np.arange(width) // self.step

        def draw(index: int) -> np.ndarray:
            if index < 2:
                return np.full((height, width), 255 * (1 - index), np.uint8)
            ahead, digit = divmod(cell // self.levels ** (len(names) - 1 - index), self.levels)
            # Every other run is reversed: neighbours differ in one digit by one level, so blur cannot jump.
            digit = np.where(ahead % 2 == 0, digit, self.levels - 1 - digit)
            return np.tile(np.rint(255 * digit / (self.levels - 1)).astype(np.uint8), (height, 1))

        names = self._names()
        return slkit.Frames(names, draw)

    def decode(self, frames: slkit.Frames, bounds: np.ndarray | None = None) -> slkit.Correspondences:
        if len(frames) != len(self._names()):
            raise InputError(f"{len(self._names())} frames are needed, not {len(frames)}")
        pictures = [_checked(frames, i, first=None) for i in range(1)]
        pictures += [_checked(frames, i, first=pictures[0]) for i in range(1, len(frames))]
        white, black, *digits = (p.mean(axis=2) if p.ndim == 3 else p.astype(float) for p in pictures)
        scale = np.iinfo(pictures[0].dtype).max
        # The noise of the dark picture, from differences of neighbours, never below one of 256 levels.
        noise = max(1.4826 * np.median(np.abs(np.diff(black))) / np.sqrt(2), scale / 255)
        keep = (white - black > self.min_snr * noise * np.sqrt(2)) & (white < scale)
        if not keep.any():
            raise DecodeError("no pixel is lit well above the noise, or all are saturated")
        span = np.maximum(white - black, 1)
        cell, margin = np.zeros(white.shape, int), np.full(white.shape, 0.5)
        for picture in digits:
            level = (picture - black) / span * (self.levels - 1)
            digit = np.clip(np.rint(level), 0, self.levels - 1).astype(int)
            margin = np.minimum(margin, 0.5 - np.clip(np.abs(level - digit), 0, 0.5))
            cell = cell * self.levels + np.where(cell % 2 == 0, digit, self.levels - 1 - digit)
        column = (cell + 0.5) * self.step - 0.5
        keep &= column <= self.projector[0] - 0.5
        if bounds is not None:
            keep &= (column >= bounds[..., 0] - self.step) & (column <= bounds[..., 1] + self.step)
        rows, cols = np.nonzero(keep)
        silent = np.full(len(rows), np.nan)
        color = pictures[0][keep] / pictures[0].max()
        return slkit.Correspondences(
            np.stack([cols, rows], axis=1),
            np.stack([column[keep], silent], axis=1),
            np.stack([np.full(len(rows), self.step / np.sqrt(12)), silent], axis=1),
            ndtr(margin * span / (self.levels - 1) / noise)[keep],
            color if color.ndim == 2 else np.repeat(color[:, None], 3, axis=1),
        )

    def lit(self, frames: slkit.Frames) -> np.ndarray:
        white = frames[0]
        return white if white.ndim == 2 else np.rint(white.mean(axis=2)).astype(white.dtype)

    def _names(self) -> tuple[str, ...]:
        digits = next(n for n in range(1, 99) if self.levels**n * self.step >= self.projector[0])
        return ("white", "black", *(f"x_digit{n}" for n in reversed(range(digits))))


def _checked(frames: slkit.Frames, index: int, first: np.ndarray | None) -> np.ndarray:
    image, name = frames[index], frames.names[index]
    check_image(image, name)
    if first is not None and (image.shape, image.dtype) != (first.shape, first.dtype):
        raise InputError(f"frame {name} is {describe_image(image)}, the first is {describe_image(first)}")
    return image


def main(rig: slkit.Rig | None = None) -> None:
    """Try the codec on the conformance suite, then scan a sphere with it and with Gray code."""
    check_codec(Levels((160, 120)))
    print("check_codec: every promise kept")
    rig = rig or one_to_one_rig()
    scanner = SimulatedScanner(build("sphere", rig), rig, Optics(), seed=1)
    for codec in (Levels(rig.projector.size), Gray(rig.projector.size, step=2)):
        patterns = codec.encode()
        cloud = slkit.triangulate(codec.decode(scanner.capture(patterns)), rig)
        error = distances_to_mesh(cloud.xyz, *scanner.scene.mesh())
        print(
            f"{type(codec).__name__}: {len(patterns)} patterns, {len(cloud)} points, "
            f"median distance to the sphere {np.median(error):.3f} mm, {np.mean(error > 5):.2%} beyond 5 mm"
        )


if __name__ == "__main__":
    main()
