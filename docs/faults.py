"""Makes every mistake of `faults.md` on purpose and counts how often the verdict names it: `make faults`.

All of it is simulated, with fixed seeds; thresholds were set on the seeds below the first one used here.
Mistakes of geometry are computed as board views; the others are rendered.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from slkit import registry
from slkit.data import Calibration, Capture, Frames, Image
from slkit.errors import CalibrationError, InputError
from slkit.geometry import Pinhole, Rig, flat
from slkit.pipeline import CalibrationTask, calibrate_captures, decode_capture, load_codec, solve_views
from slkit.protocols import Calibrator, Codec
from slkit.simulation import (
    FAULTS,
    Camera,
    Session,
    Shot,
    board_views,
    coded_session,
    paper_rig,
    planar_session,
    random_rig,
    told_targets,
    with_fault,
)

FIRST = 80
SEEDS = 10
CLEAN = 20
POSES = {False: 10, True: 6}
# Pictures are rendered with a camera of so many columns.
WIDTH = {"planar": 540, "coded": 448}
# No detector finds a board whose squares are narrower.
NARROWEST_PX = 9.0
METHODS = {"planar": "planar", "coded": "local-homography"}
FRINGES = {"periods": [20], "steps": 3}
# Computed views have no marks that move between two pictures.
RENDERED = {name for name, fault in FAULTS.items() if fault.pictures} | {"moved-board"}
BEGIN, END = "<!-- measured: begin -->\n", "<!-- measured: end -->"

Key = tuple[str, str, bool, bool]
"""Fault, method, whether it was the strong form, and whether it was the first that was named."""


def main(seeds: int = SEEDS, clean: int = CLEAN) -> None:
    """Count over all seeds in two processes and write the table into faults.md; print what was missed as well."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    jobs = [(FIRST + i, i < seeds) for i in range(max(seeds, clean))]
    named: Counter[Key] = Counter()
    alarms: Counter[str] = Counter()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for seed, hits, missed, false in pool.map(run_seed, jobs):
            named.update(hits)
            alarms.update(false)
            print(f"seed {seed}: missed {missed or 'none'}, false alarms {false or 'none'}", flush=True)
    lines = [row(name, named, seeds) for name in FAULTS]
    told = ", ".join(f"{code} {count}" for code, count in sorted(alarms.items())) or "none"
    lines.append(f"\nFalse alarms in {clean} clean calibrations by each method, of either kind: {told}.\n")
    page = Path(__file__).with_suffix(".md")
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    head = "| fault | method | mild (named first) | strong (named first) |\n| --- | --- | --- | --- |\n"
    page.write_text(before + BEGIN + "\n" + head + "".join(lines) + "\n" + END + after, encoding="utf-8")
    print("\n" + head + "".join(lines))


def row(name: str, named: Counter[Key], seeds: int) -> str:
    """Return the lines of the table for a fault, one a method."""
    lines: list[str] = []
    for method in FAULTS[name].methods:
        counts = [[named[name, method, strong, first] for first in (False, True)] for strong in (False, True)]
        cells = " | ".join(f"{sum(c)} of {seeds} ({c[1]})" for c in counts)
        lines.append(f"| {name} | {method} | {cells} |\n")
    return "".join(lines)


def run_seed(job: tuple[int, bool]) -> tuple[int, list[Key], list[str], list[str]]:
    """Return the seed, what is named, what is not, and the codes that a clean calibration raises.

    job: the seed, and whether to make mistakes too.
    """
    seed, faulty = job
    hits: list[Key] = []
    missed: list[str] = []
    alarms: list[str] = []
    for method in METHODS:
        for pictures in (False, True):
            bench = Bench(seed, method, pictures)
            alarms += sorted(bench.codes(bench.clean))
            for name, fault in FAULTS.items() if faulty else ():
                if method not in fault.methods or (name in RENDERED) != pictures:
                    continue
                for strong in (False, True):
                    codes = bench.reasons(bench.faulty(name, strong))
                    if name in codes:
                        hits.append((name, method, strong, codes[0] == name))
                    else:
                        missed.append(f"{'strong' if strong else 'mild'} {method} {name}: {codes}")
    return seed, hits, missed, alarms


