"""The same jobs on a cluster that dask.distributed schedules (``pip install "lgprjax[batch]"``).

Its workers see map, drives and results under the same paths. Each has a worker process as the pool has them: JAX and
BLAS take their number of threads when they start, and dask has started some of them by then. One job at a time runs in
it, whatever number of threads dask's worker has.
"""

import threading
from collections.abc import Generator, Sequence

from lgprjax.archive.job_key import ArchiveRun, Job
from lgprjax.archive.worker_environment import worker_environment
from lgprjax.archive.worker_pool import ATTEMPTS, PROGRAM, JobOutcome
from lgprjax.archive.worker_process import WorkerDiedError, WorkerProcess
from lgprjax.errors import InputError

_CONNECT = "10s"
_one_at_a_time = threading.Lock()
_open: dict[ArchiveRun, WorkerProcess] = {}


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
    """What a worker of the cluster does: why the job failed, or None. Raises ``WorkerDiedError``: dask tries again."""
    with _one_at_a_time:
        try:
            if run not in _open:
                _end_all()
                _open[run] = WorkerProcess(PROGRAM, worker_environment(run.threads, None))
                _open[run].begin(run)
            return _open[run].do(job, 1)
        except WorkerDiedError:
            _end_all()
            raise
        except InputError as error:
            _end_all()
            return error


def _end_all() -> None:
    for worker in _open.values():
        worker.end()
    _open.clear()


def _lost(job: Job, error: BaseException) -> InputError:
    return InputError(job.drive, "registration", "a worker that lives", f"{type(error).__name__}: {error}")
