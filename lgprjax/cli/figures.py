"""Figures as JSON: to a file, or to standard output (``--json -``)."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TextIO

from lgprjax.errors import InputError

STANDARD_OUTPUT = Path("-")
_figures_to: list[TextIO] = []


def write_figures(path: Path, figures: object, *, force: bool) -> None:
    """Write figures to a JSON file. Raises ``InputError`` if it exists (without ``force``) or cannot be written."""
    from lgprjax.formats import atomic_output

    text = json.dumps(figures, indent=2) + "\n"
    if path == STANDARD_OUTPUT:
        to = _figures_to[-1] if _figures_to else sys.stdout
        to.write(text)
        to.flush()
        return
    with atomic_output(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def figures_alone() -> Iterator[None]:
    """Reserve standard output for the figures: all other output of the block goes to standard error."""
    _figures_to.append(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _figures_to.pop()


def check_outputs(*outputs: Path | None, force: bool) -> None:
    """Check the files to write, before any work and after the inputs are read.

    Raises:
        InputError: a file exists (without ``force``), is a folder or is named twice, or its folder is missing or
            read-only.
    """
    seen: set[Path] = set()
    for path in outputs:
        if path is None or path == STANDARD_OUTPUT:
            continue
        if path.absolute() in seen:
            raise InputError(path, "output", "different files", "the same file for two outputs")
        seen.add(path.absolute())
        if path.is_dir():
            raise InputError(path, "output", "a file name", "a folder")
        if path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "an existing file")
        if not path.parent.is_dir():
            raise InputError(path, "output", "an existing folder (create it first)", f"no folder {path.parent}")
        if not os.access(path.parent, os.W_OK):
            raise InputError(path, "output", "a writable folder", f"{path.parent}, read-only")
