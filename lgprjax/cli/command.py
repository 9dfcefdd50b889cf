"""Reading and running a command of ``lgprjax``."""

import dataclasses
import difflib
import functools
import operator
import os
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated, Any

import lgprjax
from lgprjax.cli.figures import STANDARD_OUTPUT, figures_alone
from lgprjax.cli.help import group_help, top_help, verb_help
from lgprjax.cli.maps import MapUpdate
from lgprjax.cli.options import check_words, current_names, nearest
from lgprjax.cli.recognised import recognised, recording_suffixes, told_instead
from lgprjax.cli.terminal import USAGE, Level, UsageError, detail, output_level, run_verb, show_every_character
from lgprjax.cli.verbs import Verb, VerbGroup, all_verbs, every_verb
from lgprjax.errors import refuse_own_input
from lgprjax.machine import keep_programs

_MEANT = {
    **dict.fromkeys(("localise", "localize", "match"), "register"),
    **dict.fromkeys(("convert", "read", "open"), "import"),
    **dict.fromkeys(("plot", "show", "draw"), "view"),
    **dict.fromkeys(("validate", "health"), "check"),
    **{words.split()[1]: words for words, _ in every_verb() if " " in words and words.split()[1] not in all_verbs()},
    **dict.fromkeys(("fit",), "tune"),
}
"""Names that other programs use, and the command for the same task."""


def keep_compiled() -> None:
    """Cache compiled programs between commands, in ``$XDG_CACHE_HOME/lgprjax`` or ``~/.cache/lgprjax``.

    An optimisation only, and only before JAX is imported: existing environment variables are respected.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    keep_programs(root / "lgprjax" / "compiled")
    # On a full disk the cache cannot be written; the next command compiles again.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")


def run_command(arguments: Sequence[str]) -> int:
    """Read a command, without ``lgprjax``, and run it. Returns the exit status."""
    words, levels = _without_levels([str(word) for word in arguments])
    show_every_character()
    if len(levels) > 1:
        print("lgprjax: --quiet and --verbose: expected only one of them, found both (see --help)", file=sys.stderr)
        return USAGE
    with output_level(levels.pop() if levels else Level.NORMAL):
        return _run_words(words)


_LEVELS = {"-q": Level.QUIET, "--quiet": Level.QUIET, "-v": Level.VERBOSE, "--verbose": Level.VERBOSE}


def _without_levels(words: Sequence[str]) -> tuple[list[str], set[Level]]:
    """The words of a command without ``-q`` and ``-v``, and the levels that they set."""
    return [word for word in words if word not in _LEVELS], {_LEVELS[word] for word in words if word in _LEVELS}


def _run_words(words: list[str]) -> int:
    # The configuration of a run names a folder of its own.
    if words[:1] != ["run"]:
        keep_compiled()
    if words[:1] == ["import"]:
        words[1:] = recognised(words[1:])
    words = _with_default(words)
    if words[:1] == ["--version"]:
        print(f"lgprjax {lgprjax.__version__}")
        return 0
    if words[:1] == ["--completion"]:
        return run_verb(lambda: _print_completion(words[1:]), command="lgprjax")
    return run_verb(lambda: _run(words), command=" ".join(["lgprjax", *_named(words)]))


def _with_default(words: list[str]) -> list[str]:
    """The words, with a group's default command inserted after its name."""
    verb = all_verbs().get(words[0]) if words else None
    if (
        not isinstance(verb, VerbGroup)
        or not verb.default
        or len(words) == 1
        or words[1] in {*verb.verbs, "-h", "--help"}
    ):
        return words
    return [words[0], verb.default, *words[1:]]


def _named(words: Sequence[str]) -> list[str]:
    """The words that name a command, or a group of commands."""
    verb = all_verbs().get(words[0]) if words else None
    if isinstance(verb, VerbGroup) and len(words) > 1 and words[1] in verb.verbs:
        return list(words[:2])
    return [] if verb is None else [words[0]]


