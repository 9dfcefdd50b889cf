"""Options of a command, read from its dataclass: annotations, defaults, the text below each field.

tyro parses the command. This module serves the help, the reference page and the messages about wrong usage.
"""

import ast
import dataclasses
import difflib
import inspect
import re
import textwrap
import types
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from lgprjax.cli.terminal import UsageError
from lgprjax.errors import InputError

_WORDS = {float: ("NUMBER", "a number"), int: ("N", "a whole number"), Path: ("PATH", ""), str: ("NAME", "")}
_HELP = ("-h", "--help")


class Option(NamedTuple):
    """An option, or a positional argument.

    Attributes:
        names: names as typed, short ones first; a single name without dashes for a positional argument.
        metavar: placeholder of its values; empty for a flag.
        text: effect of the option.
        default: default value as typed; empty if there is none to show.
        required: whether the command needs it.
        values: number of words; 0 for a flag, None for any number.
        reads: types of a value.
        choices: further words that are accepted.
    """

    names: tuple[str, ...]
    metavar: str
    text: str
    default: str
    required: bool
    values: int | None
    reads: tuple[type, ...]
    choices: tuple[str, ...]

    @property
    def positional(self) -> bool:
        """Whether it is typed without a name."""
        return not self.names[-1].startswith("-")

    def accepts(self, word: str) -> bool:
        """Whether a word is a valid value."""
        if word in self.choices:
            return True
        for kind in self.reads:
            if kind in (int, float):
                try:
                    kind(word)
                except ValueError:
                    continue
            return True
        return False

    def suffix(self) -> str:
        """Required suffix of an output, from its metavar, such as .drive.h5; empty if any suffix is accepted."""
        named = re.fullmatch(r"[A-Z]+(\.[a-z0-9.]+)", self.metavar)
        return named[1] if named is not None and "--output" in self.names else ""

    def expected(self) -> str:
        """Accepted values in words."""
        kinds = [_WORDS[kind][1] for kind in self.reads if _WORDS[kind][1]]
        names = [*self.choices, *kinds]
        return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]


@cache
def options_of(verb: type) -> tuple[Option, ...]:
    """Options of a command's dataclass and of its nested dataclasses, in order."""
    return tuple(_options(verb))


def _options(verb: type) -> Iterator[Option]:
    hints, texts = get_type_hints(verb, include_extras=True), _texts_below(verb)
    for field in dataclasses.fields(verb):
        kind, marks = _unwrapped(hints[field.name])
        if isinstance(kind, type) and hasattr(kind, "__dataclass_fields__"):
            yield from _options(kind)
            continue
        given = next((mark for mark in marks if hasattr(mark, "metavar")), None)
        positional = any("Positional" in repr(mark) for mark in marks)
        values, reads, choices = _values(kind)
        metavar = "" if values == 0 else _metavar(values, reads, choices)
        if given is not None and given.metavar is not None:
            metavar = given.metavar
        text = texts.get(field.name, "") if given is None or given.help is None else str(given.help)
        aliases = () if given is None or given.aliases is None else tuple(given.aliases)
        name = "--" + field.name.replace("_", "-")
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        default = "" if required or "default:" in text else _in_words(field.default)
        names = (metavar,) if positional else (*aliases, name)
        yield Option(
            names=names,
            metavar=metavar,
            text=" ".join(text.split()),
            default=default,
            required=required,
            values=values,
            reads=reads,
            choices=choices,
        )


def _unwrapped(kind: Any) -> tuple[Any, list[Any]]:
    marks: list[Any] = []
    while get_origin(kind) is Annotated:
        kind, *more = get_args(kind)
        marks += more
    return kind, marks


