"""The index of an archive: its table, its sums and its worst places, against sums done by hand."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from archive_records import MAP_SHA256, cell, done, failed, figures
from lgprjax.batch import cell_sums, records_of, shares_of, sums_of, worst_places, write_table
from lgprjax.batch.jobs import CELL_M, figures_of, jobs_folder, read_record, write_record
from lgprjax.batch.register import RegisteredDrive
from lgprjax.batch.results import table_of

RECORDS = [
    done("a", figures({"ok": 30, "edge": 10}, rms_m=0.10), compiled=40),
    done("b", figures({"ok": 10, "no_window": 5}, rms_m=0.20, wrong=1, largest_m=0.5), compiled=3),
    done("c", figures({"off_map": 4}), worker="there:2"),
    failed("d", "d.drive.h5: file: expected x, found y"),
]


def test_sums_weigh_every_judged_fix_alike() -> None:
    sums = sums_of(RECORDS)
    assert (sums.drives, sums.failed, sums.scans, sums.tried) == (3, 1, 59, 54)
    assert sums.counts["ok"] == 40
    assert sums.counts["off_map"] == 4
    assert (sums.judged, sums.wrong, sums.largest_m) == (40, 1, 0.5)
    assert sums.rms_cross_m == pytest.approx(math.sqrt((30 * 0.10**2 + 10 * 0.20**2) / 40))
    assert sums.rms_along_m == pytest.approx(0.5 * math.sqrt((30 * 0.10**2 + 10 * 0.20**2) / 40))
    # Nothing known is said to be unknown.
    sums = sums_of([RECORDS[2]])
    assert (sums.wrong, sums.rms_cross_m, sums.largest_m) == (None, None, None)
    assert sums_of([]).milliseconds_per_scan is None


def test_shares_tell_what_each_process_compiled_and_when() -> None:
    first, second = shares_of(RECORDS)
    assert (first.worker, first.drives, first.compiled, first.late) == ("here:1", 2, 43, 1)
    assert (second.worker, second.late, second.peak_rss_mb) == ("there:2", 0, 500.0)


def test_the_table_has_a_row_a_job_and_blanks_for_what_failed(tmp_path: Path) -> None:
    table = pd.read_csv(write_table(tmp_path, RECORDS))
    assert list(table["drive"]) == ["a", "b", "c", "d"]
    assert list(table["state"]) == ["done", "done", "done", "failed"]
    assert table["ok_share"].iloc[0] == pytest.approx(0.75)
    assert table["edge"].iloc[0] == 10
    assert math.isnan(table["ok"].iloc[3])
    assert table["error"].iloc[3] == RECORDS[3].error
    assert table["error"].iloc[:3].isna().all()
    assert table["compiled"].iloc[0] == 40


def test_records_survive_the_disk_and_those_of_another_map_are_left_out(tmp_path: Path) -> None:
    jobs_folder(tmp_path).mkdir()
    there = done("e", figures({"ok": 3}, rms_m=0.1), cell(-3, 7, 20, 3, 0.1), cell(0, 0, 1, 1))
    for record in (*RECORDS, there, there.model_copy(update={"name": "f", "map_sha256": "o" * 64})):
        write_record(tmp_path, record)
    (jobs_folder(tmp_path) / "g.json").write_text('{"name": "cut sho')
    assert records_of(tmp_path, MAP_SHA256) == [*RECORDS, there]
    assert read_record(jobs_folder(tmp_path) / "g.json") is None


def test_wrong_fixes_come_before_missing_ones_and_right_places_are_not_named() -> None:
    cells = cell_sums(
        [
            done("a", figures({"ok": 1}), cell(0, 0, 20, 20, 0.1), cell(1, 0, 20, 5, 0.1, 3.0), cell(2, 0, 2, 0)),
            done("b", figures({"ok": 1}), cell(0, 0, 20, 20, 0.4, 7.5), cell(1, 0, 20, 15, 0.1, 4.0)),
            done("c", figures({"ok": 1}), cell(3, -1, 40, 4), cell(4, 0, 30, 30, 0.2)),
        ]
    )
    wrong, fewest, half = worst_places(cells)
    assert (wrong.drive, wrong.time_s, wrong.cell.tried, wrong.cell.ok) == ("b", 7.5, 40, 40)
    assert wrong.cell.largest_m == 0.4
    assert wrong.cell.square_m2 == pytest.approx(20 * 0.1**2 + 20 * 0.4**2)
    assert (fewest.drive, fewest.cell.ok, fewest.east_m, fewest.north_m) == ("c", 4, 3.5 * CELL_M, -0.5 * CELL_M)
    assert (half.drive, half.time_s, half.cell.tried, half.cell.ok) == ("a", 3.0, 40, 20)
    assert len(worst_places(cells, 2)) == 2


@pytest.mark.parametrize("truth", [None, np.full((3, 5), np.nan)])
def test_where_no_fix_could_be_judged_none_is_called_right(truth: np.ndarray | None) -> None:
    none = np.full(3, np.nan)
    drive: Any = RegisteredDrive.__new__(RegisteredDrive)
    for name, value in {
        "fix": SimpleNamespace(code=np.zeros(3, int), correlation=np.full(3, 0.8), pose=np.zeros((3, 5))),
        "table": none,
        "track": SimpleNamespace(travel_m=np.arange(3.0)),
        "truth": truth,
        "correlation_at_truth": none,
        "milliseconds_per_scan": 1.0,
    }.items():
        object.__setattr__(drive, name, value)
    told = figures_of(drive)
    assert (told.counts, told.judged, told.wrong) == ({"ok": 3}, 0, None)
    row = table_of([done("a", told)]).to_csv(index=False).splitlines()[1]
    assert row.startswith("a,done,3,3,1.0,3,0,0,0,0,0,0,0,2.0,0,,,,,0.8,")
