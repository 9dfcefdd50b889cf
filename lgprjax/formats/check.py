"""Hold any file of ours against its schema and report every problem, not only the first."""

import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.formats.findings import Finding, check_scalar, check_version, expected_scalar
from lgprjax.formats.fixes import parse_cells, read_cells, table_findings
from lgprjax.formats.schema import Schema, load_schema
from lgprjax.formats.store import open_store, validate_store


def check_file(path: str | Path) -> list[Finding]:
    """Findings of a ``.drive.h5``, ``.map.h5``, ``.fixes.h5``, ``.fixes.csv`` or ``.vehicle.toml`` file.

    Radar data are read block by block, so memory stays small. An empty list means that the file is as it should be.

    Raises:
        InputError: the file's name ends in none of these suffixes.
    """
    file = Path(path)
    for suffix, check in _CHECKS.items():
        if file.name.lower().endswith(suffix):
            try:
                return list(check(file))
            except InputError as error:
                return [Finding(error.file, error.place, error.expected, error.found)]
    raise InputError(path, "file name", "a suffix among " + ", ".join(_CHECKS), repr(file.name))


def _check_store(schema: Schema) -> Callable[[Path], Iterator[Finding]]:
    def check(path: Path) -> Iterator[Finding]:
        with open_store(path) as store:
            yield from validate_store(store, path, schema, bulk=True)

    return check


def _check_fixes_csv(path: Path) -> Iterator[Finding]:
    table, findings = parse_cells(path, read_cells(path))
    yield from findings
    # A column that could not be read is reported above, not again as missing.
    named = " ".join(finding.place for finding in findings)
    yield from (f for f in table_findings(path, table) if f.found != "none" or f.place not in named)


def _check_vehicle(path: Path) -> Iterator[Finding]:
    schema = load_schema("vehicle")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "file", "TOML", str(error)) from None
    refusal = check_version(schema, table.pop("schema", None), table.pop("schema_version", None))
    if refusal is not None:
        yield Finding(str(path), *refusal)
        return
    values: dict[str, object] = {}
    for name, value in table.items():
        values |= {f"{name}.{key}": inner for key, inner in value.items()} if isinstance(value, dict) else {name: value}
    for entry in schema.keys:
        if entry.path not in values:
            if entry.required:
                yield Finding(str(path), entry.path, expected_scalar(entry), "none")
            continue
        problem = check_scalar(entry, values.pop(entry.path))
        if problem is not None:
            yield Finding(str(path), entry.path, expected_scalar(entry), problem)
    for name in values:
        yield Finding(str(path), name, "a key of data_schema/vehicle.toml", "an unknown key")


_CHECKS: dict[str, Callable[[Path], Iterator[Finding]]] = {
    ".drive.h5": _check_store(load_schema("drive")),
    ".map.h5": _check_store(load_schema("map")),
    ".fixes.h5": _check_store(load_schema("fixes")),
    ".fixes.csv": _check_fixes_csv,
    ".vehicle.toml": _check_vehicle,
}
