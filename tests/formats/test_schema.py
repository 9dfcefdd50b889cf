"""The schemas themselves: complete, consistent, and found in a source tree and in an installed package."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from lgprjax.files import schema_text
from lgprjax.formats import load_schema

_NAMES = ["drive", "map", "fixes", "route", "vehicle", "cover_plan", "worked"]
_CHECKS = {"finite", "increasing", "decreasing", "positive", "non_negative"}


@pytest.mark.parametrize("name", _NAMES)
def test_schema_is_complete(name: str) -> None:
    schema = load_schema(name)
    assert schema.name == f"lgprjax.{name}"
    # 1.7: where a body does not slip. Vehicle 1.4: body, channels, weak servo. Map 1.3: codes, places, weights, map's
    # chance. Fixes 1.1: p_false and window_m. Plan 2.1: the room of each side.
    versions = {"drive": "1.7", "vehicle": "1.4", "map": "1.3", "fixes": "1.1", "cover_plan": "2.1"}
    assert schema.version == versions.get(name, "1.0")
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


def test_csv_columns_are_the_contract() -> None:
    required = [entry.path for entry in load_schema("fixes").columns if entry.required]
    assert ",".join(required) == (
        "scan,time_s,latitude_deg,longitude_deg,height_m,heading_deg,roll_deg,"
        "sigma_along_m,sigma_cross_m,correlation,margin,overlap_channels,code"
    )


@pytest.mark.parametrize("name", _NAMES)
def test_text_is_found(name: str) -> None:
    assert tomllib.loads(schema_text(name))["schema"] == f"lgprjax.{name}"
    assert (Path(__file__).parents[2] / "data_schema" / f"{name}.toml").is_file()


def test_unknown_dataset() -> None:
    with pytest.raises(KeyError):
        load_schema("drive").dataset("/radar/echoes")
