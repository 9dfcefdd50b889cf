"""The benchmark of an archive: records of made-up runs, drives cut from a longer one."""

from pathlib import Path

import numpy as np
import pytest

from archive_records import done, figures
from benchmarks.archive import ArchivePlan, Run, archive_records, cut_drive
from canon.site import Site
from lgprjax.formats import DriveLog, NavigationTrack, OdometryTrack

PLAN = ArchivePlan(drives=2, workers=(1, 2))
JOBS = [done("a", figures({"ok": 4}), compiled=50), done("b", figures({"ok": 4}))]
_Track = OdometryTrack | NavigationTrack | None
OUTPUTS = {"a.fixes.csv": "1", "b.fixes.csv": "2"}


def test_records_hold_every_run_against_the_first() -> None:
    runs = {
        "1 worker": Run(20.0, OUTPUTS, JOBS),
        "2 workers": Run(10.0, OUTPUTS, [JOBS[0], JOBS[1].model_copy(update={"attempts": 2})]),
        "nothing to do": Run(3.0, OUTPUTS, JOBS),
    }
    records = {record.key: record for record in archive_records(runs, PLAN)}
    assert records["archive/1 worker"].value == pytest.approx(6.0)
    assert records["archive/2 workers / 1 worker"].value == pytest.approx(2.0)
    assert records["archive/nothing to do"].met is True
    assert records["archive/files unlike, 2 workers"].met is True
    assert records["archive/workers a drive, most"].value == 2
    assert records["archive/search a drive"].value == pytest.approx(1500.0)
    assert records["archive/beside the search"].value == pytest.approx(500.0)
    assert records["archive/drives that compiled late"].value == 0


def test_a_file_that_differs_or_lacks_or_is_too_many_is_told() -> None:
    runs = {"1 worker": Run(20.0, OUTPUTS, JOBS)}
    for name, outputs in (("x", {"a.fixes.csv": "1", "b.fixes.csv": "9"}), ("y", {"a.fixes.csv": "1"})):
        records = archive_records({**runs, name: Run(20.0, outputs, JOBS)}, PLAN)
        (unlike,) = [record for record in records if record.key == f"archive/files unlike, {name}"]
        assert (unlike.value, unlike.met) == (1, False)


def test_a_drive_that_compiled_late_is_told() -> None:
    late = done("c", figures({"ok": 4}), compiled=1)
    records = {record.key: record for record in archive_records({"1 worker": Run(20.0, OUTPUTS, [*JOBS, late])}, PLAN)}
    assert records["archive/drives that compiled late"].met is False


def test_nothing_ran_gives_no_records() -> None:
    assert archive_records({}, PLAN) == []


def test_a_cut_drive_holds_its_scans_and_what_spans_them(site: Site, tmp_path: Path) -> None:
    path = tmp_path / "cut.drive.h5"
    with DriveLog.open(site.logs["live"]) as whole:
        cut_drive(whole, 100, 220, path)
        with DriveLog.open(path) as cut:
            assert cut.description.name == "cut"
            np.testing.assert_array_equal(cut.scan_time_s, whole.scan_time_s[100:220])
            for part, same in zip(cut.read_traces(0, 120), whole.read_traces(100, 220), strict=True):
                np.testing.assert_array_equal(part, same)
            tracks: tuple[tuple[_Track, _Track], ...] = (
                (cut.description.navigation, whole.description.navigation),
                (cut.description.odometry, whole.description.odometry),
                (cut.description.truth, whole.description.truth),
            )
            for mine, theirs in tracks:
                assert mine is not None
                assert theirs is not None
                assert mine.time_s[0] <= cut.scan_time_s[0]
                assert mine.time_s[-1] >= cut.scan_time_s[-1]
                assert len(mine.time_s) < len(theirs.time_s)
