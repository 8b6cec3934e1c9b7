"""Pictures in a row, projected or seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit.errors import InputError

Image = npt.NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True, eq=False)
class Frames:
    """A sequence of pictures, projected or seen: `frames[i]` is (h, w) grey or (h, w, 3) RGB, uint8 or uint16.

    names: one a frame, for messages and files. load: gives frame i, and may read it from disk at that moment. in_turn:
    whether to ask for them in any other order than theirs, or for several at a time, costs much, as with a video.
    """

    names: tuple[str, ...]
    load: Callable[[int], Image] = field(repr=False)
    in_turn: bool = False

    @classmethod
    def of(cls, images: Sequence[Image], names: Sequence[str] | None = None) -> Frames:
        """Return the frames of pictures in memory; default names are 000, 001, ...

        Errors: InputError where a picture is not (h, w) or (h, w, 3) of uint8 or uint16, or names are too few.
        """
        names = tuple(names) if names is not None else tuple(f"{i:03d}" for i in range(len(images)))
        if len(names) != len(images):
            raise InputError(f"{len(images)} frames need as many names, not {len(names)}")
        for name, image in zip(names, images, strict=True):
            check_image(image, name)
        held = tuple(images)
        return cls(names, held.__getitem__)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> Image:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self.load(index % len(self))

    def __iter__(self) -> Iterator[Image]:
        return (self.load(i) for i in range(len(self)))

    def select(self, indices: Sequence[int]) -> Frames:
        """Return some of the frames, in the order of `indices`; nothing is loaded."""
        chosen = tuple(range(len(self))[i] for i in indices)
        return Frames(tuple(self.names[i] for i in chosen), lambda i: self.load(chosen[i]), self.in_turn)

    def stack(self) -> Image:
        """Return all frames as one array, (n, h, w) or (n, h, w, 3).

        Errors: InputError naming the first frame whose shape or depth differs from frame 0.
        """
        images = list(self)
        for name, image in zip(self.names, images, strict=True):
            if image.shape != images[0].shape or image.dtype != images[0].dtype:
                raise InputError(
                    f"frame {name} is {describe_image(image)}, but {self.names[0]} is {describe_image(images[0])}"
                )
        return np.stack(images)


def check_image(image: Any, name: str) -> None:
    """Refuse what is not a picture: (h, w) or (h, w, 3) of uint8 or uint16. Errors: InputError naming `name`."""
    shape = getattr(image, "shape", ())
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] != 3) or 0 in shape:
        raise InputError(f"frame {name} must be grey (h, w) or RGB (h, w, 3), not of shape {shape}")
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"frame {name} must hold 8- or 16-bit whole numbers, not {image.dtype}")


def describe_image(image: Image) -> str:
    """Return size, channels and depth in words for a message, such as `1280 x 1024 px grey 8-bit`."""
    kind = "grey" if image.ndim == 2 else "colour"
    return f"{image.shape[1]} x {image.shape[0]} px {kind} {8 * image.dtype.itemsize}-bit"
