"""The only door to Open3D, which is slow to import and needs a library that a plain machine lacks."""

import ctypes
from functools import cache
from types import ModuleType
from typing import Any


@cache
def load() -> Any:
    """Return the `open3d` module, imported at the first call.

    Open3D links against libusb-1.0 for cameras that slkit does not use; the PyPI package `libusb-package`
    carries that library, so that no system package is needed.

    Errors: ImportError where Open3D is not installed whole.
    """
    import libusb_package

    library: Any = libusb_package.get_library_path()
    if library is not None:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    import open3d

    module: ModuleType = open3d
    return module
