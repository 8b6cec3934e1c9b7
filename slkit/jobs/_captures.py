"""Which captures a batch has, and what each is called."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slkit.errors import FileError, InputError
from slkit.files.sources import natural_key
from slkit.jobs._places import Place

_WILD = "*?["


def find_captures(patterns: Sequence[str]) -> dict[str, Place]:
    """Return name and place of every folder that the patterns match, in natural order of the names (2 before 10).

    patterns: paths or URLs, in which * ? [...] and ** stand for what fsspec takes them for. A name is the folder's path
    below what all patterns have in common before their first wildcard, so that no two captures share one.
    Errors: InputError where patterns lie on several file systems; FileError where no folder matches, or none of those
    that do has a capture.toml.
    """
    told, asked = ", ".join(patterns), [Place.at(pattern) for pattern in patterns]
    if len({type(place.system) for place in asked}) > 1:
        raise InputError(f"{told} lie on several file systems: run one batch for each")
    matches = [_matches(place) for place in asked]
    found = [place for _, places in matches for place in places]
    if not found:
        raise FileError(f"no folder matches {told}: name the folders of captures, each with a capture.toml")
    if not any(place.child("capture.toml").exists() for place in found):
        raise FileError(f"no folder that matches {told} has a capture.toml: `slkit patterns` writes one")
    base = posixpath.commonpath([root for root, _ in matches])
    named = {place.path[len(base) :].strip("/"): place for place in found}
    return {name: named[name] for name in sorted(named, key=natural_key)}


def _matches(place: Place) -> tuple[str, list[Place]]:
    """Return the part of a pattern before its first wildcard, and the folders below that it matches."""
    path = place.path.rstrip("/")
    try:
        # A folder may be called "scan[1]".
        if place.system.isdir(path):
            return posixpath.dirname(path), [Place(place.system, path, place.local)]
        listed: Mapping[str, Mapping[str, Any]] = place.system.glob(path, detail=True) if _wild(path) else {}
        folders = [name.rstrip("/") for name, about in listed.items() if _is_folder(place.system, name, about)]
    # Every store has errors of its own: credentials, regions, networks.
    except Exception as error:
        raise FileError(f"{place.url} cannot be listed: {type(error).__name__}: {error}") from error
    root = path
    while _wild(root):
        root = posixpath.dirname(root)
    base = Place(place.system, root, None if place.local is None else Path(root))
    below = [name[len(root) :].strip("/") for name in folders]
    return root, [base.child(name) for name in below if name]


def _wild(path: str) -> bool:
    return any(sign in path for sign in _WILD)


def _is_folder(system: Any, path: str, about: Mapping[str, Any]) -> bool:
    if posixpath.basename(path.rstrip("/")).startswith("."):
        return False
    return about["type"] == "directory" or (bool(about.get("islink")) and bool(system.isdir(path)))
