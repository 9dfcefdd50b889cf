"""A configuration as text: the file that a run is started from, its lines and paths filled in."""

import json
from pathlib import Path
from typing import Any

from lgprjax.formats.atomic import atomic_output
from lgprjax.runtime.config import RuntimeConfig


def write_config(path: Path, config: RuntimeConfig) -> None:
    """Write a configuration with absolute paths, replacing the file.

    Raises:
        InputError: it cannot be written.
    """
    table = config.model_dump(exclude={"file"}, exclude_none=True)
    for name in ("vehicle", "map", "cache"):
        if table.get(name):
            table[name] = str(config.path(table[name]))
    table["routes"] = [str(config.path(name)) for name in table["routes"]]
    for name, key in (("coverage", "plan"), ("simulation", "field")):
        if key in table.get(name, {}):
            table[name][key] = str(config.path(table[name][key]))
    table["recording"]["folder"] = str(config.path(config.recording.folder))
    with atomic_output(path, force=True) as temporary:
        temporary.write_text("\n".join(_lines(table, "")) + "\n", encoding="utf-8")


def _lines(table: dict[str, Any], prefix: str) -> list[str]:
    plain = {name: value for name, value in table.items() if not isinstance(value, dict)}
    lines = [f"{name} = {_value(value)}" for name, value in plain.items()]
    for name, inner in table.items():
        if isinstance(inner, dict):
            path = f"{prefix}{name}"
            lines += ["", f"[{path}]", *_lines(inner, f"{path}.")]
    return lines


def _value(value: Any) -> str:
    """A JSON text or number is TOML's, too; a table in a list stands on its line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(name)} = {_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(inner) for inner in value) + "]"
    return json.dumps(value)