def _values(kind: Any) -> tuple[int | None, tuple[type, ...], tuple[str, ...]]:
    """Number of values, types of a value, and further accepted words."""
    if kind is bool:
        return 0, (), ()
    if get_origin(kind) in (Union, types.UnionType):
        parts = [_values(part) for part in get_args(kind) if part is not type(None)]
        count = None if any(part[0] is None for part in parts) else parts[0][0]
        return count, tuple(one for part in parts for one in part[1]), tuple(one for part in parts for one in part[2])
    if get_origin(kind) is Literal:
        return 1, (), get_args(kind)
    if get_origin(kind) is tuple:
        first, *rest = get_args(kind)
        return None if rest == [...] else 1 + len(rest), _values(first)[1], ()
    return 1, (kind,), ()


def _metavar(values: int | None, reads: tuple[type, ...], choices: tuple[str, ...]) -> str:
    name = "|".join([*choices, *(_WORDS[kind][0] for kind in reads)])
    return f"{name}..." if values is None else " ".join([name] * values)


def _in_words(default: object) -> str:
    if default is None or default is False or default == ():
        return ""
    if isinstance(default, tuple):
        return " ".join(_in_words(part) for part in default)
    return f"{default:g}" if isinstance(default, float) else str(default)


def _texts_below(verb: type) -> dict[str, str]:
    """The string below each field of a class and of its base classes."""
    found: dict[str, str] = {}
    for part in reversed(verb.__mro__[:-1]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
                value = below.value
                if isinstance(value, ast.Constant) and isinstance(value.value, str):
                    found[field.target.id] = value.value
    return found


# Old names of options.


class Renamed(NamedTuple):
    """An option with an old name, which works until the next minor version.

    Attributes:
        verbs: commands that have the option.
        old, new: names.
        value: pattern of the values for which the new name applies; empty for all values.
    """

    verbs: tuple[str, ...]
    old: str
    new: str
    value: str = ""


_RENAMED = (
    Renamed(("import signals",), "--map", "--columns"),
    Renamed(("cover record", "cover export"), "--confidence", "--level"),
    Renamed(("import gprmax",), "--start-m", "--first-trace-m"),
    Renamed(
        tuple(f"import {name}" for name in ("dt1", "dzt", "mala", "lines")),
        "--time-zero",
        "--time-zero-ns",
        r"[-+\d.].*",
    ),
)
_REMOVED_IN = "0.3"


def current_names(verb: str, words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Words of a command with the current names of its options, and a line for each old name."""
    renamed = {each.old: each for each in _RENAMED if verb in each.verbs}
    current, notes = list(words), list[str]()
    for place, word in enumerate(words):
        typed, joined, value = word.partition("=")
        found = renamed.get(typed.replace("_", "-"))
        if found is None:
            continue
        if not joined:
            value = words[place + 1] if place + 1 < len(words) else ""
        if not found.value or re.fullmatch(found.value, value):
            current[place] = f"{found.new}={value}" if joined else found.new
            notes.append(f"{found.old} of {verb} is now {found.new}; lgprjax {_REMOVED_IN} removes the old name")
    return current, notes


# Checks of a command before it is parsed.


def nearest(word: str, known: Sequence[str]) -> str:
    """A question that suggests a similar word; empty if no word is similar."""
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean {found[0]}?" if found else ""


def check_words(verb: type, words: Sequence[str], others: Mapping[str, type] = MappingProxyType({})) -> None:
    """Check the words of a command.

    Args:
        verb: dataclass of the command.
        words: words after the command's name.
        others: other commands by name, to name the command that has an unknown option.

    Raises:
        UsageError: a word is wrong or an option is missing; the line says what to type.
        InputError: an option is missing, and so is an input file: the file is reported first.
    """
    options = options_of(verb)
    named = {name: option for option in options if not option.positional for name in option.names}
    given: set[Option] = set()
    free: list[str] = []
    paths: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word in _HELP:
            return
        if not _is_option(word):
            free.append(word)
            continue
        typed, joined, value = word.partition("=")
        name = typed.replace("_", "-") if typed.startswith("--") else typed
        option = named.get(name)
        if option is None:
            raise UsageError(f"{typed}: no such option{nearest(name, list(named)) or _whose(name, others)}")
        given.add(option)
        values = [value] if joined else _taken(option, rest)
        _check_values(typed, option, values)
        if option.reads == (Path,) and option.names[-1] not in OUTPUTS:
            paths += values
    positional = [option for option in options if option.positional]
    _check_positionals(positional, free)
    missing = [option for option in options if option.required and not option.positional and option not in given]
    if missing:
        _check_inputs([*_input_paths(positional, free), *paths])
        option = missing[0]
        raise UsageError(f"{option.names[0]} {option.metavar} is needed: {option.text}")


OUTPUTS = ("--output", "--json", "--picture")
"""Options that name files to write."""


def _input_paths(positional: Sequence[Option], free: Sequence[str]) -> Iterator[str]:
    """Words of positional arguments that name input files or folders."""
    rest = list(free)
    for option in positional:
        words = rest if option.values is None else rest[: option.values]
        rest = rest[len(words) :]
        # SITE may be the name of an example.
        if option.reads == (Path,) and option.metavar != "SITE":
            yield from words


def _check_inputs(paths: Sequence[str]) -> None:
    for path in paths:
        if not Path(path).exists():
            raise InputError(path, "file", "a readable file", "No such file or directory")


def _whose(name: str, others: Mapping[str, type]) -> str:
    """The commands that have an option of this name."""
    have = [verb for verb, kind in others.items() if any(name in option.names for option in options_of(kind))]
    return f"; it is an option of {' and '.join(have)}" if 0 < len(have) <= 3 else ""


def _is_option(word: str) -> bool:
    return len(word) > 1 and word[0] == "-" and not word[1].isdigit() and word[1] != "."


def _taken(option: Option, rest: list[str]) -> list[str]:
    """Values of an option, removed from the words after it."""
    taken: list[str] = []
    while rest and (option.values is None or len(taken) < option.values) and not _is_option(rest[0]):
        taken.append(rest.pop(0))
    return taken


def _check_values(typed: str, option: Option, values: list[str]) -> None:
    needed = 1 if option.values is None else option.values
    if len(values) < needed:
        found = f"found {' '.join(values)}" if values else "found none"
        count = f"{needed} values, " if needed > 1 else ""
        raise UsageError(f"{typed}: expected {count}{option.metavar}, {found}")
    for value in values:
        if not option.accepts(value):
            hint = nearest(value, option.choices) or _hint(value)
            raise UsageError(f"{typed}: expected {option.expected()}, found {value!r}{hint}")
        suffix = option.suffix()
        if not value.endswith(suffix):
            raise UsageError(f"{typed}: expected a file name that ends in {suffix}, found {Path(value).name!r}")


def _hint(value: str) -> str:
    """Correction of a malformed number; empty if the word does not resemble a number."""
    if re.fullmatch(r"[-+]?\d+,\d+", value):
        return "; use a decimal point, not a comma"
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([,;][-+]?\d+(\.\d*)?)+", value):
        return "; separate numbers by spaces"
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)? *[A-Za-z%°µ/]+", value):
        return "; omit the unit"
    return ""


def _check_positionals(wanted: list[Option], found: list[str]) -> None:
    if any(option.values is None for option in wanted):
        single = [option for option in wanted if option.values is not None]
        if len(found) < len(single):
            raise UsageError(f"{single[len(found)].metavar} is needed: {single[len(found)].text}")
        return
    needed = [option for option in wanted if option.required]
    if len(found) < len(needed):
        option = needed[len(found)]
        raise UsageError(f"{option.metavar} is needed: {option.text}")
    if len(found) > len(wanted):
        names = " ".join(option.metavar for option in wanted)
        most = f"only {names}" if wanted else "no file"
        raise UsageError(f"{found[len(wanted)]}: one word too many; expected {most}")
