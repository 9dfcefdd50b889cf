"""Files as every room meets them. Nothing heavy is imported: the supervisor of the runtime does not compute."""

import hashlib
import os
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

from lgprjax.errors import InputError


def load_toml(path: str | Path) -> dict[str, Any]:
    """The table of a TOML file.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "file", "TOML", str(error)) from None


def is_at(path: Path, descriptor: int) -> bool:
    """Whether the file that was opened is still the one of that name."""
    with suppress(FileNotFoundError):
        return path.stat().st_ino == os.fstat(descriptor).st_ino
    return False


def file_hash(path: str | Path) -> str:
    """SHA-256 of a file, read in blocks."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