class Bench:
    """One rig and one clean calibration, and what the verdict says of it and of its faulty forms."""

    def __init__(self, seed: int, method: str, pictures: bool, poses: int | None = None) -> None:
        self.seed, self.method, self.pictures = seed, method, pictures
        self.codec: Codec | None = None
        count, rng = poses or POSES[pictures], np.random.default_rng([seed, pictures])
        self.clean = self._session(count, rng)
        self._camera = Camera(self.clean, keep=4 * count)
        self._taken: dict[Shot, list[Image]] = {}

    def _session(self, count: int, rng: np.random.Generator) -> Session:
        # A rig or poses that hardly show the boards are nothing to test with; the next ones are drawn.
        for _ in range(100):
            rig = random_rig(rng) if self.seed % 2 else paper_rig()
            rig = scaled(rig, WIDTH[self.method] / rig.camera.size[0]) if self.pictures else rig
            try:
                if self.method == "planar":
                    return planar_session(rig, count, rng, seed=self.seed)
                parameters = {"axes": "both", "order": "gray", "x": FRINGES, "y": FRINGES}
                self.codec = load_codec("phase-shift", rig.projector.size, parameters)
                session = coded_session(rig, count, self.codec.encode(), rng, seed=self.seed)
                if not self.pictures or narrowest_square(session) > NARROWEST_PX:
                    return session
            except InputError:
                pass
        raise InputError("none of a hundred rigs can see its boards")

    def faulty(self, name: str, strong: bool) -> Session:
        """Return the calibration with a fault."""
        return with_fault(self.clean, name, "strong" if strong else "mild", np.random.default_rng([self.seed, 1]))

    def codes(self, session: Session) -> set[str]:
        """Return the faults that the verdict names, or the refusal to calibrate."""
        return set(self.reasons(session))

    def reasons(self, session: Session) -> list[str]:
        """Return the codes of the faults that are named, in the order in which they are."""
        try:
            found = self.calibrate(session).verdict.reasons
        except CalibrationError as error:
            found = error.findings
        return [finding.code for finding in found if finding.code]

    def calibrate(self, session: Session) -> Calibration:
        """Return the calibration of a session, from its pictures or from computed views."""
        plugin = registry.load("slkit.calibrators", METHODS[self.method])
        calibrator = registry.create(plugin, told_targets(session), "faults.py")
        if not self.pictures:
            return solve_views(calibrator, board_views(session, np.random.default_rng([self.seed, 2])))
        return calibrate_captures(self.task(calibrator, session), "simulated")

    def task(self, calibrator: Calibrator, session: Session) -> CalibrationTask:
        """Return a calibrator with the pictures of a session; what the clean one has in common is taken once."""
        camera = self._camera.of(session)
        taken = {shot: self._pictures(camera, shot, session.warp is None) for shot in session.shots}
        patterns = {shot.index: shot for shot in session.shots if shot.role == "projected"}
        found: list[Capture] = []
        undecoded: list[Capture] = []
        dropped: list[tuple[str, str]] = []
        for shot, pictures in taken.items():
            if shot.role == "printed":
                found.append(Capture(shot.name, printed=pictures[0]))
            elif shot.role == "marks":
                found.append(Capture(shot.name, marks=pictures[0], projected=taken[patterns[shot.index]][0]))
            elif shot.role == "coded" and self.codec is not None:
                capture, problem = decode_capture(shot.name, self.codec, Frames.of(pictures, session.patterns.names))
                (undecoded if problem else found).append(capture)
                dropped += [(shot.name, problem)] if problem else []
        kinds = {shot.name: shot.role for shot in session.shots if shot.role != "projected"}
        return CalibrationTask(calibrator, tuple(found), tuple(dropped), kinds, tuple(undecoded))

    def _pictures(self, camera: Camera, shot: Shot, plain: bool) -> list[Image]:
        clean = plain and any(shot is known for known in self.clean.shots)
        if not clean:
            return list(camera.take(shot))
        if shot not in self._taken:
            self._taken[shot] = list(camera.take(shot))
        return self._taken[shot]


def narrowest_square(session: Session) -> float:
    """Return the smallest distance of neighbouring corners in px over all views of the printed board."""
    seen = [s.rig.camera.project(s.pose.apply(flat(session.printed.points()))) for s in session.shots]
    grids = [xy.reshape(*session.printed.corners[::-1], 2) for xy in seen]
    return min(float(np.linalg.norm(np.diff(g, axis=axis), axis=-1).min()) for g in grids for axis in (0, 1))


def scaled(rig: Rig, factor: float) -> Rig:
    """Return a rig whose pictures are smaller by a factor and otherwise the same."""

    def device(one: Pinhole) -> Pinhole:
        matrix = one.K.copy()
        matrix[:2] *= factor
        matrix[:2, 2] += (factor - 1) / 2
        return Pinhole((round(one.size[0] * factor), round(one.size[1] * factor)), matrix, one.distortion)

    return replace(rig, camera=device(rig.camera), projector=device(rig.projector))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
