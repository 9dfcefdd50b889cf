"""TOML files as tables; what is none is one line."""

import tomllib
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
