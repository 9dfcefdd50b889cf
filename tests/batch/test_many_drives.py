"""Drives registered by worker processes: the same bits as by one, whoever is killed; on a cluster too."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import h5py
import pytest
from distributed import Client, LocalCluster

import lgprjax
from benchmarks.archive import FULL_ARCHIVE, cut_drive, run_archive
from canon.site import Site
from lgprjax.batch import ArchiveRun, WorkerPool, claimed, outputs_of, plan_jobs, read_records, shares_of, stamp_of
from lgprjax.cli import main
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog
from lgprjax.registration import RegisterOptions

DRIVES, SCANS = 12, 96


class Short(NamedTuple):
    """A map, short drives on it, and the folder in which one worker registered them."""

    map: Path
    drives: list[Path]
    one: Path


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def register(map_path: Path, drives: list[Path], folder: Path, *options: object) -> int:
    return status_of("register", map_path, *drives, "-o", folder, "--threads", 1, *options)


def hashes(folder: Path, drives: list[Path]) -> dict[str, str]:
    names = [path.name.removesuffix(".drive.h5") for path in drives]
    return {output: file_hash(folder / output) for name in names for output in outputs_of(name)}


def assert_same(folder: Path, short: Short) -> None:
    """The same bytes in every output; a file that differs is told by its columns."""
    ours, theirs = hashes(folder, short.drives), hashes(short.one, short.drives)
    for name in sorted(ours):
        if ours[name] != theirs[name] and name.endswith(".h5"):
            with h5py.File(folder / name) as a, h5py.File(short.one / name) as b:
                print(name, {column: (a[column][()], b[column][()]) for column in a if unlike(a[column], b[column])})
    assert ours == theirs


def unlike(a: h5py.Dataset, b: h5py.Dataset) -> bool:
    return bool(a[()].tobytes() != b[()].tobytes())


def run_in(short: Short, folder: Path) -> ArchiveRun:
    return ArchiveRun(short.map, file_hash(short.map), stamp_of(short.map), RegisterOptions(), folder, 1)


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Short:
    folder = tmp_path_factory.mktemp("many")
    drives = [folder / f"short_{number:02d}.drive.h5" for number in range(DRIVES)]
    with DriveLog.open(site.logs["live"]) as log:
        for number, path in enumerate(drives):
            start = number * (log.scans - SCANS) // DRIVES
            cut_drive(log, start, start + SCANS, path)
    assert register(site.map, drives, folder / "one", "--workers", 1) == 0
    return Short(site.map, drives, folder / "one")


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


def test_two_workers_one_of_them_killed_give_the_same_bits(short: Short, tmp_path: Path) -> None:
    run = run_in(short, tmp_path / "two")
    names = [path.name.removesuffix(".drive.h5") for path in short.drives]
    with claimed(run, names, force=False):
        plan = plan_jobs(run, short.drives, force=False)
        with WorkerPool(run, 2) as pool:
            killed = threading.Thread(target=kill_over, args=(pool, names[4]))
            killed.start()
            outcomes = list(pool.run(plan.todo))
            killed.join()
    assert {outcome.error for outcome in outcomes} == {None}
    assert_same(run.folder, short)
    records = read_records(run.folder)
    assert {name for name, record in records.items() if record.attempts > 1} == {names[4]}
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
    before = {path: path.stat().st_mtime_ns for path in short.one.glob("*.fixes.*")}
    assert register(short.map, short.drives, short.one, "--workers", 2) == 0
    told = capsys.readouterr().out
    assert f"{DRIVES} drives: 0 registered now, {DRIVES} up to date, 0 failed" in told
    assert {path: path.stat().st_mtime_ns for path in short.one.glob("*.fixes.*")} == before
    wanted = hashes(short.one, short.drives)
    (short.one / "short_03.fixes.h5").unlink()
    broken = tmp_path / "broken.drive.h5"
    broken.write_bytes(short.drives[0].read_bytes()[:5000])
    assert register(short.map, [*short.drives, broken], short.one, "--workers", 1) == 1
    out, err = capsys.readouterr()
    assert f"{DRIVES + 1} drives: 1 registered now, {DRIVES - 1} up to date, 1 failed" in out
    assert err.strip().splitlines()[-1].startswith(f"lgprjax: {broken}: file: expected a whole HDF5 file")
    assert hashes(short.one, short.drives) == wanted
    page = (short.one / "archive.html").read_text(encoding="utf-8")
    assert "Drives that failed" in page
    assert "data:image/png" in page


def test_ctrl_c_keeps_what_is_done(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command: list[object] = [sys.executable, "-c", "import sys; from lgprjax.cli import main; main(sys.argv[1:])"]
    command += ["register", short.map, *short.drives, "-o", out, "--workers", "1", "--threads", "1"]
    root = {"PYTHONPATH": str(Path(lgprjax.__file__).parents[1])}
    process = subprocess.Popen([str(word) for word in command], env={**os.environ, **root}, stderr=subprocess.PIPE)
    until = time.monotonic() + 120.0
    # As soon as there is a record: the others take a second or two, and a busy machine may come late to this line.
    while not list(out.glob("jobs/*.json")) and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 130, said.decode()
    assert said.decode().strip().splitlines()[-1] == "lgprjax: interrupted; unfinished outputs were removed"
    done = read_records(out)
    assert 1 <= len(done) < DRIVES
    assert not list(out.rglob("*.partial*"))
    names = [path.name.removesuffix(".drive.h5") for path in short.drives]
    run = run_in(short, out)
    with claimed(run, names, force=False):
        plan = plan_jobs(run, short.drives, force=False)
    assert plan.done == sorted(done)
    assert [job.name for job in plan.todo] == [name for name in names if name not in done]


def cluster_of(workers: int) -> LocalCluster:
    return LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None)


@pytest.mark.campaign
def test_a_cluster_gives_the_same_bits(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "cluster"
    with cluster_of(2) as cluster:
        assert register(short.map, short.drives, out, "--scheduler", cluster.scheduler_address) == 0
    assert_same(out, short)


@pytest.mark.campaign
def test_a_cluster_gives_the_same_bits_though_a_worker_dies(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "cluster"
    with cluster_of(2) as cluster:

        def kill_one() -> None:
            while not list(out.glob("jobs/*.json")):
                time.sleep(0.02)
            with Client(cluster.scheduler_address, set_as_default=False) as client:
                os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        assert register(short.map, short.drives, out, "--scheduler", cluster.scheduler_address) == 0
        killer.join()
    assert_same(out, short)


@pytest.mark.campaign
def test_a_thousand_drives(tmp_path: Path) -> None:
    outcome = run_archive(FULL_ARCHIVE, tmp_path, print)
    for record in outcome.records:
        print(record)
    assert not outcome.not_measured
    unlike = {record.key: record.value for record in outcome.records if "unlike" in record.key}
    assert len(unlike) == 5
    assert set(unlike.values()) == {0.0}
    assert all(record.met for record in outcome.records if record.goal is not None)
