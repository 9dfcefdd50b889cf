"""The terminal: results on standard output, progress on standard error, exit statuses, one line for each bad input."""

import codecs
import difflib
import errno
import io
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import IntEnum
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.status import Status
from rich.text import Text

from lgprjax.errors import ArgumentError, InputError


class Level(IntEnum):
    """Amount of output of a command: ``-q``, neither option, ``-v``."""

    QUIET = 0
    NORMAL = 1
    VERBOSE = 2


class Output(Console):
    """Standard output of a command. At the quiet level only ``verdict`` prints."""

    level = Level.NORMAL

    def print(self, *objects: Any, **options: Any) -> None:
        """Print tables and lines, unless the level is quiet."""
        if self.level > Level.QUIET:
            super().print(*objects, **options)

    def print_always(self, text: str) -> None:
        """Print a line at every level."""
        super().print(text, highlight=False, markup=False, soft_wrap=True)


# Names of files and extras may contain brackets: nothing printed is markup.
console = Output(markup=False)


@contextmanager
def output_level(level: Level) -> Iterator[None]:
    """Set the amount of output for the block."""
    before, console.level = console.level, level
    try:
        yield
    finally:
        console.level = before


def say(text: str) -> None:
    """Print a line without markup; not at the quiet level."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def detail(text: str) -> None:
    """Print a line at the verbose level."""
    if console.level is Level.VERBOSE:
        say(text)


def counted(count: int, noun: str) -> str:
    """A number and its noun, in the plural unless it is one."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verdict(text: str, following: str = "") -> None:
    """Print the last lines of a command: its result, at every level, and the command to run next.

    Args:
        text: result in one line.
        following: words of the next command, without ``lgprjax``; none if empty.
    """
    console.print_always(f"result: {text}")
    if following:
        say(f"next: lgprjax {following}")


# Replacements on a terminal that cannot show these characters; all others become Python escapes.
_PLAIN = {"°": " deg", "²": "2", "₀": "0", "₁": "1", "–": "-", "−": "-", "→": "->", "φ": "phi"}


def _as_it_can_be_shown(error: UnicodeError) -> tuple[str | bytes, int]:
    assert isinstance(error, UnicodeEncodeError)
    character = error.object[error.start]
    if "\udc80" <= character <= "\udcff":  # a byte of a file's name that is no text: as it came
        return bytes([ord(character) - 0xDC00]), error.start + 1
    return _PLAIN.get(character) or character.encode("ascii", "backslashreplace").decode(), error.start + 1


codecs.register_error("lgprjax.terminal", _as_it_can_be_shown)


def show_every_character() -> None:
    """Let what is printed pass through a terminal or pipe of any encoding."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="lgprjax.terminal")


class Bar:
    """A progress bar: call it with the amount done since the last call."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def __call__(self, done: int) -> None:
        """Advance."""
        self._progress.advance(self._task, done)

    def stage(self, what: str) -> None:
        """Show the present step."""
        self._progress.update(self._task, description=what)


class RateColumn(ProgressColumn):
    """Units per second."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The rate; empty until it is known."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.3g} {self._unit}/s")


_LONG_S = 1.0
_COMPILING = "compiling for this machine, up to two minutes the first time; later commands reuse the compiled programs"


class Compiling:
    """Report once per command that JAX compiles programs that are not in the cache.

    JAX reports a program after its compilation. Programs loaded from the cache are not counted.
    """

    def __init__(self) -> None:
        import jax.monitoring

        self._shown: Console | None = None
        self._new, self._took_s = False, 0.0
        jax.monitoring.register_event_listener(self._heard)
        jax.monitoring.register_event_duration_secs_listener(self._ended)

    def _heard(self, event: str, **_: str | int) -> None:
        self._new = self._new or event == "/jax/compilation_cache/cache_misses"

    def _ended(self, event: str, duration_secs: float, **_: str | int) -> None:
        if event != "/jax/core/compile/backend_compile_duration" or not self._new:
            return
        self._new, before_s = False, self._took_s
        self._took_s += duration_secs
        if before_s < _LONG_S <= self._took_s and self._shown is not None:
            self._shown.print(_COMPILING, highlight=False, soft_wrap=True)

    @contextmanager
    def told_on(self, shown: Console) -> Iterator[None]:
        """Report on this console during the block."""
        before, self._shown = self._shown, shown
        try:
            yield
        finally:
            self._shown = before


_compiling: list[Compiling] = []


def _tells_of_compiling(shown: Console) -> AbstractContextManager[None]:
    """Report compilation on a terminal, where progress stops meanwhile."""
    if not shown.is_terminal:
        return nullcontext()
    if not _compiling:
        _compiling.append(Compiling())
    return _compiling[0].told_on(shown)


@contextmanager
def progress_bar(what: str, total: int, unit: str = "scans") -> Iterator[Bar]:
    """A bar that the block advances by calling the yielded object, with rate and remaining time."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(20),
        MofNCompleteColumn(),
        RateColumn(unit),
        TimeRemainingColumn(),
    )
    shown = Console(stderr=True)
    # In a log file the bar would leave an empty line.
    hidden = not shown.is_terminal or console.level is Level.QUIET
    bar = Progress(*columns, console=shown, transient=True, disable=hidden)
    with _timed(f"{what} ({total} {unit})"), bar as progress, _tells_of_compiling(shown):
        yield Bar(progress, progress.add_task(what, total=total))


