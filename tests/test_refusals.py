"""Sentences are frozen nowhere: a refusal is tested by its fields, and each can be improved in one place."""

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from lgprjax.autopilot.monitors import Watch
from lgprjax.runtime.control.skid.watches import SkidFound

_ROOT = Path(__file__).parents[1]
# Three words of prose in a row; names of files, keys, options and datasets have dots, strokes and digits.
_PROSE = re.compile(r"(?<![\w./@-])[A-Za-z][a-z']*(?:[,;]? [A-Za-z][a-z']*){2,}(?![\w./@-])")
_OF_REFUSALS = ("refused", "check")


def _texts(node: ast.expr) -> Iterator[str]:
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            yield re.sub(r"\\(.)", r"\1", inner.value)


def _sentences(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every value of a ``match=`` and of a refusal that is prose. A place may have several words."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        values = [each.value for each in call.keywords if each.arg == "match"]
        if name in _OF_REFUSALS:
            values += [*call.args[1:], *(each.value for each in call.keywords if each.arg in ("found", "file"))]
        yield from ((value.lineno, text) for value in values for text in _texts(value) if _PROSE.search(text))


@pytest.mark.parametrize("folder", ["tests", "validation"])
def test_no_sentence_is_frozen(folder: str) -> None:
    paths = sorted((_ROOT / folder).rglob("*.py"))
    assert paths
    found = [
        f"{path.relative_to(_ROOT)}:{line}: {text}"
        for path in paths
        for line, text in _sentences(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def test_prose_is_told_from_values() -> None:
    for call, sentence in (
        ("raises(InputError, match=r'a map that is\\.')", True),
        ("raises(ValueError, match='grid_m')", False),
        ("refused('throttle and brake', '0 to 3', file='x.toml', found='no file')", False),
        ("refused('a', 'a map that no one writes')", True),
        ("refused('a', found=f'{n} of the lines are')", True),
        ("done.refusal.check('a', 'search_m, window_m', '-o DIR')", False),
    ):
        assert bool(list(_sentences(ast.parse(call)))) == sentence, call


def test_every_message_stands_in_the_table_of_the_site() -> None:
    pytest.importorskip("mkdocs", reason="lgprjax[docs] is not installed: the table of messages was NOT made")
    rows = importlib.import_module("mkdocs_hooks").messages_page().split("| --- |\n")[1].splitlines()
    assert len(rows) > 500
    assert all(re.fullmatch(r"\|( [^|\n]+ \|){4}", row) for row in rows)
    places = [row.split("|")[1].strip() for row in rows]
    assert len(set(places)) == len(places)


def test_every_finding_of_the_monitors_stands_in_the_table_of_the_site() -> None:
    pytest.importorskip("mkdocs", reason="lgprjax[docs] is not installed: the table of findings was NOT made")
    rows = importlib.import_module("mkdocs_hooks").findings_page().split("| --- |\n")[1].splitlines()
    assert len(rows) == len(Watch) + len(SkidFound)
    assert "| throttle stuck open and speed rises: drive power cut | Emergency | yes |" in rows
    assert "| off the working line: stopping | Stop | no |" in rows
