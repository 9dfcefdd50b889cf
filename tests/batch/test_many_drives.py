"""Drives registered by worker processes: the same bits as by one, whoever is killed."""

import os
import re
import shutil
import signal
import threading
import time
from pathlib import Path

import pytest

from batch.short_drives import DRIVES, SCANS, Short, assert_same, make_short, register
from canon.site import Site
from lgprjax.batch import ArchiveRun, WorkerPool, claimed, plan_jobs, read_records, shares_of, stamp_of
from lgprjax.files import file_hash
from lgprjax.registration import RegisterOptions
from refusals import printed_refusal


def run_in(short: Short, folder: Path) -> ArchiveRun:
    return ArchiveRun(short.map, file_hash(short.map), stamp_of(short.map), RegisterOptions(), folder, 1)


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Short:
    return make_short(site, tmp_path_factory)


def test_one_worker_compiles_with_its_first_drives_and_all_is_kept(short: Short) -> None:
    records = list(read_records(short.one).values())
    assert [record.state for record in records] == ["done"] * DRIVES
    assert sum(record.figures.ok for record in records if record.figures) > 0.5 * DRIVES * SCANS
    assert {record.figures.wrong for record in records if record.figures} == {0}
    (share,) = shares_of(records)
    assert share.compiled > 0
    assert 100.0 < share.peak_rss_mb < 3000.0
    costs = {record.name: record.cost for record in records}
    late = [name for name, cost in sorted(costs.items())[1:] if cost is not None and cost.compiled]
    assert not late
    assert {path.name for path in short.one.iterdir() if path.suffix != ".h5" and "fixes" not in path.name} == {
        *("jobs", "archive.json", "archive.csv", "archive.html")
    }


@pytest.mark.long
def test_two_workers_one_of_them_killed_give_the_same_bits(short: Short, tmp_path: Path) -> None:
    run = run_in(short, tmp_path / "two")
    names = [path.name.removesuffix(".drive.h5") for path in short.drives]
    with claimed(run, names, force=False):
        plan = plan_jobs(run, short.drives, force=False)
        with WorkerPool(run, 2) as pool:
            killed = threading.Thread(target=kill_over, args=(pool, names[2]))
            killed.start()
            outcomes = list(pool.run(plan.todo))
            killed.join()
    assert {outcome.error for outcome in outcomes} == {None}
    assert_same(run.folder, short)
    records = read_records(run.folder)
    assert {name for name, record in records.items() if record.attempts > 1} == {names[2]}
    assert len(shares_of(list(records.values()))) == 3
    assert not list(tmp_path.rglob("*partial*"))


def kill_over(pool: WorkerPool, name: str) -> None:
    """Kill the first worker that is at work on a drive."""
    until = time.monotonic() + 120.0
    while time.monotonic() < until:
        for number, drive in pool.at_work.items():
            if drive == name:
                os.kill(number, signal.SIGKILL)
                return
        time.sleep(0.002)


def test_a_rerun_does_nothing_and_then_only_what_changed(
    short: Short, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(short.one, out)
    before = {path: path.stat().st_mtime_ns for path in out.glob("*.fixes.*")}
    assert register(short.map, short.drives, out, "--workers", 2) == 0
    assert counts_in(capsys.readouterr().out) == [DRIVES, 0, DRIVES, 0]
    assert {path: path.stat().st_mtime_ns for path in out.glob("*.fixes.*")} == before
    (out / "short_03.fixes.h5").unlink()
    broken = tmp_path / "broken.drive.h5"
    broken.write_bytes(short.drives[0].read_bytes()[:5000])
    assert register(short.map, [*short.drives, broken], out, "--workers", 1) == 1
    told = capsys.readouterr()
    assert counts_in(told.out) == [DRIVES + 1, 1, DRIVES - 1, 1]
    printed_refusal(told.err.strip().splitlines()[-1]).check("file", file=broken)
    assert_same(out, short)
    page = (out / "archive.html").read_text(encoding="utf-8")
    assert broken.name in page
    assert "data:image/png" in page


def counts_in(out: str) -> list[int]:
    """Drives, those registered now, those up to date, and those that failed."""
    (line,) = (line for line in out.splitlines() if re.match(r"\d+ drives: \d+ ", line))
    return [int(number) for number in re.findall(r"\d+", line)[:4]]
