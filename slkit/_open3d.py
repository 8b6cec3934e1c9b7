"""The only door to Open3D, which is slow to import and needs a library that a plain machine lacks."""

import ctypes
from functools import cache
from types import ModuleType
from typing import Any

from slkit.errors import SlkitError


@cache
def load() -> Any:
    """Return the `open3d` module, imported at the first call.

    Open3D links against libusb-1.0 for cameras that slkit does not use; the PyPI package `libusb-package`
    carries that library, so that no system package is needed.

    Errors: SlkitError where Open3D cannot be imported.
    """
    import libusb_package

    library: Any = libusb_package.get_library_path()
    if library is not None:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        import open3d
    except ImportError as error:
        raise SlkitError(f"Open3D cannot be imported ({error}): reinstall it with `pip install open3d`") from error
    module: ModuleType = open3d
    return module
