"""The file formats as data: ``data_schema/*.toml`` as typed entries shared by readers, writers and checks."""

import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from lgprjax.errors import InputError
from lgprjax.files import schema_text


@dataclass(frozen=True)
class Entry:
    """One dataset, attribute, table column or key of a file.

    Attributes:
        path: place of the entry: ``/radar/time_s``, ``/radar/traces@zero_level``, a column name, ``steering.lag_s``.
        dtype: accepted types, the first of which is written.
        dims: axis names (bound to one size through the whole file) or fixed sizes.
        checks: names of checks: finite, increasing, decreasing, non_negative, positive.
        bounds: closed range of the values.
        choices: allowed values of a text.
        needs: path whose presence makes this entry required.
        bulk: whether the entry is too large to be loaded whole.
        severity: severity of a failed check.
        decimals: decimals of a printed table column.
        digits: significant digits of a column that spans decades.
    """

    path: str
    dtype: tuple[str, ...]
    description: str
    unit: str = ""
    dims: tuple[str | int, ...] = ()
    required: bool = True
    needs: str | None = None
    checks: tuple[str, ...] = ()
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    bulk: bool = False
    severity: str = "error"
    decimals: int | None = None
    digits: int | None = None


@dataclass(frozen=True)
class Schema:
    """One file format. ``minimum`` gives the smallest size of an axis, by default one."""

    name: str
    version: str
    suffix: str
    description: str
    groups: tuple[Entry, ...]
    datasets: tuple[Entry, ...]
    attributes: tuple[Entry, ...]
    columns: tuple[Entry, ...]
    keys: tuple[Entry, ...]
    one_of: tuple[tuple[str, ...], ...]
    minimum: dict[str, int]

    @property
    def major(self) -> int:
        """Major version: a file of a newer one is unreadable for older software."""
        return int(self.version.split(".")[0])

    def dataset(self, path: str) -> Entry:
        """Entry of a dataset by its path; ``KeyError`` if the format has none."""
        for entry in self.datasets:
            if entry.path == path:
                return entry
        raise KeyError(path)


def _entry(table: dict[str, Any]) -> Entry:
    fields = dict(table)
    fields["needs"] = fields.pop("with", None)
    fields["bounds"] = tuple(fields.pop("range")) if "range" in fields else None
    for name in ("dtype", "dims", "checks", "choices"):
        fields[name] = tuple(fields.get(name, ()))
    return Entry(**fields)


@lru_cache
def load_schema(name: str) -> Schema:
    """Schema of ``drive``, ``map``, ``fixes``, ``route`` or ``vehicle``."""
    table = tomllib.loads(schema_text(name))

    def entries(key: str) -> tuple[Entry, ...]:
        return tuple(_entry(item) for item in table.get(key, ()))

    columns = entries("column")
    # A table's columns are the datasets of its HDF5 form.
    as_datasets = tuple(replace(column, path=f"/{column.path}", dims=("scan",)) for column in columns)
    return Schema(
        name=table["schema"],
        version=table["version"],
        suffix=table["suffix"],
        description=table["description"],
        groups=entries("group"),
        datasets=as_datasets + entries("dataset"),
        attributes=entries("attribute"),
        columns=columns,
        keys=entries("key"),
        one_of=tuple(tuple(paths) for paths in table.get("one_of", ())),
        minimum=table.get("minimum", {}),
    )


# Validation of values against the entries of a schema; every problem becomes one finding.

_ORDER = {"increasing": "strictly increasing values", "decreasing": "strictly decreasing values"}


@dataclass(frozen=True)
class Finding:
    """One mismatch of a file with its schema. Only a finding of severity error makes it unusable."""

    file: str
    place: str
    expected: str
    found: str
    severity: Literal["error", "warning"] = "error"

    def __str__(self) -> str:
        return f"{self.severity}: {self.error()}"

    def error(self) -> InputError:
        """The finding as the exception a reader raises."""
        return InputError(self.file, self.place, self.expected, self.found)


