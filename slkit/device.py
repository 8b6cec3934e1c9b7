"""Where the heaviest loops run: on the processor, or on a graphics processor that speaks CUDA."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar

from slkit.errors import InputError

DEVICES = ("cpu", "cuda")

_chosen = ContextVar("device", default="cpu")


@contextmanager
def on_device(name: str) -> Generator[None]:
    """Run within on a device, "cpu" or "cuda", what can run there: Gray code's bits and ray-plane triangulation.

    The choice holds for the calling thread. Errors: InputError for another name, or with the reason why there is no
    CUDA.
    """
    if name not in DEVICES:
        raise InputError(f"device must be one of {', '.join(DEVICES)}, not {name!r}")
    if name == "cuda" and (why := why_no_cuda()):
        raise InputError(f"there is no CUDA device to run on: {why}; leave --device away")
    token = _chosen.set(name)
    try:
        yield
    finally:
        _chosen.reset(token)


def on_cuda() -> bool:
    """Whether the calling thread chose CUDA."""
    return _chosen.get() == "cuda"


def why_no_cuda() -> str:
    """Return the reason why CUDA cannot be used here, "" where it can."""
    try:
        from numba import cuda

        cuda.current_context()
    # The driver, numba and its settings have errors of their own, over several lines.
    except Exception as error:
        text = " ".join(str(error).split()).removeprefix("Error at driver init: ")
        return text.partition(". ")[0].strip(" .:") or type(error).__name__
    return "" if cuda.is_available() else "numba finds no CUDA toolkit"
