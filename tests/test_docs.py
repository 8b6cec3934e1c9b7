"""The documentation says what is so: its snippets run, its commands parse, its tables hold the real defaults."""

import dataclasses
import json
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from slkit import pipeline, registry
from slkit.calibration.corner_board import CornerBoard
from slkit.calibration.local_homography import LocalHomography
from slkit.calibration.model import Lens, Model
from slkit.calibration.planar import Planar
from slkit.calibration.reference_object import ReferenceObject
from slkit.cli import app
from slkit.cli._common import parse_settings, parse_size
from slkit.codecs.color_fringe import ColorFringe
from slkit.codecs.color_stripes import ColorStripes
from slkit.codecs.gray import Gray
from slkit.codecs.line_shift import LineShift
from slkit.codecs.phase_shift import Fringes, PhaseShift
from slkit.simulation import SCENES, Optics

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md"]
FENCE = re.compile(r"^( *)```(\S+)(?: title=\"([^\"]+)\")?\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
# typer carries its own click in some versions; this is the base of that one's errors of use.
UsageError = typer.BadParameter.__mro__[1]
INLINE = re.compile(r"(?<!`)`(slkit [^`]+)`(?!`)")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> list[tuple[str | None, str]]:
    """Title and text of every fenced block of a language."""
    found = FENCE.findall(page.read_text(encoding="utf-8"))
    return [(title or None, text) for _, kind, title, text in found if kind == language]


def shell_commands(page: Path) -> Iterator[list[str]]:
    """Every `slkit` command of the fenced shell blocks, split as a shell splits it."""
    for language in ("console", "bash", "sh", "shell"):
        for _, text in blocks(page, language):
            for line in text.replace("\\\n", " ").splitlines():
                words = shlex.split(line.strip().removeprefix("$ "), comments=True)
                if words and words[0].endswith("slkit"):
                    yield words[1:]


def inline_commands(page: Path) -> Iterator[list[str]]:
    """Every command in running text; it may leave out what the command requires."""
    for text in INLINE.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        yield shlex.split(text)[1:]


def parsed(words: list[str], resilient: bool) -> dict[str, Any]:
    """Return the parameters of a command line, which is not run; a wrong verb or option is an error."""
    command: Any = typer.main.get_command(app)
    context = command.make_context("slkit", [], resilient_parsing=True)
    while hasattr(command, "commands"):
        if not words:
            return {}
        assert words[0] in command.commands, f"{command.name} has no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    unknown = [word for word in words if re.match(r"--?[a-z]", word) and word not in known and word != "--help"]
    assert not unknown, f"slkit {command.name} has no option {unknown[0]}"
    with command.make_context(command.name, list(words), parent=context, resilient_parsing=resilient) as made:
        return {"verb": command.name, **made.params}


def check_names(found: dict[str, Any]) -> None:
    """Codecs, their parameters and scenes of a command must exist."""
    codecs = found.get("codec") or ()
    for codec in [codecs] if isinstance(codecs, str) else codecs:
        if codec in ("CODEC", "NAME", "checkerboard", "charuco", "color") or codec.endswith(".toml"):
            continue
        size = parse_size(found["projector"], "--projector") if found.get("projector") else (1024, 768)
        settings = parse_settings(found.get("settings"))
        registry.create(registry.load("slkit.codecs", codec), {"projector": list(size), **settings}, codec)
    scene = found.get("scene")
    assert scene is None or scene in SCENES or Path(scene).suffix, f"there is no scene {scene}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_exists(page: Path):
    for words in shell_commands(page):
        check_names(parsed(words, resilient=False))
    for words in inline_commands(page):
        check_names(parsed(words, resilient=True))


def test_the_command_check_can_fail():
    for words in (["sacn", "folder"], ["scan", "folder", "--colour"], ["rig", "shwo", "rig.json"]):
        with pytest.raises(AssertionError):
            parsed(words, resilient=True)
    with pytest.raises(UsageError):
        parsed(["scan", "folder"], resilient=False)


def run_page(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run a page's Python blocks in order in one namespace; a block with a title is written to that file first."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    found = blocks(page, "python")
    for title, text in found:
        if title is not None:
            (folder / title).write_text(text, encoding="utf-8")
            monkeypatch.delitem(sys.modules, Path(title).stem, raising=False)
    names: dict[str, Any] = {"__name__": "page"}
    for index, (title, text) in enumerate(found):
        if title is None:
            exec(compile(text, f"{page.name}, block {index}", "exec"), names)
    return names


def test_tour_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    names = run_page(DOCS / "tour.md", tmp_path, monkeypatch)
    assert len(names["good"]) > 0.5 * len(names["cloud"]) > 10_000
    assert len(names["result"].cloud) > 10_000
    assert {"sphere.ply", "cloud.ply", "cloud.png"} <= {path.name for path in tmp_path.iterdir()}


def test_scale_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    names = run_page(DOCS / "scale.md", tmp_path, monkeypatch)
    assert (names["result"].scanned, names["result"].failures) == (1, ())
    line = json.loads((tmp_path / "clouds" / "batch.jsonl").read_text(encoding="utf-8"))
    (_, shown) = next(block for block in blocks(DOCS / "formats.md", "json") if "capture" in json.loads(block[1]))
    assert list(json.loads(shown)) == list(line)
    told = re.findall(r"^\| `([a-z]+)` \|", (DOCS / "scale.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert told == list(line)


def test_extending_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    page = DOCS / "extending.md"
    codec = dict(blocks(page, "python"))["sweep.py"]
    assert len(codec.splitlines()) < 60
    names = run_page(page, tmp_path, monkeypatch)
    assert len(names["cloud"]) > 10_000
    calibration, rig = names["calibration"], names["rig"]
    assert calibration.rms_joint < 0.1
    assert calibration.rig.projector.K[0, 0] == pytest.approx(rig.projector.K[0, 0], rel=0.01)

    project, example = (tomllib.loads(text) for _, text in blocks(page, "toml"))
    entries = project["project"]["entry-points"]
    info = tmp_path / "slkit_sweep-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: slkit-sweep\nVersion: 1.0\n")
    groups = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in table.items()) for group, table in entries.items()]
    (info / "entry_points.txt").write_text("\n".join(groups))
    assert "sweep" in registry.names("slkit.codecs")
    assert registry.load("slkit.codecs", "sweep") is names["Sweep"]
    parameters = {"projector": example["projector"], "sheet": example["sheet"]}
    plugin = registry.load("slkit.calibrators", example["method"])
    assert registry.create(plugin, parameters, "extending.md") == names["calibrator"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_on_the_pages_are_well_formed(page: Path):
    for _, text in blocks(page, "toml"):
        table = tomllib.loads(text)
        for coded in (table, table.get("coded", {})):
            if coded.get("codec") in registry.names("slkit.codecs"):
                plugin = registry.load("slkit.codecs", coded["codec"])
                parameters = {"projector": table["projector"], **coded.get("parameters", {})}
                registry.create(plugin, parameters, name_of(page))
    for _, text in blocks(page, "json"):
        json.loads(text)


def rows(page: str) -> dict[str, str]:
    """Name and default of every parameter in the tables of a page whose second column is `default`."""
    result: dict[str, str] = {}
    for table in re.findall(r"\| field \| default \|.*\n\|[ -|]+\n((?:\|.*\n)+)", (DOCS / page).read_text("utf-8")):
        for line in table.splitlines():
            name, default = (cell.strip() for cell in line.split("|")[1:3])
            result[name.strip("`")] = default.strip("`")
    return result


def told(value: Any) -> str:
    """A default as the pages write it."""
    if value is dataclasses.MISSING:
        return "none"
    if value is None:
        return "unset"
    return json.dumps(value)


@pytest.mark.parametrize(
    ("page", "plugins"),
    [
        ("methods/gray.md", [Gray]),
        ("methods/line-shift.md", [LineShift]),
        ("methods/phase-shift.md", [PhaseShift, Fringes]),
        ("methods/color-stripes.md", [ColorStripes]),
        ("methods/color-fringe.md", [ColorFringe]),
        ("methods/planar.md", [Planar]),
        ("methods/local-homography.md", [LocalHomography]),
        ("methods/bundle-adjustment.md", [Model, Lens]),
        ("methods/corner-board.md", [CornerBoard]),
        ("methods/reference-object.md", [ReferenceObject]),
        ("methods/simulation.md", [Optics]),
    ],
)
def test_parameter_tables_hold_the_defaults(page: str, plugins: list[Any]):
    # The size of the projector is everywhere the same and in no table; a model's projector is a lens.
    fields = [f for p in plugins for f in dataclasses.fields(p) if f.name != "projector" or p is Model]
    assert rows(page) == {f.name: told(f.default) for f in fields}


def test_boards_page_tells_every_kind_and_shows_what_is_printed(tmp_path: Path):
    page = DOCS / "boards.md"
    told_kinds = re.findall(r"^\| `([a-z-]+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(told_kinds) == sorted(pipeline.BOARDS)
    (_, text) = blocks(page, "toml")[0]
    shown = tomllib.loads(text)
    for kind in re.findall(r"^# slkit board ([a-z-]+) ", text, re.MULTILINE):
        for name, table in pipeline.write_board(tmp_path / "board.svg", kind).items():
            assert shown.pop(name) == json.loads(json.dumps(table))
    assert not shown


def test_tour_shows_the_rooms():
    with open(ROOT / "pyproject.toml", "rb") as file:
        contract = tomllib.load(file)["tool"]["importlinter"]["contracts"][0]
    shown = [text.split("\n") for _, text in blocks(DOCS / "tour.md", "text")]
    assert [*contract["layers"], ""] in shown
