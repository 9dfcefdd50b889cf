"""The record of a worked field: there and back, and what is damaged or foreign refused in one line."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from drawn_record import made_record
from lgprjax.errors import InputError
from lgprjax.formats import check_file, load_schema, read_worked, stop_words, write_worked


def _same(one: Any, other: Any) -> None:
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif hasattr(one, "_fields"):
        for name in one._fields:
            _same(getattr(one, name), getattr(other, name))
    else:
        assert one == other


@pytest.mark.parametrize("empty", [False, True])
def test_what_is_written_is_read_again(tmp_path: Path, empty: bool) -> None:
    record, path = made_record(empty=empty), tmp_path / "r.worked.h5"
    write_worked(path, record)
    _same(read_worked(path), record)
    assert check_file(path) == []
    with pytest.raises(InputError, match="one that exists"):
        write_worked(path, record)


def test_anyone_can_read_it_by_the_schema(tmp_path: Path) -> None:
    record, path = made_record(), tmp_path / "r.worked.h5"
    write_worked(path, record)
    with h5py.File(path) as store:
        for entry in load_schema("worked").datasets:
            assert store[entry.path].dtype.name == entry.dtype[0]
        probability = store["cells/probability"][()] / 65535
        np.testing.assert_array_equal(store["cells/state"][0] == 2, probability >= store["cells/level"][0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.__delitem__("/cells/probability"), "/cells/probability: expected a dataset, found none"),
        (lambda s: s.attrs.__setitem__("cell_m", -0.1), "/@cell_m: expected a number, finite, above zero, found -0.1"),
        (lambda s: s.attrs.__setitem__("schema", "lgprjax.map"), "@schema: expected lgprjax.worked"),
        (lambda s: s.attrs.__setitem__("schema_version", "2.0"), "update lgprjax"),
        (lambda s: s.attrs.__setitem__("provenance", '{"runs": []}'), "/@provenance: expected every run"),
        (lambda s: s.attrs.__setitem__("provenance", "{}"), "/@provenance: expected every run"),
        (lambda s: s["/time/time_s"].__setitem__(0, np.nan), "/time/time_s: expected finite values"),
        (lambda s: s["/events/text"].__setitem__(-1, 32), "/events/text: expected 2 lines, one an event, found 1"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "r.worked.h5"
    write_worked(path, made_record())
    with h5py.File(path, "r+") as store:
        change(store)
    with pytest.raises(InputError) as refused:
        read_worked(path)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_foreign_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.worked.h5"
    write_worked(path, made_record())
    whole = path.read_bytes()
    for data, message in ((b"", "an empty file"), (b"PK" * 500, "another format"), (whole[: len(whole) // 2], "cut")):
        path.write_bytes(data)
        with pytest.raises(InputError, match=message):
            read_worked(path)
    with pytest.raises(InputError, match="a readable file"):
        read_worked(tmp_path / "none.worked.h5")


def test_a_record_that_breaks_the_schema_is_not_written(tmp_path: Path) -> None:
    record = made_record()
    broken = record._replace(channels=record.channels._replace(time_s=record.channels.time_s * np.nan))
    with pytest.raises(InputError, match="/time/time_s: expected finite values"):
        write_worked(tmp_path / "r.worked.h5", broken)
    assert list(tmp_path.iterdir()) == []


def test_reasons_are_told_in_words() -> None:
    assert stop_words(0) == "none"
    assert stop_words(2 | 8) == "edge of the field predicted crossed, position too uncertain"
    assert stop_words(1 | 1 << 15) == "operator or remote link, reason 0x8000"
