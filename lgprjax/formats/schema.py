"""The file formats as data: loads ``data_schema/*.toml`` into typed entries that readers, writers and checks share."""

import tomllib
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Entry:
    """One dataset, attribute, table column or key of a file.

    Attributes:
        path: where it stands: ``/radar/time_s``, ``/radar/traces@zero_level``, a column name, ``steering.lag_s``.
        dtype: accepted types, the first being the one that is written.
        dims: axis names (bound to one size through the whole file) or fixed sizes.
        checks: among finite, increasing, decreasing, non_negative, positive.
        bounds: closed range of the values.
        choices: allowed values of a text.
        needs: path whose presence makes this entry required.
        bulk: too large to be loaded whole.
        severity: how bad a value that fails a check is.
        decimals: how a table column is printed; digits: the same for one that spans decades.
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
    """One file format. ``minimum`` gives the smallest size of an axis, one where it says nothing."""

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
        """Version number whose growth makes a file unreadable for older software."""
        return int(self.version.split(".")[0])

    def dataset(self, path: str) -> Entry:
        """Entry of a dataset by its path; ``KeyError`` when the format has none such."""
        for entry in self.datasets:
            if entry.path == path:
                return entry
        raise KeyError(path)


def schema_text(name: str) -> str:
    """Text of ``data_schema/NAME.toml``: from the installed package, or from the source tree beside it."""
    packaged = resources.files("lgprjax").joinpath("data_schema", f"{name}.toml")
    if packaged.is_file():
        return packaged.read_text(encoding="utf-8")
    source_tree = Path(__file__).resolve().parents[2] / "data_schema" / f"{name}.toml"
    return source_tree.read_text(encoding="utf-8")


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
