"""The whole way without hardware: simulate the rig of the paper, calibrate it, scan with it, compare with the truth.

    python examples/00_demo.py FOLDER

This is what `make demo` runs. FOLDER gets rig.json, one PLY and one picture a codec, the simulated pictures that they
come from, and pictures of what the camera saw. Every figure that it prints is measured in this run.
"""

import shutil
import sys
import time
from pathlib import Path

import numpy as np

import slkit
from slkit.files import write_toml
from slkit.report.measure import cloud_against_truth, volume_error
from slkit.simulation import Optics, paper_rig, working_distance
from slkit.triangulation import ray_plane

# Room light on the marks, a projector with a gamma, noise of an ordinary 8-bit camera, blur of two lenses.
OPTICS = Optics(ambient=0.18, projector_gamma=1.8, read_noise=1.0, shot_noise=0.01)
# One projector pixel is half a camera pixel here: lines two pixels wide, eight apart, are what this camera resolves.
LINE_SHIFT = {"codec": "line-shift", "parameters": {"axes": "x", "period": 8, "width": 2}}
OUTLIER_MM, NEAR_MM = 2.0, 1.0


def main(folder: Path, truth: slkit.Rig | None = None, poses: int = 10) -> None:
    """Run the demo into a folder, with `poses` poses of each side of the board; default rig: the paper's."""
    started = time.perf_counter()
    truth = truth or paper_rig()
    print(
        f"rig: camera {truth.camera.size[0]} x {truth.camera.size[1]} px, projector {truth.projector.size[0]} x "
        f"{truth.projector.size[1]} px, {np.linalg.norm(truth.projector_center):.0f} mm apart; simulating ..."
    )
    rig = calibrate(folder, truth, poses)
    write_toml(folder / "line-shift.toml", LINE_SHIFT | {"projector": list(truth.projector.size)})
    codecs = [str(folder / "line-shift.toml"), "phase-shift"]
    scans = slkit.simulate_scan(folder / "scan", truth, "free-form", codecs, optics=OPTICS, seed=2)
    print(f"\ndistance of the scanned points to the true surface, not aligned; outliers: beyond {OUTLIER_MM:g} mm;")
    print(f"complete: share of the pixels that see it lit, with a point within {NEAR_MM:g} mm")
    print(f"{'codec':<12} {'rig':<11} {'points':>7} {'rms mm':>7} {'median':>7} {'outliers':>10} {'complete':>9}")
    for pictures in scans:
        scan(folder, pictures, rig, truth)
    shutil.copy(scans[0] / "000_white.png", folder / "seen_object.png")
    print(f"\neverything is in {folder}/; look at line-shift.png; {time.perf_counter() - started:.0f} s")


def calibrate(folder: Path, truth: slkit.Rig, poses: int) -> slkit.Rig:
    """Simulate the captures of the planar method, calibrate from them, and print how far that is from the truth."""
    captures = folder / "calibration"
    slkit.simulate_calibration(captures, truth, poses, optics=OPTICS, seed=1)
    result = slkit.calibrate(captures)
    slkit.write_rig(folder / "rig.json", result.rig, slkit.provenance(result))
    shutil.copy(captures / "side_b_pattern" / "000.png", folder / "seen_board.png")
    used = sum(view.used for view in result.views)
    print(
        f"\ncalibration: {result.method}, {used} of {len(result.views)} views used, verdict {result.verdict.grade}\n"
        f"  reprojection error: camera {result.rms_camera:.3f} px, projector {result.rms_projector:.3f} px, "
        f"joint {result.rms_joint:.3f} px"
    )
    depths = working_distance(truth) * np.array([0.85, 0.925, 1.0, 1.075, 1.15])
    error = volume_error(result.rig, truth, ray_plane, [float(depth) for depth in depths])
    print(
        f"  3D error over the working volume, {depths[0]:.0f} to {depths[-1]:.0f} mm, {error.points} points: "
        f"rms {error.rms_mm:.3f} mm as is, {error.aligned_mm:.3f} mm after the best rigid fit"
    )
    return result.rig


def scan(folder: Path, pictures: Path, rig: slkit.Rig, truth: slkit.Rig) -> None:
    """Scan with the calibrated rig, write cloud and picture, and print the error; that of the true rig below it."""
    for name, used in (("calibrated", rig), ("true", truth)):
        cloud = slkit.scan(pictures, used).cloud
        if used is rig:
            slkit.write_cloud(folder / f"{pictures.name}.ply", cloud)
            slkit.view(folder / f"{pictures.name}.ply", folder / f"{pictures.name}.png")
        with (
            np.load(pictures.parent / "truth" / "object.npz") as seen,
            np.load(pictures.parent / "truth" / "object_mesh.npz") as mesh,
        ):
            pixels = seen["camera_xy"].astype(int)
            surface = (mesh["vertices_mm"], mesh["faces"])
            error = cloud_against_truth(cloud, *surface, pixels, seen["xyz_mm"], OUTLIER_MM, NEAR_MM)
        print(
            f"{pictures.name if used is rig else '':<12} {name:<11} {len(cloud):>7} {error.rms_mm:>7.3f} "
            f"{error.median_mm:>7.3f} {100 * error.outliers:>8.3f} % {100 * error.completeness:>7.1f} %"
        )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/00_demo.py FOLDER")
    main(Path(sys.argv[1]))
