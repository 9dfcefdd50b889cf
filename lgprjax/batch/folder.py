"""Many drives registered into one folder by worker processes, of this machine or of a cluster."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lgprjax.batch.jobs import ArchiveRun, Job, claimed, drive_name, note_failure, plan_jobs, stamp_of
from lgprjax.batch.register import HeldGround, check_region
from lgprjax.batch.workers import JobOutcome, WorkerPool, gpus, run_on_scheduler
from lgprjax.errors import ArgumentError, InputError
from lgprjax.files import file_hash
from lgprjax.formats import MapFile
from lgprjax.machine import usable_cores
from lgprjax.registration import RegisterOptions

Progress = Callable[[int], None]
Bars = Callable[[str, int, str], AbstractContextManager[Progress]]
"""Makes a progress bar of a title, a total and its unit; the block that it is open for advances it."""


def no_bars(_title: str, _total: int, _unit: str) -> AbstractContextManager[Progress]:
    """Progress bars without display."""
    return nullcontext(lambda _: None)


@dataclass(frozen=True)
class Workforce:
    """The workers: processes of this machine, or a cluster.

    Attributes:
        workers: processes of this machine; None with a scheduler.
        threads: limit of each; None for an equal share of the cores, one on a cluster.
        scheduler: address of a dask scheduler.
    """

    workers: int | None
    threads: int | None
    scheduler: str | None

    def check(self) -> None:
        """Refuse counts out of range, and both workers and a scheduler, or neither. Raises ``ArgumentError``."""
        if self.workers is not None and self.scheduler is not None:
            raise ArgumentError("workers, scheduler", "one of them", "both")
        if self.workers is None and self.scheduler is None:
            raise ArgumentError("workers, scheduler", "one of them", "neither")
        for name, value in (("workers", self.workers), ("threads", self.threads)):
            if value is not None and not 1 <= value <= 4096:
                raise ArgumentError(name, "1 to 4096", str(value))


class RegisteredFolder(NamedTuple):
    """Result of registering drives into a folder.

    Attributes:
        run: map, folder and search.
        registered, kept: number of drives registered now, and of earlier results kept.
        failed: error messages of the drives that could not be registered.
    """

    run: ArchiveRun
    registered: int
    kept: int
    failed: tuple[InputError, ...]


@contextmanager
def register_folder(
    map_path: Path,
    drives: Sequence[Path],
    folder: Path,
    options: RegisterOptions,
    workforce: Workforce,
    *,
    force: bool,
    bars: Bars = no_bars,
) -> Iterator[RegisteredFolder]:
    """Register what is missing or changed in a folder, which stays claimed by this process while the block is open.

    Raises:
        InputError: the map, the folder or an option cannot be used, or two drives have one name. A drive that cannot be
            registered is among ``failed``.
    """
    workforce.check()
    names = [drive_name(path) for path in drives]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(
            twice, "drives", "drives with different names (output files use them)", "two drives with this name"
        )
    own_gpus = [] if workforce.scheduler else gpus()
    if own_gpus and (workforce.workers or 0) > len(own_gpus):
        raise ArgumentError("workers", f"at most {len(own_gpus)}, one per GPU", str(workforce.workers))
    with MapFile.open(map_path) as source:
        check_region(options.search_m, source)
        # Measured and cached here, or each worker would measure it.
        with bars("preparing the map", 1, "maps"):
            HeldGround(source, options)
    stamp = stamp_of(map_path)
    with bars(f"reading {map_path.name}", 1, "maps"):
        map_sha256 = file_hash(map_path)
    threads = workforce.threads or (1 if workforce.workers is None else max(1, usable_cores() // workforce.workers))
    run = ArchiveRun(map_path.absolute(), map_sha256, stamp, options, folder.absolute(), threads)
    with claimed(run, names, force=force):
        with bars("checking drives", len(drives), "drives") as progress:
            plan = plan_jobs(run, drives, force=force, progress=progress)
        failed = list(plan.unreadable)
        with bars(f"registering {len(plan.todo)} drives", sum(job.scans for job in plan.todo), "scans") as progress:
            told = ScansDone(progress)
            with _done_by(workforce, run, own_gpus, plan.todo, told.some) as outcomes:
                for outcome in outcomes:
                    if outcome.error is not None:
                        failed.append(outcome.error)
                        note_failure(run, outcome.job, outcome.error, outcome.attempts)
                    told.all_of(outcome.job)
        done = len(drives) - len(plan.done) - len(failed)
        yield RegisteredFolder(run, done, len(plan.done), tuple(failed))


class ScansDone:
    """Progress in scans over all drives: a drive that is searched twice, or tried again, counts once."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._lock = progress, threading.Lock()
        self._told: dict[str, int] = {}

    def some(self, job: Job, scans: int) -> None:
        """Scans of a job, as they are done; by any thread."""
        with self._lock:
            before = self._told.get(job.name, 0)
            self._told[job.name] = min(before + scans, job.scans)
            self._progress(self._told[job.name] - before)

    def all_of(self, job: Job) -> None:
        """A job that is finished, or has failed."""
        self.some(job, job.scans)


@contextmanager
def _done_by(
    workforce: Workforce,
    run: ArchiveRun,
    own_gpus: Sequence[str],
    jobs: Sequence[Job],
    progress: Callable[[Job, int], None],
) -> Iterator[Iterator[JobOutcome]]:
    """Outcomes of jobs as they come; leaving the block ends running workers. A cluster reports whole drives only."""
    if workforce.workers is not None:
        with WorkerPool(run, workforce.workers, gpus=own_gpus, progress=progress) as pool:
            yield pool.run(jobs)
    else:
        assert workforce.scheduler is not None
        outcomes = run_on_scheduler(workforce.scheduler, run, jobs)
        try:
            yield outcomes
        finally:
            outcomes.close()
