"""Mistakes that the numbers of a calibration show: its residuals, its rig and its poses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from slkit.calibration._hypotheses import CHANCE, Explanation, Score
from slkit.calibration._pose_findings import coverage_findings, pose_findings
from slkit.calibration.bundle import Adjusted
from slkit.calibration.model import Model
from slkit.data import BoardView, Finding
from slkit.geometry import Rig

_NEARLY = 0.6
"""Explanations that take away this share of what the best one does are as good as it."""
_RIVAL = 0.4
"""Beside the best explanation another counts that takes away this share of what it does."""
_WHOLE = 0.3
"""An explanation that takes away this share of the squares leaves nothing for others to explain."""
_VISIBLE_PX = 0.1
"""Mistakes that move no pixel by as much do no harm worth naming."""
_HARMFUL_PX = 2.0
"""A rig whose projector is skewed by more, and not modelled so, measures shapes wrongly."""
_ODD = 5e-4
"""How likely a view that was rejected is so by noise alone, of one whose board is said to have moved."""
_ASPECT = 0.004
"""Pixels of projectors are square to two in a thousand."""
_RESAMPLED = 0.025
_BEND = 5e-4
"""Smallest bend that is named, as a share of the board's diagonal."""
_ZOOM, _ZOOM_PX, _ZOOM_SHARE = 2e-3, 1.0, 0.1
"""A lens that changed by less, or whose change explains less of the misfit, is imitated by inexact prints."""


def geometry_findings(
    found: Adjusted,
    plain: Adjusted,
    rest: Adjusted,
    views: Sequence[BoardView],
    boards: Sequence[str],
    model: Model,
) -> list[Finding]:
    """Return what the numbers tell of mistakes, those that spoil most first.

    found: as adjusted; plain: adjusted without rejecting anything, for the explanation of a misfit may have been
    rejected with the rows; rest: the same without the views that were rejected. boards: how to call each board in a
    sentence; model: what was estimated.
    """
    score, rig = Score(plain), plain.state.rig
    told = _explained(score, views, model, rig, _share_of_rejected(rest, plain))
    whole = bool(told) and told[0].share > _WHOLE
    if not told and found.rejected:
        rig = rest.state.rig
        told = _explained(Score(rest), views, model, rig, 0.0)
    share = told[0].share if told else 0.0
    findings = [finding for e in told for finding in _told(e, views, boards, rig)]
    if not whole:
        named = {f.view for f in findings if f.code == "moved-board"}
        findings = [*(f for f in _rejected(found, views, score) if f.view not in named), *findings]
    aspect = aspect_finding(found)
    if aspect is not None and share < _WHOLE and "keystone" not in [f.code for f in findings]:
        findings.append(aspect)
    state, board = found.state, found.problem.board
    # How far an object tilts, and how much of an image it fills, its shape and size decide.
    flat = [i for i, v in enumerate(views) if v.face is None and i not in found.rejected]
    for number, name in enumerate(boards):
        mine = [i for i in flat if board[i] == number]
        findings += pose_findings(state.rig, [views[i] for i in mine], [state.poses[i] for i in mine], name)
    return findings + list(coverage_findings(state.rig, [views[i] for i in flat], [state.poses[i] for i in flat]))


def _share_of_rejected(rest: Adjusted, plain: Adjusted) -> float:
    """Return which share of the misfit goes away with the views that were rejected."""
    if rest is plain:
        return 0.0
    before, after = (a.problem.blocks(a.state) for a in (plain, rest))
    whole = np.concatenate([w * before[n].error ** 2 for n, w in plain.weights.items()])
    left = np.concatenate([(w * after[n].error ** 2)[rest.kept[n]] for n, w in plain.weights.items()])
    return 1 - float(left.mean() / whole.mean())


def _explained(score: Score, views: Sequence[BoardView], model: Model, rig: Rig, rejected: float) -> list[Explanation]:
    """Return the best explanation of the misfit, and those that hold beside it.

    rejected: share of the misfit that is explained by views that do not belong to the others.
    """

    def credible(found: Iterable[Explanation]) -> list[Explanation]:
        likely = (e for e in found if e.chance < CHANCE and e.share > _NEARLY * rejected)
        return [e for e in likely if _matters(e, score, rig)]

    first = credible(score.with_skew(e, model) if e.code == "keystone" else e for e in score.explanations(views))
    top = max((e.share for e in first), default=0.0)
    # Of explanations that do nearly as well the one with the fewest parameters is taken.
    best = max((e for e in first if e.share > _NEARLY * top), key=lambda e: e.f, default=None)
    if best is None or best.share > _WHOLE:
        return [] if best is None else [best]
    others = [e for e in credible(score.given(best).explanations(views)) if e.code != best.code]
    beside = [e for e in others if e.share > _RIVAL * best.share]
    return [best, *sorted(beside, key=lambda e: -e.share)]


