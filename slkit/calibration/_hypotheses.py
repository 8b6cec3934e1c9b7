"""What would explain the misfit: score tests of mistakes against a calibration that was solved without them.

Every mistake adds parameters that would be zero without it. Where the residuals ask for them the misfit falls, and the
first step of least squares tells by how much and how large they would be; nothing is solved again.
Source: Rao's score test (1948).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from slkit.calibration._normal import cost, free_parameters, minimize, whole_jacobian
from slkit.calibration._parameters import Array
from slkit.calibration._residuals import Block, Ints
from slkit.calibration._state import LENS, MOTION
from slkit.calibration.bundle import Adjusted
from slkit.calibration.model import Model
from slkit.calibration.surfaces import Sheet
from slkit.data import BoardView

CHANCE = 1e-6
"""How likely noise alone may imitate an explanation that is believed."""
_ALONE = 0.9
"""One mark that explains this share of what several do is the only one."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A mistake that the residuals speak for.

    code: its name; value (k,): what its parameters would be, sigma (k,) 1 sigma; share: of the weighted squares, how
    many it takes away; f: its F statistic, of k parameters. views: which it concerns, by index. where: of the board;
    place: (x, y) mm on it. extra (m, k): the weighted derivatives of all residuals over its parameters.
    """

    code: str
    value: Array
    sigma: Array
    share: float
    f: float
    chance: float
    views: tuple[int, ...] = ()
    where: int = 0
    place: tuple[float, float] | None = None
    extra: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Weighted residuals (m,), their Jacobian over the free parameters (m, q), and its inverse normal matrix."""

    residual: Array
    jacobian: Array
    inverse: Array


def _fitted(residual: Array, jacobian: Array) -> _Fitted:
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    return _Fitted(residual, scaled, np.linalg.pinv(scaled.T @ scaled, hermitian=True, rcond=1e-13))


