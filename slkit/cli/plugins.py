"""slkit plugins."""

from __future__ import annotations

from slkit.cli._common import JsonOption, print_json
from slkit.registry import GROUPS, names


def plugins(as_json: JsonOption = False) -> None:
    """List what is installed; nothing of it is imported."""
    found = {group.removeprefix("slkit."): names(group) for group in GROUPS}
    if as_json:
        print_json(found)
        return
    for kind, installed in found.items():
        print(f"{kind}: {', '.join(installed) or 'none'}")
