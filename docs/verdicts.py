"""Runs the commands of a page and writes below each what it prints: `.venv/bin/python docs/verdicts.py [FAULT]`.

A block of commands that is followed by a block of text is such a place. All of it is simulated, with fixed seeds. With
the name of a fault only its place is filled.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).parent / "my-projector-error-is-40-px.md"
PLACE = re.compile(r"```console\n([^`]*)```\n\n```text\n[^`]*```\n")
# The frame and the rows of the table of views.
TABLE = "┏┃┡│└"


def main(fault: str = "") -> None:
    """Run every command of the page in one folder, or those that name a fault, and fill what they print."""
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        filled = PLACE.sub(
            lambda found: _filled(found.group(1), Path(folder)) if fault in found.group(1) else found.group(0), text
        )
    PAGE.write_text(filled, encoding="utf-8")


def _filled(commands: str, folder: Path) -> str:
    """Return a block of commands and what the last of them prints, the table of views left away."""
    printed = ""
    for line in commands.splitlines():
        words = shlex.split(line.removeprefix("$ "))
        done = subprocess.run(
            [sys.executable, "-m", "slkit.cli", *words[1:]], cwd=folder, capture_output=True, text=True, check=False
        )
        printed = done.stdout + done.stderr
        print(line, flush=True)
    lines = [line for line in printed.splitlines() if line[:1] not in TABLE]
    return f"```console\n{commands}```\n\n```text\n" + "\n".join(lines) + "\n```\n"


if __name__ == "__main__":
    main(*sys.argv[1:])
