import os
import subprocess
import sys

import pytest

from slkit import pipeline
from slkit.registry import GROUPS, names


def test_import_is_light():
    heavy = "['numpy', 'cv2', 'numba', 'open3d', 'scipy', 'trimesh', 'rich', 'fsspec', 'distributed']"
    script = f"import sys, slkit.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_imports_nothing_heavy():
    script = (
        "import sys\nfrom slkit.cli import main\nsys.argv = ['slkit', 'plugins']\n"
        "try:\n    main()\nexcept SystemExit as left:\n    code = left.code\n"
        "print(code or 0, [m for m in ('numpy', 'cv2', 'numba', 'open3d', 'slkit.codecs') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"
    assert "codecs: color-fringe" in done.stdout


def test_plugins(slkit):
    assert slkit("plugins", "--json").json == {group.removeprefix("slkit."): names(group) for group in GROUPS}


@pytest.mark.parametrize("arguments", [["nonsense"], ["scan"], ["scan", "x", "--rigg", "y"], ["rig", "turn"]])
def test_usage_errors(slkit, arguments):
    outcome = slkit(*arguments)
    assert outcome.code == 2 and outcome.out == "" and "Error" in outcome.err


def test_help_names_every_verb(slkit):
    outcome = slkit("--help")
    assert outcome.code == 0
    for verb in ("patterns", "board", "simulate", "calibrate", "scan", "batch", "rig", "view", "plugins"):
        assert f"\n  {verb} " in outcome.out


def test_internal_fault(slkit, monkeypatch, tmp_path):
    def broken(*_):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(pipeline, "view", broken)
    monkeypatch.delenv("SLKIT_DEBUG", raising=False)
    outcome = slkit("view", "a.ply", "-o", tmp_path / "a.png")
    assert outcome.code == 1 and outcome.out == ""
    assert outcome.err.count("\n") == 1 and "internal error, please report" in outcome.err
    monkeypatch.setenv("SLKIT_DEBUG", "1")
    assert "Traceback" in slkit("view", "a.ply", "-o", tmp_path / "a.png").err


def test_interrupt(slkit, monkeypatch, tmp_path):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "view", interrupted)
    assert slkit("view", "a.ply", "-o", tmp_path / "a.png").code == 130


def test_the_installed_command(tmp_path):
    command = [
        sys.executable,
        "-m",
        "slkit.cli",
        "scan",
        str(tmp_path),
        "--rig",
        "r.json",
        "-o",
        str(tmp_path / "a.ply"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ})
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.startswith("slkit: ") and done.stderr.count("\n") == 1
