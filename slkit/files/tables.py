"""TOML tables that people write: reading them with clear messages, and writing templates."""

from __future__ import annotations

import json
import math
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from slkit.errors import FileError
from slkit.files.atomic import write_text
from slkit.files.images import read_bytes

Table = dict[str, Any]

_VARIABLE = re.compile(r"\$\{(\w+)(?::-([^}]*))?\}")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def read_toml(path: str | Path) -> Table:
    """Return the table of a TOML file. Errors: FileError where it is absent, or is not TOML, with line and column."""
    try:
        return tomllib.loads(read_bytes(path).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise FileError(f"{path} is not a text file in UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path} is not valid TOML: {error}") from error


def write_toml(path: str | Path, table: Mapping[str, Any], comment: str = "") -> None:
    """Write a table as `toml_text` gives it, atomically."""
    write_text(path, toml_text(table, comment))


def toml_text(table: Mapping[str, Any], comment: str = "") -> str:
    """Return a table as TOML, its sub-tables as sections; `comment` becomes # lines at the top."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [f"{_key(k)} = {_value(v)}" for k, v in table.items() if not isinstance(v, Mapping)]
    for name, section in table.items():
        if isinstance(section, Mapping):
            lines += ["", f"[{_key(name)}]"]
            lines += [f"{_key(k)} = {_value(v)}" for k, v in cast("Mapping[str, Any]", section).items()]
    return "\n".join(lines).lstrip("\n") + "\n"


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Table:
    """Return `base` with `changes` laid over it; tables in both are merged key by key."""
    result = dict(base)
    for key, value in changes.items():
        below = result.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            value = merged(cast("Mapping[str, Any]", below), cast("Mapping[str, Any]", value))
        result[key] = value
    return result


def want(table: Mapping[str, Any], key: str, kind: type | tuple[type, ...], where: str, default: Any = None) -> Any:
    """Return table[key], checked to be of `kind`. Errors: FileError naming `where` and the key; no default: missing."""
    names = {str: "a text", Mapping: "a table", list: "a list"}
    value = table.get(key, default)
    if value is None:
        raise FileError(f"{where}: {key!r} is missing")
    if not isinstance(value, kind):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        raise FileError(f"{where}: {key} must be {' or '.join(names.get(k, str(k)) for k in kinds)}, not {value!r}")
    return value


def resolve_root(file: Path, root: str) -> Path:
    """Return the folder that `root` in a TOML file means, relative to that file.

    ${NAME} stands for an environment variable, whose value is relative to the working folder, and ${NAME:-text} for
    `text` where the variable is not set. Errors: FileError where a variable is not set or the folder is absent.
    """

    def expand(match: re.Match[str]) -> str:
        name, default = match.groups()
        if name in os.environ:
            return str(Path(os.environ[name]).absolute())
        if default is None:
            raise FileError(f"{file}: root uses the environment variable {name}, which is not set")
        return default

    folder = file.parent / _VARIABLE.sub(expand, root)
    if not folder.is_dir():
        raise FileError(f"{file}: there is no folder {folder}, which root names")
    return folder


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else _text(name)


def _text(value: str) -> str:
    # JSON's escapes are TOML's, save for DEL and for what JSON writes as pairs of surrogates.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else {math.inf: "inf", -math.inf: "-inf"}.get(value, "nan")
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        items = cast("Mapping[str, Any]", value).items()
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in items) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in cast("list[Any]", value)) + "]"
    raise TypeError(f"{value!r} has no form in TOML")
