"""Fixes of a drive: a CSV for users and an HDF5 file next to it, both by ``data_schema/fixes.toml``."""

import csv
import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats.schema import Entry, Finding, Tally, load_schema
from lgprjax.formats.store import (
    atomic_output,
    attribute_of,
    create_store,
    open_store,
    reading,
    validate_store,
    write_array,
    write_attribute,
)

_SCHEMA = load_schema("fixes")
_BLOCK_ROWS = 8192
COLUMNS = tuple(entry.path for entry in _SCHEMA.columns if entry.required)


def write_fixes(
    csv_path: str | Path,
    h5_path: str | Path,
    table: pd.DataFrame,
    *,
    attributes: Mapping[str, object],
    pose_m: Float[np.ndarray, "scan 5"] | None = None,
    covariance: Float[np.ndarray, "scan 5 5"] | None = None,
    force: bool = False,
) -> None:
    """Write the fixes of a drive as CSV and as HDF5; both appear, or neither.

    Args:
        csv_path, h5_path: paths of the outputs.
        table: one row per scan with the schema's columns; optional ones may be missing. NaN means no value.
        attributes: root attributes of the HDF5 file: texts and numbers as such, anything else as JSON.
        pose_m: east_m, north_m, height_m, yaw_rad, roll_rad in the map frame.
        covariance: covariance of ``pose_m``, in its order.
        force: whether to replace existing outputs.

    Raises:
        InputError: an output exists or cannot be written, or the table does not match the schema.
    """
    unknown = [str(name) for name in table.columns if name not in {entry.path for entry in _SCHEMA.columns}]
    if unknown:
        raise InputError(csv_path, "columns", "the columns of data_schema/fixes.toml", ", ".join(unknown))
    for finding in table_findings(csv_path, table):
        raise finding.error()
    entries = [entry for entry in _SCHEMA.columns if entry.path in table.columns]
    with atomic_output(csv_path, force) as temporary, create_store(h5_path, _SCHEMA, force) as (store, _):
        with temporary.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([entry.path for entry in entries])
            for start in range(0, len(table), _BLOCK_ROWS):
                block = table.iloc[start : start + _BLOCK_ROWS]
                writer.writerows(zip(*(_cells(block[e.path], e) for e in entries), strict=True))
        for entry in entries:
            write_array(store, _SCHEMA, f"/{entry.path}", table[entry.path].to_numpy())
        for path, array in (("/pose_m", pose_m), ("/covariance", covariance)):
            if array is not None:
                write_array(store, _SCHEMA, path, array)
        for name, value in attributes.items():
            write_attribute(store, name, value if isinstance(value, str | int | float) else json.dumps(value))
        for finding in validate_store(store, h5_path, _SCHEMA):
            raise finding.error()


def read_fixes(path: str | Path) -> pd.DataFrame:
    """Read fixes from ``.fixes.csv`` or ``.fixes.h5``; the latter's root attributes are in ``.attrs``.

    Raises:
        InputError: the file is missing, damaged or does not match the schema.
    """
    table = _read_csv(Path(path)) if Path(path).suffix.lower() == ".csv" else _read_h5(path)
    for finding in table_findings(path, table):
        raise finding.error()
    return table


def read_fix_poses(
    path: str | Path,
) -> tuple[Float[np.ndarray, "scan 5"] | None, Float[np.ndarray, "scan 5 5"] | None]:
    """``pose_m`` and ``covariance`` of a ``.fixes.h5`` file; ``None`` for missing ones."""
    with open_store(path) as store:
        for finding in validate_store(store, path, _SCHEMA):
            raise finding.error()
        with reading(path, "/pose_m"):
            pose_m, covariance = (store[n][()] if n in store else None for n in ("/pose_m", "/covariance"))
    return pose_m, covariance


def drive_hash_of(table: pd.DataFrame) -> str | None:
    """SHA-256 of the fixes' drive log, if their file states it."""
    with suppress(ValueError, TypeError, KeyError):
        return str(json.loads(table.attrs["provenance"])["drive"]["sha256"])
    return None


