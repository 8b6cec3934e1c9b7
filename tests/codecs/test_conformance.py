"""Every installed codec keeps the promises of the seam, with several sets of parameters."""

from __future__ import annotations

from typing import Any

import pytest

from slkit import registry
from slkit.testing import check_codec

SIZE = [160, 120]
FRINGES = {"periods": [11.5, 3.1, 0.9], "steps": 5, "sign": -1, "offset": 1.0}
# By default slits lie further apart than the blocks of which most must hold a row.
STRIPES = {"projector": [240, 160], "gap": 4}
DEFAULTS: dict[str, dict[str, Any]] = {"color-stripes": {"gap": 4}}
CASES: list[tuple[str, dict[str, Any]]] = [
    ("gray", {}),
    ("gray", {"axes": "y", "references": False}),
    ("gray", {"axes": "both", "inverse": False, "step": 2}),
    ("gray", {"robust": True}),
    ("line-shift", {}),
    ("line-shift", {"axes": "y", "period": 8, "width": 2}),
    ("line-shift", {"axes": "both"}),
    ("line-shift", {"axes": "both", "peaks": "temporal"}),
    ("phase-shift", {}),
    ("phase-shift", {"axes": "both"}),
    ("phase-shift", {"axes": "y", "order": "gray"}),
    ("phase-shift", {"references": False, "x": {"periods": [10, 1], "steps": 3}}),
    ("phase-shift", {"axes": "both", "x": FRINGES, "y": FRINGES}),
    ("color-fringe", {}),
    ("color-fringe", {"axes": "y", "transitions": "switch", "period": 12}),
    ("color-fringe", {"references": True, "colors": ["red", "green", "blue", "yellow", "cyan"]}),
    ("color-stripes", STRIPES),
    ("color-stripes", STRIPES | {"axes": "y", "transitions": "switch", "first": 3}),
    ("color-stripes", STRIPES | {"references": True, "colors": ["red", "green", "blue", "yellow", "cyan"]}),
    ("color-stripes", STRIPES | {"style": "edges", "width": 5, "gap": 0}),
]


@pytest.mark.parametrize(("name", "parameters"), CASES, ids=str)
def test_codec_conforms(name: str, parameters: dict[str, Any]) -> None:
    check_codec(registry.create(registry.load("slkit.codecs", name), {"projector": SIZE} | parameters, name))


@pytest.mark.parametrize("name", registry.names("slkit.codecs"))
def test_every_installed_codec_conforms_by_default(name: str) -> None:
    check_codec(
        registry.create(registry.load("slkit.codecs", name), {"projector": [97, 131]} | DEFAULTS.get(name, {}), name)
    )


def test_a_codec_that_needs_bounds_conforms_with_them() -> None:
    codec = registry.load("slkit.codecs", "phase-shift")
    parameters = {"projector": SIZE, "axes": "both", "x": {"periods": [8]}, "y": {"periods": [6]}}
    check_codec(registry.create(codec, parameters, "test"), bounded=True)
