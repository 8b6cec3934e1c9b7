"""Mistakes of a calibration, made on purpose: each takes a session and returns what the user's mistake makes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from slkit.data import BoardView, Frames
from slkit.errors import InputError
from slkit.geometry import Rig
from slkit.simulation import _weak, _wrongs
from slkit.simulation.session import Session, coded_session, planar_session
from slkit.simulation.views import board_views, told_targets

Strength = Literal["mild", "strong"]
STRENGTHS: tuple[Strength, ...] = ("mild", "strong")


@dataclass(frozen=True)
class Fault:
    """A mistake: what the user did, which methods it can befall, and what it changes.

    methods: planar, coded or both. pictures: it shows in pictures only, not in computed views. change: takes a session,
    whether it is the strong form, and a random generator that chooses views and directions.
    """

    sentence: str
    methods: tuple[str, ...]
    pictures: bool
    change: Callable[[Session, bool, np.random.Generator], Session]


_ANY, _PLANAR, _CODED = ("planar", "coded"), ("planar",), ("coded",)

FAULTS: dict[str, Fault] = {
    "swapped-pictures": Fault(
        "exchanged the picture under white light and the one under the pattern", _PLANAR, True, _wrongs.swapped
    ),
    "moved-board": Fault("moved the board between the two pictures", _PLANAR, False, _wrongs.moved),
    "stale-frame": Fault("took the picture before the projector had changed", _ANY, True, _wrongs.stale),
    "not-native": Fault("ran the projector at a resolution that is not its own", _ANY, False, _wrongs.not_native),
    "keystone": Fault("left the keystone correction on", _ANY, False, _wrongs.keystone),
    "mirrored": Fault("left the setting for rear projection on", _ANY, False, _wrongs.mirrored),
    "turned": Fault("left the setting for the ceiling on, or turned the desktop", _ANY, False, _wrongs.turned),
    "wrong-corners": Fault("counted the corners wrongly", _PLANAR, True, _wrongs.wrong_corners),
    "wrong-square": Fault("mistyped square_mm", _PLANAR, True, _wrongs.wrong_square),
    "wrong-marks": Fault("mistyped xy_mm", _PLANAR, True, _wrongs.wrong_marks),
    "bent-board": Fault("used a board that is not flat", _ANY, False, _wrongs.bent),
    "parallel-poses": Fault("held the board the same way in all views", _ANY, False, _weak.parallel),
    "one-depth": Fault("held the board at one distance in all views", _ANY, False, _weak.one_depth),
    "one-corner": Fault("kept a small board in one corner of the picture", _ANY, False, _weak.one_corner),
    "saturated": Fault("exposed for too long", _ANY, True, _wrongs.saturated),
    "under-exposed": Fault("exposed too briefly", _ANY, True, _wrongs.under_exposed),
    "blurred": Fault("did not focus", _ANY, True, _wrongs.blurred),
    "zoomed": Fault("left autofocus on, or touched the zoom half way", _ANY, False, _wrongs.zoomed),
    "exif-rotated": Fault("copied pictures with a program that turns them", _ANY, True, _wrongs.exif_rotated),
    "other-size": Fault("saved some pictures at another size", _ANY, True, _wrongs.other_size),
    "gamma": Fault("left the projector's gamma as it was", _CODED, True, _wrongs.gamma),
}
"""By code, as `slkit.data.faults` explains them."""


def with_fault(session: Session, name: str, strength: str, rng: np.random.Generator) -> Session:
    """Return a session in which the user made a mistake. strength: mild or strong.

    Errors: InputError for an unknown fault or strength, or one that cannot befall this kind of session.
    """
    if name not in FAULTS:
        raise InputError(f"there is no fault called {name!r}; there are: {', '.join(FAULTS)}")
    if strength not in STRENGTHS:
        raise InputError(f"strength must be mild or strong, not {strength!r}")
    fault = FAULTS[name]
    if session.method not in fault.methods:
        kind = "coded light" if session.method == "coded" else "the planar method"
        raise InputError(f"the fault {name} cannot befall a calibration by {kind}")
    return fault.change(session, strength == "strong", rng)


def views_with_fault(
    name: str | None,
    strength: str,
    rig: Rig,
    rng: np.random.Generator,
    method: str = "planar",
    poses: int = 10,
    noise_px: float = 0.1,
) -> tuple[dict[str, Any], list[BoardView]]:
    """Return the fields of a calibrator and the views that it solves, with a fault (None: without), no picture taken.

    method: planar or coded. noise_px: 1 sigma of every found point. Errors: as `with_fault`, and InputError for a fault
    that shows in pictures only.
    """
    if name in FAULTS and FAULTS[name].pictures:
        raise InputError(f"the fault {name} shows in pictures only")
    if method == "planar":
        session = planar_session(rig, poses, rng)
    else:
        session = coded_session(rig, poses, Frames.of([]), rng)
    if name is not None:
        session = with_fault(session, name, strength, rng)
    return told_targets(session), board_views(session, rng, noise_px)
