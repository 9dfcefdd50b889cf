"""The terminal: progress on standard error, exit statuses, one line for each bad input."""

import errno
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from lgprjax.errors import ArgumentError, InputError

# Names of files and extras may contain brackets: nothing printed is markup.
console = Console(markup=False)


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


@contextmanager
def progress_bar(what: str, total: int) -> Iterator[Bar]:
    """A bar that the block advances by calling the yielded object."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield Bar(progress, progress.add_task(what, total=total))


def working(what: str) -> AbstractContextManager[object]:
    """A spinner for work of unknown length."""
    return Console(stderr=True).status(what)


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


def run_verb(verb: Callable[[], int | None]) -> int:
    """Run a verb; bad input becomes one line on standard error and status 1."""
    try:
        return verb() or 0
    except ArgumentError as error:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in error.place.split(", "))
        print(f"lgprjax: {options}: expected {error.expected}, found {error.found} (see --help)", file=sys.stderr)
        return USAGE
    except InputError as error:
        print(f"lgprjax: {error}", file=sys.stderr)
        return BAD_INPUT
    except UsageError as error:
        print(f"lgprjax: {error} (see --help)", file=sys.stderr)
        return USAGE
    except OSError as error:
        if error.errno not in _ABOUT_FILES:
            raise
        print(f"lgprjax: {error.filename}: {os.strerror(error.errno)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("lgprjax: interrupted; unfinished outputs were removed", file=sys.stderr)
        return INTERRUPTED
