"""All that a calibration estimates, as one value that can take a small step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slkit.calibration._parameters import Array
from slkit.calibration.surfaces import Sheet, Surface
from slkit.geometry import LENS_NAMES, RIG_NAMES, Pinhole, Pose, Rig

LENS = len(LENS_NAMES)
LENSES, MOTION = 2 * LENS, len(RIG_NAMES)
"""Shared parameters: those of the camera's lens, of the projector's lens, of the projector's motion; then two a board's
warp, and three a released point. Where the second, the third and the fourth of these begin."""


@dataclass(frozen=True, eq=False)
class State:
    """The rig, one pose camera_from_target a view, and per board its surface and how its points are displaced.

    rotations (v, 3, 3); translations (v, 3) mm; released: per board (k, 3) mm.
    """

    rig: Rig
    rotations: Array
    translations: Array
    surfaces: tuple[Surface, ...]
    released: tuple[Array, ...]

    @property
    def poses(self) -> list[Pose]:
        """One pose camera_from_target a view."""
        return [Pose(r, t) for r, t in zip(self.rotations, self.translations, strict=True)]

    def moved(self, shared: Array, motions: Array) -> State:
        """Return the state after a step of all shared parameters (s,) and of each pose (v, 6).

        A motion turns by its first three numbers, in radians, in front of the pose, then shifts by the others, in mm.
        """
        rig, boards = self.rig, len(self.surfaces)
        turn, shift = shared[LENSES : LENSES + 3], shared[LENSES + 3 : MOTION]
        placed = _rotations(turn[None]) @ rig.projector_from_camera.rotation
        warps = shared[MOTION : MOTION + 2 * boards].reshape(boards, 2)
        ends = np.cumsum([len(r) for r in self.released])
        offsets = np.split(shared[MOTION + 2 * boards :].reshape(-1, 3), ends[:-1])
        return State(
            Rig(
                moved_lens(rig.camera, shared[:LENS]),
                moved_lens(rig.projector, shared[LENS:LENSES]),
                Pose(_orthonormal(placed)[0], rig.projector_from_camera.translation + shift),
            ),
            _orthonormal(_rotations(motions[:, :3]) @ self.rotations),
            self.translations + motions[:, 3:],
            tuple(
                replace(s, warp=s.warp + w) if isinstance(s, Sheet) else s
                for s, w in zip(self.surfaces, warps, strict=True)
            ),
            tuple(r + o for r, o in zip(self.released, offsets, strict=True)),
        )


def shared_values(state: State) -> Array:
    """Return the values of all shared parameters (s,); of the projector's motion, which has none, zeros."""
    lenses = [device.parameters for device in (state.rig.camera, state.rig.projector)]
    warps = [s.warp if isinstance(s, Sheet) else np.zeros(2) for s in state.surfaces]
    return np.concatenate([*lenses, np.zeros(6), *warps, *(r.ravel() for r in state.released)])


def moved_lens(lens: Pinhole, step: Array) -> Pinhole:
    """Return a lens after a step (10,) of its parameters, in the order of LENS_NAMES."""
    fx, fy, cx, cy, skew = step[:5]
    matrix = lens.K + np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 0]])
    # A step that would turn the image round is cut; least squares then tries a smaller one.
    matrix[0, 0], matrix[1, 1] = max(matrix[0, 0], 1e-3), max(matrix[1, 1], 1e-3)
    return replace(lens, K=matrix, distortion=lens.distortion + step[5:])


def _rotations(vectors: Array) -> Array:
    """Return the rotations (n, 3, 3) about vectors (n, 3), whose length is the angle. Source: Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    half = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + np.sinc(angle / np.pi) * cross + half * cross @ cross


def _orthonormal(matrices: Array) -> Array:
    """Return matrices (n, 3, 3), rotations but for rounding, without the rounding."""
    # One step of Newton's iteration for the polar factor; the error goes from e to e squared.
    return 1.5 * matrices - 0.5 * matrices @ matrices.transpose(0, 2, 1) @ matrices
