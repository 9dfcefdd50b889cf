"""The terminal: progress on standard error, exit statuses, one line for each bad input."""

import codecs
import difflib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

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

# Names of files and extras may contain brackets: nothing printed is markup.
console = Console(markup=False)


# What a terminal that is not of UTF-8 shows in place of these characters; every other one as Python writes it.
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
    """How many are done a second."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The rate; nothing before it is known."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.3g} {self._unit}/s")


_LONG_S = 1.0
_COMPILING = "compiling for this machine, up to two minutes the first time; later commands load what is compiled now"


class Compiling:
    """Tells a terminal, once a command, that programs are compiled that no earlier command has kept.

    JAX reports a program when it has been compiled; those loaded from the cache do not count.
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
        """Tell it on this console during the block."""
        before, self._shown = self._shown, shown
        try:
            yield
        finally:
            self._shown = before


_compiling: list[Compiling] = []


def _tells_of_compiling(shown: Console) -> AbstractContextManager[None]:
    """Where somebody watches, say why nothing moves while programs are compiled."""
    if not shown.is_terminal:
        return nullcontext()
    if not _compiling:
        _compiling.append(Compiling())
    return _compiling[0].told_on(shown)


@contextmanager
def progress_bar(what: str, total: int, unit: str = "scans") -> Iterator[Bar]:
    """A bar that the block advances by calling the yielded object; rate and time left beside it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(20),
        MofNCompleteColumn(),
        RateColumn(unit),
        TimeRemainingColumn(),
    )
    shown = Console(stderr=True)
    # Where nobody watches, as in a log, the bar would leave an empty line.
    bar = Progress(*columns, console=shown, transient=True, disable=not shown.is_terminal)
    with bar as progress, _tells_of_compiling(shown):
        yield Bar(progress, progress.add_task(what, total=total))


def working(what: str) -> AbstractContextManager[Status]:
    """A spinner for work of unknown length, whose text may be updated."""
    shown = Console(stderr=True)
    return shown.status(what, spinner="dots" if shown.encoding.startswith("utf") else "line")


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
    """Raise ``UsageError`` if a verb was given no file."""
    if not files:
        raise UsageError(f"{what}: expected at least one file, found none")


def advice(error: InputError) -> str:
    """What to do where a file is none, or is not there; empty for every other error."""
    path = Path(error.file)
    if error.place != "file":
        return ""
    try:
        if path.is_dir():
            return "; name a file in it"
        if path.is_symlink() and not path.exists():
            return f"; it is a link to {path.readlink()}, which is not there"
        if path.exists():
            return "; copy or record it again" if path.is_file() and not path.stat().st_size else ""
        if not path.parent.is_dir():
            return f"; there is no folder {path.parent}"
        near = difflib.get_close_matches(path.name, [each.name for each in path.parent.iterdir()], n=1, cutoff=0.8)
    except OSError:  # a folder that may not be read: the error itself says so
        return ""
    return f"; did you mean {path.with_name(near[0])}?" if near else "; check its name and folder"


def run_verb(verb: Callable[[], int | None], command: str = "") -> int:
    """Run a verb; bad input becomes one line on standard error and status 1.

    Args:
        verb: what runs.
        command: its words, which the lines about wrong usage refer to.
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
