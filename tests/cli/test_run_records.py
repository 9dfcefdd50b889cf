"""Times of a run: each from the records that it is made of, while the vehicle tracks."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from lgprjax.run_records import FIX, PLAN, Record, RecordKind, Source, pack
from lgprjax.simulation.run_figures import read_records, timing_of

MS = 1_000_000
RADAR_SCAN = bytes([0, 0, 0, 0x12])


def fix(scan_ms: float) -> bytes:
    row = np.zeros(1, FIX)
    row["scan_ns"] = scan_ms * MS
    return row.tobytes()


def plan(mode: int, speed_mps: float) -> bytes:
    row = np.zeros(1, PLAN)
    row["mode"], row["speed_mps"] = mode, speed_mps
    return row.tobytes()


def told() -> list[tuple[RecordKind, Source, int, float, bytes]]:
    """Standing, then engaged, then moving (backwards) as well; kind, source, tick, time in ms, payload."""
    return [
        (RecordKind.TICK, Source.CONTROL, 1, 900.0, b""),
        (RecordKind.PLAN, Source.CONTROL, 1, 905.0, plan(2, 0.0)),
        (RecordKind.PORT_IN, Source.RADAR, 0, 910.0, RADAR_SCAN),
        (RecordKind.FIX, Source.REGISTRATION, 0, 930.0, fix(908.0)),
        (RecordKind.TICK, Source.CONTROL, 2, 940.0, b""),
        (RecordKind.FIX, Source.CONTROL, 2, 941.0, fix(908.0)),
        (RecordKind.PLAN, Source.CONTROL, 2, 945.0, plan(4, 0.0)),
        (RecordKind.PORT_IN, Source.RADAR, 0, 1010.0, RADAR_SCAN),
        (RecordKind.FIX, Source.REGISTRATION, 0, 1026.0, fix(1008.0)),
        (RecordKind.TICK, Source.CONTROL, 3, 1060.0, b""),
        (RecordKind.FIX, Source.CONTROL, 3, 1061.0, fix(1008.0)),
        # Of a tick that was not recorded.
        (RecordKind.FIX, Source.CONTROL, 9, 1061.0, fix(1008.0)),
        (RecordKind.PLAN, Source.CONTROL, 3, 1062.0, plan(4, -2.0)),
        (RecordKind.MONITOR, Source.MONITOR, 3, 1063.0, b'{"rss_mb": {"a": 200.0, "b": null, "c": 100.0}}'),
    ]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> list[tuple[RecordKind, Source, int, float, bytes]]:
    rows = told()

    def read(_: Path) -> Iterator[tuple[int, bytes]]:
        for number, (kind, source, tick, at_ms, payload) in enumerate(rows):
            yield number, pack(Record(kind, source, tick, int(at_ms * MS), payload))

    monkeypatch.setattr("lgprjax.formats.read_run", read)
    return rows


@pytest.mark.usefixtures("run")
def test_times_count_from_the_scan_and_only_while_tracking() -> None:
    records = read_records(Path("run"))
    assert (records.scans, len(records.fixes), len(records.plans)) == (2, 2, 3)
    np.testing.assert_allclose(records.period_ms, [40.0, 120.0])
    np.testing.assert_allclose(records.fix_ms, [18.0])
    np.testing.assert_allclose(records.command_ms, [52.0])
    np.testing.assert_allclose(records.memory, [[1.063, 300.0]])
    search, command, period = timing_of(records, "a run").stages
    assert command.deadline_ms == 100.0
    np.testing.assert_allclose([*search.milliseconds, *command.milliseconds], [18.0, 52.0])
    np.testing.assert_array_equal(period.milliseconds, records.period_ms)


def test_an_older_run_tells_the_same_times(run: list[tuple[RecordKind, Source, int, float, bytes]]) -> None:
    new = read_records(Path("run"))
    # Its fixes end before the probability of a false match.
    run[:] = [(*row[:4], row[4][:-4]) if row[0] is RecordKind.FIX else row for row in run]
    old = read_records(Path("run"))
    np.testing.assert_array_equal(old.fix_ms, new.fix_ms)
    np.testing.assert_array_equal(old.command_ms, new.command_ms)
    assert np.isnan(old.fixes["p_false"]).all()


def test_a_run_without_a_plan_has_no_time_of_tracking(run: list[tuple[RecordKind, Source, int, float, bytes]]) -> None:
    run[:] = [row for row in run if row[0] is not RecordKind.PLAN]
    records = read_records(Path("run"))
    assert len(records.fix_ms) == len(records.command_ms) == 0
    assert len(records.period_ms) == 2
    run.clear()
    assert len(read_records(Path("run")).period_ms) == 0