def refuse_other_drive(path: str | Path, table: pd.DataFrame, drive: Path) -> None:
    """Raise ``InputError`` if the provenance of the fixes in ``path`` names another file than ``drive``."""
    known = drive_hash_of(table)
    if known is not None and known != file_hash(drive):
        raise InputError(path, "provenance", f"fixes of the current {drive.name}", "fixes of another drive log")


def table_findings(path: str | Path, table: pd.DataFrame) -> Iterator[Finding]:
    """Schema violations of a table of fixes."""
    file = str(path)
    if table.empty:
        yield Finding(file, "rows", "at least one fix", "none")
    for entry in _SCHEMA.columns:
        if entry.path not in table.columns:
            if entry.required:
                yield Finding(file, f"column {entry.path}", "a column", "none")
            continue
        column = table[entry.path]
        kinds = {"int64": "iu", "float64": "iuf"}.get(entry.dtype[0])
        if kinds is not None and column.dtype.kind not in kinds:
            yield Finding(file, f"column {entry.path}", f"type {entry.dtype[0]}", f"type {column.dtype}")
            continue
        tally = Tally(entry)
        tally.add(column.astype(str).to_numpy(dtype=str) if kinds is None else column.to_numpy())
        yield from tally.findings(file, f"column {entry.path}")


def read_cells(path: Path) -> pd.DataFrame:
    """Cells of a CSV as text. Raises ``InputError`` if it is not a table."""
    try:
        return pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8")
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except pd.errors.EmptyDataError:
        raise InputError(path, "file", "a table of fixes", "an empty file") from None
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise InputError(path, "file", "a table of fixes", str(error)) from None


def parse_cells(path: Path, cells: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Numbers and codes of the cells; a column with an invalid number is left out and becomes a finding."""
    findings = []
    header = [str(name) for name in cells.columns]
    if tuple(header[: len(COLUMNS)]) != COLUMNS:
        findings.append(Finding(str(path), "header", ",".join(COLUMNS), ",".join(header)))
    columns: dict[str, Any] = {}
    for entry in _SCHEMA.columns:
        if entry.path not in header:
            continue
        texts = cells[entry.path]
        if entry.choices:
            columns[entry.path] = texts
            continue
        empty = (texts == "").to_numpy()
        numbers = pd.to_numeric(texts.where(~empty), errors="coerce")
        wrong = numbers.isna().to_numpy() & (~empty | (entry.dtype == ("int64",)))
        if entry.dtype == ("int64",):
            wrong |= np.mod(numbers.to_numpy(np.float64), 1) != 0
        if np.any(wrong):
            row = int(np.argmax(wrong))
            place = f"column {entry.path}, row {row}"
            kind = "a whole number" if entry.dtype == ("int64",) else "a number or an empty cell"
            findings.append(Finding(str(path), place, kind, repr(str(texts.iloc[row]))))
        else:
            columns[entry.path] = numbers.to_numpy(entry.dtype[0])
    return pd.DataFrame(columns), findings


def _read_csv(path: Path) -> pd.DataFrame:
    table, findings = parse_cells(path, read_cells(path))
    for finding in findings:
        raise finding.error()
    return table


def _read_h5(path: str | Path) -> pd.DataFrame:
    with open_store(path) as store:
        for finding in validate_store(store, path, _SCHEMA):
            raise finding.error()
        with reading(path, "columns"):
            columns = {entry.path: store[entry.path][()] for entry in _SCHEMA.columns if entry.path in store}
        attributes: dict[Any, Any] = {name: attribute_of(store, name) for name in store.attrs}
    table = pd.DataFrame({n: v.astype(str) if v.dtype.kind == "S" else v for n, v in columns.items()})
    table.attrs = attributes
    return table


def _cells(column: pd.Series, entry: Entry) -> list[str]:
    if entry.decimals is None and entry.digits is None:
        return [str(value) for value in column.tolist()]
    form = f".{entry.digits}g" if entry.decimals is None else f".{entry.decimals}f"
    return ["" if value != value else format(value, form) for value in column.tolist()]
