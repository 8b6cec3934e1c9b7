"""What travels through slkit: pictures, correspondences, clouds, board views and calibrations.

All are frozen; the shape and unit of a field stand in the line below it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import _open3d
from slkit.errors import InputError
from slkit.geometry import Rig

Image = npt.NDArray[np.unsignedinteger[Any]]
Float32s = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Frames:
    """A sequence of pictures, projected or seen: `frames[i]` is (h, w) grey or (h, w, 3) RGB, uint8 or uint16.

    names: one a frame, for messages and files. load: gives frame i, and may read it from disk at that moment.
    """

    names: tuple[str, ...]
    load: Callable[[int], Image] = field(repr=False)

    @classmethod
    def of(cls, images: Sequence[Image], names: Sequence[str] | None = None) -> Frames:
        """Return the frames of pictures in memory; default names are 000, 001, ...

        Errors: InputError where a picture is not (h, w) or (h, w, 3) of uint8 or uint16, or names are too few.
        """
        names = tuple(names) if names is not None else tuple(f"{i:03d}" for i in range(len(images)))
        if len(names) != len(images):
            raise InputError(f"{len(images)} frames need as many names, not {len(names)}")
        for name, image in zip(names, images, strict=True):
            check_image(image, name)
        held = tuple(images)
        return cls(names, held.__getitem__)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> Image:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self.load(index % len(self))

    def __iter__(self) -> Iterator[Image]:
        return (self.load(i) for i in range(len(self)))

    def select(self, indices: Sequence[int]) -> Frames:
        """Return some of the frames, in the order of `indices`; nothing is loaded."""
        chosen = tuple(range(len(self))[i] for i in indices)
        return Frames(tuple(self.names[i] for i in chosen), lambda i: self.load(chosen[i]))

    def stack(self) -> Image:
        """Return all frames as one array, (n, h, w) or (n, h, w, 3).

        Errors: InputError naming the first frame whose shape or depth differs from frame 0.
        """
        images = list(self)
        for name, image in zip(self.names, images, strict=True):
            if image.shape != images[0].shape or image.dtype != images[0].dtype:
                raise InputError(
                    f"frame {name} is {describe_image(image)}, but {self.names[0]} is {describe_image(images[0])}"
                )
        return np.stack(images)


def check_image(image: Any, name: str) -> None:
    """Refuse what is not a picture: (h, w) or (h, w, 3) of uint8 or uint16. Errors: InputError naming `name`."""
    shape = getattr(image, "shape", ())
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] != 3) or 0 in shape:
        raise InputError(f"frame {name} must be grey (h, w) or RGB (h, w, 3), not of shape {shape}")
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"frame {name} must hold 8- or 16-bit whole numbers, not {image.dtype}")


def describe_image(image: Image) -> str:
    """Return size, channels and depth in words for a message, such as `1280 x 1024 px grey 8-bit`."""
    kind = "grey" if image.ndim == 2 else "colour"
    return f"{image.shape[1]} x {image.shape[0]} px {kind} {8 * image.dtype.itemsize}-bit"


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Pairs of a camera and a projector position, one a row; rows come in no particular order.

    camera_xy (m, 2) px, sub-pixel for line peaks; projector_xy (m, 2) px, NaN where the code is silent;
    sigma (m, 2): 1 sigma of projector_xy in projector px, the camera's share carried over by the local slope, NaN
    where the code is silent; confidence (m,) 0 to 1 that the label is right; color (m, 3) RGB 0 to 1.
    All float32. Errors: InputError where shapes disagree.
    """

    camera_xy: Float32s
    projector_xy: Float32s
    sigma: Float32s
    confidence: Float32s
    color: Float32s

    def __post_init__(self) -> None:
        _hold_float32(self, {"camera_xy": 2, "projector_xy": 2, "sigma": 2, "confidence": None, "color": 3})

    def __len__(self) -> int:
        return len(self.camera_xy)

    def select(self, keep: npt.NDArray[Any]) -> Correspondences:
        """Return the rows named by a mask (m,) or by indices."""
        return Correspondences(
            self.camera_xy[keep], self.projector_xy[keep], self.sigma[keep], self.confidence[keep], self.color[keep]
        )

    def as_map(self, shape: tuple[int, int]) -> Float32s:
        """Return projector_xy as a picture (h, w, 2) for display, NaN where nothing was decoded.

        shape (h, w). A row is written to the camera pixel nearest to it.
        """
        result = np.full((*shape, 2), np.nan, dtype=np.float32)
        nearest = np.rint(self.camera_xy).astype(np.intp)
        cols, rows = nearest[:, 0], nearest[:, 1]
        within = (nearest >= 0) & (nearest < np.array(shape[::-1]))
        inside: npt.NDArray[Any] = np.flatnonzero(within.all(axis=1))
        result[rows[inside], cols[inside]] = self.projector_xy[inside]
        return result


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in the camera frame with the evidence for each.

    xyz (m, 3) mm; color (m, 3) RGB 0 to 1; sigma_mm (m,): 1 sigma along the viewing ray that the decoding causes;
    residual_px (m,): reprojection residual, NaN where one coded axis leaves no redundancy. All float32.
    camera_xy (m, 2) px: where the camera saw the point. normals (m, 3), of length 1, or None.
    Errors: InputError where shapes disagree.
    """

    xyz: Float32s
    color: Float32s
    sigma_mm: Float32s
    residual_px: Float32s
    camera_xy: Float32s
    normals: Float32s | None = None

    def __post_init__(self) -> None:
        widths = {"xyz": 3, "color": 3, "sigma_mm": None, "residual_px": None, "camera_xy": 2}
        _hold_float32(self, widths | ({} if self.normals is None else {"normals": 3}))

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def finite(self) -> npt.NDArray[np.bool_]:
        """Mask (m,) of the points that exist: xyz is not NaN."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def select(self, keep: npt.NDArray[Any]) -> PointCloud:
        """Return the points named by a mask (m,) or by indices."""
        return PointCloud(
            self.xyz[keep],
            self.color[keep],
            self.sigma_mm[keep],
            self.residual_px[keep],
            self.camera_xy[keep],
            None if self.normals is None else self.normals[keep],
        )

    def to_open3d(self) -> Any:
        """Return an `open3d.t.geometry.PointCloud` with positions, colors, sigma_mm, residual_px and normals kept."""
        o3d = _open3d.load()
        tensor = o3d.core.Tensor
        cloud = o3d.t.geometry.PointCloud(tensor(np.ascontiguousarray(self.xyz)))
        cloud.point["colors"] = tensor(np.ascontiguousarray(self.color))
        cloud.point["sigma_mm"] = tensor(self.sigma_mm.reshape(-1, 1).copy())
        cloud.point["residual_px"] = tensor(self.residual_px.reshape(-1, 1).copy())
        if self.normals is not None:
            cloud.point["normals"] = tensor(np.ascontiguousarray(self.normals))
        return cloud


