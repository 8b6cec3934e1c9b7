"""A projector and a camera that look at a scene: pictures of patterns, and the truth behind them."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.data import Frames, Image, check_image
from slkit.errors import InputError
from slkit.geometry import Floats, Rig
from slkit.simulation.light import LightField, Singles, Tracer
from slkit.simulation.surface import Doubles, Scene

# A projector pixel is a lit square: each is cut into this many cells a side before it is blurred.
_CELLS = 3


@dataclass(frozen=True)
class Optics:
    """How bright, how sharp and how noisy. Levels are shares of full scale; blurs are 1 sigma of a Gaussian in px.

    white_level: what an albedo of 1 gives that faces the projector's white at the working distance. ambient: what the
    same surface gives by room light alone. black_level: what darkness gives. projector_gamma: light = value ** gamma.
    crosstalk: the share of each channel that each of the others sees instead, or the 3 x 3 mixing (seen, projected).
    read_noise: 1 sigma in grey levels of the picture's depth; shot_noise: variance in grey levels per grey level.
    bits: 8 or 16. color: RGB pictures, else the mean of the channels. samples: rays a pixel's side.
    Errors: InputError where a value is out of range.
    """

    white_level: float = 0.65
    ambient: float = 0.12
    black_level: float = 0.015
    projector_gamma: float = 1.0
    projector_blur_px: float = 0.6
    camera_blur_px: float = 0.6
    crosstalk: float | tuple[tuple[float, float, float], ...] = 0.0
    read_noise: float = 1.0
    shot_noise: float = 0.01
    bits: int = 8
    color: bool = False
    samples: int = 3

    def __post_init__(self) -> None:
        if self.bits not in (8, 16):
            raise InputError(f"bits must be 8 or 16, not {self.bits}")
        if self.samples < 3:
            raise InputError(f"samples must be at least 3 a side, not {self.samples}")
        for name in ("ambient", "black_level", "projector_blur_px", "camera_blur_px", "read_noise", "shot_noise"):
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name} must not be negative or infinite: {getattr(self, name)}")
        for name in ("white_level", "projector_gamma"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}")
        if self.mixing().shape != (3, 3) or not np.isfinite(self.mixing()).all() or self.mixing().min() < 0:
            raise InputError("crosstalk must be a share between 0 and 0.5, or 3 x 3 shares that are not negative")

    def mixing(self) -> Doubles:
        """Return the 3 x 3 matrix that takes reflected RGB to seen RGB."""
        if isinstance(self.crosstalk, int | float):
            return (1 - 3 * self.crosstalk) * np.eye(3) + np.full((3, 3), self.crosstalk)
        return np.array(self.crosstalk, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Truth:
    """What is really there, for every camera pixel that sees a surface which the projector lights; rows by pixel row.

    camera_xy (m, 2) whole px; xyz_mm (m, 3), camera frame, on the ray through the pixel's centre; projector_xy (m, 2)
    px; visible, lit (h, w): which pixels see a surface at all, and which of them have a row.
    """

    camera_xy: Doubles
    xyz_mm: Doubles
    projector_xy: Doubles
    visible: npt.NDArray[np.bool_]
    lit: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SimulatedScanner:
    """A `Scanner` without hardware. Equal arguments give equal pictures; noise differs by seed, frame and name."""

    scene: Scene
    rig: Rig
    optics: Optics = field(default_factory=Optics)
    seed: int = 0

    def capture(self, patterns: Frames) -> Frames:
        """Return one picture a pattern, rendered when it is asked for; the scene is traced once.

        Errors: InputError (when a picture is asked for) where a pattern has not the projector's size.
        """

        def load(index: int) -> Image:
            light = self._projected(patterns[index], patterns.names[index])
            return self._expose(light + self.optics.ambient * self._field.albedo, index, patterns.names[index])

        return Frames(patterns.names, load)

    def photograph(self, name: str = "photograph") -> Image:
        """Return a picture with the projector off and room light as strong as its white."""
        return self._expose(self.optics.white_level * self._field.albedo, 0, name)

    def under(self, optics: Optics, seed: int) -> SimulatedScanner:
        """Return the same scene and rig with other optics and noise; rays are not traced again."""
        other = replace(self, optics=optics, seed=seed)
        if optics.samples == self.optics.samples:
            other.__dict__["_tracer"], other.__dict__["_field"] = self._tracer, self._field
        return other

    def truth(self) -> Truth:
        """Return what the centre ray of every pixel meets."""
        width, height = self.rig.camera.size
        hits = self._tracer.centers()
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
        lit = hits.lit
        shape = (height, width)
        return Truth(
            pixels[lit].astype(np.float64),
            hits.xyz[lit],
            hits.projector_xy[lit],
            hits.seen.reshape(shape),
            lit.reshape(shape),
        )

    @cached_property
    def _tracer(self) -> Tracer:
        return Tracer(self.scene, self.rig, self.optics.samples)

    @cached_property
    def _field(self) -> LightField:
        return self._tracer.field()

    def _projected(self, pattern: Any, name: str) -> Singles:
        """Return what the scene reflects of a pattern, (h, w, 1 or 3), shares of full scale."""
        from slkit.simulation._kernels import gather

        check_image(pattern, name)
        width, height = self.rig.projector.size
        if pattern.shape[:2] != (height, width):
            raise InputError(
                f"pattern {name} is {pattern.shape[1]} x {pattern.shape[0]} px, the projector {width} x {height} px"
            )
        cells, shift = self._emitted(pattern)
        light = self._field
        channels = max(cells.shape[2], light.weight.shape[3])
        seen = np.empty((*light.weight.shape[:2], channels), dtype=np.float32)
        gather(cells, light.projector_xy, light.weight, float(_CELLS), shift, seen)
        return seen

    def _emitted(self, pattern: Image) -> tuple[Singles, float]:
        """Return the light that leaves the projector, in cells (H, W, 1 or 3), and where pixel 0 lies in them."""
        import cv2

        optics = self.optics
        scale = np.iinfo(pattern.dtype).max
        table = optics.white_level * (np.arange(scale + 1) / scale) ** optics.projector_gamma
        light: Any = table.astype(np.float32)[pattern]
        edge = int(np.ceil(3 * optics.projector_blur_px)) + 1
        light = np.pad(light, ((edge, edge), (edge, edge), *((0, 0),) * (light.ndim - 2)))
        light = light.repeat(_CELLS, axis=0).repeat(_CELLS, axis=1)
        if optics.projector_blur_px > 0:
            sigma = _CELLS * optics.projector_blur_px
            light = cv2.GaussianBlur(light, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        return light.reshape(*light.shape[:2], -1), _CELLS * edge + (_CELLS - 1) / 2

    def _expose(self, light: Floats, index: int, name: str) -> Image:
        """Return the picture of light (h, w, 1 or 3), shares of full scale, that falls on the sensor."""
        import cv2

        optics, full = self.optics, 2**self.optics.bits - 1
        mixing = optics.mixing() if optics.color else optics.mixing().mean(axis=0, keepdims=True)
        mixing = mixing.sum(axis=1, keepdims=True) if light.shape[2] == 1 else mixing
        seen: Any = light @ mixing.T.astype(np.float32)
        if optics.camera_blur_px > 0:
            seen = cv2.GaussianBlur(seen, (0, 0), optics.camera_blur_px).reshape(seen.shape)
        seen *= full
        if optics.read_noise > 0 or optics.shot_noise > 0:
            rng = np.random.default_rng([self.seed, index, zlib.crc32(name.encode())])
            sigma = np.sqrt(optics.read_noise**2 + optics.shot_noise * seen)
            seen = seen + sigma * rng.standard_normal(seen.shape, dtype=np.float32)
        picture = np.clip(np.rint(seen + optics.black_level * full), 0, full)
        picture = picture.astype(np.uint8 if optics.bits == 8 else np.uint16)
        return picture if optics.color else picture[:, :, 0]
