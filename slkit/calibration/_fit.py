"""The place of a printed drawing to a few hundredths of a pixel: blurred and shaded, it is fitted to its picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_FEWEST_PX = 40
_MOST_PX = 2500
"""Pixels that are fitted; of a larger drawing every second or third is taken."""
_CLEAR = 3.0
"""Least contrast of a drawing that was found, in units of what the fit leaves unexplained."""
_ROUNDS = 12
_STILL_PX = 1e-3
_RIDGE = 1e-10
_SOFT_PX = 0.6
_START_BLUR_PX = 1.0
_LEAST_BLUR_PX, _MOST_BLUR_PX = 0.5, 8.0
_SHRINK = 0.3
_SHORTEST_STEP = 0.05


@dataclass(frozen=True, eq=False)
class Drawing:
    """Black and white cells between straight lines, in units of the drawing's own.

    x (nx + 1,), y (ny + 1,): the lines; ink (ny, nx): 1 where black. reach: half side of the square around (0, 0) whose
    pixels are compared. perspective: whether it is large enough to show its own.
    """

    x: Array
    y: Array
    ink: Array
    reach: float
    perspective: bool = False


def softened(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Return a picture (h, w) so soft that its edges are those of a Gaussian blur, however sharp it is."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), _SOFT_PX), dtype=np.float32)


def fit_drawing(image: npt.NDArray[np.float32], drawing: Drawing, homography: Array) -> Array | None:
    """Return the homography (3, 3) from the drawing's units to px under which it looks like its picture, or None.

    image (h, w): as `softened` gives it. homography: a start, good to a share of a cell. Estimated by least squares: an
    affine correction (of the perspective too, where the drawing is large), the blur, taken to lie along the drawing's
    axes, and a linear shade of paper and of ink. None where the picture holds too little of the drawing, or does not
    look like it.
    """
    middle = homography[:2, 2] / homography[2, 2]
    pixels = _around(image.shape, drawing, homography)
    if len(pixels) < _FEWEST_PX:
        return None
    size = float(np.ptp(pixels, axis=0).max()) / 2
    levels = image[pixels[:, 1], pixels[:, 0]].astype(np.float64)
    place = np.column_stack([(pixels - middle) / size, np.ones(len(pixels))])
    back = np.linalg.inv(homography) @ np.array([[size, 0, middle[0]], [0, size, middle[1]], [0, 0, 1]])
    found = _solve(place, levels, back / back[2, 2], drawing, size)
    if found is None:
        return None
    seen = np.linalg.inv(
        found @ np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])
    )
    return seen / seen[2, 2]


def _around(shape: tuple[int, ...], drawing: Drawing, homography: Array) -> npt.NDArray[np.intp]:
    """Return the pixels (n, 2), x first, of the picture that lie within the drawing's reach."""
    rim = np.array([[-1.0, -1.0, 1], [1.0, -1.0, 1], [1.0, 1.0, 1], [-1.0, 1.0, 1]]) * [drawing.reach, drawing.reach, 1]
    rim = rim @ homography.T
    rim = rim[:, :2] / rim[:, 2:]
    low = np.maximum(np.ceil(rim.min(axis=0)), 0).astype(np.intp)
    high = np.minimum(np.floor(rim.max(axis=0)), np.array(shape[1::-1]) - 1).astype(np.intp)
    step = max(int(np.sqrt(np.prod(np.maximum(high - low, 1)) / _MOST_PX)), 1)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    units = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(homography).T
    return pixels[(np.abs(units[:, :2]) <= drawing.reach * units[:, 2:]).all(axis=1)]


