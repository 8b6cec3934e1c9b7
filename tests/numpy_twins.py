"""The same work in plain NumPy, for `make bench`; tests compare the compiled loops with `lines` and `centres`, too."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.special import ndtr

from slkit.data import Correspondences
from slkit.geometry import Rig, homogeneous

_LEAST_SNR = 5


def gray_cells(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return the cell (h, w) that each pixel shows in white, black, and each bit followed by its inverse."""
    cell, bit = np.zeros(pictures[0].shape, np.int32), np.zeros(pictures[0].shape, np.bool_)
    for lit, inverse in zip(pictures[2::2], pictures[3::2], strict=True):
        bit ^= lit > inverse
        cell = 2 * cell + bit
    return cell


def gray_columns(pictures: Sequence[np.ndarray], noise: float) -> Correspondences:
    """Return what `Gray.decode` does of the same pictures: a row a lit pixel, the doubt of its weakest bit.

    noise: 1 sigma of a picture in grey levels; pixels between two cells get one of them.
    """
    white, black = (picture.astype(np.float32) for picture in pictures[:2])
    margin = np.full(white.shape, np.inf, np.float32)
    cell, bit = np.zeros(white.shape, np.int32), np.zeros(white.shape, np.bool_)
    for lit, inverse in zip(pictures[2::2], pictures[3::2], strict=True):
        difference = lit.astype(np.float32) - inverse
        margin = np.minimum(margin, np.abs(difference))
        bit ^= difference > 0
        cell = 2 * cell + bit
    mask = white - black > _LEAST_SNR * np.sqrt(2) * noise
    sigma = np.full(mask.shape, 1 / np.sqrt(12), np.float32)
    return _listed(mask, cell, sigma, ndtr(margin / (np.sqrt(2) * noise)), pictures[0])


def phase_columns(
    pictures: Sequence[np.ndarray], noise: float, periods: Sequence[float], offset: float, extent: int
) -> Correspondences:
    """Return what `PhaseShift.decode` does of sets of four shifted sinusoids, without the shift of a patch.

    noise: as `gray_columns`; periods: of each set in the order shown. Coarser sets count the periods of finer ones.
    """
    position, mask, chance = None, np.True_, np.float32(1)
    for index in np.argsort(periods):
        one, two, three, four = (p.astype(np.float32) for p in pictures[4 * index : 4 * index + 4])
        sine, cosine = two - four, one - three
        snr = np.hypot(sine, cosine) / (2 * noise)
        mask, chance = mask & (snr > _LEAST_SNR), chance * -np.expm1(-(snr**2))
        cycle, pitch = (np.arctan2(sine, cosine) - offset) / (2 * np.pi) % 1, extent / periods[index]
        order = 0 if position is None else np.rint(position / pitch - cycle)
        position, sigma = (order + cycle) * pitch, pitch * np.sqrt(0.5) / (2 * np.pi) / np.maximum(snr, 1e-3)
    white = np.mean(pictures[:4], axis=0, dtype=np.float32)
    return _listed(mask, position, sigma, chance, white)


def _listed(
    mask: np.ndarray, value: np.ndarray, sigma: np.ndarray, confidence: np.ndarray, white: np.ndarray
) -> Correspondences:
    rows, cols = np.nonzero(mask)
    silent = np.full(len(rows), np.nan)
    color = np.repeat((white[mask] / np.float32(white.max()))[:, None], 3, axis=1)
    columns = [np.stack([a[mask], silent], axis=1) for a in (value, sigma)]
    return Correspondences(np.stack([cols, rows], axis=1), *columns, confidence[mask], color)