@dataclass
class Tally:
    """Checks of an array's values, block by block, so that memory stays bounded on large files."""

    entry: Entry
    size: int = 0
    bad: dict[str, tuple[int, int]] | None = None
    last: float | None = None

    def add(self, values: np.ndarray) -> None:
        """Count the values of the next block that fail a check. Arrays of several axes are counted flat."""
        flat = values.reshape(-1)
        bad = self.bad if self.bad is not None else {}
        finite = np.ones(flat.shape, dtype=bool) if flat.dtype.kind in "SU" else np.isfinite(flat)
        # NaN means "no value" unless the schema requires finite values; ranges do not apply to it.
        for check, failed in self._failures(flat, finite):
            if np.any(failed):
                count, first = bad.get(check, (0, self.size + int(np.argmax(failed))))
                bad[check] = (count + int(np.count_nonzero(failed)), first)
        self.bad = bad
        self.size += flat.size
        if flat.size and flat.dtype.kind not in "cSU":
            self.last = float(flat[-1])

    def _failures(self, flat: np.ndarray, finite: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        checks = self.entry.checks
        if self.entry.choices:
            texts = np.char.decode(flat, "latin-1") if flat.dtype.kind == "S" else flat
            yield "one of " + ", ".join(self.entry.choices), ~np.isin(texts, self.entry.choices)
        if "finite" in checks:
            yield "finite values", ~finite
        if "positive" in checks:
            yield "values above zero", finite & ~(flat > 0)
        if "non_negative" in checks:
            yield "values of zero or more", finite & (flat < 0)
        if self.entry.bounds is not None:
            low, high = self.entry.bounds
            yield f"values from {low:g} to {high:g}", finite & ((flat < low) | (flat > high))
        for name, sign in (("increasing", 1.0), ("decreasing", -1.0)):
            if name in checks:
                before = np.concatenate([[-sign * np.inf if self.last is None else self.last], flat[:-1]])
                both = finite & ~np.isnan(before)
                yield _ORDER[name], both & ~(sign * flat > sign * before)

    def findings(self, file: str, place: str) -> Iterator[Finding]:
        """One finding a failed check: the number of values, and the place of the first."""
        for expected, (count, first) in (self.bad or {}).items():
            found = f"{count} of {self.size} other values, the first at index {first}"
            yield Finding(file, place, expected, found, "warning" if self.entry.severity == "warning" else "error")


def check_scalar(entry: Entry, value: object) -> str | None:
    """Problem of one attribute or key of a file, or ``None``."""
    kind = entry.dtype[0]
    problem: str | None = None
    if kind == "number":
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
            return f"{value!r}"
        tally = Tally(entry)
        tally.add(np.asarray([value], dtype=np.float64))
        return f"{float(value):g}" if tally.bad else None
    if kind == "boolean":
        return None if isinstance(value, bool) else f"{value!r}"
    if not isinstance(value, str):
        return f"{value!r}"
    if entry.choices and value not in entry.choices:
        problem = f"{value!r}"
    elif kind == "utc":
        try:
            offset = datetime.fromisoformat(value).utcoffset()
        except ValueError:
            return f"{value!r}"
        problem = None if offset in (None, timedelta(0)) else f"{value!r}"
    elif kind == "json":
        try:
            problem = None if isinstance(json.loads(value), dict) else "JSON that is not an object"
        except json.JSONDecodeError as error:
            problem = f"text that is not JSON ({error.msg})"
    return problem


def expected_scalar(entry: Entry) -> str:
    """The expected value of an attribute or key, in words."""
    words = {
        "number": "a number",
        "string": "a text",
        "boolean": "true or false",
        "utc": "a UTC time in ISO 8601",
        "json": "a JSON object",
    }
    parts = [words[entry.dtype[0]]]
    parts += [{"finite": "finite", "positive": "above zero", "non_negative": "zero or more"}[c] for c in entry.checks]
    if entry.bounds is not None:
        parts.append(f"from {entry.bounds[0]:g} to {entry.bounds[1]:g}")
    if entry.choices:
        parts.append("one of " + ", ".join(entry.choices))
    return ", ".join(parts)


_KINDS = {
    "lgprjax.drive": "a drive log",
    "lgprjax.map": "a subsurface database",
    "lgprjax.fixes": "a file of fixes",
    "lgprjax.worked": "a worked-area record",
}
"""Files that are easily mistaken for each other."""


def check_version(schema: Schema, name: object, version: object) -> tuple[str, str, str] | None:
    """Place, expected and found when a file is of another format, or newer than this software reads."""
    if name != schema.name:
        wanted, kind = _KINDS.get(schema.name), _KINDS.get(str(name))
        expected = schema.name + (f", {wanted}" if wanted else "")
        if name is None and schema.suffix.endswith(".toml"):
            return "schema", f'schema = "{schema.name}" and schema_version = "{schema.version}" at the top', "none"
        if name is None:
            return "@schema", expected, "none: another program wrote this file"
        return "@schema", expected, f"{name!r}" + (f", which is {kind}" if kind else "")
    major, _, minor = str(version).partition(".")
    if not (major.isdecimal() and minor.isdecimal()):
        return "@schema_version", f"a version such as {schema.version}", "none" if version is None else f"{version!r}"
    if int(major) > schema.major:
        return "@schema_version", f"version {schema.major}.x or older (update lgprjax)", str(version)
    return None


def key_findings(schema: Schema, file: str, values: dict[str, object]) -> Iterator[Finding]:
    """Every key of a text file that is missing, wrong or unknown, in the schema's order, without lists.

    Args:
        schema: schema of the keys.
        file: name of the file in the findings.
        values: values by dotted path, without schema and version.
    """
    left = dict(values)
    for entry in schema.keys:
        if entry.path in left:
            problem = check_scalar(entry, left.pop(entry.path))
        else:
            problem = "none" if entry.required else None
        if problem is not None:
            yield Finding(file, entry.path, expected_scalar(entry), problem)
    for key in left:
        yield Finding(file, key, f"a key of data_schema/{schema.name.rpartition('.')[2]}.toml", "an unknown key")
