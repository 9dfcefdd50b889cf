"""Arguments of callers: paths or open objects, and errors in terms of the call."""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeGuard

import numpy as np

from lgprjax.errors import ArgumentError, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OPTION = re.compile(r"--([a-z][a-z-]*)")


class HasPath(Protocol):
    """An open file of this package: a drive, a map, a vehicle, or the log that one was opened from."""

    @property
    def path(self) -> Path | None:
        """Path of the file; ``None`` while it has not been saved."""


PathLike = str | os.PathLike[str] | HasPath
"""A path, or an object that was opened from one."""


def path_of(given: PathLike, what: str) -> Path:
    """The path of what a caller passed.

    Raises:
        InputError: neither a path nor an open object, or an object that has not been saved.
    """
    if isinstance(given, str | os.PathLike):
        return Path(given)
    path = getattr(given, "path", given)
    if path is None:
        raise InputError(what, "path", "an object saved to a file (save it first)", repr(given))
    if not isinstance(path, Path):
        raise InputError("call", what, f"a path or an open {what}", f"{type(given).__name__} {given!r}"[:80])
    return path


def paths_of(given: PathLike | Iterable[PathLike], what: str) -> list[Path]:
    """Paths of several files; a single path is accepted too.

    Raises:
        InputError: as ``path_of``, or there are no files.
    """
    if isinstance(given, str | os.PathLike) or not isinstance(given, Iterable):
        return [path_of(given, what)]
    several = [path_of(each, what) for each in given]
    if not several:
        raise InputError("call", what, "at least one", "none")
    return several


def require_number(name: str, value: object, expected: str, least: float, most: float) -> None:
    """Refuse an argument that is not a plain number, or is out of its closed range.

    Raises:
        InputError: the argument is refused.
    """
    if not is_number(value) or not least <= value <= most:
        raise ArgumentError(name, expected, repr(value)[:60])


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a plain real number, of Python or of NumPy; NaN and infinities are."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def whole_number(name: str, value: object) -> int:
    """An argument as a Python number. Raises ``InputError`` where it is no whole number, of Python or of NumPy."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ArgumentError(name, "a whole number", repr(value)[:60])
    return int(value)


def require_slice(given: object) -> None:
    """Refuse scans that are not a slice. Raises ``InputError``."""
    if not isinstance(given, slice):
        raise ArgumentError("scans", "a slice, as slice(0, 512)", repr(given)[:60])


@contextmanager
def told_as_arguments() -> Iterator[None]:
    """Errors in the words of a call: an option of the command line (``--search-m``) is the argument (``search_m``), and
    a folder or file that the system refuses is an ``InputError``.
    """
    try:
        yield
    except InputError as error:
        place, expected = _as_argument(error.place), _as_argument(error.expected)
        if (place, expected) == (error.place, error.expected):
            raise
        raise InputError(error.file, place, expected, error.found) from None
    except OSError as error:
        if error.filename is None or error.errno is None:
            raise
        expected, found = "an accessible file or folder", os.strerror(error.errno).lower()
        raise InputError(error.filename, "file", expected, found) from error


def _as_argument(text: str) -> str:
    text = text.replace("--force", "force=True")
    return _OPTION.sub(lambda option: option[1].replace("-", "_"), text)


def axes_or_new(ax: "Axes | None", *, width_in: float = 9.0, height_in: float = 4.5) -> "Axes":
    """The axes that the caller passed, or those of a new figure. Raises ``InputError`` where they are none."""
    from matplotlib import pyplot
    from matplotlib.axes import Axes

    if ax is not None:
        if not isinstance(ax, Axes):
            raise ArgumentError("ax", "matplotlib axes", repr(ax)[:60])
        return ax

    _, made = pyplot.subplots(figsize=(width_in, height_in), layout="constrained")
    return made
