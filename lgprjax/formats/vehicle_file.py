"""The vehicle file ``X.vehicle.toml``: read, written, and held against ``data_schema/vehicle.toml``."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.atomic import atomic_output
from lgprjax.formats.findings import Finding, check_scalar, check_version, expected_scalar
from lgprjax.formats.schema import Entry, load_schema
from lgprjax.formats.vehicle_model import VehicleFile
from lgprjax.formats.vehicle_rules import BrokenRuleError, flat_keys

_SCHEMA = load_schema("vehicle")


def read_vehicle(path: str | Path) -> VehicleFile:
    """A vehicle from its file.

    Raises:
        InputError: the file is missing, no TOML or of a newer major version; a key is unknown, missing, of a wrong
            type or out of its range; numbers contradict each other.
    """
    table = load_toml(path)
    for finding in table_problems(path, table):
        raise finding.error()
    return VehicleFile.model_validate(_tables(table))


def write_vehicle(path: str | Path, vehicle: VehicleFile, *, force: bool = False) -> None:
    """Write a vehicle to its file, each key with its description.

    Raises:
        InputError: a value is not as the schema says, or the output exists (without ``force``) or cannot be written.
    """
    table = vehicle.model_dump(exclude_none=True)
    header = {"schema": _SCHEMA.name, "schema_version": _SCHEMA.version}
    for finding in table_problems(path, {**header, **table}):
        raise finding.error()
    lines = [_line(name, value) for name, value in header.items()]
    lines += [_line(name, value) for name, value in table.items() if not isinstance(value, dict)]
    for name, value in table.items():
        if isinstance(value, dict) and name != "found" and value:
            lines += ["", f"[{name}]", *(_line(key, inner, f"{name}.{key}") for key, inner in value.items())]
    for found, value in table.get("found", {}).items():
        lines += ["", f"[found.{json.dumps(found)}]", *(_line(key, inner) for key, inner in value.items())]
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def require_serial_number(
    vehicle: VehicleFile, vehicle_path: str | Path, named: str | None, file: str | Path, place: str
) -> None:
    """Refuse a file that names another vehicle. What names none says nothing against this one.

    Args:
        vehicle, vehicle_path: the vehicle and its file.
        named: serial number that a study or a drive log names.
        file, place: where it names it.

    Raises:
        InputError: another serial number, or one where the vehicle file has none.
    """
    if named is None or named == vehicle.serial_number:
        return
    own = "no serial_number" if vehicle.serial_number is None else f"serial number {vehicle.serial_number!r}"
    raise InputError(file, place, f"the vehicle of {vehicle_path} ({own})", f"another vehicle, {named!r}")


def vehicle_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a vehicle file.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    return table_problems(path, load_toml(path))


def table_problems(path: str | Path, table: dict[str, Any]) -> Iterator[Finding]:
    """Every problem of a vehicle's table, header included; rules between numbers only where the numbers are good."""
    refusal = check_version(_SCHEMA, table.get("schema"), table.get("schema_version"))
    if refusal is not None:
        yield Finding(str(path), *refusal)
        return
    values = flat_keys(_tables(table))
    sound = True
    for place, expected, found in _key_problems(values):
        sound = False
        yield Finding(str(path), place, expected, found)
    if sound:
        try:
            VehicleFile.model_validate(_tables(table))
        except ValidationError as error:
            for problem in error.errors():
                yield Finding(str(path), *_rule_broken(problem))


def _tables(table: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name not in ("schema", "schema_version")}


def _key_problems(values: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Place, expected and found of each key that is missing, wrong or unknown, in the schema's order."""
    left = dict(values)
    for entry in _SCHEMA.keys:
        prefix, star, suffix = entry.path.partition("*")
        if not star:
            if entry.path in left:
                yield from _value_problems(entry, entry.path, left.pop(entry.path), many=bool(entry.dims))
            elif entry.required:
                yield entry.path, expected_scalar(entry), "none"
            continue
        for path in [path for path in left if path.startswith(prefix) and path.endswith(suffix)]:
            value = left.pop(path)
            yield from _value_problems(entry, path, value, many=isinstance(value, list))
    for path in left:
        yield path, "a key of data_schema/vehicle.toml", "an unknown key"


def _value_problems(entry: Entry, path: str, value: object, *, many: bool) -> Iterator[tuple[str, str, str]]:
    if not many:
        problem = check_scalar(entry, value)
        if problem is not None:
            yield path, expected_scalar(entry), problem + _degrees_hint(entry, value)
        return
    if not isinstance(value, list):
        yield path, f"a list, each {expected_scalar(entry)}", repr(value)
        return
    for index, item in enumerate(value):
        problem = check_scalar(entry, item)
        if problem is not None:
            yield f"{path}[{index}]", expected_scalar(entry), problem + _degrees_hint(entry, item)


def _degrees_hint(entry: Entry, value: object) -> str:
    """Says so when the number would be a good one in degrees."""
    if not entry.unit.startswith("rad") or isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    radians = math.radians(value)
    # A number that a range does not hold is no degree either when its sign is what is wrong.
    if check_scalar(replace(entry, bounds=None), value) is not None or check_scalar(entry, radians) is not None:
        return ""
    per = entry.unit.removeprefix("rad")
    return f", which looks like degrees ({value:g} deg{per} are {radians:.4g} {entry.unit})"


def _rule_broken(problem: Any) -> tuple[str, str, str]:
    """Place, expected and found of a pydantic error."""
    path = ".".join(str(part) for part in problem["loc"])
    cause = problem.get("ctx", {}).get("error")
    if isinstance(cause, BrokenRuleError):
        place, expected, found = cause.problem
        return f"{path}.{place}" if path else place, expected, found
    if problem["type"] == "missing":
        return path, "a value, as for the rest of its table", "none"
    return path, str(problem["msg"]), repr(problem["input"])[:60]


def _line(name: str, value: object, path: str = "") -> str:
    # A JSON string is a TOML string, and a JSON number of Python's a TOML number.
    text = f"{name} = {json.dumps(value, ensure_ascii=False)}"
    described = [f"{entry.description}" for entry in _SCHEMA.keys if entry.path == path]
    return f"{text}  # {described[0]}" if described else text
