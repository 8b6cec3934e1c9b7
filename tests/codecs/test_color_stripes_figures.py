"""How many of the visible slits colour stripes label, and how many of those wrongly.

`python -m pytest tests/codecs/test_color_stripes_figures.py -s` prints the figures that docs/methods/color-stripes.md
shows. A crossing of a slit's centre with a camera row is lit where the truth is known there, and visible where slits
are besides at least 3 px apart and no edge of the object or of its shadow is within 2 px.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slkit import pipeline
from slkit.codecs.color_stripes import ColorStripes
from slkit.data import Frames
from slkit.files import read_capture, read_rig
from slkit.geometry import Rig
from slkit.pipeline._simulating import depth_axis
from slkit.report.measure import Signal, color_line_limit_px, plane_fit
from slkit.simulation import Optics, SimulatedScanner, build, one_to_one_rig, paper_rig, random_rig, scene

from .stripe_truth import Score, at, labelled, runs_along_rows, score

TOML = Path(__file__).parent.parent / "data_toml"
NOISE = {"color": True, "read_noise": 2.0, "shot_noise": 0.0}
OPTICS = {
    "free-form": Optics(**NOISE),
    "color-free-form": Optics(**NOISE, crosstalk=0.15, projector_gamma=2.2, ambient=0.1),
}
# Not looked at one by one while the codec was made; the price of a jump was chosen with them among others.
FRESH_SEEDS = (711, 712, 713)


@cache
def captured(name: str, seed: int) -> tuple[Any, np.ndarray, tuple[float, float]]:
    """A scanner before a scene, by the name of the rig and of the scene; its truth (h, w, 2) px; depths in mm."""
    rig_name, scene = name.split(" ")
    rig, optics = (
        {"paper": paper_rig, "one-to-one": one_to_one_rig}.get(rig_name, lambda: random_setup(seed)[0])(),
        None,
    )
    optics = OPTICS[scene] if rig_name in ("paper", "one-to-one") and scene in OPTICS else random_setup(seed)[1]
    scanner = SimulatedScanner(build(scene, rig), rig, optics, seed)
    seen = scanner.truth()
    truth = np.full((*seen.lit.shape, 2), np.nan)
    truth[seen.lit] = seen.projector_xy
    return scanner, truth, (float(seen.xyz_mm[:, 2].min()), float(seen.xyz_mm[:, 2].max()))


def random_setup(seed: int) -> tuple[Rig, Optics]:
    """A rig and light drawn at random: noise, crosstalk, room light, gamma, brightness and blur of both devices."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    ranges = {
        "read_noise": (0.5, 3),
        "shot_noise": (0, 0.03),
        "crosstalk": (0, 0.2),
        "ambient": (0.02, 0.2),
        "projector_gamma": (1, 2.4),
        "white_level": (0.4, 0.9),
        "projector_blur_px": (0.3, 1.2),
        "camera_blur_px": (0.3, 1.0),
    }
    return rig, Optics(color=True, **{k: float(rng.uniform(*limits)) for k, limits in ranges.items()})


def judged(name: str, seed: int = 0, depth: bool = False, **parameters: Any) -> Score:
    scanner, truth, (near, far) = captured(name, seed)
    codec = ColorStripes(scanner.rig.projector.size, axes=depth_axis(scanner.rig), **parameters)
    bounds = pipeline.bounds(scanner.rig, (near - 20, far + 20)) if depth else None
    result = score(codec, codec.decode(scanner.capture(codec.encode()), bounds), truth)
    told = (
        f"{name}{f' {seed}' if seed else ''}, {codec.layout.width} + {codec.layout.gap} px{', depth' if depth else ''}"
    )
    show(told, result)
    return result


def show(told: str, result: Score) -> None:
    error = result.error
    shares = f"{result.visible:.1%} | {result.lit:.1%} | {result.clear:.1%} | {error.wrong:.2%}"
    print(f"| {told} | {shares} | {error.rms_px:.2f} | {error.points} |")


