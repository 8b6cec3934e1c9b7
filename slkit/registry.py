"""From a name to a plug-in, and from a table of parameters to its fields.

Built-in plug-ins come in by the same door as a stranger's: the entry points of an installed distribution.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from slkit.errors import InputError, PluginError

GROUPS = ("slkit.codecs", "slkit.calibrators", "slkit.triangulators", "slkit.scanners", "slkit.exporters")


def names(group: str) -> list[str]:
    """Return the names installed in a group, sorted; nothing is imported."""
    return sorted(_installed(group))


def load(group: str, name: str) -> Any:
    """Return the plug-in, a class or function, of that name. Errors: PluginError listing what is installed."""
    if name not in _remembered(group):
        # It may have been installed since.
        _remembered.cache_clear()
    installed = _remembered(group)
    if name not in installed:
        kind = group.removeprefix("slkit.").removesuffix("s")
        raise PluginError(
            f"there is no {kind} called {name!r}; installed are: {', '.join(sorted(installed)) or 'none'}"
        )
    try:
        return installed[name].load()
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{name} is installed as {installed[name].value} but cannot be imported: {error}") from error


def create(plugin: Any, parameters: Mapping[str, Any], where: str) -> Any:
    """Return plugin(**parameters), its fields checked and converted against their annotations.

    plugin: a dataclass; nested tables become nested dataclasses, lists become tuples. where: the file or option the
    parameters came from, for messages. Errors: InputError naming the parameter.
    """
    hints = typing.get_type_hints(plugin)
    fields = {f.name: f for f in dataclasses.fields(plugin) if f.init}
    unknown = [name for name in parameters if name not in fields]
    if unknown:
        raise InputError(f"{where}: {unknown[0]!r} is no parameter; there are: {', '.join(fields) or 'none'}")
    missing = [
        name
        for name, f in fields.items()
        if name not in parameters and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise InputError(f"{where}: {missing[0]!r} is missing")
    values = {name: _convert(value, hints[name], f"{where}: {name}") for name, value in parameters.items()}
    try:
        return plugin(**values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def parameters_of(plugin: Any) -> dict[str, Any]:
    """Return the fields of a frozen dataclass as a table that `create` takes: tuples as lists, None left out."""
    return {
        f.name: v for f in dataclasses.fields(plugin) if f.init and (v := _plain(getattr(plugin, f.name))) is not None
    }


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return parameters_of(value)
    if isinstance(value, tuple | list):
        return [_plain(v) for v in typing.cast("tuple[Any, ...]", value)]
    return value


@cache
def _remembered(group: str) -> dict[str, EntryPoint]:
    """Return what was installed in a group when it was first asked for: looking takes milliseconds."""
    return _installed(group)


def _installed(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def _convert(value: Any, hint: Any, where: str) -> Any:
    """Return `value` as the annotation `hint` wants it: bool, int, float, str, Literal, tuples, dataclasses, unions."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        return _convert_union(value, arguments, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise InputError(f"{where} must be one of {', '.join(map(repr, arguments))}, not {value!r}")
        return value
    if origin is tuple:
        return _convert_tuple(value, arguments, where)
    if dataclasses.is_dataclass(hint):
        if isinstance(value, Mapping):
            return create(hint, typing.cast("Mapping[str, Any]", value), where)
        if isinstance(value, typing.cast("type", hint)):
            return value
        raise InputError(f"{where} must be a table with {', '.join(f.name for f in dataclasses.fields(hint))}")
    return _convert_scalar(value, hint, where)


def _convert_union(value: Any, arguments: tuple[Any, ...], where: str) -> Any:
    if value is None and type(None) in arguments:
        return None
    errors: list[InputError] = []
    for argument in _of_kind(value, [a for a in arguments if a is not type(None)], where):
        try:
            return _convert(value, argument, where)
        except InputError as error:
            errors.append(error)
    raise errors[-1]


def _of_kind(value: Any, arguments: list[Any], where: str) -> list[Any]:
    """Return the members of a union that a table may mean: its `kind` chooses, and without it those that have none.

    Errors: InputError that lists the kinds.
    """
    kinds = {a: typing.get_type_hints(a).get("kind") for a in arguments if dataclasses.is_dataclass(a)}
    if not isinstance(value, Mapping) or not any(kinds.values()):
        return arguments
    kind = typing.cast("Mapping[str, Any]", value).get("kind")
    chosen = [a for a, hint in kinds.items() if kind in (typing.get_args(hint) or (None,))]
    if chosen:
        return chosen
    known = ", ".join(repr(name) for hint in kinds.values() for name in typing.get_args(hint))
    plain = " or ".join(getattr(a, "__name__", "table") for a, hint in kinds.items() if hint is None)
    without = f", or be left away for a {plain}" if plain else ""
    raise InputError(f"{where}: kind must be one of {known}{without}, not {kind!r}")


def _convert_tuple(value: Any, arguments: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise InputError(f"{where} must be a list, not {value!r}")
    items = list(typing.cast("tuple[Any, ...]", value))
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        arguments = (arguments[0],) * len(items)
    if len(items) != len(arguments):
        raise InputError(f"{where} must have {len(arguments)} items, not {len(items)}")
    return tuple(_convert(v, a, f"{where}[{i}]") for i, (v, a) in enumerate(zip(items, arguments, strict=True)))


def _convert_scalar(value: Any, hint: Any, where: str) -> Any:
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise InputError(f"{where} must be a finite number, not {value}")
        return float(value)
    if hint is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, hint) and not (isinstance(value, bool) and hint is not bool):
        return value
    kinds = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    raise InputError(f"{where} must be {kinds.get(hint, str(hint))}, not {value!r}")
