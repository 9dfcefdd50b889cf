"""Recorded runs: whole ones come back; of cut and damaged ones every whole record, and none that was not recorded."""

import os
import random
import tomllib
import tracemalloc
from pathlib import Path
from uuid import UUID

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formats.run_log_sample import HEADS, RUN, data_of, head_bytes, own_bytes, record_bytes, write_run
from lgprjax import run_segment
from lgprjax.files import schema_text
from lgprjax.formats.run_log import DamagedBytes, MissingNumbers, read_run
from refusals import refused

_SECOND = 30  # records
_FIRST = HEADS + len(own_bytes(0, dropped={"control_log": 0}))


def test_a_whole_run(tmp_path: Path) -> None:
    held = write_run(tmp_path, segments=3, records=20)
    reading = read_run(tmp_path)
    assert dict(reading) == held
    assert [number for number, _ in reading] == sorted(held)
    summary = reading.summary
    assert summary.complete
    assert (summary.run, summary.segments, summary.records) == (RUN, 3, 60)
    assert (summary.first, summary.last, summary.end) == (0, 63, "ended")
    assert (summary.cut, summary.damaged, summary.missing) == ((), (), ())
    assert summary.dropped == {"control_log": 0}
    assert [head.segment for head in reading.heads] == [0, 1, 2]
    assert reading.heads[0].utc_ns == 1_800_000_000_000_000_000


def test_what_is_written_is_by_the_specification() -> None:
    table = tomllib.loads(schema_text("run_log"))
    head = run_segment.SegmentHead(RUN.bytes, 3, 7, 8, 9)
    assert run_segment.pack_head(head) == head_bytes(3, 9, utc_ns=7, mono_ns=8)
    assert len(run_segment.pack_head(head)) == run_segment.HEADS_SIZE == HEADS
    packed = run_segment.pack_record(RUN.bytes, 5, 2, 5000, b"data")
    assert packed == record_bytes(5, b"data", origin=2)
    assert packed[:4] == bytes(table["record"]["sync"])
    assert tuple(table["record"]["origins"]) == run_segment.ORIGINS
    sizes = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "u8[4]": 4, "u8[8]": 8, "u8[16]": 16}
    assert sum(sizes[field["type"]] for field in table["record"]["head"]) == 25
    assert 2 * (sum(sizes[field["type"]] for field in table["segment"]["head"]) + 4) == HEADS
    assert table["segment"]["magic"].encode() == head_bytes(0, 0)[:8]
    with pytest.raises(ValueError, match="33554432"):
        run_segment.pack_record(RUN.bytes, 0, 1, 0, bytes(table["record"]["largest"] + 1))


class _Cuts:
    """A run of one segment that is cut again and again; what of it lies before a cut."""

    def __init__(self, folder: Path) -> None:
        self.held = write_run(folder, records=_SECOND + 10)
        self.folder, self.path = folder, folder / "0000.lgprun"
        self.whole = self.path.read_bytes()
        self.stops: dict[int, int] = {}
        stop = _FIRST
        for number, data in self.held.items():
            stop += len(record_bytes(number, data))
            self.stops[number] = stop

    def check(self, cut: int) -> None:
        """Every record before the cut is found, so all older than a second; none else; the place is told."""
        self.path.write_bytes(self.whole[:cut])
        reading = read_run(self.folder)
        found = dict(reading)
        due = [number for number, stop in self.stops.items() if stop <= cut]
        assert found == {number: self.held[number] for number in due}
        summary = reading.summary
        assert not summary.complete
        assert (summary.damaged, summary.missing) == ((), ())
        before = self.stops[due[-1]] if due else 0
        assert all(lost.stop == cut and lost.start >= before for lost in summary.cut)
        assert len(summary.cut) == (cut not in self.stops.values() and cut not in (0, HEADS, _FIRST, len(self.whole)))


def test_cut_at_every_byte_of_the_last_two_records(tmp_path: Path) -> None:
    cuts = _Cuts(tmp_path)
    for cut in range(sorted(cuts.stops.values())[-3], len(cuts.whole)):
        cuts.check(cut)
    # The last record of the run is the end that the recorder writes itself.
    assert cuts.whole.endswith(own_bytes(_SECOND + 11, end="ended"))


