"""Options of a verb as people read and type them, from its dataclass: annotations, defaults, the text below each.

tyro parses. What is here serves the help, the reference page and the one line that says what is wrong with a command.
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

_WORDS = {float: ("NUMBER", "a number"), int: ("N", "a whole number"), Path: ("PATH", ""), str: ("NAME", "")}
_HELP = ("-h", "--help")


class Option(NamedTuple):
    """An option, or a positional argument.

    Attributes:
        names: as typed, short ones first; one without dashes for a positional argument.
        metavar: what stands for its values; empty for a flag.
        text: what it does.
        default: as people write it; empty where there is none to tell.
        values: how many words it takes: 0 for a flag, None for any number.
        reads: types of a value.
        choices: words that are allowed beside.
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
        """Whether it has no name of its own in a command."""
        return not self.names[-1].startswith("-")

    def accepts(self, word: str) -> bool:
        """Whether a word can be read as a value."""
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
        """How the name of an output must end, as its metavar does: X.drive.h5; empty where it may end in anything."""
        named = re.fullmatch(r"[A-Z]+(\.[a-z0-9.]+)", self.metavar)
        return named[1] if named is not None and "--output" in self.names else ""

    def expected(self) -> str:
        """What a value may be, in words."""
        kinds = [_WORDS[kind][1] for kind in self.reads if _WORDS[kind][1]]
        names = [*self.choices, *kinds]
        return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]


@cache
def options_of(verb: type) -> tuple[Option, ...]:
    """Options of a verb's dataclass, its nested dataclasses' among them, in their order."""
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
        yield Option(names, metavar, " ".join(text.split()), default, required, values, reads, choices)


def _unwrapped(kind: Any) -> tuple[Any, list[Any]]:
    marks: list[Any] = []
    while get_origin(kind) is Annotated:
        kind, *more = get_args(kind)
        marks += more
    return kind, marks


def _values(kind: Any) -> tuple[int | None, tuple[type, ...], tuple[str, ...]]:
    """How many values, the types of one, and words that are allowed beside."""
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
    """The string below each field, as in the class and in those that it is made from."""
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


# What is wrong with a command, before it is parsed.


def nearest(word: str, known: Sequence[str]) -> str:
    """A question that names the word that was probably meant; empty where none resembles it."""
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean {found[0]}?" if found else ""


def check_words(verb: type, words: Sequence[str], others: Mapping[str, type] = MappingProxyType({})) -> None:
    """Refuse words that a verb cannot take. Raises ``UsageError`` with a line that says what to type.

    Args:
        verb: the verb.
        words: that follow it.
        others: further verbs by name, for an option that is one of theirs.
    """
    options = options_of(verb)
    named = {name: option for option in options if not option.positional for name in option.names}
    told: set[Option] = set()
    free: list[str] = []
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
        told.add(option)
        _check_values(typed, option, [value] if joined else _taken(option, rest))
    _check_positionals([option for option in options if option.positional], free)
    missing = [option for option in options if option.required and not option.positional and option not in told]
    if missing:
        option = missing[0]
        raise UsageError(f"{option.names[0]} {option.metavar} is needed: {option.text}")


def _whose(name: str, others: Mapping[str, type]) -> str:
    """The verbs that have an option of this name."""
    have = [verb for verb, kind in others.items() if any(name in option.names for option in options_of(kind))]
    return f"; it is one of {' and '.join(have)}" if 0 < len(have) <= 3 else ""


def _is_option(word: str) -> bool:
    return len(word) > 1 and word[0] == "-" and not word[1].isdigit() and word[1] != "."


def _taken(option: Option, rest: list[str]) -> list[str]:
    """The values of an option, taken from the words behind it."""
    taken: list[str] = []
    while rest and (option.values is None or len(taken) < option.values) and not _is_option(rest[0]):
        taken.append(rest.pop(0))
    return taken


def _check_values(typed: str, option: Option, values: list[str]) -> None:
    needed = 1 if option.values is None else option.values
    if len(values) < needed:
        found = f"found {' '.join(values)}" if values else "found nothing after it"
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
    """What to leave out of a number that is none; empty where it is no number with something beside it."""
    if re.fullmatch(r"[-+]?\d+,\d+", value):
        return "; write a point, not a comma"
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([,;][-+]?\d+(\.\d*)?)+", value):
        return "; put blanks between numbers"
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)? *[A-Za-z%°µ/]+", value):
        return "; leave out the unit"
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
