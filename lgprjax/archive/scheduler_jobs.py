"""The same jobs on a cluster that dask.distributed schedules (``pip install "lgprjax[batch]"``).

Its workers see map, drives and results under the same paths. One job at a time runs in a process, whatever number of
threads a worker has: a process has one map open and one set of compiled programs.
"""

import os
import threading
from collections.abc import Generator, Sequence

from lgprjax.archive.drive_jobs import DriveJobs
from lgprjax.archive.job_key import ArchiveRun, Job
from lgprjax.archive.worker_environment import thread_variables
from lgprjax.archive.worker_pool import ATTEMPTS, JobOutcome
from lgprjax.errors import InputError

_CONNECT = "10s"
_one_at_a_time = threading.Lock()
_open: dict[ArchiveRun, DriveJobs] = {}


def run_on_scheduler(address: str, run: ArchiveRun, jobs: Sequence[Job]) -> Generator[JobOutcome, None, None]:
    """Do all jobs on a cluster; outcomes as they come. Leaving it early cancels what has not begun.

    A job whose worker dies is given to another one by the scheduler, as often as its ``allowed-failures`` says.

    Args:
        address: of the scheduler, as ``tcp://HOST:8786``.
        run: the run.
        jobs: of it.

    Raises:
        InputError: dask.distributed is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        expected = 'the optional package distributed (pip install "lgprjax[batch]")'
        raise InputError("--scheduler", "option", expected, "none") from None
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError("--scheduler", address, "a scheduler that answers", str(error)) from None
    with client:
        futures = {client.submit(do_job, run, job, pure=False, retries=ATTEMPTS - 1): job for job in jobs}
        try:
            for future in as_completed(list(futures), loop=client.loop):
                job, lost = futures[future], future.exception()
                # Done with: the cluster need not keep it.
                why = future.result() if lost is None else _lost(job, lost)
                future.release()
                yield JobOutcome(job, why, 1)
        finally:
            client.cancel(list(futures))


def do_job(run: ArchiveRun, job: Job) -> InputError | None:
    """What a worker of the cluster does: why the job failed, or None."""
    with _one_at_a_time:
        if run not in _open:
            for variable, value in thread_variables(run.threads).items():
                # XLA reads its own when the first function runs here.
                os.environ[variable] = value
            for jobs in _open.values():
                jobs.close()
            _open.clear()
            try:
                _open[run] = DriveJobs(run)
            except InputError as error:
                return error
        return _open[run].do(job)


def _lost(job: Job, error: BaseException) -> InputError:
    return InputError(job.drive, "registration", "a worker that lives", f"{type(error).__name__}: {error}")
