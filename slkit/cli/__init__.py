"""The command line: typer verbs over `slkit.pipeline`.

What is heavy is imported inside the commands, so that `slkit --help` answers at once.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
import traceback
from collections.abc import Sequence

import typer

from slkit.cli import batch, board, calibrate, compare, patterns, plugins, rig, scan, simulate
from slkit.errors import SlkitError

app = typer.Typer(
    name="slkit",
    help="Structured light with a camera and a projector: calibrate the pair, scan objects, trust the numbers.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("patterns")(patterns.patterns)
app.command("board")(board.board)
app.add_typer(simulate.app, name="simulate")
app.command("calibrate")(calibrate.calibrate)
app.command("scan")(scan.scan)
app.command("batch")(batch.batch)
app.command("compare")(compare.compare)
app.add_typer(rig.app, name="rig")
app.command("view")(scan.view)
app.command("plugins")(plugins.plugins)


def main() -> None:
    """Run the command line and exit: 0 done, 1 a fault of slkit, 2 a mistake that the user can mend, 3 some failed.

    A mistake is told in one sentence on standard error; SLKIT_DEBUG=1 adds the traceback of a fault.
    """
    # OpenCV reports damaged pictures on standard error on its own, beside slkit's sentence.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    # Looking for cycles among all that is imported, and once more at the end, takes a fifth of a second for nothing;
    # scans leave none.
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)
    try:
        app()
    except SlkitError as error:
        _leave(str(error), 2, getattr(error, "__notes__", ()))
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        if os.environ.get("SLKIT_DEBUG"):
            traceback.print_exc()
        what = f"{type(error).__name__}: {error}"
        _leave(f"internal error, please report it with the output of SLKIT_DEBUG=1: {what}", 1)


def _leave(sentence: str, code: int, notes: Sequence[str] = ()) -> None:
    for line in (sentence, *(f"note: {note}" for note in notes)):
        print("slkit: " + " ".join(line.splitlines()), file=sys.stderr)
    sys.exit(code)