@contextmanager
def working(what: str) -> Iterator[Status]:
    """A spinner for work of unknown length, whose text may be updated."""
    shown = Console(stderr=True, quiet=console.level is Level.QUIET)
    spinner = "dots" if shown.encoding.startswith("utf") else "line"
    with _timed(what), shown.status(what, spinner=spinner) as status:
        yield status


@contextmanager
def _timed(what: str) -> Iterator[None]:
    """Print the duration of the block at the verbose level."""
    began_s = time.perf_counter()
    yield
    detail(f"{what}: {time.perf_counter() - began_s:.1f} s")


# Exit statuses: 0 done, 1 bad input with one clear line, 2 usage.

BAD_INPUT = 1
USAGE = 2
INTERRUPTED = 130


# Errors of a path or a disk; other operating system errors are defects and keep their traceback.
_ABOUT_FILES = {
    *(errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EACCES, errno.EROFS, errno.EPERM),
    *(errno.ENOENT, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP),
}


class UsageError(Exception):
    """Invalid options; the message is one line."""


def require_files(files: Sequence[object], what: str) -> None:
    """Raise ``UsageError`` if no file is given."""
    if not files:
        raise UsageError(f"{what}: expected at least one file, found none")


def advice(error: InputError) -> str:
    """Advice for a file that is missing, a folder or empty; empty text for every other error."""
    path = Path(error.file)
    if error.place != "file":
        return ""
    try:
        if path.is_dir():
            return "; name a file in it"
        if path.is_symlink() and not path.exists():
            return f"; the link points to {path.readlink()}, which does not exist"
        if path.exists():
            return "; copy or record it again" if path.is_file() and not path.stat().st_size else ""
        if not path.parent.is_dir():
            return f"; there is no folder {path.parent}"
        near = difflib.get_close_matches(path.name, [each.name for each in path.parent.iterdir()], n=1, cutoff=0.8)
    except OSError:  # unreadable folder: the error reports it
        return ""
    return f"; did you mean {path.with_name(near[0])}?" if near else "; check its name and folder"


def run_verb(verb: Callable[[], int | None], command: str = "") -> int:
    """Run a command; bad input becomes one line on standard error and status 1.

    Args:
        verb: function to run.
        command: command name, for the hint at the end of usage errors.
    """
    see = f"(see {command} --help)".replace("  ", " ") if command else "(see --help)"
    try:
        return verb() or 0
    except ArgumentError as error:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in error.place.split(", "))
        print(f"lgprjax: {options}: expected {error.expected}, found {error.found} {see}", file=sys.stderr)
        return USAGE
    except InputError as error:
        print(f"lgprjax: {error}{advice(error)}", file=sys.stderr)
        return BAD_INPUT
    except UsageError as error:
        print(f"lgprjax: {error} {see}", file=sys.stderr)
        return USAGE
    except OSError as error:
        if error.errno not in _ABOUT_FILES:
            raise
        print(f"lgprjax: {error.filename}: {os.strerror(error.errno)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("lgprjax: interrupted; unfinished outputs were removed", file=sys.stderr)
        return INTERRUPTED
