import os
import pkgutil
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook

# Every call into slkit has its arguments and result checked against their annotations, a whole number passing for a
# float; numba's kernels cannot be wrapped.
sys.modules["typecheck"] = ModuleType("typecheck")
sys.modules["typecheck"].check = beartype(conf=BeartypeConf(is_pep484_tower=True))
_ROOT = Path(__file__).parent.parent / "slkit"
_MODULES = [m.name for m in pkgutil.walk_packages([str(_ROOT)], "slkit.") if not m.ispkg and "_kernels" not in m.name]
install_import_hook(_MODULES, "typecheck.check")

from slkit.geometry import Pinhole, Rig  # noqa: E402


@pytest.fixture(scope="session")
def scaled() -> Callable[[Rig, float], Rig]:
    """Return a function that gives a rig whose pictures are smaller by a factor and otherwise the same."""

    def device(d: Pinhole, factor: float) -> Pinhole:
        matrix = d.K.copy()
        matrix[:2] *= factor
        matrix[:2, 2] += (factor - 1) / 2
        return Pinhole((round(d.size[0] * factor), round(d.size[1] * factor)), matrix, d.distortion)

    return lambda rig, factor: replace(rig, camera=device(rig.camera, factor), projector=device(rig.projector, factor))


@pytest.fixture(scope="session")
def small_rig(scaled: Callable[[Rig, float], Rig]) -> Rig:
    """The paper's rig with a camera of 192 x 144 and a projector of 256 x 192 px."""
    from slkit.simulation import paper_rig

    return scaled(paper_rig(), 0.25)


@pytest.fixture(scope="session")
def gray_scan(small_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated scan folder of a sphere under Gray code with the small rig; not to be changed by a test."""
    from slkit import pipeline
    from slkit.simulation import Optics

    folder = tmp_path_factory.mktemp("gray_scan")
    optics = Optics(read_noise=0.5, shot_noise=0.0)
    pipeline.simulate_scan(folder, small_rig, "sphere", ["gray"], {"step": 2}, optics, seed=3)
    return folder


@pytest.fixture(scope="session")
def tiny_rig(scaled: Callable[[Rig, float], Rig]) -> Rig:
    """The paper's rig with a camera of 96 x 72 and a projector of 128 x 96 px."""
    from slkit.simulation import paper_rig

    return scaled(paper_rig(), 0.125)


@pytest.fixture(scope="session")
def tiny_captures(tiny_rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """Return a function that writes scan folders with the tiny rig, all different, under given names into a folder."""
    from slkit import pipeline
    from slkit.files import read_image, write_png
    from slkit.simulation import Optics

    pattern = tmp_path_factory.mktemp("tiny_scan")
    pipeline.simulate_scan(pattern, tiny_rig, "sphere", ["gray"], {"step": 4}, Optics(read_noise=0.5, shot_noise=0.0))
    pictures = {file.name: read_image(file) for file in pattern.glob("*.png")}

    def write(folder: Path, *names: str) -> None:
        for seed, name in enumerate(names):
            rng = np.random.default_rng(seed)
            (folder / name).mkdir(parents=True)
            shutil.copy(pattern / "capture.toml", folder / name)
            for file, picture in pictures.items():
                noisy = picture + rng.integers(-1, 2, picture.shape)
                write_png(folder / name / file, np.clip(noisy, 0, 255).astype(np.uint8))

    return write


@pytest.fixture(scope="session")
def captures() -> Callable[[str], Path]:
    """Return a function that gives the folder of a real capture set, or skips the test where it is absent."""
    root = Path(os.environ.get("SLKIT_DATA", Path(__file__).parent.parent.parent / "shared" / "data"))

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"the capture set {name} is not in {root}: set SLKIT_DATA")
        return root / name

    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