def test_neutral_object() -> None:
    paper = judged("paper free-form")
    assert paper.visible >= 0.91 and paper.error.wrong <= 0.003
    alike = judged("one-to-one free-form")
    assert alike.visible >= 0.97 and alike.error.wrong <= 0.002
    wide = judged("one-to-one free-form", gap=12)
    assert wide.visible >= 0.97 and wide.error.wrong <= 0.002
    known = judged("one-to-one free-form", depth=True)
    assert known.visible >= 0.97 and known.error.wrong <= 0.002


def test_colored_object() -> None:
    paper = judged("paper color-free-form")
    assert paper.visible >= 0.81 and paper.error.wrong <= 0.005
    alike = judged("one-to-one color-free-form")
    assert alike.visible >= 0.91 and alike.error.wrong <= 0.003


def test_references_cancel_the_object_s_own_color() -> None:
    three = judged("one-to-one color-free-form", references=True)
    assert three.visible >= 0.92 and three.error.wrong <= 0.003


def test_edges_of_a_colored_object() -> None:
    alike = judged("one-to-one color-free-form", style="edges")
    assert alike.visible >= 0.74 and alike.error.wrong <= 0.01


def test_a_random_rig_with_few_slits_that_are_clear() -> None:
    result = judged("random color-free-form", 904)
    assert result.visible >= 0.55 and result.error.wrong <= 0.015


@pytest.mark.parametrize("seed", FRESH_SEEDS)
def test_random_rigs_and_light(seed: int) -> None:
    result = judged(f"random {('free-form', 'color-free-form', 'sphere')[seed % 3]}", seed)
    assert result.error.wrong <= 0.006 and result.visible >= 0.79


