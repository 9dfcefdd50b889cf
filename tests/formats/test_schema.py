"""The schemas themselves: complete, consistent, and found in a source tree and in an installed package."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from lgprjax.files import schema_text
from lgprjax.formats import load_schema

_CHECKS = {"finite", "increasing", "decreasing", "positive", "non_negative"}


@pytest.mark.parametrize("name", ["drive", "map", "fixes", "route", "vehicle", "cover_plan", "worked", "radar"])
def test_a_schema_is_found_and_consistent(name: str) -> None:
    assert tomllib.loads(schema_text(name))["schema"] == f"lgprjax.{name}"
    assert (Path(__file__).parents[2] / "data_schema" / f"{name}.toml").is_file()
    schema = load_schema(name)
    assert schema.name == f"lgprjax.{name}"
    entries = [*schema.datasets, *schema.attributes, *schema.columns, *schema.keys]
    paths = [entry.path for entry in entries]
    assert len(set(paths)) == len(paths)
    for entry in entries:
        assert entry.description, entry.path
        assert set(entry.checks) <= _CHECKS, entry.path
        assert entry.severity in ("error", "warning")
    for dataset in schema.datasets:
        assert dataset.dims, dataset.path
        for kind in dataset.dtype:
            assert kind == "string" or np.dtype(kind), dataset.path
        # A name that carries a unit carries the one that is stored.
        stem, _, unit = dataset.path.rpartition("_")
        if stem and unit in ("m", "s", "deg", "rad", "hz", "ns", "v"):
            assert dataset.unit.lower().startswith(unit), dataset.path
    for needed in (entry.needs for entry in schema.datasets if entry.needs):
        schema.dataset(needed)
    with pytest.raises(KeyError):
        schema.dataset("/radar/echoes")
