"""Draws the pictures of these pages and fills their measured tables: `.venv/bin/python docs/figures.py`.

All of it is simulated, with fixed seeds.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import slkit
from slkit.data import Correspondences, Frames, PointCloud
from slkit.files import read_image, write_png
from slkit.protocols import Codec
from slkit.report.figures import VIEWS, draw_cloud
from slkit.report.measure import cloud_against_truth, volume_error
from slkit.simulation import SimulatedScanner, board, board_poses, boards_for, build, one_to_one_rig, paper_rig
from slkit.simulation.light import Tracer
from slkit.triangulation import Filters, ray_plane

Picture = npt.NDArray[np.uint8]

SEED = 1
PANEL = (300, 225)
# Steps of grey that the eye does not see at this size, and that make a noisy PNG half as large.
STEP = 8
DETAIL = (500, 380)
REPORT = ("rig-3d", "residual-field-projector", "uncertainty-2")
REPORT_PANEL = (420, 315)
SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("gray", {"step": 2}),
    ("gray", {"step": 2, "subpixel": True}),
    ("line-shift", {}),
    ("line-shift", {"period": 8, "width": 2}),
    ("line-shift", {"peaks": "temporal"}),
    ("phase-shift", {}),
    ("phase-shift", {"order": "gray"}),
)
HEAD = (
    "| rig | settings | frames | rows | error px | error / sigma | rms mm | complete |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |\n"
)
VOLUME_MM = (900.0, 1000.0, 1100.0, 1200.0, 1300.0)


def main() -> None:
    """Write every picture into img/ and every table into its page; print what the pages of the calibrations tell."""
    here = Path(__file__).parent
    rows: dict[str, list[str]] = {codec: [] for codec, _ in SETTINGS}
    for name, rig in (("paper", paper_rig()), ("one-to-one", one_to_one_rig())):
        scanner = SimulatedScanner(build("free-form", rig), rig, seed=SEED)
        for codec, parameters in SETTINGS:
            rows[codec].append(f"| {name} | {told(parameters)} | {codec_row(scanner, codec, parameters)} |\n")
    for codec, lines in rows.items():
        page = here / "methods" / f"{codec}.md"
        before, head, after = page.read_text(encoding="utf-8").partition(HEAD)
        after = re.sub(r"\A(\|.*\n)*", "", after)
        page.write_text(before + head + "".join(lines) + after, encoding="utf-8")
    pictures(here / "img")
    for codec in (None, "gray", "phase-shift"):
        print(calibration_row(codec, here / "img"))


def told(parameters: dict[str, Any]) -> str:
    """Return settings as `--set` takes them."""
    return (
        "defaults"
        if not parameters
        else ", ".join(f"`{k}={str(v).lower() if isinstance(v, bool) else v}`" for k, v in parameters.items())
    )


def codec_row(scanner: SimulatedScanner, name: str, parameters: dict[str, Any]) -> str:
    """Return frames, rows, median error in projector px, spread of error / sigma, rms in mm, completeness."""
    codec = slkit.load_codec(name, scanner.rig.projector.size, parameters)
    patterns = codec.encode()
    found = codec.decode(held(scanner.capture(patterns)))
    off, spread = column_error(scanner, found)
    cloud, _ = Filters().apply(slkit.triangulate(found, scanner.rig))
    truth = scanner.truth()
    error = cloud_against_truth(cloud, *scanner.scene.mesh(), truth.camera_xy.astype(int), truth.xyz_mm)
    figures = f"{off:.3f} | {spread:.2f} | {error.rms_mm:.3f} | {100 * error.completeness:.1f} %"
    return f"{len(patterns)} | {len(found)} | {figures}"


def column_error(scanner: SimulatedScanner, found: Correspondences) -> tuple[float, float]:
    """Return the median of |error| in projector columns, and the robust standard deviation of error / sigma."""
    hits = Tracer(scanner.scene, scanner.rig, 3).trace(found.camera_xy)
    error = found.projector_xy[:, 0] - hits.projector_xy[:, 0]
    known = hits.lit & np.isfinite(error)
    share = error[known] / found.sigma[known, 0]
    return float(np.median(np.abs(error[known]))), float(1.4826 * np.median(np.abs(share - np.median(share))))


def calibration_row(codec: str | None, img: Path) -> str:
    """Return the figures of a calibration, planar or with a codec; draw what the report of the planar one shows."""
    truth = paper_rig()
    with tempfile.TemporaryDirectory() as folder:
        slkit.simulate_calibration(folder, truth, codec=codec, seed=SEED)
        found = slkit.calibrate(folder, report=f"{folder}/report")
        if codec is None:
            panels = [fitted(read_image(Path(folder, "report", f"{name}.png"))) for name in REPORT]
            write_png(img / "report.png", coarse(np.concatenate(panels, axis=1)))
    error = volume_error(found.rig, truth, ray_plane, VOLUME_MM)
    rms = f"camera {found.rms_camera:.3f}, projector {found.rms_projector:.3f}, joint {found.rms_joint:.3f} px"
    cy = f"cy {found.rig.projector.K[1, 2]:.1f} (true {truth.projector.K[1, 2]:.1f}) px"
    return f"{codec or 'planar'}: {rms}; {cy}; 3D error {error.rms_mm:.2f} mm as is, {error.aligned_mm:.2f} mm aligned"


def pictures(folder: Path) -> None:
    """Write the pictures of the method pages."""
    rig = one_to_one_rig()
    scanner = SimulatedScanner(build("free-form", rig), rig, seed=SEED)
    truth = scanner.truth()
    box = box_of(truth.visible)
    width = rig.projector.size[0]
    shown = {"gray": ("x_bit5", {"step": 2}), "line-shift": ("x_line0", {}), "phase-shift": ("x_8_0", {})}
    for name, (frame, parameters) in shown.items():
        codec = slkit.load_codec(name, rig.projector.size, parameters)
        names, patterns = codec.encode().names, codec.encode()
        frames, found = decoded(scanner, codec)
        index = names.index(frame)
        left, middle = patterns[index][box], frames[index][box]
        columns = colours(found, truth.lit.shape, 0, width)[box]
        if name == "line-shift":
            # Lines do not survive shrinking, and line centres leave gaps between them.
            left, middle = enlarged(patterns[index]), zoomed(frames[index], found)
            columns = cv2.dilate(columns, np.ones((3, 3), np.uint8))
        write_png(folder / f"{name}.png", row(left, middle, columns))
    cloud, _ = Filters().apply(slkit.triangulate(found, rig))
    write_png(folder / "triangulation.png", by_sigma(cloud))
    depth = np.full(truth.lit.shape, np.nan)
    depth[truth.camera_xy[:, 1].astype(int), truth.camera_xy[:, 0].astype(int)] = truth.xyz_mm[:, 2]
    write_png(folder / "simulation.png", row(scanner.photograph()[box], frames[0][box], painted(depth)[box]))
    draw_boards(folder)


def box_of(mask: npt.NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the part of a picture, four to three, that holds what is marked in a mask (h, w)."""
    rows, cols = np.nonzero(mask)
    high = max(int(np.ptp(rows)), int(np.ptp(cols)) * 3 // 4) + 40
    top = max((int(rows.min()) + int(rows.max()) - high) // 2, 0)
    left = max((int(cols.min()) + int(cols.max()) - high * 4 // 3) // 2, 0)
    return slice(top, top + high), slice(left, left + high * 4 // 3)


def draw_boards(folder: Path) -> None:
    """Write what the camera sees of both sides of a board, and of a printed board under Gray code."""
    rig, rng = paper_rig(), np.random.default_rng(SEED)
    printed, marks, projected = boards_for(rig)
    side_a = board(printed, board_poses(rig, printed.extent(), 1, rng)[0])
    side_b = board(marks, board_poses(rig, marks.extent(), 1, rng, projected=projected, marks=marks)[0])
    size = rig.projector.size
    white = np.full(size[::-1], 255, np.uint8)
    seen = SimulatedScanner(side_b, rig, seed=SEED).capture(Frames.of([white, projected.draw(size)]))
    write_png(folder / "planar.png", row(SimulatedScanner(side_a, rig, seed=SEED).photograph(), *seen))
    lit = boards_for(rig, lit=True)[0]
    scanner = SimulatedScanner(board(lit, board_poses(rig, lit.extent(), 1, rng, lit=True)[0]), rig, seed=SEED)
    codec = slkit.load_codec("gray", size, {"step": 2, "axes": "both"})
    frames, found = decoded(scanner, codec)
    visible = scanner.truth().visible
    box = box_of(visible)
    stripes = frames[codec.encode().names.index("y_bit5")]
    rows = colours(found, visible.shape, 1, size[1])
    write_png(folder / "local-homography.png", row(frames[0][box], stripes[box], rows[box]))


def decoded(scanner: SimulatedScanner, codec: Codec) -> tuple[Frames, Correspondences]:
    """Return the pictures of a codec's patterns, held in memory, and what they say."""
    frames = held(scanner.capture(codec.encode()))
    return frames, codec.decode(frames)


def held(frames: Frames) -> Frames:
    """Return frames that are rendered now, once."""
    return Frames.of(list(frames), frames.names)


def colours(found: Correspondences, shape: tuple[int, ...], axis: int, most: int) -> Picture:
    """Return a decoded projector coordinate as a picture, 0 to `most` px; black where nothing is known."""
    return painted(found.as_map((shape[0], shape[1]))[..., axis], 0, most)


def painted(values: npt.NDArray[Any], low: float | None = None, high: float | None = None) -> Picture:
    """Return values (h, w) in colour, black where they are NaN."""
    low, high = np.nanmin(values) if low is None else low, np.nanmax(values) if high is None else high
    levels = np.clip(255 * (np.nan_to_num(values, nan=low) - low) / (high - low), 0, 255).astype(np.uint8)
    picture = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(np.isfinite(values)[..., None], picture, 0).astype(np.uint8)


def enlarged(picture: npt.NDArray[Any]) -> Picture:
    """Return the 48 x 36 px of a picture at DETAIL eight times as large, as bright as possible."""
    x, y = DETAIL
    part = cv2.resize(picture[y : y + 36, x : x + 48], None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST)
    return np.rint(part * (230 / part.max())).astype(np.uint8)


def zoomed(seen: npt.NDArray[Any], found: Correspondences) -> Picture:
    """Return a detail of a camera picture of `x_line0`, with the centres of its lines as red dots."""
    picture = np.repeat(enlarged(seen)[..., None], 3, axis=2)
    mine = np.rint(found.projector_xy[:, 0]) % 6 == 0
    for u, v in 8 * (found.camera_xy[mine] - DETAIL + 0.5):
        cv2.circle(picture, (round(16 * float(u)), round(16 * float(v))), 32, (255, 60, 40), -1, cv2.LINE_AA, 4)
    return picture


def row(*panels: npt.NDArray[Any]) -> Picture:
    """Return pictures side by side, each fitted into a panel."""
    parts: list[Picture] = []
    for panel in panels:
        colour = np.repeat(panel[..., None], 3, axis=2) if panel.ndim == 2 else panel
        parts.append(cv2.resize(colour, PANEL, interpolation=cv2.INTER_AREA).astype(np.uint8))
    gap = np.full((PANEL[1], 6, 3), 255, np.uint8)
    return coarse(np.concatenate([p for part in parts for p in (part, gap)][:-1], axis=1))


def fitted(picture: npt.NDArray[Any]) -> Picture:
    """Return a picture shrunk into a panel of the report, white around."""
    scale = min(panel / length for panel, length in zip(REPORT_PANEL, picture.shape[1::-1], strict=True))
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    panel = np.full((REPORT_PANEL[1], REPORT_PANEL[0], 3), 255, np.uint8)
    panel[: small.shape[0], : small.shape[1]] = small
    return panel


def coarse(picture: Picture) -> Picture:
    """Return a picture whose levels are multiples of STEP, and white."""
    return np.minimum(np.rint(picture / STEP) * STEP, 255).astype(np.uint8)


def by_sigma(cloud: PointCloud) -> Picture:
    """Return a picture of a cloud whose colours are its sigma_mm, dark where small, up to the 98th percentile."""
    sigma = cloud.sigma_mm
    shade = painted(sigma[None], float(sigma.min()), float(np.percentile(sigma, 98)))[0] / np.float32(255)
    values = (cloud.xyz, shade, sigma, cloud.residual_px, cloud.camera_xy)
    return draw_cloud(PointCloud(*values), (416, 416), VIEWS[:1], colored=True)


if __name__ == "__main__":
    main()
