"""What a calibration estimates: which parameters of each device are free, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from slkit.errors import InputError
from slkit.geometry import DISTORTION_NAMES, Pinhole

DEFAULT_DISTORTION = ("k1", "k2", "p1", "p2")


@dataclass(frozen=True)
class Lens:
    """Which parameters of one device are free, and what its data sheet says of it.

    distortion: the coefficients of k1 k2 p1 p2 k3 that are estimated, the others are 0; skew: estimated, else 0.
    aspect: fy / fx where that is known, None where both are free. principal_point: (x, y) px where it is known, None
    where it is free. throw_ratio: value and 1 sigma of distance over image width, for fx. offset: value and 1 sigma of
    how far the axis lies below the middle of the image, in half image heights (1: at the lower edge), for cy.
    Errors: InputError for values that cannot be.
    """

    distortion: tuple[str, ...] = DEFAULT_DISTORTION
    skew: bool = False
    aspect: float | None = None
    principal_point: tuple[float, float] | None = None
    throw_ratio: tuple[float, float] | None = None
    offset: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_distortion(self.distortion, "distortion")
        if self.aspect is not None and not 0 < self.aspect < np.inf:
            raise InputError(f"aspect must be a positive number, not {self.aspect}")
        for name in ("throw_ratio", "offset"):
            prior = getattr(self, name)
            if prior is not None and not 0 < prior[1] < np.inf:
                raise InputError(f"{name} must be a value and its 1 sigma, which is positive, not {list(prior)}")
        if self.throw_ratio is not None and not self.throw_ratio[0] > 0:
            raise InputError(f"throw_ratio must be positive, not {self.throw_ratio[0]}")

    def held(self, device: Pinhole) -> Pinhole:
        """Return a device with what this lens holds fixed at its value."""
        matrix = np.array(device.K)
        matrix[0, 1] *= self.skew
        if self.aspect is not None:
            matrix[1, 1] = self.aspect * matrix[0, 0]
        if self.principal_point is not None:
            matrix[:2, 2] = self.principal_point
        kept = np.array([name in self.distortion for name in DISTORTION_NAMES])
        return replace(device, K=matrix, distortion=device.distortion * kept)


@dataclass(frozen=True)
class Model:
    """What is estimated, and how.

    camera, projector: their lenses. refine: adjust everything together; False leaves the paper's sequence of camera,
    poses, projector. warp: every board may be bent, by two numbers each (see `surfaces.Sheet`). release_mm: the printed
    points may lie that far (1 sigma) from where they should, None: they are exact.
    loss: `huber` weighs rows down that lie far out and rejects those that cannot be noise, `squares` takes all.
    Errors: InputError for a release that is not positive.
    """

    camera: Lens = field(default_factory=Lens)
    projector: Lens = field(default_factory=Lens)
    refine: bool = True
    warp: bool = False
    release_mm: float | None = None
    loss: Literal["huber", "squares"] = "huber"

    def __post_init__(self) -> None:
        if self.release_mm is not None and not 0 < self.release_mm < np.inf:
            raise InputError(f"release_mm must be a positive length, not {self.release_mm}")


def check_distortion(free: Sequence[str], name: str) -> None:
    """Refuse unknown distortion coefficients. Errors: InputError naming the field `name`."""
    for coefficient in free:
        if coefficient not in DISTORTION_NAMES:
            known = ", ".join(DISTORTION_NAMES)
            raise InputError(f"{name}: there is no coefficient {coefficient!r}; there are {known}")
