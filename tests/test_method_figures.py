"""Scanning methods on one calibration: a simulated plane at 1.1 m, the paper's rig, calibrated by `planar`.

Run with `python -m pytest tests/test_method_figures.py -s` to see the figures.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from slkit import pipeline
from slkit.geometry import Rig
from slkit.report.measure import limit_mm, plane_fit
from slkit.simulation import Optics, SimulatedScanner, paper_rig, plane, random_rig, working_volume
from slkit.triangulation import triangulate


@dataclass(frozen=True)
class Method:
    codec: str
    parameters: dict
    color: bool
    limit_mm: float
    reach_px: int

    def scan(self, scene: object, rig: Rig, calibrated: Rig, seed: int) -> tuple[float, float, int]:
        """Return rms in mm to the fitted plane, the share of lit pixels within reach of a point, and points."""
        parameters = self.parameters
        if "x" in parameters and pipeline._simulating.depth_axis(rig) == "y":
            parameters = {"y": parameters["x"]}
        axes = pipeline._simulating.depth_axis(rig)
        codec = pipeline.load_codec(self.codec, rig.projector.size, {"axes": axes} | parameters)
        optics = Optics(color=self.color, read_noise=2.0, shot_noise=0.0)
        scanner = SimulatedScanner(scene, rig, optics, seed)
        cloud = triangulate(codec.decode(scanner.capture(codec.encode())), calibrated)
        covered = np.zeros(rig.camera.size[::-1], dtype=np.uint8)
        cols, rows = np.rint(cloud.camera_xy).astype(int).T
        covered[rows, cols] = 1
        return plane_fit(cloud.xyz)[2], float(_grown(covered, self.reach_px)[scanner.truth().lit].mean()), len(cloud)


METHODS = (
    # Slits lie 12 projector px apart, at most 8 camera px here: half of that to the next one.
    Method("color-stripes", {}, True, 0.45, 4),
    Method("line-shift", {"period": 8, "width": 2, "cell": 4}, False, 0.30, 1),
    Method("phase-shift", {"x": {"periods": [128, 16, 1], "steps": 6}}, False, 0.08, 1),
)


def _grown(mask: np.ndarray, reach: int) -> np.ndarray:
    import cv2

    return cv2.dilate(mask, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    folder = tmp_path_factory.mktemp("calibration")
    pipeline.simulate_calibration(folder, poses=6)
    return pipeline.calibrate(folder).rig


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.codec)
@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (-20.0, 25.0)], ids=["flat", "tilted"])
def test_plane_at_1100_mm(method: Method, tilt_deg: tuple[float, float], calibrated: Rig):
    rms_mm, share, points = method.scan(plane(1100.0, tilt_deg), paper_rig(), calibrated, 1)
    print(f"{method.codec}, tilt {tilt_deg}: rms {rms_mm:.3f} mm, {points} points, complete {share:.3f}")
    assert rms_mm <= method.limit_mm
    assert share > 0.95


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.codec)
@pytest.mark.parametrize("seed", [201, 202])
def test_plane_with_devices_drawn_at_random(method: Method, seed: int):
    """The same limits in projector px; the ranges are those of `random_rig`."""
    rig = random_rig(np.random.default_rng(seed))
    if "x" in method.parameters:
        axis = "xy".index(pipeline._simulating.depth_axis(rig))
        count = rig.projector.size[axis] // 8
        method = Method(method.codec, {"x": {"periods": [count, count // 8, 1], "steps": 6}}, False, 0.08, 1)
    center, radius = working_volume(rig)
    scene = plane(float(center[2]), (10.0, -12.0), (2 * radius, 1.5 * radius), (float(center[0]), float(center[1])))
    rms_mm, share, points = method.scan(scene, rig, rig, seed)
    axis = "xy".index(pipeline._simulating.depth_axis(rig))
    # What a projector px is worth in depth, here and with the paper's rig at 1.1 m.
    here, there = (
        float(limit_mm(r, [[*xy, z]], 1.0, a)[0])
        for r, xy, z, a in ((rig, center[:2], center[2], axis), (paper_rig(), (0.0, 0.0), 1100.0, 0))
    )
    print(f"{method.codec}, rig {seed}: rms {rms_mm / here:.3f} projector px, {points} points, complete {share:.3f}")
    assert rms_mm / here <= method.limit_mm / there
    assert share > 0.9
