"""The route file ``X.route.toml``."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

from lgprjax.files import load_toml
from lgprjax.formats.schema import Finding, check_version, key_findings, load_schema
from lgprjax.formats.store import atomic_output

_SCHEMA = load_schema("route")
_DIGITS = 64


class RouteFile(NamedTuple):
    """Contents of a route file; paths are ready to open.

    Attributes:
        map: path of the route's file: subsurface database, drive log or waypoints.
        map_sha256: SHA-256 of that file when the route was chosen.
        route: name of the baseline or track in the file.
        from_m, to_m: start and end of the stretch along the recorded route.
        direction: direction of driving: as recorded, or from the stretch's end to its beginning.
        cruise_mps: highest speed.
        lateral_mps2: highest lateral acceleration.
        vehicle: vehicle file whose smallest radius the route was checked against.
    """

    map: Path
    map_sha256: str
    route: str
    from_m: float
    to_m: float
    direction: Literal["along", "against"]
    cruise_mps: float
    lateral_mps2: float
    vehicle: Path | None


def read_route(path: str | Path) -> RouteFile:
    """A route from its file; whether the map is unchanged is checked elsewhere (``mapping.require_map``).

    Raises:
        InputError: the file is missing, not TOML or of a newer major version; a key is unknown, missing, of a wrong
            type or out of its range.
    """
    file = Path(path)
    table = load_toml(file)
    for finding in _problems(file, table):
        raise finding.error()
    vehicle = table.get("vehicle")
    return RouteFile(
        map=file.parent / table["map"],
        map_sha256=table["map_sha256"],
        route=table["route"],
        from_m=float(table["from_m"]),
        to_m=float(table["to_m"]),
        direction=table["direction"],
        cruise_mps=float(table["cruise_mps"]),
        lateral_mps2=float(table["lateral_mps2"]),
        vehicle=None if vehicle is None else file.parent / vehicle,
    )


def write_route(path: str | Path, route: RouteFile, *, force: bool = False) -> None:
    """Write a route to its file, each key with its description and paths relative to the file's folder.

    Raises:
        InputError: a value does not match the schema, or the output exists (without ``force``) or cannot be written.
    """
    folder = Path(path).parent
    values = {key: value for key, value in route._asdict().items() if value is not None}
    for key in ("map", "vehicle"):
        if key in values:
            # Not resolved: paths through a link stay as the user made them.
            values[key] = Path(os.path.relpath(values[key], folder)).as_posix()
    table = {"schema": _SCHEMA.name, "schema_version": _SCHEMA.version, **values}
    for finding in _problems(path, table):
        raise finding.error()
    described = {entry.path: entry.description for entry in _SCHEMA.keys}
    lines = []
    for key, value in table.items():
        # A JSON string is a TOML string, and a JSON number of Python's a TOML number.
        line = f"{key} = {json.dumps(value, ensure_ascii=False)}"
        lines.append(f"{line}  # {described[key]}" if key in described else line)
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def route_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a route file.

    Raises:
        InputError: the file cannot be read, or is not TOML.
    """
    return _problems(path, load_toml(path))


def _problems(path: str | Path, table: dict[str, Any]) -> Iterator[Finding]:
    """Every problem of a table, header included; rules between numbers only where the numbers are valid."""
    refusal = check_version(_SCHEMA, table.get("schema"), table.get("schema_version"))
    if refusal is not None:
        yield Finding(str(path), *refusal)
        return
    values = {key: value for key, value in table.items() if key not in ("schema", "schema_version")}
    problems = list(key_findings(_SCHEMA, str(path), values))
    yield from problems
    if any(finding.found != "an unknown key" for finding in problems):
        return
    if table["to_m"] <= table["from_m"]:
        yield Finding(str(path), "to_m", f"more than from_m, {table['from_m']:g}", f"{table['to_m']:g}")
    digest = table["map_sha256"]
    if len(digest) != _DIGITS or set(digest) - set("0123456789abcdef"):
        yield Finding(str(path), "map_sha256", f"{_DIGITS} hexadecimal digits", repr(digest)[:_DIGITS])