def _rejected(found: Adjusted, views: Sequence[BoardView], score: Score) -> Iterator[Finding]:
    """Name views that were rejected because what light shows on the board and what is printed do not go together."""
    for index, reason in found.rejected.items():
        own = [p.name for p in found.problem.parts if (p.view == index).any()]
        if min(score.by_chance(index, name) for name in own) > _ODD:
            continue
        if "projected" in own:
            yield _moved(views[index].name, reason)
        elif "decoded" in own:
            fault = (
                f"its codes and its printed corners do not go together, a frame is not the one it should be: {reason}"
            )
            remedy = "wait longer after a change of the pattern, hold the board still, and take this pose again"
            yield Finding(fault, views[index].name, remedy, "stale-frame")


def _moved(view: str, evidence: str) -> Finding:
    fault = f"marks and projected corners do not belong to one pose of the board: {evidence}"
    return Finding(
        fault, view, "hold the board still between its two pictures, and take this view again", "moved-board"
    )


def _matters(e: Explanation, score: Score, rig: Rig) -> bool:
    """Tell whether an explanation moves points by more than a trifle."""
    size = np.abs(e.value)
    if e.code in ("keystone", "camera-skew"):
        return _skewed_px(e, rig) > _VISIBLE_PX
    if e.code == "zoomed":
        return bool(e.share > _ZOOM_SHARE and (size[0] > _ZOOM or size[1:].max() > _ZOOM_PX))
    return float(size.max()) > _BEND * score.diagonal(e.where)


def _skewed_px(e: Explanation, rig: Rig) -> float:
    """Return by how many px skew moves the upper and the lower edge of a device's image."""
    device = rig.projector if e.code == "keystone" else rig.camera
    return float(abs(e.value[0]) * device.size[1] / (2 * device.K[1, 1]))


def _told(e: Explanation, views: Sequence[BoardView], boards: Sequence[str], rig: Rig) -> list[Finding]:
    """Return what an explanation means to the user; one that concerns several views on their own, once a view."""
    if e.code == "moved-board":
        rises = e.value.reshape(-1, 3)[:, 0]
        return [
            _moved(views[v].name, f"it rose by {rise:+.1f} mm and tilted in between")
            for v, rise in zip(e.views, rises, strict=True)
        ]
    return [_sentence(e, views, boards, rig)]


def _sentence(e: Explanation, views: Sequence[BoardView], boards: Sequence[str], rig: Rig) -> Finding:
    share = f"it explains {100 * e.share:.0f} % of the misfit"
    if e.code == "keystone":
        return Finding(
            f"the projector's pixels are skewed by {e.value[0]:.1f} +- {e.sigma[0]:.1f} px",
            "",
            "switch off keystone correction and take all views again, or set model.projector.skew = true",
            "keystone",
            "bad" if _skewed_px(e, rig) > _HARMFUL_PX else "usable",
        )
    if e.code == "camera-skew":
        return Finding(
            f"the camera's pixels are skewed by {e.value[0]:.1f} +- {e.sigma[0]:.1f} px",
            "",
            "look for what warps the pictures (stabilisation, a perspective filter), or set model.camera.skew = true",
            "camera-skew",
        )
    if e.code == "bent-board":
        return Finding(
            f"{boards[e.where]} is bent by about {np.abs(e.value).max():.1f} mm: {share}",
            "",
            "glue it to glass or aluminium, or set model.warp = true",
            "bent-board",
        )
    if e.code == "wrong-marks":
        off = float(np.hypot(*e.value.reshape(-1, 2).T).max())
        which = "marks seem up to" if e.place is None else f"the mark at ({e.place[0]:g}, {e.place[1]:g}) mm seems"
        return Finding(
            f"{which} {off:.1f} mm from where xy_mm puts {'them' if e.place is None else 'it'}: {share}",
            "",
            "measure the marks from centre to centre again and mend xy_mm",
            "wrong-marks",
        )
    scale, dx, dy = e.value
    return Finding(
        f"the camera's lens changed from view {views[e.views[0]].name} on: focal length {100 * scale:+.1f} %, "
        f"principal point {dx:+.1f} {dy:+.1f} px; {share}",
        views[e.views[0]].name,
        "switch off autofocus, zoom and stabilisation and take all views again",
        "zoomed",
    )


def aspect_finding(found: Adjusted) -> Finding | None:
    """Return the finding of a projector whose pixels are not square, None where they are."""
    projector = found.state.rig.projector
    fx, fy = projector.K[0, 0], projector.K[1, 1]
    wanted, slope, sigma = ("projector.fx", "projector.fy"), np.array([-fy / fx**2, 1 / fx]), 0.0
    if set(wanted) <= set(found.names):
        places = [found.names.index(name) for name in wanted]
        # Of a known aspect nothing but rounding is left.
        sigma = float(np.sqrt(max(slope @ found.covariance[np.ix_(places, places)] @ slope, 0.0)))
    aspect = float(fy / fx)
    if abs(aspect - 1) < max(_ASPECT, 5 * sigma):
        return None
    width, height = projector.size
    fault = f"the projector's pixels are not square: fy / fx = {aspect:.4f} +- {sigma:.4f}"
    remedy = (
        f"set the projector to its own resolution (is it {width} x {height} px?) and switch off keystone correction"
    )
    # A desktop of another shape stretches by several per cent; a little is what keystone correction leaves.
    return Finding(fault, "", remedy, "not-native" if abs(aspect - 1) > _RESAMPLED else "keystone")