def _solve(place: Array, levels: Array, back: Array, drawing: Drawing, size: float) -> Array | None:
    """Return the matrix (3, 3) from places (n, 3), homogeneous, to the drawing, by Gauss and Newton's method."""
    free = 8 if drawing.perspective else 6
    # Blur in px is blur in the drawing's units along either of its axes.
    units = np.linalg.norm(back[:2, :2] - back[:2, 2:] * back[2, :2], axis=1) / size
    state = _compare(place, levels, back, _START_BLUR_PX, drawing, units)
    length = 1.0
    for _ in range(_ROUNDS):
        step = _least_squares(state.slopes(place, free), state.rest)
        change = np.append(step[:free], np.zeros(9 - free)).reshape(3, 3)
        while length > _SHORTEST_STEP:
            blur = float(np.clip(state.blur + np.clip(length * step[free], -0.4, 0.4), _LEAST_BLUR_PX, _MOST_BLUR_PX))
            trial = _compare(place, levels, state.back + length * change, blur, drawing, units)
            if trial.cost <= state.cost:
                break
            length *= _SHRINK
        else:
            break
        moved = float((np.linalg.norm(length * change[:2], axis=1) / units).max())
        state, length = trial, 1.0
        if moved < _STILL_PX:
            break
    clear = np.abs(place @ state.shade[3:]).mean() > _CLEAR * np.sqrt(state.cost / len(levels))
    return state.back if clear and np.isfinite(state.back).all() else None


@dataclass(frozen=True, eq=False)
class _State:
    """A drawing under a matrix back (3, 3) and a blur in px, shaded to be most like the picture.

    seen (n, 3): homogeneous places in the drawing; ink (n,), slope (n, 2), by_blur (n,): as `_ink` gives them; shade
    (6,): of paper, and of ink against paper; rest (n,): what of the picture is left unexplained.
    """

    back: Array
    blur: float
    seen: Array
    ink: Array
    slope: Array
    by_blur: Array
    shade: Array
    rest: Array

    @property
    def cost(self) -> float:
        """Sum of the squares of what is left unexplained."""
        return float(self.rest @ self.rest)

    def slopes(self, place: Array, free: int) -> Array:
        """Return the derivatives (n, free + 7) of the picture by the matrix, the blur and the shade."""
        contrast = place @ self.shade[3:]
        gain = contrast[:, None] / self.seen[:, 2:]
        at = self.seen[:, :2] / self.seen[:, 2:]
        along = [place * (gain * self.slope[:, k : k + 1]) for k in (0, 1)]
        down = -(along[0] * at[:, :1] + along[1] * at[:, 1:])[:, : free - 6]
        return np.concatenate(
            [*along, down, (contrast * self.by_blur)[:, None], place, place * self.ink[:, None]], axis=1
        )


def _compare(place: Array, levels: Array, back: Array, blur: float, drawing: Drawing, units: Array) -> _State:
    seen = place @ back.T
    ink, slope, by_blur = _ink(seen[:, :2] / seen[:, 2:], blur * units, drawing, units)
    basis = np.concatenate([place, place * ink[:, None]], axis=1)
    shade = _least_squares(basis, levels)
    return _State(back, blur, seen, ink, slope, by_blur, shade, levels - basis @ shade)


def _least_squares(matrix: Array, values: Array) -> Array:
    """Return x (k,) of least |matrix x - values|; columns without influence get 0."""
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    scaled = matrix / scale
    # Normal equations are several times quicker than an orthogonal solution, and exact enough for a step.
    normal = scaled.T @ scaled + _RIDGE * np.eye(len(scale))
    return np.linalg.solve(normal, scaled.T @ values) / scale


def _ink(at: Array, blur: Array, drawing: Drawing, units: Array) -> tuple[Array, Array, Array]:
    """Return the ink (n,) at places (n, 2) under a Gaussian of 1 sigma blur (2,), and its derivatives.

    They are by the place (n, 2), and by the blur in px (n,), of which units (2,) of the drawing make one.
    """
    from scipy.special import ndtr

    shares: list[Array] = []
    slopes: list[Array] = []
    spreads: list[Array] = []
    for k, lines in enumerate((drawing.x, drawing.y)):
        away = (at[:, k : k + 1] - lines) / blur[k]
        bell = np.exp(-0.5 * away * away) / np.sqrt(2 * np.pi) / blur[k]
        shares.append(-np.diff(ndtr(away), axis=1))
        slopes.append(-np.diff(bell, axis=1))
        spreads.append(np.diff(bell * away, axis=1) * units[k])
    across, down = shares[0] @ drawing.ink.T, shares[1]
    ink = (across * down).sum(axis=1)
    slope = np.stack([((slopes[0] @ drawing.ink.T) * down).sum(axis=1), (across * slopes[1]).sum(axis=1)], axis=1)
    by_blur = ((spreads[0] @ drawing.ink.T) * down).sum(axis=1) + (across * spreads[1]).sum(axis=1)
    return ink, slope, by_blur
