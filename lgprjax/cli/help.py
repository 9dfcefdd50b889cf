"""Text of ``--help``, and the reference page of the site with every option (``python -m lgprjax.cli.help``)."""

import inspect
import re
import shutil
import textwrap
from collections.abc import Iterator, Sequence

from lgprjax.cli.options import Option, options_of
from lgprjax.cli.verbs import VERBS, Verb, VerbGroup, every_verb

_LEFT = 26
SHARED = tuple(
    Option(names=names, metavar="", text=text, default="", required=False, values=0, reads=(), choices=())
    for names, text in (
        (("-h", "--help"), "show this help"),
        (("-q", "--quiet"), "print only errors and the result"),
        (("-v", "--verbose"), "also print durations and details"),
    )
)
"""Options of every command. ``lgprjax.cli.command`` reads them before the command is parsed."""
_WHAT = "Localizing ground-penetrating radar: locate a vehicle by radar scans."
_ENDING = (
    "Usual order: import recordings, map build, register later drives on the map.",
    "",
    "lgprjax COMMAND --help   options and two examples of a command",
    "lgprjax --version        version",
    "lgprjax --completion bash|zsh|fish|tcsh   completion script for a shell",
    "Every command: -q prints only errors and the result, -v adds durations.",
    "Exit status: 0 done, 1 bad input (file: place, expected, found), 2 wrong usage.",
)


def _width() -> int:
    return max(60, min(shutil.get_terminal_size((80, 24)).columns, 100))


def top_help() -> str:
    """Commands grouped by task, on one screen."""
    lines = ["usage: lgprjax COMMAND ...", "", _WHAT, ""]
    for part, verbs in VERBS.items():
        lines += [part, *(f"  {name:12}{verb.what}" for name, verb in verbs.items())]
    return "\n".join([*lines, "", *_ENDING]) + "\n"


def group_help(name: str, group: VerbGroup) -> str:
    """Commands of a group."""
    lines = [f"usage: lgprjax {name} COMMAND ...", "", *_wrapped(group.text), ""]
    if name == "import":
        lines[0] = "usage: lgprjax import [FORMAT] FILE... -o X.drive.h5"
    lines += [f"  {part:12}{verb.what}" for part, verb in group.verbs.items()]
    lines += ["", "Examples", *_examples(group.examples)]
    lines += ["", f"lgprjax {name} {'FORMAT' if name == 'import' else 'COMMAND'} --help shows its options."]
    return "\n".join(lines) + "\n"


def verb_help(name: str, verb: Verb) -> str:
    """Description, options and examples of a command."""
    options = options_of(verb.options)
    positional, named = _parted(options)
    lines = [*_usage(name, options), "", *_described(verb), ""]
    for option in positional:
        lines += _row(option)
    lines += ["", "Options"] if positional else ["Options"]
    for option in [*named, *SHARED]:
        lines += _row(option)
    return "\n".join([*lines, "", "Examples", *_examples(verb.examples)]) + "\n"


def _parted(options: Sequence[Option]) -> tuple[list[Option], list[Option]]:
    positional = [option for option in options if option.positional]
    named = [option for option in options if not option.positional]
    return positional, sorted(named, key=lambda option: not option.required)


def _usage(name: str, options: Sequence[Option]) -> list[str]:
    positional, named = _parted(options)
    words = [option.metavar if option.required else f"[{option.metavar}]" for option in positional]
    words += [f"{option.names[0]} {option.metavar}" for option in named if option.required]
    text = f"usage: lgprjax {name} {' '.join([*words, '[OPTIONS]'])}"
    return textwrap.wrap(text, _width(), subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _described(verb: Verb) -> Iterator[str]:
    text = inspect.cleandoc(verb.options.__doc__ or "")
    for number, part in enumerate(text.split("\n\n")):
        yield from ([""] if number else [])
        yield from _wrapped(part)


def _row(option: Option) -> Iterator[str]:
    left = option.metavar if option.positional else f"{', '.join(option.names)} {option.metavar}".rstrip()
    text = option.text
    if option.required and not option.positional:
        text += " (required)"
    elif option.default:
        text += f" (default: {option.default})"
    rows = textwrap.wrap(text, _width() - _LEFT, break_long_words=False, break_on_hyphens=False) or [""]
    if len(left) > _LEFT - 4:
        yield f"  {left}"
    else:
        yield f"  {left:{_LEFT - 2}}{rows.pop(0)}".rstrip()
    yield from (" " * _LEFT + row for row in rows)


def _examples(examples: Sequence[str]) -> Iterator[str]:
    for example in examples:
        yield from textwrap.wrap(
            f"lgprjax {example}",
            _width() - 4,
            initial_indent="  ",
            subsequent_indent="      ",
            break_long_words=False,
            break_on_hyphens=False,
        )


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), _width(), break_long_words=False, break_on_hyphens=False)


# The reference page.


def reference_page() -> str:
    """Every command with its options, in Markdown."""
    parts = [
        "# Command reference\n",
        "Every command with its options, as `lgprjax COMMAND --help` prints them. [Command line](../cli.md) lists the "
        "commands by task.\n",
        f"```text\n{top_help()}```\n",
        "Options of every command:\n\n| option | effect |\n| --- | --- |",
        *map(_table_row, SHARED),
        "",
    ]
    for name, verb in every_verb():
        positional, named = _parted(options_of(verb.options))
        parts.append(f"## lgprjax {name}\n")
        parts += [f"{' '.join(part.split())}\n" for part in inspect.cleandoc(verb.options.__doc__ or "").split("\n\n")]
        parts.append("| option | effect |\n| --- | --- |")
        parts += [_table_row(option) for option in [*positional, *named]]
        examples = "\n".join(f"lgprjax {example}" for example in verb.examples)
        parts.append(f"\n```sh\n{examples}\n```\n")
    return "\n".join(parts)


def _table_row(option: Option) -> str:
    left = option.metavar if option.positional else f"{', '.join(option.names)} {option.metavar}".rstrip()
    text = option.text.replace("|", "\\|")
    needed = " (required)" if option.required and not option.positional else ""
    default = f" (default: {option.default})" if option.default else ""
    return f"| `{re.sub(r'[|]', chr(92) + '|', left)}` | {text}{needed}{default} |"


if __name__ == "__main__":
    print(reference_page(), end="")
