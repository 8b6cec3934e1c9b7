"""The straight line in memory: patterns, pictures, correspondences, points; no file and no hardware.

    python examples/01_simulated_scan.py

A dumbbell is scanned with phase shift on both axes. Since the simulator knows the truth, the error of every point can
be compared with the sigma that the scan itself states.
"""

import numpy as np

import slkit
from slkit.codecs.phase_shift import PhaseShift
from slkit.report.measure import distances_to_mesh
from slkit.simulation import Optics, SimulatedScanner, build, one_to_one_rig
from slkit.triangulation import Filters


def main(rig: slkit.Rig | None = None) -> None:
    """Scan a dumbbell with a rig; default: one with a projector column a camera column."""
    rig = rig or one_to_one_rig()
    scanner = SimulatedScanner(build("dumbbell", rig), rig, Optics(read_noise=1.5), seed=1)

    codec = PhaseShift(projector=rig.projector.size, axes="both")
    patterns = codec.encode()
    pictures = scanner.capture(patterns)
    correspondences = codec.decode(pictures)
    cloud = slkit.triangulate(correspondences, rig)
    cloud, removed = Filters().apply(cloud)

    print(f"{len(patterns)} patterns, {len(correspondences)} pixels decoded, {len(cloud)} points left")
    print("removed by filter: " + ", ".join(f"{name} {count}" for name, count in removed.items()))
    error = distances_to_mesh(cloud.xyz, *scanner.scene.mesh())
    print(
        f"distance to the true surface: median {np.median(error):.3f} mm, 95 % below {np.percentile(error, 95):.3f} mm"
    )
    truth = scanner.truth()
    depth = np.full(truth.lit.shape, np.nan)
    depth[truth.lit] = np.linalg.norm(truth.xyz_mm, axis=1)
    columns, rows = cloud.camera_xy.astype(int).T
    ratio = (np.linalg.norm(cloud.xyz, axis=1) - depth[rows, columns]) / cloud.sigma_mm
    spread = 1.4826 * np.nanmedian(np.abs(ratio))
    print(f"sigma that the scan states, along the viewing ray: median {np.median(cloud.sigma_mm):.3f} mm")
    print(f"true error along the ray / sigma: robust standard deviation {spread:.2f}, 1 is honest")


if __name__ == "__main__":
    main()
