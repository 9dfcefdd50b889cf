"""The record of a worked field: there and back, and what is damaged or foreign refused in one line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drawn_record import made_record
from lgprjax.formats import check_file, load_schema, read_worked, stop_words, write_worked
from refusals import refused


def _same(one: Any, other: Any) -> None:
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif hasattr(one, "_fields"):
        for name in one._fields:
            _same(getattr(one, name), getattr(other, name))
    else:
        assert one == other


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    for empty in (False, True):
        record, path = made_record(empty=empty), tmp_path / f"{empty}.worked.h5"
        write_worked(path, record)
        _same(read_worked(path), record)
        assert check_file(path) == []
        with refused("output", "--force"):
            write_worked(path, record)
    # Anyone can read it by the schema.
    record, path = made_record(), tmp_path / "False.worked.h5"
    with h5py.File(path) as store:
        for entry in load_schema("worked").datasets:
            assert store[entry.path].dtype.name == entry.dtype[0]
        probability = store["cells/probability"][()] / 65535
        np.testing.assert_array_equal(store["cells/state"][0] == 2, probability >= store["cells/level"][0])


_CHANGES: list[tuple[Callable[[Any], object], str, tuple[object, ...]]] = [
    (lambda s: s.__delitem__("/cells/probability"), "/cells/probability", ("none",)),
    (lambda s: s.attrs.__setitem__("cell_m", -0.1), "/@cell_m", (-0.1,)),
    (lambda s: s.attrs.__setitem__("schema", "lgprjax.map"), "@schema", ("lgprjax.worked",)),
    (lambda s: s.attrs.__setitem__("schema_version", "2.0"), "@schema_version", ("2.0",)),
    (lambda s: s.attrs.__setitem__("provenance", '{"runs": []}'), "/@provenance", ()),
    (lambda s: s["/time/time_s"].__setitem__(0, np.nan), "/time/time_s", ("1 of 40",)),
    (lambda s: s["/events/text"].__setitem__(-1, 32), "/events/text", (2, "1")),
]


def test_a_wrong_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.worked.h5"
    write_worked(path, made_record())
    whole = path.read_bytes()
    for change, place, values in _CHANGES:
        path.write_bytes(whole)
        with h5py.File(path, "r+") as store:
            change(store)
        with refused(place, *values, file=path):
            read_worked(path)


def test_foreign_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.worked.h5"
    write_worked(path, made_record())
    whole = path.read_bytes()
    for data in (b"", b"PK" * 500, whole[: len(whole) // 2]):
        path.write_bytes(data)
        with refused("file", "HDF5", file=path):
            read_worked(path)
    with refused("file", file="none.worked.h5"):
        read_worked(tmp_path / "none.worked.h5")


def test_a_record_that_breaks_the_schema_is_not_written(tmp_path: Path) -> None:
    record = made_record()
    broken = record._replace(channels=record.channels._replace(time_s=record.channels.time_s * np.nan))
    with refused("/time/time_s", "40 of 40"):
        write_worked(tmp_path / "r.worked.h5", broken)
    assert list(tmp_path.iterdir()) == []


def test_every_reason_of_a_stop_is_told() -> None:
    one, other = stop_words(2), stop_words(8)
    assert one != other
    assert stop_words(2 | 8) == f"{one}, {other}"
    assert stop_words(0) not in (one, other)
    assert "0x8000" in stop_words(1 | 1 << 15)
