import os
import sys

import pytest

from slkit.cli._common import number, parse_settings, parse_size, print_json, print_table, progress_bar
from slkit.errors import InputError


def test_settings_are_toml_with_dotted_keys_and_bare_words():
    given = ["axes=both", "step = 2", "x.periods=[16, 1]", "x.steps=3", 'name="a b"', "path=/a=b", "on=true", "f=1e-3"]
    assert parse_settings(given) == {
        "axes": "both",
        "step": 2,
        "x": {"periods": [16, 1], "steps": 3},
        "name": "a b",
        "path": "/a=b",
        "on": True,
        "f": 0.001,
    }
    assert parse_settings(None) == {}


@pytest.mark.parametrize("setting", ["axes", "=3", "x.=3", ".x=3"])
def test_settings_that_are_none(setting: str):
    with pytest.raises(InputError, match="write it as key=value"):
        parse_settings([setting])
    with pytest.raises(InputError, match="x has a value already"):
        parse_settings(["x=1", "x.steps=3"])


def test_sizes():
    assert parse_size("1024x768", "--projector") == (1024, 768)
    for text in ("1024", "1024x", "0x768", "-4x5", "1024x768x3", "nanxnan", "10.5x3"):
        with pytest.raises(InputError, match="--projector must be width x height"):
            parse_size(text, "--projector")


def test_json_has_no_nan(capsys: pytest.CaptureFixture[str]):
    print_json({"a": float("nan"), "b": [1.5, float("inf")], "c": {"d": "ü"}})
    assert capsys.readouterr().out == '{"a": null, "b": [1.5, null], "c": {"d": "ü"}}\n'
    assert number(float("nan")) == "-" and number(None) == "-" and number(1.23456, 2) == "1.23"


def test_table_in_a_pipe_is_plain_text(capsys: pytest.CaptureFixture[str]):
    print_table(("view", "rms", "reason"), [("[a]", "1.0", "long " * 20)])
    out = capsys.readouterr().out
    assert "[a]" in out and "\x1b" not in out


def test_progress_bar_shows_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    with progress_bar() as show:
        assert show is None
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(os, "environ", {**os.environ, "TERM": "xterm", "COLUMNS": "80"})
    with progress_bar() as show:
        assert show is not None
        show("decode", 3, 10)
    out, err = capsys.readouterr()
    assert out == "" and "decode" in err
