"""Pictures of printed targets under a known homography: the detectors' input with known truth."""

import cv2
import numpy as np

from slkit.targets import Target


def seen(
    target: Target,
    homography: np.ndarray,
    rng: np.random.Generator,
    size: tuple[int, int] = (900, 700),
    noise: float = 1.5,
    blur: float = 0.8,
    around: float = 0.04,
) -> np.ndarray:
    """A target on its sheet, brighter to the right, seen through a homography from mm to px; 8-bit grey (h, w).

    around: reflectance beside the sheet. Each pixel is the mean of 3 x 3 places in it.
    """
    fine = 3
    x, y = ((np.arange(fine * n) + 0.5) / fine - 0.5 for n in size)
    xy = np.stack(np.meshgrid(x, y), axis=-1)
    place = mapped(np.linalg.inv(homography), xy.reshape(-1, 2)).reshape(xy.shape)
    middle = np.array([size]) / 2
    sides = mapped(np.linalg.inv(homography), middle + np.array([[0, 0], [1, 0], [0, 1]]))
    footprint = float(np.linalg.norm(sides[1:] - sides[0], axis=1).mean()) / fine
    x0, y0, x1, y1 = target.extent()
    on_sheet = (place[..., 0] > x0) & (place[..., 0] < x1) & (place[..., 1] > y0) & (place[..., 1] < y1)
    light = np.where(on_sheet, target.reflectance(place, footprint), around)
    light = light.reshape(size[1], fine, size[0], fine).mean(axis=(1, 3)) * np.linspace(0.5, 1.0, size[0])
    levels = 230 * cv2.GaussianBlur(light, (0, 0), blur) + 6
    return np.clip(np.rint(levels + noise * rng.normal(size=levels.shape)), 0, 255).astype(np.uint8)


def tilted(
    target: Target, rng: np.random.Generator, tilt_deg: float, size: tuple[int, int] = (900, 700), fill: float = 0.85
) -> np.ndarray:
    """A homography from mm to px of a sheet, tilted about a random axis and rolled a little, that fills the picture."""
    x0, y0, x1, y1 = target.extent()
    outline = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], dtype=float)
    center = outline.mean(axis=0)
    angle = rng.uniform(0, 2 * np.pi)
    lean = cv2.Rodrigues(np.radians(tilt_deg) * np.array([np.cos(angle), np.sin(angle), 0.0]))[0]
    turn = lean @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.3, 0.3)]))[0]
    far = 2.2 * (x1 - x0)
    board = np.column_stack([turn[:, 0], turn[:, 1], np.array([0, 0, far]) - turn @ center])
    flat = mapped(board, outline[:, :2])
    scale = fill * min(np.array(size) / np.ptp(flat, axis=0))
    shift = (np.array(size) - 1) / 2 - scale * (flat.max(axis=0) + flat.min(axis=0)) / 2
    return np.array([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1]]) @ board


def mapped(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) under a homography."""
    return cv2.perspectiveTransform(np.asarray(points, dtype=float)[None], homography)[0]
