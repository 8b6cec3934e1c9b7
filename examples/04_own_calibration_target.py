"""A calibration board of one's own: dots instead of squares, found by one's own detection, solved by slkit.

    python examples/04_own_calibration_target.py

A calibrator has two methods: `observe` turns pictures into board views, `solve` turns board views into a rig. Any
detection that ends in board views can use slkit's solvers; the simulator draws the board from the same description.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

import slkit
from slkit.calibration.detect import to_8bit
from slkit.calibration.local_homography import LocalHomography, transfer
from slkit.codecs.phase_shift import PhaseShift
from slkit.report.measure import volume_error
from slkit.simulation import Optics, SimulatedScanner, board, board_poses, paper_rig, working_distance, working_volume
from slkit.targets import INK, PAPER, Checkerboard
from slkit.testing import check_calibrator
from slkit.triangulation import ray_plane

ROWS, COLUMNS = 9, 5


@dataclass(frozen=True)
class DotBoard:
    """Staggered rows of dots, every other row shifted by `spacing_mm`, rows `spacing_mm` apart."""

    spacing_mm: float

    def points(self) -> np.ndarray:
        """Return the centres (45, 2) mm, in the order in which OpenCV finds them."""
        row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
        return np.stack([2 * column + row % 2, row], axis=1) * self.spacing_mm

    def extent(self) -> tuple[float, float, float, float]:
        """Return the sheet: x min, y min, x max, y max in mm."""
        return (-1.5 * self.spacing_mm, -1.5 * self.spacing_mm, *(np.array([10.5, 9.5]) * self.spacing_mm))

    def reflectance(self, xy: np.ndarray, footprint_mm: float) -> np.ndarray:
        """Return the reflectance (...) at board points (..., 2) mm, edges as wide as the footprint."""
        x, y = np.moveaxis(np.asarray(xy) / self.spacing_mm, -1, 0)
        row = np.clip(np.rint(y), 0, ROWS - 1)
        column = np.clip(np.rint((x - row % 2) / 2), 0, COLUMNS - 1)
        away = np.hypot(x - 2 * column - row % 2, y - row)
        ink = np.clip((0.4 - away) * self.spacing_mm / max(footprint_mm, 1e-9) + 0.5, 0, 1)
        return PAPER + (INK - PAPER) * ink


@dataclass(frozen=True)
class DotCalibrator:
    """Coded light on a board of dots: local homographies at the dots, both devices refined together."""

    projector: tuple[int, int]
    board: DotBoard

    def observe(self, captures: Sequence[slkit.Capture]) -> list[slkit.BoardView]:
        """Return the dots of every capture with the projector pixels that light them."""
        return [self._observe(capture) for capture in captures]

    def solve(self, views: Sequence[slkit.BoardView]) -> slkit.Calibration:
        """Return the rig; the views hold all that slkit's solver needs, it never looks at the checkerboard."""
        return replace(LocalHomography(self.projector, Checkerboard((3, 3), 1.0)).solve(views), method="dots")

    def _observe(self, capture: slkit.Capture) -> slkit.BoardView:
        picture = to_8bit(capture.lit)
        size = (picture.shape[1], picture.shape[0])
        found, dots = cv2.findCirclesGrid(picture, (COLUMNS, ROWS), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
        if not found:
            return slkit.BoardView.unusable(capture.name, size, f"no board of {ROWS} x {COLUMNS} dots was found")
        camera_xy = dots.reshape(ROWS, COLUMNS, 2).astype(float)
        projector_xy, sigma = transfer(camera_xy, capture.correspondences, window=0.6)
        return slkit.BoardView(capture.name, size, self.board.points(), camera_xy.reshape(-1, 2), projector_xy, sigma)


def main(truth: slkit.Rig | None = None, poses: int = 5) -> None:
    """Simulate the board under coded light, calibrate, and compare with the true rig; default: the paper's."""
    truth = truth or paper_rig()
    dots, codec = DotBoard(0.13 * working_volume(truth)[1]), PhaseShift(truth.projector.size, axes="both")
    captures: list[slkit.Capture] = []
    for i, pose in enumerate(board_poses(truth, dots.extent(), poses, np.random.default_rng(2), lit=True)):
        seen = SimulatedScanner(board(dots, pose), truth, Optics(), seed=i).capture(codec.encode())
        captures.append(slkit.Capture(f"pose{i}", lit=codec.lit(seen), correspondences=codec.decode(seen)))
    check_calibrator(calibrator := DotCalibrator(truth.projector.size, dots), captures)
    print("check_calibrator: every promise kept")
    result = calibrator.solve(calibrator.observe(captures))
    print(
        f"{sum(view.used for view in result.views)} of {poses} views used; camera {result.rms_camera:.3f} px,", end=" "
    )
    print(f"projector {result.rms_projector:.3f} px, joint {result.rms_joint:.3f} px")
    error = volume_error(result.rig, truth, ray_plane, [working_distance(truth) * d for d in (0.9, 1.0, 1.1)])
    print(f"3D error: rms {error.rms_mm:.3f} mm as is, {error.aligned_mm:.3f} mm after the best rigid fit")


if __name__ == "__main__":
    main()