@dataclass(frozen=True, eq=False)
class Capture:
    """One pose of a calibration, as pictures or as coded light that is decoded already.

    printed, marks, projected: pictures (h, w) or (h, w, 3), None where the method has none. lit (h, w): the fully lit
    picture that belongs to `correspondences`.
    """

    name: str
    printed: Image | None = None
    marks: Image | None = None
    projected: Image | None = None
    lit: Image | None = None
    correspondences: Correspondences | None = None


@dataclass(frozen=True, eq=False)
class BoardView:
    """What one pose of a board says, one row a point; every capture protocol ends in these.

    board_xy (n, 2) mm in the board's plane, NaN for a projected point that is not printed on it;
    camera_xy (n, 2) px; projector_xy (n, 2) px, NaN for a point whose projector pixel is not known;
    sigma (n, 2): 1 sigma of projector_xy in projector px, 0 where it is exact by construction, NaN where unknown.
    image_size (width, height) px of the camera. problem: why the view cannot be used, or None (then it has no rows).
    notes: what a person should know of a view that is used.
    """

    name: str
    image_size: tuple[int, int]
    board_xy: npt.NDArray[np.float64]
    camera_xy: npt.NDArray[np.float64]
    projector_xy: npt.NDArray[np.float64]
    sigma: npt.NDArray[np.float64]
    problem: str | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def unusable(cls, name: str, image_size: tuple[int, int], problem: str) -> BoardView:
        """Return a view without rows that says why."""
        empty = np.empty((0, 2))
        return cls(name, image_size, empty, empty, empty, empty, problem)

    @property
    def printed(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of the rows whose place on the board is known."""
        return np.asarray(np.isfinite(self.board_xy).all(axis=1))

    @property
    def projected(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of the rows whose projector pixel is known."""
        return np.asarray(np.isfinite(self.projector_xy).all(axis=1))


@dataclass(frozen=True)
class ViewResult:
    """How one view of a calibration fared.

    rms in px, NaN where the view has no such points: rms_camera and rms_projector under the view's own pose
    (rms_device), rms_joint with both under the one shared pose. reason: why it was not used, or what to know; else "".
    """

    name: str
    used: bool
    reason: str = ""
    rms_camera: float = float("nan")
    rms_projector: float = float("nan")
    rms_joint: float = float("nan")


@dataclass(frozen=True)
class Finding:
    """One reason of a verdict: what is wrong, in which view ("" = all), and what to do about it."""

    fault: str
    view: str
    remedy: str


@dataclass(frozen=True)
class Verdict:
    """A grade, good, usable or bad, and the reasons for it in order of weight."""

    grade: str
    reasons: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class Calibration:
    """A rig and the evidence for it.

    rms_camera, rms_projector: rms_device in px, each device with its own pose per view; rms_joint: camera and
    projector residuals pooled under the shared pose. covariance: {"parameters": names, "matrix": (p, p)} of the
    solver, 1 sigma squared, or None.
    """

    rig: Rig
    method: str
    views: tuple[ViewResult, ...]
    rms_camera: float
    rms_projector: float
    rms_joint: float
    covariance: Mapping[str, Any] | None
    verdict: Verdict
    notes: tuple[str, ...] = ()


def _hold_float32(owner: object, widths: Mapping[str, int | None]) -> None:
    rows: int | None = None
    for name, width in widths.items():
        array = np.asarray(getattr(owner, name), dtype=np.float32)
        rows = len(array) if rows is None and array.ndim else rows
        wanted = (rows,) if width is None else (rows, width)
        if array.shape != wanted:
            raise InputError(f"{name} must have the shape {wanted}, not {array.shape}")
        object.__setattr__(owner, name, array)
