"""The reference-object method: a known object with flat faces; one view of it suffices.

Source: Fernandez and Salvi, Planar-based camera-projector calibration (2011), section V, where a known 3D object is the
way to calibrate from one shot; Zhang (2000) for the first guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from slkit.calibration import solve
from slkit.calibration._faces import observe_solid
from slkit.calibration._observe import Printed, observe_printed
from slkit.calibration.bundle import adjust
from slkit.calibration.detect import picture_size, usual_size, wrong_size
from slkit.calibration.estimate import estimate
from slkit.calibration.model import Model
from slkit.calibration.surfaces import Solid, Surface
from slkit.data import BoardView, Calibration, Capture
from slkit.errors import CalibrationError, InputError
from slkit.geometry import Pinhole, Pose, Rig, as_size
from slkit.targets import ProjectedFaces, SolidTarget

_FEWEST_POINTS = 4


@dataclass(frozen=True)
class ReferenceObject:
    """Calibrate with a folded sheet that carries numbered tags, a checkerboard projected on each of its faces.

    projector: size (w, h) px; solid: the folded sheet; projected: one checkerboard a face; printed: side A of a flat
    board, which makes the camera surer, if there is one; model: what is estimated.
    Errors: InputError for a projector size that cannot be, or not one checkerboard a face.
    """

    fewest_views: ClassVar[int] = 1

    projector: tuple[int, int]
    solid: SolidTarget
    projected: ProjectedFaces
    printed: Printed | None = None
    model: Model = field(default_factory=Model)

    def __post_init__(self) -> None:
        as_size(self.projector, "projector")
        if len(self.projected.boards) != len(self.solid.faces):
            raise InputError(
                f"projected has {len(self.projected.boards)} boards, but the object {len(self.solid.faces)} faces: "
                "each face, in the same order, needs a board of its own"
            )

    @property
    def surface(self) -> Solid:
        """The faces of the object in its own frame."""
        return Solid([face.solid_from_face for face in self.solid.faces])

    def observe(self, captures: Sequence[Capture]) -> list[BoardView]:
        """Return one view a capture: printed and projected corners of the object, each with its face; or side A.

        A picture in which nothing is found, or of another size than most, becomes a view that says so.
        """
        size = usual_size([p for c in captures for p in (c.printed, c.marks) if p is not None])
        return [self._observe(capture, size) for capture in captures]

    def solve(self, views: Sequence[BoardView]) -> Calibration:
        """Return the rig: camera and poses from all printed points at once, then the projector, then all together.

        Errors: CalibrationError where no view shows two faces, or the views do not determine the rig.
        """
        used = [v for v in views if v.problem is None]
        if not any(len(_faces(v)) > 1 for v in used):
            raise CalibrationError("at least one view must show two faces of the object, but none does")
        flat = any(v.face is None for v in used)
        boards = {v.name: int(flat and v.face is not None) for v in used}
        surfaces: list[Surface | None] = [None, self.surface] if flat else [self.surface]
        camera, poses = self._place(used, [boards[v.name] for v in used], surfaces)
        placed = {v.name: pose for v, pose in zip(used, poses, strict=True)}
        arguments = (views, placed, camera, self.projector, self.model, boards, surfaces)
        sides = ("side A", "the object")[not flat :]
        return estimate("reference-object", *arguments, sides=sides, enough_views=self.fewest_views)

    def _observe(self, capture: Capture, size: tuple[int, int]) -> BoardView:
        for picture in (capture.printed, capture.marks, capture.projected):
            if picture is not None and picture_size(picture) != size:
                return BoardView.unusable(capture.name, size, wrong_size(picture, size))
        if capture.printed is not None:
            if self.printed is None:
                return BoardView.unusable(capture.name, size, "there is no [printed] that says what side A is")
            return observe_printed(capture.name, capture.printed, self.printed)
        if capture.marks is None or capture.projected is None:
            problem = "the object needs a picture under white light and one of the pattern"
            return BoardView.unusable(capture.name, size, problem)
        return observe_solid(capture.name, capture.marks, capture.projected, self.solid, self.projected)

    def _place(
        self, views: Sequence[BoardView], boards: Sequence[int], surfaces: Sequence[Surface | None]
    ) -> tuple[Pinhole, list[Pose]]:
        """Return the camera and one pose camera_from_target a view, from the printed points alone.

        Every face is a plane of Zhang's for a first guess; then the faces of an object keep their angles.
        """
        printed = [v.select(v.printed) for v in views]
        planes = [(i, f, v.select(mask)) for i, v in enumerate(printed) for f, mask in _faces(v).items()]
        camera, found = solve.calibrate_camera([p for *_, p in planes], views[0].image_size, self.model.camera)
        poses: list[Pose] = []
        for i, view in enumerate(views):
            # The face with the most points places the whole object best.
            best = max((k for k, p in enumerate(planes) if p[0] == i), key=lambda k: len(planes[k][2].camera_xy))
            motion = self.surface.solid_from_face[planes[best][1]].inverse() if view.face is not None else None
            poses.append(found[best] if motion is None else found[best] @ motion)
        lonely = Rig(camera, camera, Pose.identity())
        model = Model(camera=self.model.camera, loss=self.model.loss)
        state = adjust(lonely, poses, printed, model, boards, surfaces).state
        return state.rig.camera, state.poses


def _faces(view: BoardView) -> dict[int, npt.NDArray[np.bool_]]:
    """Return the rows (n,) of printed points by face, for faces that show enough of them; a board is its face 0."""
    masks = {int(f): view.printed & (view.faces == f) for f in np.unique(view.faces)}
    return {f: mask for f, mask in masks.items() if mask.sum() >= _FEWEST_POINTS}
