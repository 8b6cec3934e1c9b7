import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slkit.errors import FileError
from slkit.files import merged, read_toml, resolve_root, write_toml

TEXTS = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)
SCALARS = st.one_of(st.booleans(), st.integers(-(2**53), 2**53), st.floats(allow_nan=False), TEXTS)
VALUES = st.recursive(SCALARS, lambda v: st.one_of(st.lists(v, max_size=3), st.dictionaries(TEXTS, v, max_size=3)))


@settings(max_examples=80, deadline=None)
@given(table=st.dictionaries(TEXTS, VALUES, max_size=5))
def test_what_is_written_is_read_again(tmp_path_factory: pytest.TempPathFactory, table: dict):
    path = tmp_path_factory.mktemp("toml") / "x.toml"
    write_toml(path, table, "a comment\nof two lines")
    assert read_toml(path) == table


def test_faults_of_a_file_are_named(tmp_path: Path):
    (tmp_path / "a.toml").write_text("x = = 1")
    with pytest.raises(FileError, match=r"a\.toml is not valid TOML.*line 1"):
        read_toml(tmp_path / "a.toml")
    (tmp_path / "b.toml").write_bytes(b"x = '\xff'")
    with pytest.raises(FileError, match="UTF-8"):
        read_toml(tmp_path / "b.toml")
    with pytest.raises(FileError, match="none.toml"):
        read_toml(tmp_path / "none.toml")


def test_merged_goes_into_tables():
    base = {"a": 1, "x": {"p": 1, "q": 2}, "y": {"p": 1}}
    assert merged(base, {"x": {"q": 3}, "y": 4, "z": {}}) == {"a": 1, "x": {"p": 1, "q": 3}, "y": 4, "z": {}}
    assert base == tomllib.loads("a = 1\nx = {p = 1, q = 2}\ny = {p = 1}")


def test_root_is_relative_to_the_file(tmp_path: Path):
    (tmp_path / "data").mkdir()
    (tmp_path / "calib").mkdir()
    assert resolve_root(tmp_path / "calib" / "a.toml", "../data").resolve() == tmp_path / "data"
    assert resolve_root(tmp_path / "calib" / "a.toml", str(tmp_path)) == tmp_path
    with pytest.raises(FileError, match=r"a\.toml: there is no folder .*nowhere"):
        resolve_root(tmp_path / "a.toml", "nowhere")


def test_root_with_a_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "data" / "board").mkdir(parents=True)
    (tmp_path / "calib").mkdir()
    file = tmp_path / "calib" / "a.toml"
    monkeypatch.delenv("SLKIT_TEST_DATA", raising=False)
    assert resolve_root(file, "${SLKIT_TEST_DATA:-../data}/board").resolve() == tmp_path / "data" / "board"
    with pytest.raises(FileError, match="SLKIT_TEST_DATA, which is not set"):
        resolve_root(file, "${SLKIT_TEST_DATA}/board")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SLKIT_TEST_DATA", "data")
    assert resolve_root(file, "${SLKIT_TEST_DATA:-elsewhere}/board") == tmp_path / "data" / "board"
