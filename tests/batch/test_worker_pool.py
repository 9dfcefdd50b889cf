"""The pool's own rules with workers of a few lines: deaths, refusals, Ctrl-C, nothing left behind."""

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from distributed import LocalCluster

from lgprjax.batch import ArchiveRun, Job, JobOutcome, WorkerPool, workers
from lgprjax.batch.folder import ScansDone
from lgprjax.batch.jobs import FileStamp
from lgprjax.registration import RegisterOptions
from refusals import refusal_in, refused

# Answers what it is handed without looking inside, but for the drive's name.
_BEGIN = """
import os, pathlib, signal, sys, time
from multiprocessing.connection import Connection
folder, connection = pathlib.Path(sys.argv[1]), Connection(int(sys.argv[2]))
connection.recv_bytes()
"""
_OBEYS = """
connection.send(True)
while True:
    try:
        asked = connection.recv_bytes()
    except EOFError:
        break
    (folder / f"{os.getpid()}").touch()
    first = b"once" in asked and not (folder / "tried").exists()
    if first:
        (folder / "tried").touch()
    if first or b"doomed" in asked:
        os.kill(os.getpid(), signal.SIGKILL)
    if b"slow" in asked:
        try:
            time.sleep(60.0)
        except KeyboardInterrupt:
            (folder / "in order").touch()
            break
    connection.send(None)
"""


def pool_of(folder: Path, workers: int, told: str = _OBEYS) -> WorkerPool:
    run = ArchiveRun(folder / "m.map.h5", "m", FileStamp(0, 0), RegisterOptions(), folder, 1)
    return WorkerPool(run, workers, program=(sys.executable, "-c", _BEGIN + told, str(folder)))


def jobs_of(*names: str) -> list[Job]:
    return [Job(name, Path(f"/nowhere/{name}.drive.h5"), "d", "k") for name in names]


def outcomes_of(pool: WorkerPool, *names: str) -> dict[str, JobOutcome]:
    with pool:
        return {outcome.job.name: outcome for outcome in pool.run(jobs_of(*names))}


def test_every_job_is_done_once_by_as_many_workers_as_asked(tmp_path: Path) -> None:
    found = outcomes_of(pool_of(tmp_path, 3), *(f"drive {n}" for n in range(12)))
    assert len(found) == 12
    assert {(outcome.error, outcome.attempts) for outcome in found.values()} == {(None, 1)}
    assert 1 <= len(list(tmp_path.iterdir())) <= 3


_COUNTS = """
connection.send(True)
while True:
    try:
        asked = connection.recv_bytes()
    except EOFError:
        break
    first = b"once" in asked and not (folder / "tried").exists()
    (folder / "tried").touch()
    for scans in (30, 40, 30) if b"whole" in asked else (60, 60):
        connection.send(scans)
    if first:
        os.kill(os.getpid(), signal.SIGKILL)
    connection.send(None)
"""


def test_scans_are_told_as_they_are_done_each_once(tmp_path: Path) -> None:
    """Of drives that a worker died on, or searched twice, too: the sum is that of all scans, and never falls."""
    told: list[int] = []
    done = ScansDone(told.append)
    run = ArchiveRun(tmp_path / "m.map.h5", "m", FileStamp(0, 0), RegisterOptions(), tmp_path, 1)
    program = (sys.executable, "-c", _BEGIN + _COUNTS, str(tmp_path))
    jobs = [job._replace(scans=100) for job in jobs_of("once", "whole", "twice")]
    with WorkerPool(run, 1, program=program, progress=done.some) as pool:
        for outcome in pool.run(jobs):
            assert outcome.error is None
            done.all_of(outcome.job)
    assert sum(told) == 300
    assert min(told) >= 0
    # Within a drive as well, not at its end alone.
    assert {30, 40} <= set(told)


def test_a_drive_whose_worker_dies_is_tried_again_three_times_at_most(tmp_path: Path) -> None:
    """The others are done, once each."""
    found = outcomes_of(pool_of(tmp_path, 2), "first", "once", "doomed", "last")
    assert (found["once"].error, found["once"].attempts) == (None, 2)
    assert found["first"].attempts == found["last"].attempts == 1
    assert found["first"].error is found["last"].error is None
    error = found["doomed"].error
    assert error is not None
    refusal_in(error).check("registration", file="/nowhere/doomed.drive.h5", found="signal 9")
    assert found["doomed"].attempts == 3


def test_workers_that_cannot_begin_end_the_run_with_their_last_line(tmp_path: Path) -> None:
    with refused(None, found="exit 1: OSError: no room"):
        outcomes_of(pool_of(tmp_path, 2, "raise OSError('no room')"), "first", "second")


def test_a_refusal_ends_the_run_at_once(tmp_path: Path) -> None:
    refuses = """
from lgprjax.errors import InputError
(folder / f"{os.getpid()}").touch()
connection.send(InputError("m.map.h5", "file", "a map", "none"))
"""
    with refused("file", file="m.map.h5", found="none"):
        outcomes_of(pool_of(tmp_path, 1, refuses), "first")
    assert len(list(tmp_path.iterdir())) == 1


def test_ctrl_c_ends_workers_in_order(tmp_path: Path) -> None:
    began = time.monotonic()

    def press() -> None:
        while not list(tmp_path.iterdir()):
            time.sleep(0.02)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    presser = threading.Thread(target=press)
    presser.start()
    with pytest.raises(KeyboardInterrupt):
        outcomes_of(pool_of(tmp_path, 2), "slow 1", "slow 2", "slow 3")
    presser.join()
    assert (tmp_path / "in order").exists()
    assert time.monotonic() - began < 20.0
    for name in tmp_path.iterdir():
        if name.name.isdecimal():
            with pytest.raises(ProcessLookupError):
                os.kill(int(name.name), 0)


def test_at_work_names_the_drive_of_each_process(tmp_path: Path) -> None:
    with pool_of(tmp_path, 1) as pool:
        outcomes = pool.run(jobs_of("slow"))
        waiter = threading.Thread(target=lambda: list(outcomes), daemon=True)
        waiter.start()
        until = time.monotonic() + 20.0
        while not pool.at_work and time.monotonic() < until:
            time.sleep(0.02)
        (held,) = pool.at_work.items()
        assert held[1] == "slow"
        os.kill(held[0], 0)


def test_a_scheduler_hands_out_the_same_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a cluster in this process; ``validation/drives`` compares the bits of a real one."""
    monkeypatch.setattr(workers, "PROGRAM", (sys.executable, "-c", _BEGIN + _OBEYS, str(tmp_path)))
    run = ArchiveRun(tmp_path / "m.map.h5", "m", FileStamp(0, 0), RegisterOptions(), tmp_path, 1)
    try:
        with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
            jobs = jobs_of("first", "once", "doomed", "last")
            found = {
                each.job.name: each.error for each in workers.run_on_scheduler(cluster.scheduler_address, run, jobs)
            }
    finally:
        workers._end_all()
    assert found.keys() == {"first", "once", "doomed", "last"}
    assert found["first"] is found["once"] is found["last"] is None
    error = found["doomed"]
    assert error is not None
    refusal_in(error).check("registration", file="/nowhere/doomed.drive.h5", found="WorkerDiedError")
