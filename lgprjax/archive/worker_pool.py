"""Worker processes of this machine: started, handed drive after drive, replaced when they die, ended in order."""

import queue
import sys
import threading
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import NamedTuple

from lgprjax.archive.job_key import ArchiveRun, Job
from lgprjax.archive.worker_environment import worker_environment
from lgprjax.archive.worker_process import WorkerDiedError, WorkerProcess
from lgprjax.errors import InputError

ATTEMPTS = 3
"""Workers that a drive may cost, and starts that a worker may take."""
PROGRAM = (sys.executable, "-m", "lgprjax.archive.worker")
"""Command line of a worker."""


class JobOutcome(NamedTuple):
    """A job that is over: why it failed, or None; and workers that tried."""

    job: Job
    error: InputError | None
    attempts: int


class WorkerPool:
    """Processes that register drives; a context manager. Leaving it ends them, whatever they are at.

    Each is a fresh process, never a fork: JAX does not survive one. A drive whose worker dies is tried again by a
    new one, ``ATTEMPTS`` times in all.

    Args:
        run: the run.
        workers: processes.
        gpus: numbers of the machine's GPUs, one a worker; empty where there are none.
        program: command line of a worker, to which the number of its connection's descriptor is added.
    """

    def __init__(
        self, run: ArchiveRun, workers: int, *, gpus: Sequence[str] = (), program: Sequence[str] = PROGRAM
    ) -> None:
        self._run = run
        self._workers = workers
        self._gpus = gpus
        self._program = program
        self._todo: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._told: queue.SimpleQueue[JobOutcome | BaseException] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._live: dict[int, WorkerProcess] = {}
        self._threads: list[threading.Thread] = []
        self._serving = 0
        self._stopping = False

    def __enter__(self) -> "WorkerPool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._stopping = True
            live = list(self._live.values())
        for worker in live:
            worker.interrupt()
        for worker in live:
            worker.await_end()
        for thread in self._threads:
            thread.join()

    @property
    def at_work(self) -> dict[int, str]:
        """The drive that each worker has now, by the number of its process."""
        with self._lock:
            return {number: worker.drive for number, worker in self._live.items() if worker.drive}

    def run(self, jobs: Sequence[Job]) -> Iterator[JobOutcome]:
        """Do all jobs; outcomes as they come.

        Raises:
            InputError: no worker can begin, so that no job could ever be done.
        """
        for job in jobs:
            self._todo.put(job)
        self._serving = min(self._workers, len(jobs))
        for number in range(self._serving):
            self._threads.append(threading.Thread(target=self._serve, args=(number,), daemon=True))
        for thread in self._threads:
            thread.start()
        for _ in jobs:
            told = self._told.get()
            if isinstance(told, BaseException):
                raise told
            yield told

    def _serve(self, number: int) -> None:
        """One worker after another in one place of the pool."""
        environment = worker_environment(self._run.threads, self._gpus[number] if self._gpus else None)
        worker: WorkerProcess | None = None
        try:
            while (job := self._next()) is not None:
                outcome: JobOutcome | None = None
                why = ""
                for attempt in range(1, ATTEMPTS + 1):
                    try:
                        worker = worker or self._start(environment)
                    except WorkerDiedError as died:
                        self._give_back(job, died)
                        return
                    try:
                        outcome = JobOutcome(job, worker.do(job, attempt), attempt)
                        break
                    except WorkerDiedError as died:
                        why = str(died)
                        self._bury(worker)
                        worker = None
                        if self._stopping:
                            return
                self._told.put(outcome or _lost(job, why))
        except BaseException as error:  # told where the outcomes are awaited
            self._told.put(error)
        finally:
            if worker is not None:
                self._bury(worker)

    def _next(self) -> Job | None:
        with self._lock:
            if not self._stopping:
                try:
                    return self._todo.get_nowait()
                except queue.Empty:
                    pass
            self._serving -= 1
            return None

    def _give_back(self, job: Job, died: WorkerDiedError) -> None:
        """Leave a job to the other workers: with fewer of them there may be memory enough."""
        with self._lock:
            self._serving -= 1
            self._todo.put(job)
            if self._serving or self._stopping:
                return
        raise InputError(self._run.map_path, "workers", "a process that opens the map", str(died))

    def _start(self, environment: dict[str, str]) -> WorkerProcess:
        """A worker that is ready. Raises ``WorkerDiedError`` where none will live, ``InputError`` where none may."""
        for attempt in range(1, ATTEMPTS + 1):
            worker = WorkerProcess(self._program, environment)
            with self._lock:
                self._live[worker.number] = worker
                if self._stopping:
                    worker.interrupt()
            try:
                worker.begin(self._run)
                return worker
            except WorkerDiedError:
                self._bury(worker)
                if attempt == ATTEMPTS or self._stopping:
                    raise
            except InputError:
                self._bury(worker)
                raise
        raise AssertionError("unreachable: the last attempt returns or raises")

    def _bury(self, worker: WorkerProcess) -> None:
        worker.end()
        with self._lock:
            self._live.pop(worker.number, None)


def _lost(job: Job, why: str) -> JobOutcome:
    found = f"{ATTEMPTS} that died, the last by {why}"
    return JobOutcome(job, InputError(job.drive, "registration", "a worker that lives", found), ATTEMPTS)
