"""Decodes and triangulates small scenes on the processor and on CUDA, and says of each that both are the same.

Run by test_device.py, in a process of its own because numba's simulator is chosen before numba is imported.
"""

from dataclasses import replace

import numpy as np

from slkit.codecs.gray import Gray
from slkit.data import Correspondences, Frames
from slkit.device import on_device
from slkit.geometry import RIG_NAMES, Pinhole, Pose, Rig, homogeneous
from slkit.triangulation import ray_plane


def pictures(codec: Gray, dtype: type, rng: np.random.Generator) -> Frames:
    """What a camera of 40 x 30 px sees of the patterns, with noise and a dark corner."""
    y, x = np.mgrid[0:30, 0:40]
    rows, cols = (y * 1.5 + 1 + np.sin(x)).astype(int), ((x * 1.4 + 2) * codec.projector[0] / 64).astype(int)
    paint = np.where(x + y < 12, 0.02, 0.6)
    scale = 1 if dtype == np.uint8 else 200
    seen = [scale * (p[rows, cols] * paint + rng.normal(20, 2, x.shape)) for p in codec.encode()]
    return Frames.of([np.rint(p).clip(0, scale * 255).astype(dtype) for p in seen], codec.encode().names)


def gray(columns: int, inverse: bool, dtype: type, rng: np.random.Generator) -> None:
    codec = Gray((columns, 48), axes="both", inverse=inverse)
    frames = pictures(codec, dtype, rng)
    here = codec.decode(frames)
    with on_device("cuda"):
        there = codec.decode(frames)
    assert 500 < len(here) < 1200
    np.testing.assert_array_equal(there.camera_xy, here.camera_xy)
    np.testing.assert_array_equal(there.projector_xy, here.projector_xy)
    np.testing.assert_array_equal(there.sigma, here.sigma)
    np.testing.assert_allclose(there.confidence, here.confidence, atol=1e-6)
    print("the same:", codec, np.dtype(dtype))


def points(seed: int, covered: bool) -> None:
    rng = np.random.default_rng(seed)
    camera = Pinhole((800, 600), [[1100, 1, 390], [0, 1110, 310], [0, 0, 1]], [-0.2, 0.05, 1e-3, -2e-3, 0])
    projector = Pinhole((1024, 768), [[1500, 0, 500], [0, 1490, 900], [0, 0, 1]], [-0.1, 0.02, -1e-3, 1e-3, 0])
    rig = Rig(camera, projector, Pose.from_rotation_vector([-0.05, 0.25, 0.02], [-250, 30, 20]))
    if covered:
        roots = rng.normal(0, 1e-3, (26, 26))
        rig = replace(rig, covariance={"parameters": RIG_NAMES, "matrix": roots @ roots.T})
    camera_xy = rng.uniform([0, 0], [799, 599], (300, 2)).astype(np.float32)
    seen = rig.to_projector(homogeneous(camera.normalize(camera_xy)) * rng.uniform(700, 1200, (300, 1)))
    seen = (seen + rng.normal(0, 0.2, seen.shape)).astype(np.float32)
    seen[::7, 0] = seen[::11, 1] = np.nan
    sigma = rng.uniform(0.05, 0.4, seen.shape).astype(np.float32)
    sigma[::5] = np.nan
    found = Correspondences(camera_xy, seen, sigma, np.ones(300, np.float32), np.ones((300, 3), np.float32))
    here = ray_plane(found, rig)
    with on_device("cuda"):
        there = ray_plane(found, rig)
    assert here.finite.sum() > 250
    for name in ("xyz", "sigma_mm", "residual_px", "sigma_cal_mm"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=2e-5, atol=1e-4, err_msg=name)
    print("the same: points of seed", seed)


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    for inverse in (True, False):
        for dtype in (np.uint8, np.uint16):
            gray(64, inverse, dtype, rng)
    # More bits than are read at a time, and more than a short number holds.
    gray(600, True, np.uint8, rng)
    gray(40_000, False, np.uint8, rng)
    for seed in range(3):
        points(seed, covered=False)
        points(seed, covered=True)
