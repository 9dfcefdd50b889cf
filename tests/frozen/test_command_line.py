"""Verbs, their options, exit statuses and the fields of a refusal are contracts."""

from pathlib import Path

import pytest

from frozen.command_line import WRONG, options_of_verbs, refusals, write_wrong_files
from frozen.harness import read_json


def test_verbs_and_options(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert options_of_verbs() == read_json("commands.json")


def test_wrong_input_is_refused_in_the_same_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_wrong_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    found, held = refusals(), read_json("refusals.json")
    assert found.keys() == WRONG.keys() == held.keys()
    for name, told in found.items():
        assert told == held[name], name
        assert told[0] in (1, 2), name
    assert sorted(tmp_path.iterdir()) == before