def test_cut_at_random_bytes(tmp_path: Path) -> None:
    cuts, rng = _Cuts(tmp_path), random.Random(7)
    for _ in range(150):
        cuts.check(rng.randrange(len(cuts.whole)))


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.lists(st.integers(0, 2**31), min_size=1, max_size=5), bits=st.integers(1, 255))
def test_flipped_bytes_lose_only_the_records_they_touch(tmp_path: Path, at: list[int], bits: int) -> None:
    held = write_run(tmp_path, segments=2, records=30)
    touched: set[int] = set()
    path = tmp_path / "0000.lgprun"
    data = bytearray(path.read_bytes())
    for place in {each % len(data) for each in at}:
        data[place] ^= bits
        stop = _FIRST
        for number in range(1, 31):
            start, stop = stop, stop + len(record_bytes(number, held[number]))
            touched |= {number} if start <= place < stop else set()
    path.write_bytes(data)
    reading = read_run(tmp_path)
    assert dict(reading) == {number: held[number] for number in held if number not in touched}
    summary = reading.summary
    assert summary.damaged or summary.cut
    assert sum(one.last - one.first + 1 for one in summary.missing) >= len(touched)
    assert not touched or not summary.complete


@pytest.mark.parametrize("junk", [b"\x9dRec" * 50, b"\x9dRec" + b"\xff" * 21, bytes(3000)])
def test_bytes_of_others_between_records(tmp_path: Path, junk: bytes) -> None:
    tmp_path.joinpath("0000.lgprun").write_bytes(
        head_bytes(0, 0) + record_bytes(0, b"a") + junk + record_bytes(1, b"b") + own_bytes(2, end="ended")
    )
    reading = read_run(tmp_path)
    assert dict(reading) == {0: b"a", 1: b"b"}
    start = HEADS + len(record_bytes(0, b"a"))
    assert reading.summary.damaged == (DamagedBytes("0000.lgprun", start, start + len(junk)),)
    assert reading.summary.complete


def test_records_of_an_older_run_are_none_of_this(tmp_path: Path) -> None:
    old = record_bytes(1, b"old", run=UUID(int=5))
    again = record_bytes(0, b"again")
    parts = [head_bytes(0, 0), record_bytes(0, b"a"), old, again, record_bytes(2, b"c")]
    (tmp_path / "0000.lgprun").write_bytes(b"".join(parts))
    reading = read_run(tmp_path)
    assert dict(reading) == {0: b"a", 2: b"c"}
    assert reading.summary.missing == (MissingNumbers(1, 1),)
    assert reading.summary.end is None
    # A record within another's data is data.
    inner = record_bytes(1, b"inner")
    (tmp_path / "0000.lgprun").write_bytes(head_bytes(0, 0) + record_bytes(0, inner) + record_bytes(1, b"outer"))
    assert dict(read_run(tmp_path)) == {0: inner, 1: b"outer"}


def test_heads_and_segments_that_are_gone(tmp_path: Path) -> None:
    held = write_run(tmp_path, segments=3, records=5)
    first = tmp_path / "0000.lgprun"
    first.write_bytes(bytes(HEADS) + first.read_bytes()[HEADS:])
    reading = read_run(tmp_path)
    # The others tell whose run it is.
    assert dict(reading) == held
    assert [head.segment for head in reading.heads] == [1, 2]
    (tmp_path / "0001.lgprun").unlink()
    reading = read_run(tmp_path)
    assert dict(reading) == {n: data for n, data in held.items() if not 6 <= n <= 11}
    assert reading.summary.missing == (MissingNumbers(6, 11),)
    (tmp_path / "0002.lgprun").unlink()
    reading = read_run(tmp_path)
    assert list(reading) == []
    assert reading.summary.run is None
    (tmp_path / "run.json").write_text(f'{{"uuid": "{RUN}"}}')
    assert dict(read_run(tmp_path)) == {n: held[n] for n in range(1, 6)}


def test_sectors_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = write_run(tmp_path, records=400)
    path = tmp_path / "0000.lgprun"
    whole, real = path.read_bytes(), os.pread

    def pread(file: int, size: int, at: int) -> bytes:
        if at < 8192 and at + size > 4096:
            raise OSError(5, "Input/output error")
        return real(file, size, at)

    monkeypatch.setattr(os, "pread", pread)
    found = dict(read_run(tmp_path))
    monkeypatch.undo()
    path.write_bytes(whole[:4096] + bytes(4096) + whole[8192:])
    assert found == dict(read_run(tmp_path))
    assert 300 < len(found) < len(held)


def test_what_is_no_run(tmp_path: Path) -> None:
    with refused("folder", file=tmp_path / "none"):
        read_run(tmp_path / "none")
    with refused("folder", "0000.lgprun", file=tmp_path):
        read_run(tmp_path)
    (tmp_path / "0000.lgprun").write_bytes(b"")
    assert list(read_run(tmp_path)) == []
    assert read_run(tmp_path).summary.end is None


def test_memory_stays_small(tmp_path: Path) -> None:
    (tmp_path / "0000.lgprun").write_bytes(
        head_bytes(0, 0) + b"".join(record_bytes(n, data_of(n, 4000)) for n in range(5000))
    )
    tracemalloc.start()
    assert sum(1 for _ in read_run(tmp_path)) == 5000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 << 20