@pytest.mark.parametrize(("rig", "seed"), [("paper", 0), ("one-to-one", 0), ("random", 721), ("random", 722)])
@pytest.mark.parametrize("thickness", [1, 6])
def test_a_rod_in_front_of_a_plane(rig: str, seed: int, thickness: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In rows that the rod crosses: the plane on both sides, and the rod, of which a row shows one slit or none.

    A thin rod has no pixel that is far from an edge: all its lit crossings count, and how many of its slits are found.
    """
    monkeypatch.setattr(scene, "_ROD_RADIUS", thickness * scene._ROD_RADIUS)
    scanner, truth, _ = captured.__wrapped__(f"{rig} rod", seed)
    codec = ColorStripes(scanner.rig.projector.size, axes=depth_axis(scanner.rig))
    found = codec.decode(scanner.capture(codec.encode()))
    true, got = labelled(codec, found, truth)
    rod = rod_of(scanner)
    if runs_along_rows(truth[..., int(codec.axes == "y")]):
        rod = rod.T
    cols = np.arange(rod.shape[1])
    first = np.where(rod, cols, cols[-1] + 1).min(axis=1)[true.row]
    last = np.where(rod, cols, -1).max(axis=1)[true.row]
    on_rod = rod[true.row, np.rint(true.col).astype(int)]
    parts = {
        "one side": true.visible & (last >= 0) & (true.col < first),
        "rod": on_rod,
        "other side": true.visible & (last >= 0) & (true.col > last),
    }
    shares = {k: float(got[v].mean()) for k, v in parts.items()}
    slits = len(np.unique(true.label[on_rod & got])) / len(np.unique(true.label[on_rod]))
    told = ", ".join(f"{k} {v:.1%}" for k, v in shares.items())
    result = score(codec, found, truth)
    show(f"rod x {thickness}, {rig} {seed}: {told}, {slits:.0%} of its slits", result)
    assert shares["one side"] >= 0.98 and shares["other side"] >= 0.98
    assert result.error.wrong <= 0.005
    if thickness > 1:
        assert shares["rod"] >= 0.65 and slits >= 0.9
    elif seed != 722:  # There a slit is 4.3 px from the next and the rod 4 px wide: none of its slits is seen whole.
        assert shares["rod"] >= 0.3 and slits >= 0.4


def rod_of(scanner: SimulatedScanner) -> np.ndarray:
    """Which pixels (h, w) see the rod: those more than 10 mm off the plane through most of the points."""
    seen = scanner.truth()
    kept = np.ones(len(seen.xyz_mm), dtype=bool)
    away = np.zeros(len(kept))
    for limit in (100.0, 40.0, 20.0, 10.0):
        normal, offset, _ = plane_fit(seen.xyz_mm[kept])
        away = np.abs(seen.xyz_mm @ normal - offset)
        kept = away < limit
    result = np.zeros(seen.lit.shape, dtype=bool)
    result[seen.lit] = away > 10
    return result


def test_on_a_plane_centers_are_near_the_limit() -> None:
    """The error on a plane against the bound for what a slit is in its own row, one channel, at its own height."""
    scanner, truth, _ = captured("one-to-one plane", 0)
    codec = ColorStripes(scanner.rig.projector.size)
    found = codec.decode(scanner.capture(codec.encode()))
    result = score(codec, found, truth)
    error = at((truth[..., 0] - 1.5) / codec.layout.period, found.camera_xy) * codec.layout.period + 1.5
    error -= found.projector_xy[:, 0]
    error = error[np.isfinite(error)]
    whole = np.abs(error) < 0.5
    level = np.percentile(codec.lit(scanner.capture(codec.encode())), [1, 90])
    signal = Signal(float(level[1] - level[0]), float(np.sqrt(2.0**2 + 1 / 12)), 1.0, float(np.hypot(0.6, 0.6)))
    limit = float(color_line_limit_px([signal], codec.layout.width))
    rms, middle = float(np.sqrt(np.mean(error[whole] ** 2))), float(1.4826 * np.median(np.abs(error)))
    print(f"plane: rms {rms:.3f} px of {whole.mean():.1%}, 1.48 x median {middle:.3f} px, limit {limit:.3f} px")
    assert middle <= 1.5 * limit and rms <= 2.5 * limit and whole.mean() > 0.98
    assert result.visible >= 0.97 and result.error.wrong <= 0.001


@pytest.fixture
def planar(captures: Any, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Frames, np.ndarray, Rig]:
    root = captures("planar_capture")
    monkeypatch.setenv("SLKIT_DATA", str(root.parent))
    capture = read_capture(TOML / "planar_capture" / "capture_color_stripes.toml")
    codec = pipeline.load_codec(capture.codec, capture.projector, capture.parameters)
    known = np.load(root / "truth" / "object.npz", allow_pickle=False)
    frames = capture.frames(codec.encode().names)
    truth = np.full((*frames[0].shape[:2], 2), np.nan)
    truth[known["camera_xy"][:, 1], known["camera_xy"][:, 0]] = known["projector_xy"]
    return codec, frames, truth, read_rig(root / "truth" / "rig.json")


def test_planar_capture(planar: Any) -> None:
    codec, frames, truth, rig = planar
    result = score(codec, codec.decode(frames), truth)
    show("planar_capture", result)
    assert result.visible >= 0.96 and result.lit >= 0.91
    assert result.error.wrong <= 0.003 and result.error.rms_px <= 0.3
    found = codec.decode(frames, pipeline.bounds(rig, (550, 900)))
    known = score(codec, found, truth)
    show("planar_capture, depth", known)
    assert known.error.wrong <= 0.005 and known.error.rms_px <= 0.3


def test_a_depth_range_invents_nothing_beyond_it(planar: Any) -> None:
    """Off the object no truth is known; but what is found there with a depth range is found without one, too."""
    codec, frames, truth, rig = planar
    every = codec.decode(frames)
    places = np.rint(every.camera_xy).astype(int)
    free = np.full(truth.shape[:2], np.nan)
    free[places[:, 1], places[:, 0]] = every.projector_xy[:, 0]
    for depth in ((550, 900), (700, 850)):
        found = codec.decode(frames, pipeline.bounds(rig, depth))
        cols, rows = np.rint(found.camera_xy).astype(int).T
        off = np.isnan(truth[rows, cols, 0])
        near = np.stack([free[rows, np.clip(cols + c, 0, free.shape[1] - 1)] for c in (-1, 0, 1)])
        new = off & ~(np.abs(near - found.projector_xy[:, 0]) < 1).any(axis=0)
        print(f"{depth}: {off.sum()} points off the object, {new.sum()} of them new")
        assert new.sum() <= 0.03 * len(every)
