"""Thresholds as a small TOML file, with what they were found on."""

import json
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.atomic import atomic_output

_SCHEMA = "lgprjax.thresholds"
_NAMES = ("strength_by_chance", "margin_by_chance", "overlap", "sigma_scale")
_ABSOLUTE = ("strength", "margin")
"""Of version 1.0: least score and lead as such. Nothing is asked of them any more."""


def write_thresholds(
    path: str | Path,
    thresholds: dict[str, float],
    *,
    window_m: float,
    search_m: float,
    found_on: dict[str, float | int | str],
    force: bool,
) -> None:
    """Write ``X.thresholds.toml``.

    Args:
        path: the output.
        thresholds: by name; what each means stands in ``registration.Thresholds``.
        window_m, search_m: of the registrations that they hold for.
        found_on: counts, names and the risk that were behind them.
        force: replace an output that exists.

    Raises:
        InputError: the output cannot be written, or exists.
    """
    lines = [f'schema = "{_SCHEMA}"', 'version = "1.1"', f"window_m = {window_m!r}", f"search_m = {search_m!r}", ""]
    lines += ["[thresholds]", *(f"{name} = {float(thresholds[name])!r}" for name in _NAMES), "", "[found_on]"]
    for name, value in found_on.items():
        # A JSON string is a TOML string: names of files may hold quotes.
        lines.append(f"{name} = {json.dumps(value)}")
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_thresholds(path: str | Path, window_m: float) -> dict[str, float]:
    """Thresholds by name.

    Args:
        path: the file.
        window_m: of the registration that they are for; thresholds of another window do not hold.

    Raises:
        InputError: not a file of thresholds, one is missing or no number, they are for other windows, or an older file
            asks for an absolute score or lead.
    """
    held = load_toml(path)
    if held.get("schema") != _SCHEMA:
        raise InputError(path, "schema", _SCHEMA, repr(held.get("schema")))
    if not str(held.get("version", "")).startswith("1."):
        raise InputError(path, "version", "1.x", repr(held.get("version")))
    if held.get("window_m") != window_m:
        raise InputError(path, "window_m", f"{window_m:g}, as --window-m says", repr(held.get("window_m")))
    table = held.get("thresholds")
    values = table if isinstance(table, dict) else {}
    for name in _NAMES:
        value = values.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e6:
            raise InputError(path, f"thresholds.{name}", "a number of at least 0", repr(value))
    for name in _ABSOLUTE:
        if values.get(name, 0.0) != 0.0:
            expected = "0: fixes are judged in units of the noise floor alone; calibrate again with lgprjax thresholds"
            raise InputError(path, f"thresholds.{name}", expected, repr(values[name]))
    return {name: float(values[name]) for name in _NAMES}
