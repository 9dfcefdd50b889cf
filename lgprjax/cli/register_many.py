"""``lgprjax register --workers N`` and ``--scheduler ADDRESS``: very many drives, one folder of results."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lgprjax.cli.archive_views import print_sums, write_views
from lgprjax.cli.errors import BAD_INPUT, UsageError
from lgprjax.cli.progress import console, progress_bar, working
from lgprjax.cli.search_options import check_region, hold_ground
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive import ArchiveRun, Job, JobOutcome
    from lgprjax.registration import RegisterOptions


@dataclass(frozen=True)
class Workforce:
    """Who registers the drives: processes of this machine, or a cluster.

    Attributes:
        workers: processes of this machine; None where a scheduler is named.
        threads: each is held to; None for an equal share of the cores, on a cluster for one.
        scheduler: address of a dask scheduler.
    """

    workers: int | None
    threads: int | None
    scheduler: str | None

    def check(self) -> None:
        """Raise ``UsageError`` where the options make no sense together."""
        if self.workers is not None and self.scheduler is not None:
            raise UsageError("--workers, --scheduler: expected one of them, found both")
        if self.workers is None and self.scheduler is None:
            raise UsageError("--threads: expected --workers or --scheduler beside it, found neither")
        for name, value in (("--workers", self.workers), ("--threads", self.threads)):
            if value is not None and not 1 <= value <= 4096:
                raise UsageError(f"{name}: expected 1 to 4096, found {value}")


def register_many(
    map_path: Path,
    drives: Sequence[Path],
    folder: Path,
    options: "RegisterOptions",
    workforce: Workforce,
    *,
    json: Path | None,
    force: bool,
) -> int:
    """Register what is missing or changed in a folder; table and page of all that it holds. Returns the exit status."""
    from lgprjax.archive import ArchiveRun, claimed, drive_name, note_failure, plan_jobs, stamp_of
    from lgprjax.archive.worker_environment import gpus
    from lgprjax.files import file_hash
    from lgprjax.formats import MapFile
    from lgprjax.machine import usable_cores

    workforce.check()
    names = [drive_name(path) for path in drives]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(twice, "drives", "drives of different names", "this name twice")
    own_gpus = [] if workforce.scheduler else gpus()
    if own_gpus and (workforce.workers or 0) > len(own_gpus):
        raise UsageError(f"--workers: expected at most {len(own_gpus)}, one a GPU, found {workforce.workers}")
    with MapFile.open(map_path) as source:
        check_region(options.search_m, source)
        # Measured and remembered here, or each worker would measure for itself.
        hold_ground(source, options)
    stamp = stamp_of(map_path)
    with working(f"reading {map_path.name}"):
        map_sha256 = file_hash(map_path)
    threads = workforce.threads or (1 if workforce.workers is None else max(1, usable_cores() // workforce.workers))
    run = ArchiveRun(map_path.absolute(), map_sha256, stamp, options, folder.absolute(), threads)
    with claimed(run, names, force=force):
        with progress_bar("looking at drives", len(drives)) as progress:
            plan = plan_jobs(run, drives, force=force, progress=progress)
        failed = list(plan.unreadable)
        with (
            progress_bar("registering drives", len(plan.todo)) as progress,
            _done_by(workforce, run, own_gpus, plan.todo) as outcomes,
        ):
            for outcome in outcomes:
                if outcome.error is not None:
                    failed.append(outcome.error)
                    note_failure(run, outcome.job, outcome.error, outcome.attempts)
                progress(1)
        with working("drawing"):
            sums = write_views(run)
    for error in failed:
        print(f"lgprjax: {error}", file=sys.stderr)
    done = len(drives) - len(plan.done) - len(failed)
    print_sums(sums)
    _say(f"{len(drives)} drives: {done} registered now, {len(plan.done)} as they were, {len(failed)} failed")
    _say(f"fixes, archive.csv and the records of all jobs: {folder}")
    _say(f"page: {(folder / 'archive.html').resolve()}")
    if json is not None:
        from lgprjax.cli.figures import write_figures

        write_figures(json, sums._asdict(), force=force)
    return BAD_INPUT if failed else 0


@contextmanager
def _done_by(
    workforce: Workforce, run: "ArchiveRun", gpus: Sequence[str], jobs: Sequence["Job"]
) -> "Iterator[Iterator[JobOutcome]]":
    """Outcomes of jobs as they come; leaving the block ends what is still at work."""
    from lgprjax.archive import WorkerPool, run_on_scheduler

    if workforce.workers is not None:
        with WorkerPool(run, workforce.workers, gpus=gpus) as pool:
            yield pool.run(jobs)
    else:
        assert workforce.scheduler is not None
        outcomes = run_on_scheduler(workforce.scheduler, run, jobs)
        try:
            yield outcomes
        finally:
            outcomes.close()


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
