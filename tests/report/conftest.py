"""A calibration with every kind of evidence, computed from a rig and noise: what a solver hands to a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slkit.data import (
    BoardView,
    Calibration,
    Capture,
    DeviceDiagnosis,
    Diagnosis,
    Finding,
    ResidualClass,
    Verdict,
    ViewResult,
    VolumeMap,
)
from slkit.geometry import LENS_NAMES, Pose, Rig
from slkit.simulation import paper_rig
from slkit.targets import Checkerboard, grid

NOISE_PX = 0.15


def make_view(rig: Rig, rng: np.random.Generator, name: str, lit: bool) -> ViewResult:
    """A view of a board, its last row rejected; lit: half of the rows are projected corners that nobody printed."""
    board = Checkerboard((9, 7), 40.0).points()
    center = Pose(np.eye(3), np.append(-board.mean(axis=0), 0))
    turn = Pose.from_rotation_vector(rng.uniform(-0.4, 0.4, 3), [*rng.uniform(-40, 40, 2), rng.uniform(900, 1300)])
    pose = turn @ center
    board_xy = np.concatenate([board, grid((9, 7)) * 30 + 20]) if lit else board
    xyz = pose.apply(np.pad(board_xy, ((0, 0), (0, 1))))
    camera_xy, projector_xy = rig.camera.project(xyz), rig.to_projector(xyz)
    camera_error, projector_error = rng.normal(0, NOISE_PX, (2, *camera_xy.shape))
    camera_error[-1] = [9, -4]
    if lit:
        board_xy[63:] = np.nan
        projector_xy[:63] = projector_error[:63] = np.nan
    else:
        projector_xy[:] = projector_error[:] = np.nan
    sigma = np.where(np.isfinite(projector_xy), 0.0, np.nan)
    view = BoardView(name, rig.camera.size, board_xy, camera_xy - camera_error, projector_xy, sigma)
    kept = np.arange(len(camera_xy)) < len(camera_xy) - 1
    rms = float(np.sqrt(2)) * NOISE_PX
    return ViewResult(name, True, "", rms, rms if lit else np.nan, rms, view, pose, camera_error, projector_error, kept)


def volume(rig: Rig, level_mm: float) -> VolumeMap:
    """A bowl over the image at four depths; the far left is out of reach."""
    x, y = np.linspace(0, rig.camera.size[0] - 1, 16), np.linspace(0, rig.camera.size[1] - 1, 12)
    camera_xy = np.stack(np.meshgrid(x, y), axis=-1)
    away = np.linalg.norm(camera_xy / rig.camera.size - 0.5, axis=-1)
    value = level_mm * np.stack([(1 + k / 4) * (1 + 2 * away**2) for k in range(4)])
    value[:, :, :2] = np.nan
    return VolumeMap(np.array([900.0, 1000, 1100, 1200]), camera_xy, value)


def covariance() -> dict:
    names = [f"{d}.{n}" for d in ("camera", "projector") for n in LENS_NAMES if n not in ("skew", "k3")]
    names += [f"projector_from_camera.{n}" for n in ("rx", "ry", "rz", "tx", "ty", "tz")]
    sigma = [0.5, 0.5, 0.8, 0.8, 1e-3, 2e-3, 1e-4, 1e-4, 1.5, 1.5, 2, 2, 2e-3, 5e-3, 2e-4, 2e-4]
    sigma += [1e-3] * 3 + [0.2] * 3
    return {"parameters": names, "matrix": np.diag(np.square(sigma))}


@pytest.fixture(scope="session")
def make_calibration() -> Callable[..., Calibration]:
    """Return a function that makes a calibration of so many views of the camera alone and of both devices."""

    def make(printed: int = 3, white: int = 4, seed: int = 0) -> Calibration:
        rig, rng = paper_rig(), np.random.default_rng(seed)
        views = [make_view(rig, rng, f"side_a/{i:02d}", False) for i in range(printed)]
        views += [make_view(rig, rng, f"side_b/{i:02d}", True) for i in range(white)]
        views.append(ViewResult("side_b/lost", False, "no marks were found"))
        device = DeviceDiagnosis(np.full((3, 3), 20), (905.0, 1290.0), (4.0, 31.0), {})
        board = Checkerboard((9, 7), 40.0).points()
        diagnosis = Diagnosis(
            {"camera": device, "projector": device},
            (("projector.cy", "projector_from_camera.rx", -0.9971),),
            {"printed corners": (board, rng.normal(0, 0.05, board.shape), np.full(len(board), 0.03))},
            {v.name: 0.25 for v in views if v.used},
            0.25,
            volume(rig, 0.08),
            volume(rig, 0.05),
        )
        reason = Finding("the board is bent by 2 mm", "", "glue it to a flat plate", "bent-board")
        classes = {
            "printed": ResidualClass(630, 9, 1180.5, 0.1503),
            "projected": ResidualClass(252, 4, 470, 0.149, 1.1),
        }
        return Calibration(
            rig,
            "planar",
            tuple(views),
            0.21,
            0.2,
            0.212,
            covariance(),
            Verdict("usable", (reason,)),
            (),
            classes,
            diagnosis,
        )

    return make


@pytest.fixture(scope="session")
def calibration(make_calibration: Callable[..., Calibration]) -> Calibration:
    return make_calibration()


@pytest.fixture(scope="session")
def bare(calibration: Calibration) -> Calibration:
    """The same as a method without any evidence gives it."""
    views = tuple(ViewResult(v.name, v.used, v.reason) for v in calibration.views)
    return replace(calibration, views=views, covariance=None, classes={}, diagnosis=None, verdict=Verdict("good"))


@pytest.fixture(scope="session")
def pictures(calibration: Calibration) -> list[Capture]:
    """Grey ramps of the camera's size, as the pictures of every view."""
    width, height = calibration.rig.camera.size
    ramp = np.broadcast_to(np.linspace(20, 200, width).astype(np.uint8), (height, width)).copy()
    return [
        Capture(v.name, marks=ramp, projected=ramp) if v.name.startswith("side_b") else Capture(v.name, printed=ramp)
        for v in calibration.views
    ]