def lines(share: np.ndarray, variance: np.ndarray, scale: np.ndarray, spacing: np.ndarray) -> dict[str, np.ndarray]:
    """Return the bright lines of pictures (h, w) that cross the rows: where the smoothed derivative falls through zero.

    variance (h, w): of the picture. scale (h, w): sigma in px of the Gaussian whose derivative is used, one of few
    values, NaN where no line is looked for. spacing (h, w): px between lines, for the valleys.
    The row, column, its sigma, contrast and noise of each line.
    """
    parts: list[list[np.ndarray]] = []
    for sigma in np.unique(scale[np.isfinite(scale)]):
        reach = int(np.ceil(4.5 * sigma))
        offset = np.arange(-reach, reach + 1)
        kernel = (offset * np.exp(-((offset / sigma) ** 2) / 2)).astype(np.float32)
        slope = cv2.filter2D(share, cv2.CV_32F, kernel[None], borderType=cv2.BORDER_REPLICATE)
        falls = (slope[:, :-1] > 0) & (slope[:, 1:] <= 0) & (scale[:, :-1] == sigma)
        falls[:, : reach + 1] = falls[:, -reach - 1 :] = False
        row, left = np.nonzero(falls)
        before, after = (slope[row, at].astype(float) for at in (left, left + 1))
        col, doubt = centres(share, np.sqrt(variance), row, left + before / (before - after), float(sigma))
        half = spacing[row, left] / 2
        contrast = _between(share, row, col) - (_between(share, row, col - half) + _between(share, row, col + half)) / 2
        noise = np.sqrt(variance[row, np.rint(col).astype(int)].astype(float))
        parts.append([row, col, doubt, contrast, noise])
    found = (
        [np.concatenate(part) for part in zip(*parts, strict=True)] if parts else [np.empty(0, int), *np.empty((4, 0))]
    )
    keep = np.isfinite(found[2])
    names = "row", "col", "sigma", "contrast", "noise"
    return {name: part[keep] for name, part in zip(names, found, strict=True)}


def _between(picture: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    col = np.clip(col, 0, picture.shape[1] - 1)
    left = np.minimum(col.astype(int), picture.shape[1] - 2)
    return (1 - col + left) * picture[row, left] + (col - left) * picture[row, left + 1]


def centres(
    picture: np.ndarray, noise: np.ndarray, row: np.ndarray, start: np.ndarray, scale: float, rising: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sub-pixel column (m,) of each line or edge near `start` (m,), and its 1 sigma; where it falls.

    Where a column left the picture (h, w), it is at its border.
    """
    last, reach = picture.shape[1] - 1, int(np.ceil(4.5 * scale))
    at = np.rint(start).astype(int)[:, None] + np.arange(-reach, reach + 1)
    inside = np.clip(at, 0, last)
    values, doubts = picture[row[:, None], inside].astype(float), noise[row[:, None], inside].astype(float)
    col, sigma = start.copy(), np.full(len(start), np.nan)
    for _ in range(3):
        offset = at - col[:, None]
        bell = np.exp(-((offset / scale) ** 2) / 2)
        kernel = -bell if rising else offset * bell
        slope = -offset / scale**2 * bell if rising else ((offset / scale) ** 2 - 1) * bell
        pace = (values * slope).sum(axis=1)
        falls = pace < 0
        with np.errstate(divide="ignore", invalid="ignore"):
            col = np.where(falls, col - np.clip((values * kernel).sum(axis=1) / pace, -0.5, 0.5), col)
            sigma = np.where(falls, np.sqrt((kernel**2 * doubts**2).sum(axis=1)) / -pace, np.nan)
    sigma[np.abs(col - start) > 1] = np.nan
    return np.clip(col, 0, last), sigma


def ray_plane(camera_xy: np.ndarray, column: np.ndarray, rig: Rig) -> np.ndarray:
    """Return the points (n, 3) mm at which viewing rays meet the sheets of light of projector columns (n,).

    The plane of light without distortion, moved four times by what the point it gives misses its column.
    """
    rays, pose, lens = homogeneous(rig.camera.normalize(camera_xy)), rig.projector_from_camera, rig.projector.K
    turned, (tx, _, tz) = rays @ pose.rotation.T, pose.translation
    aim = (column - lens[0, 2]) / lens[0, 0]
    z = (aim * tz - tx) / (turned[:, 0] - aim * turned[:, 2])
    for _ in range(4):
        aim = aim + (column - rig.to_projector(rays * z[:, None])[:, 0]) / lens[0, 0]
        z = (aim * tz - tx) / (turned[:, 0] - aim * turned[:, 2])
    return rays * z[:, None]
