"""Help, reference, old names of options, amount of output, completion, figures on standard output, early Ctrl-C."""

import contextlib
import io
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import lgprjax
from canon.commands import run
from lgprjax.cli.command import parsed
from lgprjax.cli.help import SHARED, reference_page, top_help, verb_help
from lgprjax.cli.options import current_names, options_of
from lgprjax.cli.verbs import VERBS, VerbGroup, all_verbs, every_verb

_ROOT = Path(__file__).parents[2]
_EVERY = dict(every_verb())


def test_the_version() -> None:
    assert run("--version") == (0, f"lgprjax {lgprjax.__version__}\n", "")


def test_the_top_help_is_one_screen_of_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = top_help().splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    for part, verbs in VERBS.items():
        assert part in lines
        for name, verb in verbs.items():
            assert sum(line.split(maxsplit=1) == [name, verb.what] for line in lines) == 1
    assert run("--help") == (0, top_help(), "")
    status, out, err = run()
    assert (status, out, err) == (2, "", top_help())


@pytest.mark.parametrize("name", _EVERY)
def test_a_verbs_help_fits_a_screen_and_shows_two_examples(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    verb = _EVERY[name]
    text = verb_help(name, verb)
    assert len(text.splitlines()) <= 60
    assert max(map(len, text.splitlines())) <= 80
    assert len(verb.examples) == 2
    for example in verb.examples:
        assert example.startswith(name)
        assert isinstance(parsed(shlex.split(example)), verb.options)
    for wrong in ("(default: )", "None", "{", "FLOAT", "(default: False)"):
        assert wrong not in text
    assert not re.search(r"--[a-z-]*-$", text, re.MULTILINE)  # no option is broken at its hyphen
    assert run(*name.split(), "--help") == (0, text, "")
    # tyro's own help names the same options, and the same ones as needed.
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit):
        parsed([*name.split(), "--help"])
    shown = re.sub(r"[│╭╰╮╯─]", " ", out.getvalue())
    theirs = set(re.findall(r"^  (?:-\w \S+, )?(--[a-z][a-z0-9-]+)", shown, re.M))
    ours = options_of(verb.options)
    assert {option.names[-1] for option in ours if not option.positional} == theirs
    # Of several files tyro needs none.
    needed = [option for option in ours if option.required and not (option.positional and option.values is None)]
    assert shown.count("(required)") == len(needed)


def test_groups_list_their_verbs() -> None:
    groups = {name: verb for name, verb in all_verbs().items() if isinstance(verb, VerbGroup)}
    assert len(groups) == 6
    for name, group in groups.items():
        status, out, _ = run(name, "--help")
        assert status == 0
        assert all(f"  {part:12}{verb.what}\n" in out for part, verb in group.verbs.items())
        assert run(name)[0] == 2


def test_the_reference_has_every_command_and_option() -> None:
    parts = re.split(r"^## lgprjax (.+)\n", reference_page().replace("\\|", "|"), flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert list(sections) == list(_EVERY)
    for name, text in sections.items():
        assert all(f"`{', '.join(option.names)}" in text for option in options_of(_EVERY[name].options))
        assert all(f"lgprjax {example}\n" in text for example in _EVERY[name].examples)
    assert all(f"`{', '.join(option.names)}`" in parts[0] for option in SHARED)


def test_the_page_names_every_command() -> None:
    page = (_ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    assert {name for name in all_verbs() if f"- `lgprjax {name}`: " not in page} == set()
    assert all(f"`{option.names[-1]}`" in page for option in SHARED)
    assert len(page.split()) <= 500


def test_an_option_has_one_type_in_all_commands() -> None:
    """Apart from the number of values, and from a format's own choices."""
    types: dict[str, set[frozenset[type]]] = {}
    for verb in _EVERY.values():
        for option in options_of(verb.options):
            types.setdefault(option.names[-1], set()).add(frozenset(option.reads))
    assert {name for name, found in types.items() if len(found) > 1 and name.startswith("--")} == set()


@pytest.mark.parametrize(
    ("verb", "old", "new"),
    [
        ("import signals", "a.csv --map m.toml", "a.csv --columns m.toml"),
        ("import signals", "a.csv --map=m.toml", "a.csv --columns=m.toml"),
        ("cover export", "r --confidence 0.9 0.99", "r --level 0.9 0.99"),
        ("import gprmax", "a.out --start_m 2", "a.out --first-trace-m 2"),
        ("import lines", "a.DT1 --time-zero 3.2", "a.DT1 --time-zero-ns 3.2"),
        ("import lines", "a.DT1 --time-zero header", ""),
        ("cover plan", "f --confidence 0.9", ""),
        ("recover", "run --map m.map.h5", ""),
    ],
)
def test_old_names_of_options_work_with_a_note(verb: str, old: str, new: str) -> None:
    words, notes = current_names(verb, old.split())
    assert words == (new or old).split()
    assert len(notes) == bool(new)
    known = {name for option in options_of(_EVERY[verb].options) for name in option.names}
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known


def test_a_note_goes_to_standard_error_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("", encoding="utf-8")
    done = run("import", "signals", "a.csv", "--map", "none.toml", "-o", "a.drive.h5")
    note, refusal = done.err.splitlines()
    assert "--map" in note
    assert "--columns" in note
    assert refusal.startswith("lgprjax: none.toml: ")
    assert (done.status, done.out) == (1, "")


@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_amount_of_output_is_set_anywhere(place: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["examples", "--force"]

    def said(*options: str) -> list[str]:
        done = run(*words[:place], *options, *words[place:])
        assert (done.status, done.err) == (0, "")
        return done.out.splitlines()

    usual = said()
    (result,) = said("-q")
    assert usual[-2:][0] == result
    assert result.startswith("result: ")
    assert usual[-1].startswith("next: lgprjax ")
    assert len(usual) > 2
    told = said("--verbose")
    assert [line for line in told if line in usual] == usual
    (timing,) = (line for line in told if line not in usual)
    assert re.fullmatch(r"total: [0-9.]+ s", timing)


def test_completion_knows_the_verbs() -> None:
    for shell in ("bash", "zsh", "fish"):
        status, out, _ = run("--completion", shell)
        assert status == 0
        assert "lgprjax" in out
        assert "register" in out


def test_figures_go_to_standard_output_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-").write_text("kept")
    status, out, err = run("doctor", "--json", "-")
    assert status == 0
    assert {"name", "found", "verdict", "advice"} <= json.loads(out)[0].keys()
    assert err
    assert (tmp_path / "-").read_text() == "kept"


@pytest.mark.parametrize("module", ["tyro", "lgprjax.cli.command", "lgprjax.cli.verbs", "lgprjax.cli.terminal"])
def test_ctrl_c_is_one_line_from_the_first_import_on(module: str) -> None:
    """Ctrl-C while a module is imported, which is where a command spends its first half second."""
    code = f"""
import sys
class Pressed:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Pressed())
sys.modules.pop({module!r}, None)
from lgprjax.cli import main
main(["doctor", "--json", "-"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 130, done.stderr
    assert re.fullmatch(r"lgprjax: interrupted.*\n", done.stderr), done.stderr
