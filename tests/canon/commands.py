"""Commands in this process as a person types them: one by one, or a block as a shell reads it."""

import contextlib
import io
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from lgprjax.cli import main
from lgprjax.cli.recognised import recognised
from printed_options import VERBS, unknown_options
from refusals import Refusal, printed_refusal


class Done(NamedTuple):
    """A command's exit status and what it printed."""

    status: int
    out: str
    err: str

    @property
    def refusal(self) -> Refusal:
        """Fields of the one line of a command that was refused."""
        assert self.status in (1, 2), self
        return printed_refusal(self.err)

    @property
    def about(self) -> str:
        """What the one line of a command that was refused is about: ``FILE: PLACE``, an option, or a word."""
        (line,) = (line for line in (self.err or self.out).strip().splitlines() if not line.startswith("result: "))
        told = line.removeprefix("lgprjax: ").removeprefix("error: ")
        assert told != line, line
        about, expected, _ = told.partition(": expected ")
        return about if expected else told.split()[0].rstrip(":")


def run(*words: object) -> Done:
    """A command with these words."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as stopped:
        main([str(word) for word in words])
    assert isinstance(stopped.value.code, int)
    done = Done(stopped.value.code, out.getvalue(), err.getvalue())
    _check_options([str(word) for word in words], done)
    return done


def _check_options(words: list[str], done: Done) -> None:
    """Assert that what a command printed names no option that it, or the verb named with it, does not accept."""
    given = recognised(words[1:]) if words[:1] == ["import"] else words[1:]
    verb = next((name for name in VERBS if [*words[:1], *given][: len(name.split())] == name.split()), "")
    for line in (done.out + done.err).splitlines() if verb and "--help" not in words else ():
        unknown = unknown_options(line.removeprefix("next: "), verb)
        assert [each for each in unknown if each not in " ".join(words)] == [], (words, line)


def succeed(*words: object) -> str:
    """What a command that must succeed printed."""
    done = run(*words)
    assert done.status == 0, (words, done.err)
    return done.out


def shell(text: str) -> Iterator[list[str]]:
    """Words of each command of a block, whose texts between marks are written as they come; patterns are resolved."""
    lines = iter(text.replace("\\\n", " ").splitlines())
    for line in lines:
        words = shlex.split(line, comments=True)
        if words[:2] == ["cat", ">"]:
            end = words[3].removeprefix("<<")
            Path(words[2]).write_text("".join(f"{each}\n" for each in iter(lines.__next__, end)), encoding="utf-8")
        elif words:
            assert words[0] == "lgprjax", line
            yield [each for word in words[1:] for each in _resolved(word)]


def _resolved(word: str) -> list[str]:
    found = sorted(str(path) for path in Path().glob(word)) if "*" in word else []
    return found or [word]
