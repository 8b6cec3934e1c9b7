"""The planar method: a two-sided board, printed for the camera, white with corner marks for the projector.

Source: Fernandez and Salvi, Planar-based camera-projector calibration (2011). Their equation (6) maps an image point
to the camera frame by a 3 x 3 homography, which carries no depth; the viewing ray is intersected with the board
instead, which is what the equation stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from slkit.calibration._observe import Marks, Printed, Projected
from slkit.calibration._two_sides import SIDES, observe_sides, place_sides
from slkit.calibration.estimate import estimate
from slkit.calibration.model import Model
from slkit.data import BoardView, Calibration, Capture
from slkit.geometry import as_size


@dataclass(frozen=True)
class Planar:
    """Calibrate by the paper's method.

    projector: size (w, h) px; printed: side A; marks: side B; projected: the checkerboard in the projector image.
    model: what is estimated. Errors: InputError for a projector size that cannot be.
    """

    projector: tuple[int, int]
    printed: Printed
    marks: Marks
    projected: Projected
    model: Model = field(default_factory=Model)

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed corners of side A, or marks and projected corners of side B.

        A picture in which nothing is found, or of another size than most, becomes a view that says so.
        """
        return observe_sides(captures, self.printed, self.marks, self.projected)

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig: camera by Zhang's method, board poses from the marks, projector from all points at once.

        Unless the model says otherwise all of it is then adjusted together.

        Errors: CalibrationError for fewer than two views of a side, or views that do not determine the rig.
        """
        placed = place_sides(views, self.model.camera)
        arguments = (placed.views, placed.poses, placed.camera, self.projector, self.model, placed.sides)
        return estimate("planar", *arguments, sides=SIDES)
