from dataclasses import dataclass
from typing import Literal

import pytest

from slkit import registry
from slkit.errors import InputError, PluginError


@dataclass(frozen=True)
class Inner:
    count: int
    share: float = 0.5


@dataclass(frozen=True)
class Plugin:
    size: tuple[int, int]
    inner: Inner
    mode: Literal["fast", "slow"] = "fast"
    names: tuple[str, ...] = ()
    limit: float | None = None
    flag: bool = False

    def __post_init__(self) -> None:
        if self.size[0] <= 0:
            raise InputError("size must be positive")


GOOD = {"size": [3, 4], "inner": {"count": 2}}


def test_tables_become_nested_dataclasses_and_go_back():
    made = registry.create(Plugin, GOOD | {"names": ["a", "b"], "limit": 2, "inner": {"count": 2.0}}, "x.toml")
    assert made == Plugin((3, 4), Inner(2), names=("a", "b"), limit=2.0)
    assert isinstance(made.inner.count, int) and isinstance(made.limit, float)
    assert registry.create(Plugin, registry.parameters_of(made), "again") == made


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sise": 1}, "x.toml: 'sise' is no parameter; there are: size, inner"),
        ({"mode": "quick"}, "x.toml: mode must be one of 'fast', 'slow', not 'quick'"),
        ({"size": [3]}, "size must have 2 items, not 1"),
        ({"size": 3}, "size must be a list"),
        ({"size": [3, 4.5]}, r"size\[1\] must be a whole number, not 4.5"),
        ({"size": [-3, 4]}, "x.toml: size must be positive"),
        ({"inner": {}}, "inner: 'count' is missing"),
        ({"inner": {"count": 1, "share": float("nan")}}, "inner: share must be a finite number"),
        ({"inner": 5}, "inner must be a table with count, share"),
        ({"inner": {"count": True}}, "count must be a whole number, not True"),
        ({"flag": 1}, "flag must be true or false"),
        ({"names": ["a", 2]}, r"names\[1\] must be a text"),
    ],
)
def test_a_wrong_parameter_is_named(change, words):
    with pytest.raises(InputError, match=words):
        registry.create(Plugin, GOOD | change, "x.toml")


@dataclass(frozen=True)
class Plain:
    width: float


@dataclass(frozen=True)
class Round:
    radius: float
    kind: Literal["round"] = "round"


@dataclass(frozen=True)
class Square:
    side: float
    kind: Literal["square"] = "square"


@dataclass(frozen=True)
class Shaped:
    shape: Plain | Round | Square


@dataclass(frozen=True)
class AlwaysRound:
    shape: Round | Square


def test_a_table_chooses_among_classes_by_its_kind():
    for shape in (Plain(1.0), Round(2.0), Square(3.0)):
        made = registry.create(Shaped, registry.parameters_of(Shaped(shape)), "x.toml")
        assert made == Shaped(shape)


@pytest.mark.parametrize(
    ("plugin", "shape", "words"),
    [
        (
            Shaped,
            {"kind": "oval"},
            "shape: kind must be one of 'round', 'square', or be left away for a Plain, not 'oval'",
        ),
        (Shaped, {"kind": "round", "side": 2}, "shape: 'side' is no parameter; there are: radius, kind"),
        (Shaped, {"radius": 2}, "shape: 'radius' is no parameter; there are: width"),
        (Shaped, {"kind": ["round"]}, "kind must be one of"),
        (AlwaysRound, {"radius": 2}, "kind must be one of 'round', 'square', not None"),
        (Shaped, 3, "shape must be a table"),
    ],
)
def test_a_wrong_kind_is_named(plugin, shape, words):
    with pytest.raises(InputError, match=words):
        registry.create(plugin, {"shape": shape}, "x.toml")


def test_a_missing_parameter_is_named():
    with pytest.raises(InputError, match="'inner' is missing"):
        registry.create(Plugin, {"size": [1, 1]}, "x.toml")


def test_built_in_plugins_come_in_by_entry_points():
    assert {"gray", "line-shift", "phase-shift"} <= set(registry.names("slkit.codecs"))
    for group in registry.GROUPS:
        for name in registry.names(group):
            assert callable(registry.load(group, name))


def test_an_unknown_plugin_lists_what_is_installed():
    with pytest.raises(PluginError, match="no codec called 'grey'; installed are: color-.*gray, line-shift, phase"):
        registry.load("slkit.codecs", "grey")