def _run(words: list[str]) -> int:
    name, known = _named(words), all_verbs()
    rest = words[len(name) :]
    wants_help = any(word in ("-h", "--help") for word in rest)
    if not name:
        if not wants_help:
            if not words:
                print(top_help(), end="", file=sys.stderr)
                return 2
            raise UsageError(f"{words[0]}: no such command{_meant(words[0], list(known))}")
        print(top_help(), end="")
        return 0
    verb = known[name[0]]
    if isinstance(verb, VerbGroup):
        if len(name) == 1:
            if rest and not wants_help:
                _refuse_group(name[0], verb, rest[0])
            print(group_help(name[0], verb), end="", file=sys.stdout if wants_help else sys.stderr)
            return 0 if wants_help else 2
        verb = verb.verbs[name[1]]
    if wants_help:
        print(verb_help(" ".join(name), verb), end="")
        return 0
    rest, notes = current_names(" ".join(name), rest)
    for note in notes:
        print(f"lgprjax: {note}", file=sys.stderr)
    check_words(verb.options, rest, {each: one.options for each, one in every_verb()})
    return _parse_and_run([*name, *rest])


def _meant(word: str, known: Sequence[str]) -> str:
    """A question that suggests a command for an unknown word; empty if none is similar."""
    if recognised([word]) != [word]:
        return f"; did you mean import {word}?"
    near = difflib.get_close_matches(word.lower(), [*known, *_MEANT], n=1, cutoff=0.6)
    return f"; did you mean {_MEANT.get(near[0], near[0])}?" if near else ""


def _refuse_group(name: str, group: VerbGroup, word: str) -> None:
    if name == "import":
        instead, recordings = told_instead(word), f"a recording ({recording_suffixes()})"
        if instead:
            raise UsageError(f"{word}: expected {recordings}; found {instead}")
        expected = f"a format ({', '.join(group.verbs)}), or {recordings}"
        if Path(word).is_file():
            expected += "; for other formats see docs/own_radar.md"
        raise UsageError(f"{word}: expected {expected}{nearest(word, list(group.verbs))}")
    raise UsageError(f"{word}: expected one of {', '.join(group.verbs)}{nearest(word, list(group.verbs))}")


_OUTPUTS = ("output", "json", "picture")


def _refuse_own_input(verb: Any) -> None:
    """Raise ``InputError`` if an output is also an input: ``--force`` replaces older outputs only."""
    if not dataclasses.is_dataclass(verb):
        return
    given = {field.name: getattr(verb, field.name) for field in dataclasses.fields(verb)}
    if isinstance(verb, MapUpdate):
        # It replaces its map.
        del given["output"]
    inputs = [
        path
        for name, value in given.items()
        if name not in _OUTPUTS
        for path in (value if isinstance(value, tuple | list) else (value,))
        if isinstance(path, Path)
    ]
    for output in (given.get(name) for name in _OUTPUTS):
        if isinstance(output, Path):
            refuse_own_input(output, inputs)


def _parse_and_run(words: Sequence[str]) -> int:
    verb = parsed(words)
    _refuse_own_input(verb)
    began_s = time.perf_counter()
    with figures_alone() if getattr(verb, "json", None) == STANDARD_OUTPUT else nullcontext():
        status = verb.run() or 0
        detail(f"total: {time.perf_counter() - began_s:.1f} s")
    return int(status)


def parsed(words: Sequence[str]) -> Any:
    """The command's dataclass with the values of the words."""
    import tyro

    def one_of(verbs: Mapping[str, Verb | VerbGroup]) -> Any:
        kinds = (
            Annotated[
                verb.options if isinstance(verb, Verb) else one_of(verb.verbs),
                tyro.conf.subcommand(name, description=verb.what),
            ]
            for name, verb in verbs.items()
        )
        return functools.reduce(operator.or_, kinds)

    return tyro.cli(
        one_of(all_verbs()),
        prog="lgprjax",
        args=list(words),
        config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )


_SHELLS = ("bash", "zsh", "fish", "tcsh")


def _print_completion(words: list[str]) -> int:
    if len(words) != 1 or words[0] not in _SHELLS:
        found = " ".join(words) or "nothing"
        raise UsageError(f"--completion: expected one of {', '.join(_SHELLS)}, found {found}")
    with suppress(SystemExit):  # when it has printed
        parsed(["--tyro-write-completion", words[0], "-"])
    return 0
