"""The record of a worked field ``X.worked.h5``: written whole, read and held against ``data_schema/worked.toml``."""

import json
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np

from lgprjax.coverage import Tool
from lgprjax.errors import InputError
from lgprjax.formats.hdf5_output import create_store
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, open_store, reading, validate_store, write_array, write_attribute
from lgprjax.formats.worked_record import (
    CoverChannels,
    CoverEvents,
    CoverPasses,
    CoverStops,
    CoverSwaths,
    WorkedCells,
    WorkedRecord,
)
from lgprjax.frames import LocalFrame

_SCHEMA = load_schema("worked")
_PLACED = ("run", "time_s", "east_m", "north_m")
_Table = TypeVar("_Table", CoverChannels, CoverPasses, CoverStops)


def write_worked(path: str | Path, record: WorkedRecord, *, force: bool = False) -> None:
    """Write a record.

    Raises:
        InputError: something in it is not as the schema says, or the output exists (without ``force``) or cannot be
            written. Nothing is left behind then.
    """
    cells, frame = record.cells, record.frame
    attributes: dict[str, str | float] = {
        "name": record.name,
        "provenance": json.dumps(record.provenance),
        "t0_utc": record.t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "cell_m": cells.cell_m,
        "east_m": cells.east_m,
        "north_m": cells.north_m,
        **{f"tool_{name}": value for name, value in record.tool._asdict().items()},
    }
    events = record.events
    arrays: dict[str, np.ndarray] = {
        "/field/perimeter_m": record.perimeter_m,
        "/cells/probability": cells.probability,
        "/cells/level": cells.level,
        "/cells/state": cells.state,
        "/swaths/pass": record.swaths.number,
        "/swaths/east_m": record.swaths.east_m,
        "/swaths/north_m": record.swaths.north_m,
        **{f"/events/{name}": getattr(events, name) for name in _PLACED},
        "/events/text": np.frombuffer("".join(f"{line}\n" for line in events.text).encode(), np.uint8),
    }
    for group, table in (("time", record.channels), ("passes", record.passes), ("stops", record.stops)):
        arrays |= {f"/{group}/{name}": values for name, values in table._asdict().items()}
    with create_store(path, _SCHEMA, force) as (store, _):
        for name, value in attributes.items():
            write_attribute(store, name, value)
        for each in _SCHEMA.groups:
            store.create_group(each.path)
        for place, values in arrays.items():
            write_array(store, _SCHEMA, place, values)
        for finding in validate_store(store, path, _SCHEMA, bulk=True):
            if finding.severity == "error":
                raise finding.error()


def read_worked(path: str | Path) -> WorkedRecord:
    """A record from its file.

    Raises:
        InputError: the file is missing, damaged, of another format or of a newer major version; something in it is not
            as the schema says.
    """
    file = Path(path)
    with open_store(file) as store:
        for finding in validate_store(store, file, _SCHEMA):
            if finding.severity == "error":
                raise finding.error()
        with reading(file, "contents"):
            return _record(store, file)


def _record(store: h5py.File, file: Path) -> WorkedRecord:
    text = store["events/text"][()].tobytes().decode("utf-8", "replace").split("\n")[:-1]
    events = len(store["events/run"])
    if len(text) != events:
        raise InputError(file, "/events/text", f"{events} lines, one an event", str(len(text)))
    runs = np.concatenate([store[f"{group}/run"][()] for group in ("time", "passes", "stops", "events")])
    provenance: dict[str, Any] = json.loads(str(attribute_of(store, "provenance")))
    told = provenance.get("runs")
    if not isinstance(told, list) or (len(runs) and runs.max() >= len(told)):
        found = len(told) if isinstance(told, list) else "none"
        raise InputError(file, "/@provenance", "every run that the record names", f"{found}")
    return WorkedRecord(
        name=str(attribute_of(store, "name")),
        frame=LocalFrame(*(_number(store, f"anchor_{name}") for name in ("latitude_deg", "longitude_deg", "height_m"))),
        perimeter_m=store["field/perimeter_m"][()],
        tool=Tool(*(_number(store, f"tool_{name}") for name in Tool._fields)),
        t0_utc=str(attribute_of(store, "t0_utc")),
        cells=WorkedCells(
            east_m=_number(store, "east_m"),
            north_m=_number(store, "north_m"),
            cell_m=_number(store, "cell_m"),
            probability=store["cells/probability"][()],
            level=store["cells/level"][()],
            state=store["cells/state"][()],
        ),
        channels=_table(CoverChannels, store["time"]),
        passes=_table(CoverPasses, store["passes"]),
        swaths=CoverSwaths(*(store[f"swaths/{name}"][()] for name in ("pass", "east_m", "north_m"))),
        stops=_table(CoverStops, store["stops"]),
        events=CoverEvents(**{name: store[f"events/{name}"][()] for name in _PLACED}, text=tuple(text)),
        provenance=provenance,
    )


def _table(kind: type[_Table], group: h5py.Group) -> _Table:
    return kind(**{name: group[name][()] for name in kind._fields})


def _number(store: h5py.File, name: str) -> float:
    # The schema has seen to it that it is one.
    return float(str(attribute_of(store, name)))