class Score:
    """The score tests of one adjusted calibration."""

    def __init__(self, found: Adjusted) -> None:
        self._problem, self._state, self._weights = found.problem, found.state, found.weights
        self._blocks: Mapping[str, Block] = found.problem.blocks(found.state)
        self._names = [p.name for p in self._problem.parts]
        self._roots = {n: np.sqrt(found.weights[n]) for n in self._names}
        jacobian = np.concatenate(
            [
                self._weighted(p.name, whole_jacobian(self._problem, p, self._blocks[p.name]))
                for p in self._problem.parts
            ]
        )
        residual = np.concatenate([self._weighted(n, self._blocks[n].error[:, :, None]) for n in self._names])[:, 0]
        self._fitted = _fitted(residual, jacobian)
        self.dof = int((np.abs(residual) > 0).sum()) - jacobian.shape[1]

    def given(self, e: Explanation) -> Score:
        """Return the tests of what is left when an explanation is believed: what only looked like it is gone."""
        other = copy(self)
        other._fitted = _fitted(self._fitted.residual, np.concatenate([self._fitted.jacobian, e.extra], axis=1))
        other.dof = self.dof - e.extra.shape[1]
        return other

    def _weighted(self, name: str, columns: Array) -> Array:
        """Return columns (n, 2, k) times the root of their weights, as (2n, k)."""
        return (columns * self._roots[name][:, :, None]).reshape(-1, columns.shape[2])

    def test(
        self, code: str, columns: Mapping[str, Array], views: Sequence[int] = (), where: int = 0
    ) -> Explanation | None:
        """Return how well extra parameters explain the misfit; columns: per class d error / d parameter (n, 2, k)."""
        width = next(iter(columns.values())).shape[2]
        extra = np.concatenate(
            [
                self._weighted(p.name, columns[p.name]) if p.name in columns else np.zeros((2 * len(p.view), width))
                for p in self._problem.parts
            ]
        )
        from scipy.stats import f as f_distribution

        fitted, whole = self._fitted, extra
        length = np.linalg.norm(extra, axis=0)
        extra = extra - fitted.jacobian @ (fitted.inverse @ (fitted.jacobian.T @ extra))
        left = np.linalg.norm(extra, axis=0)
        # A parameter that the others imitate almost wholly cannot be told from them.
        if not (left > 1e-4 * np.maximum(length, 1e-300)).all() or self.dof <= width:
            return None
        matrix = (extra / left).T @ (extra / left)
        if np.linalg.cond(matrix) > 1e8:
            return None
        pull = (extra / left).T @ fitted.residual
        value = -np.linalg.solve(matrix, pull)
        total, taken = float(fitted.residual @ fitted.residual), float(-value @ pull)
        rest = max(total - taken, 1e-300) / (self.dof - width)
        sigma = np.sqrt(rest * np.diag(np.linalg.inv(matrix)))
        f = taken / width / rest
        chance = float(f_distribution.sf(f, width, self.dof - width))
        share = taken / max(total, 1e-300)
        return Explanation(code, value / left, sigma / left, share, f, chance, tuple(views), where, extra=whole)

    def diagonal(self, board: int) -> float:
        """Return the diagonal in mm of a board's points."""
        parts = self._problem.parts
        points = [self._blocks[p.name].local[self._problem.board[p.view] == board] for p in parts]
        return float(np.linalg.norm(np.ptp(np.concatenate(points)[:, :2], axis=0)))

    def explanations(self, views: Sequence[BoardView]) -> Iterator[Explanation]:
        """Test every mistake of geometry: skewed pixels, bent boards, misplaced marks, a lens that changed."""
        free = np.abs(self._problem.free.spread).sum(axis=1) > 0
        found = [
            self.test(code, {n: self._blocks[n].shared[:, :, [first + 4]] for n in self._names})
            for code, first in (("camera-skew", 0), ("keystone", LENS))
            if not free[first + 4] and free[first]
        ]
        for board, surface in enumerate(self._state.surfaces):
            first = MOTION + 2 * board
            if isinstance(surface, Sheet) and not free[first]:
                found.append(self._bend(board, surface))
        found += [self._marks(), self._moved(), self._changes(views)]
        return (e for e in found if e is not None)

    def _bend(self, board: int, sheet: Sheet) -> Explanation | None:
        """Test whether a board is bent, by three numbers in mm: along x, along y, and twisted."""
        columns: dict[str, Array] = {}
        for part in self._problem.parts:
            block = self._blocks[part.name]
            mine = self._problem.board[part.view] == board
            place = (block.local[:, :2] - sheet.center) / sheet.half
            shape = np.column_stack([1 - place**2, place[:, :1] * place[:, 1:]]) * mine[:, None]
            columns[part.name] = block.height[:, :, None] * shape[:, None]
        return self.test("bent-board", columns, where=board)

    def by_chance(self, view: int, name: str) -> float:
        """Return how likely the residuals of a class are in one view so much larger than in the others by noise alone.

        An F test of their squares, one degree of freedom a point: poses take up about half of the residuals.
        """
        from scipy.stats import f as f_distribution

        part = next(p for p in self._problem.parts if p.name == name)
        squares, mine = (self._blocks[name].error ** 2).sum(axis=1), part.view == view
        ratio = squares[mine].mean() / max(float(squares[~mine].mean()), 1e-300)
        return float(f_distribution.sf(ratio, mine.sum(), (~mine).sum()))

    def with_skew(self, keystone: Explanation, model: Model) -> Explanation:
        """Return the explanation by skewed pixels of the projector as a new solution finds it, with the same weights.

        Strong keystone correction is more than a small step away, yet focal lengths, skew and a turn make all of it.
        """
        problem, state, weights = self._problem, self._state, self._weights
        skewed = replace(model, projector=replace(model.projector, skew=True))
        other = replace(problem, free=free_parameters(skewed, state, problem.parts))
        there, blocks, _ = minimize(other, state, self._blocks, lambda _: weights)
        before, after = cost(problem, self._blocks, weights, state), cost(other, blocks, weights, there)
        share = 1 - after / max(before, 1e-300)
        f = share / max(1 - share, 1e-12) * (self.dof - 1)
        return replace(keystone, value=np.array([there.rig.projector.K[0, 1]]), share=share, f=f)

    def _marks(self) -> Explanation | None:
        """Test whether a mark is elsewhere on the board than stated, two numbers in mm; or several of them."""
        part = next((p for p in self._problem.parts if p.name == "marks"), None)
        if part is None:
            return None
        numbers = np.unique(part.point)
        turns = self._state.rotations[part.view]
        slope = self._blocks["marks"].pose[:, :, 3:] @ turns[:, :, :2]
        board = int(self._problem.board[part.view[0]])
        columns = [slope * (part.point == number)[:, None, None] for number in numbers]
        # A shift of all marks together is a shift of the board: two of them stay where they are.
        several = self.test("wrong-marks", {"marks": np.concatenate(columns[:-2] or columns[:1], axis=2)}, where=board)
        single = [self.test("wrong-marks", {"marks": c}, where=board) for c in columns]
        known = [(e, int(n)) for e, n in zip(single, numbers, strict=True) if e is not None]
        best, number = max(known, key=lambda pair: pair[0].f, default=(None, 0))
        if best is None or (several is not None and best.share < _ALONE * several.share):
            return several
        x, y = self._blocks["marks"].local[part.point == number][0, :2]
        return replace(best, place=(float(x), float(y)))

    def _moved(self) -> Explanation | None:
        """Test in which views the board lay elsewhere when the pattern was shown: a rise in mm and two tilts a view.

        Sliding within its plane does not move a projected corner.
        """
        part = next((p for p in self._problem.parts if p.name == "projected"), None)
        if part is None:
            return None
        block = self._blocks["projected"]
        span = np.maximum(np.ptp(block.local[:, :2], axis=0), 1e-9)
        shape = np.column_stack([np.ones(len(part.view)), block.local[:, :2] / span])
        whole = block.height[:, :, None] * shape[:, None]
        tests = {
            int(v): self.test("moved-board", {"projected": whole * (part.view == v)[:, None, None]}, [int(v)])
            for v in np.unique(part.view)
        }
        moved = [v for v, e in tests.items() if e is not None and e.chance < CHANCE]
        columns = [whole * (part.view == v)[:, None, None] for v in moved]
        if not moved:
            return None
        return self.test(
            "moved-board", {"projected": np.concatenate(columns, axis=2)}, moved, int(self._problem.board[moved[0]])
        )

    def _changes(self, views: Sequence[BoardView]) -> Explanation | None:
        """Test whether focal length and principal point of the camera differ from some view on."""
        count = len(views)
        light = np.array([bool(v.projected.any()) for v in views])
        sets: list[list[int]] = [list(range(first, count)) for first in range(2, count - 1)]
        sides = [np.flatnonzero(light == side) for side in (False, True)]
        if all(len(side) >= 4 for side in sides):
            for share in np.arange(1, 8) / 8:
                sets.append([int(i) for side in sides for i in side[round(share * len(side)) :]])
        K = self._state.rig.camera.K
        slopes: dict[str, tuple[Ints, Array]] = {}
        for part in self._problem.parts:
            over = self._blocks[part.name].shared[:, :, :4]
            focal = over[:, :, :1] * K[0, 0] + over[:, :, 1:2] * K[1, 1]
            if part.name != "decoded":
                slopes[part.name] = part.view, np.concatenate([focal, over[:, :, 2:]], axis=2)
        tests = (
            self.test("zoomed", {n: s * np.isin(v, chosen)[:, None, None] for n, (v, s) in slopes.items()}, chosen)
            for chosen in sets
        )
        return max((e for e in tests if e is not None), key=lambda e: e.f, default=None)
