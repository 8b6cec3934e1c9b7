"""How far each codec is from its physical limit, on a simulated plane: rms to the fitted plane in projector px.

Run with `python -m pytest tests/test_plane_figures.py -s` to see the figures.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from slkit import registry
from slkit.data import Frames
from slkit.geometry import Rig, homogeneous, intersect_plane
from slkit.report.measure import plane_fit
from slkit.simulation import Optics, SimulatedScanner, one_to_one_rig, random_rig, scene, working_volume
from slkit.triangulation import ray_plane

CODECS = {"line-shift": {}, "phase-shift": {}, "gray": {}}


@dataclass(frozen=True)
class Figures:
    modulation: float
    rms_px: float
    limit_px: float
    completeness: float
    spread: float


def measure(name: str, parameters: dict, rig: Rig, optics: Optics, seed: int) -> Figures:
    """Scan a plane that fills the view; each point's projector coordinate against that of the plane through all."""
    axis = int(np.argmax(np.abs(rig.projector_center[:2])))
    codec = registry.load("slkit.codecs", name)(rig.projector.size, axes="xy"[axis], **parameters)
    center, radius = working_volume(rig)
    wide = 4 * float(np.max(radius))
    target = scene.plane(float(center[2]), (8.0, -6.0), (wide, wide), (float(center[0]), float(center[1])))
    scanner = SimulatedScanner(target, rig, optics, seed)
    seen = scanner.capture(codec.encode())
    found = codec.decode(seen)
    cloud = ray_plane(found, rig)
    there = cloud.finite
    normal, offset, _ = plane_fit(cloud.xyz[there])
    rays = homogeneous(rig.camera.normalize(found.camera_xy[there].astype(np.float64)))
    expected = rig.to_projector(intersect_plane(rays, normal, offset))[:, axis]
    away = found.projector_xy[there, axis] - expected
    cols, rows = np.rint(found.camera_xy[there]).astype(int).T
    lit = scanner.truth().lit
    covered = np.zeros_like(lit)
    covered[rows[np.abs(away) < 1], cols[np.abs(away) < 1]] = True
    limit = _limit(codec, seen, optics.read_noise, rows, cols)
    spread = 1.4826 * float(np.median(np.abs(away / found.sigma[there, axis])))
    completeness = float(_filled(covered, rig, name)[lit].mean())
    white, black = (seen[seen.names.index(name)].astype(float) for name in ("white", "black"))
    modulation = float(np.median((white - black)[lit]))
    return Figures(modulation, float(np.sqrt(np.mean(away**2))), limit, completeness, spread)


def _filled(covered: np.ndarray, rig: Rig, name: str) -> np.ndarray:
    """Line peaks lie a camera pixel or two apart: a pixel counts as covered that has one within a pixel."""
    if name != "line-shift":
        return covered
    around = np.pad(covered, 1)
    height, width = covered.shape
    shifts = [around[1 + a : 1 + a + height, 1 + b : 1 + b + width] for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return np.any(shifts, axis=0)


def _limit(codec, seen: Frames, noise: float, rows: np.ndarray, cols: np.ndarray) -> float:
    """The limit in projector px: of a cell's width for Gray code, of N shifted sinusoids for phase shift.

    For sinusoids lambda / (2 pi) sqrt(2 / N) noise / B, with the modulation B that the finest set shows in the picture.
    """
    if not hasattr(codec, "fringes"):
        return getattr(codec, "step", np.nan) / np.sqrt(12)
    fringes = codec.fringes(codec.axes)
    finest = [i for i, n in enumerate(seen.names) if n.startswith(f"{codec.axes}_{max(fringes.periods):g}_")]
    steps = len(finest)
    wave = sum(seen[i].astype(float) * np.exp(2j * np.pi * k / steps) for k, i in enumerate(finest))
    modulation = np.abs(wave)[rows, cols] * 2 / steps
    period = codec.projector[codec.axes == "y"] / max(fringes.periods)
    return float(np.sqrt(np.mean((period / (2 * np.pi) * np.sqrt(2 / steps) * noise / modulation) ** 2)))


@pytest.mark.parametrize("name", CODECS)
def test_one_projector_pixel_a_camera_pixel(name):
    """Modulation 100 grey levels, noise 2, blur 0.7 px in all (0.5 in each device)."""
    optics = Optics(
        white_level=0.54, ambient=0.02, read_noise=2.0, shot_noise=0.0, projector_blur_px=0.5, camera_blur_px=0.5
    )
    found = measure(name, CODECS[name], one_to_one_rig(), optics, 1)
    print(f"\n{name}: {found}, rms / limit {found.rms_px / found.limit_px:.3f}")
    assert found.completeness > 0.97
    assert 0.7 < found.spread < 1.4
    if name == "line-shift":
        assert found.rms_px <= 0.10
    else:
        assert found.rms_px / found.limit_px <= (1.3 if name == "phase-shift" else 1.15)


def _parameters(name: str, rig: Rig) -> dict:
    """Lines at least five camera pixels apart, as docs/methods/line-shift.md asks; the other codecs take any rig."""
    if name != "line-shift":
        return {}
    center, _ = working_volume(rig)
    axis = int(np.argmax(np.abs(rig.projector_center[:2])))
    step = np.eye(3)[axis] * center[2] / rig.camera.K[axis, axis]
    ratio = abs(float((rig.to_projector(center + step) - rig.to_projector(center))[axis]))
    return next({"period": p, "width": w} for p, w in ((6, 1), (8, 2), (12, 3), (18, 4)) if p >= 5 * ratio)


@pytest.mark.parametrize("seed", [21, 22, 23])
@pytest.mark.parametrize("name", CODECS)
def test_devices_and_noise_drawn_at_random(name, seed):
    """The same with `simulation.random_rig`, noise of 0.7 to 3 grey levels and blurs of 0.4 to 0.8 px."""
    rng = np.random.default_rng(seed)
    optics = Optics(
        white_level=rng.uniform(0.35, 0.6),
        read_noise=rng.uniform(0.7, 3.0),
        shot_noise=0.0,
        projector_blur_px=rng.uniform(0.4, 0.8),
        camera_blur_px=rng.uniform(0.4, 0.8),
    )
    rig = random_rig(rng)
    found = measure(name, _parameters(name, rig), rig, optics, seed)
    print(f"\n{name}, seed {seed}: {found}, rms / limit {found.rms_px / found.limit_px:.3f}")
    assert found.completeness > 0.9
    assert 0.7 < found.spread < 1.4
    if name == "phase-shift":
        assert found.rms_px / found.limit_px <= 1.3
