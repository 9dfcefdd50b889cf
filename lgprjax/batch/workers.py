"""Worker processes, local or on a cluster: started, given one drive after another, replaced when they die."""

import asyncio
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import entry_points
from multiprocessing import Pipe
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import lgprjax
from lgprjax.batch.jobs import ArchiveRun, Job
from lgprjax.errors import InputError

# Environment of a worker process: its share of the cores, its GPU, the package.


def gpus() -> list[str]:
    """Numbers of the GPUs that JAX would use here, as ``CUDA_VISIBLE_DEVICES`` counts them; JAX is not started."""
    wanted = os.environ.get("JAX_PLATFORMS") or "cuda"
    plugins = [plugin.name for plugin in entry_points(group="jax_plugins")]
    if not re.search("cuda|gpu", wanted) or not any("cuda" in name for name in plugins):
        return []
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [number.strip() for number in visible.split(",") if number.strip()]
    found = [re.fullmatch(r"nvidia(\d+)", path.name) for path in Path("/dev").glob("nvidia*")]
    return sorted((number.group(1) for number in found if number is not None), key=int)


def thread_variables(threads: int) -> dict[str, str]:
    """Environment variables that limit BLAS and XLA to this many threads; both read them at their start.

    Equal thread numbers give bitwise equal results, because they decide the order of additions.
    """
    eigen = "--xla_cpu_multi_thread_eigen="
    flags = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if not flag.startswith(eigen)]
    return {
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"), str(threads)),
        "XLA_FLAGS": " ".join((*flags, eigen + ("true" if threads > 1 else "false"))),
    }


def worker_environment(threads: int, gpu: str | None) -> dict[str, str]:
    """Environment of a worker.

    Args:
        threads: thread limit.
        gpu: the only visible GPU; ``None`` for the CPU.
    """
    root = str(Path(lgprjax.__file__).resolve().parents[1])
    path = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
    environment = {**os.environ, **thread_variables(threads), "PYTHONPATH": path}
    if gpu is not None:
        environment["CUDA_VISIBLE_DEVICES"] = gpu
        # Sums by atomic additions differ from run to run.
        environment["XLA_FLAGS"] += " --xla_gpu_deterministic_ops=true"
    return environment


# One worker process and the connection to it: requests, answers, death and end.

_ENDING_S = 10.0  # a compile cannot be interrupted


class WorkerDiedError(Exception):
    """A worker ended before it answered; the message describes the end."""


class WorkerProcess:
    """A process that registers drives.

    Args:
        program: command line; the descriptor number of its connection is appended.
        environment: environment of the process.

    Attributes:
        number: ID of the process.
        drive: name of the drive in work; empty for none.
    """

    def __init__(self, program: Sequence[str], environment: Mapping[str, str]) -> None:
        self.drive = ""
        self._connection, theirs = Pipe()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  # closed with the process
        with theirs:
            self._process = subprocess.Popen(
                [*program, str(theirs.fileno())],
                env=environment,
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                # Signals of a terminal reach the pool alone, which ends its workers in order.
                start_new_session=True,
            )
        self.number = self._process.pid

    def begin(self, run: ArchiveRun) -> None:
        """Send it the run. Raises ``InputError`` if it refuses to begin, ``WorkerDiedError`` if it died."""
        answer = self._request(run)
        if isinstance(answer, InputError):
            raise answer

    def do(self, job: Job, attempt: int, progress: Callable[[int], None] = lambda _: None) -> InputError | None:
        """Have a drive registered; returns why it failed, or None. Raises ``WorkerDiedError`` if the worker died.

        ``progress`` is called with numbers of scans done.
        """
        self.drive = job.name
        answer = self._request((job, attempt), progress)
        self.drive = ""
        assert answer is None or isinstance(answer, InputError)
        return answer

    def interrupt(self) -> None:
        """Interrupt as by Ctrl-C; files being written are abandoned cleanly."""
        self._process.send_signal(signal.SIGINT)

    def await_end(self) -> None:
        """Wait until it ends; kill it if it does not."""
        try:
            self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def end(self) -> None:
        """Close the connection, which ends the worker."""
        self._connection.close()
        self.await_end()
        self._said.close()

    def _request(self, what: object, progress: Callable[[int], None] = lambda _: None) -> object:
        try:
            self._connection.send(what)
            # True is the answer of one that begins, and no number of scans.
            while type(answer := self._connection.recv()) is int:
                progress(answer)
            return answer
        except (EOFError, OSError):
            raise WorkerDiedError(self._death()) from None

    def _death(self) -> str:
        """Description of the process's end, in one line."""
        try:
            status = self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            return "a closed connection"
        if status < 0:
            return f"signal {-status} ({signal.strsignal(-status)})"
        self._said.seek(0)
        last = (self._said.read().decode(errors="replace").strip().splitlines() or [""])[-1]
        return f"exit {status}" + (f": {last}" if last else "")


ATTEMPTS = 3
"""Workers that may die on one drive, and attempts to start a worker."""
PROGRAM = (sys.executable, "-m", "lgprjax.batch.worker")
"""Command line of a worker."""


class JobOutcome(NamedTuple):
    """A finished job: why it failed, or None; and the number of workers that tried."""

    job: Job
    error: InputError | None
    attempts: int


class WorkerPool:
    """Processes that register drives; a context manager. Leaving it ends them, even at work.

    Each is a fresh process, as JAX does not survive a fork. A drive whose worker dies is retried by a new one,
    ``ATTEMPTS`` times in all.

    Args:
        run: the run.
        workers: processes.
        gpus: numbers of the machine's GPUs, one for each worker; empty without any.
        program: command line of a worker; the descriptor number of its connection is appended.
        progress: called with a job and the number of its scans done since the last call; by several threads.
    """

    def __init__(
        self,
        run: ArchiveRun,
        workers: int,
        *,
        gpus: Sequence[str] = (),
        program: Sequence[str] = PROGRAM,
        progress: Callable[[Job, int], None] = lambda _job, _scans: None,
    ) -> None:
        self._run, self._progress = run, progress
        self._workers = workers
        self._gpus = gpus
        self._program = program
        self._todo: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._outcomes: queue.SimpleQueue[JobOutcome | BaseException] = queue.SimpleQueue()
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
        """The drive that each worker has in work, by process number."""
        with self._lock:
            return {number: worker.drive for number, worker in self._live.items() if worker.drive}

    def run(self, jobs: Sequence[Job]) -> Iterator[JobOutcome]:
        """Do all jobs; yields outcomes as they come.

        Raises:
            InputError: no worker can begin, so that no job can be done.
        """
        for job in jobs:
            self._todo.put(job)
        self._serving = min(self._workers, len(jobs))
        for number in range(self._serving):
            self._threads.append(threading.Thread(target=self._serve, args=(number,), daemon=True))
        for thread in self._threads:
            thread.start()
        for _ in jobs:
            result = self._outcomes.get()
            if isinstance(result, BaseException):
                raise result
            yield result

    def _serve(self, number: int) -> None:
        """Run one worker after another in one slot of the pool."""
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
                        outcome = JobOutcome(job, worker.do(job, attempt, partial(self._progress, job)), attempt)
                        break
                    except WorkerDiedError as died:
                        why = str(died)
                        self._bury(worker)
                        worker = None
                        if self._stopping:
                            return
                self._outcomes.put(outcome or _lost(job, why))
        except BaseException as error:  # raised where the outcomes are awaited
            self._outcomes.put(error)
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
        """Leave a job to the other workers: fewer of them may have enough memory."""
        with self._lock:
            self._serving -= 1
            self._todo.put(job)
            if self._serving or self._stopping:
                return
        raise InputError(self._run.map_path, "workers", "a worker process that opens the map", str(died))

    def _start(self, environment: dict[str, str]) -> WorkerProcess:
        """A worker that is ready. Raises ``WorkerDiedError`` if none survives, ``InputError`` if none is allowed to
        begin.
        """
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
    found = f"{ATTEMPTS} terminated workers, the last one: {why}"
    return JobOutcome(job, InputError(job.drive, "registration", "a worker that completes the drive", found), ATTEMPTS)


# The same jobs on a cluster that dask.distributed schedules (``pip install "lgprjax[batch]"``).
#
# Its workers see map, drives and results under the same paths. Each runs a worker process like those of the pool: JAX
# and BLAS read their number of threads when they start, and dask may have loaded them by then. It runs one job at a
# time, whatever number of threads dask's worker has.

_CONNECT_S = 10.0
_ADDRESS = re.compile(r"(\w+://)?[^\s/]+:\d+|inproc://\S+")
_one_at_a_time = threading.Lock()
_open: dict[ArchiveRun, WorkerProcess] = {}


def run_on_scheduler(address: str, run: ArchiveRun, jobs: Sequence[Job]) -> Generator[JobOutcome, None, None]:
    """Run all jobs on a cluster; yields outcomes as they come. Leaving it early cancels jobs that have not begun.

    The scheduler gives a job whose worker dies to another one, at most ``allowed-failures`` times.

    Args:
        address: address of the scheduler, such as ``tcp://HOST:8786``.
        run: settings of the run.
        jobs: jobs of the run.

    Raises:
        InputError: dask.distributed is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client, Security, as_completed
        from distributed.comm.core import connect
    except ImportError:
        expected = 'the optional package distributed (pip install "lgprjax[batch]")'
        raise InputError("--scheduler", "option", expected, "none") from None
    if not _ADDRESS.fullmatch(address):
        raise InputError("--scheduler", "address", "HOST:PORT, such as tcp://10.0.0.5:8786", address)

    async def answers() -> None:
        secured = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=_CONNECT_S, **secured), _CONNECT_S + 1.0)
        comm.abort()

    try:
        # Before the client: that of an address of no use prints a traceback when the program ends, and where something
        # else than a scheduler listens, it waits for ever. In a thread: a notebook's own has an event loop already.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(lambda: asyncio.run(answers())).result()
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        found = str(error) or f"no response from a scheduler within {_CONNECT_S:g} s"
        raise InputError("--scheduler", address, "a scheduler that responds", found) from None
    with client:
        futures = {client.submit(do_job, run, job, pure=False, retries=ATTEMPTS - 1): job for job in jobs}
        try:
            for future in as_completed(list(futures), loop=client.loop):
                job, lost = futures[future], future.exception()
                # Done: the cluster need not keep it.
                why = future.result() if lost is None else _lost_on_cluster(job, lost)
                future.release()
                yield JobOutcome(job, why, 1)
        finally:
            client.cancel(list(futures))


def do_job(run: ArchiveRun, job: Job) -> InputError | None:
    """Runs on a cluster worker; returns why the job failed, or None. Raises ``WorkerDiedError``: dask retries."""
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


def _lost_on_cluster(job: Job, error: BaseException) -> InputError:
    return InputError(
        job.drive, "registration", "a worker that completes the drive", f"{type(error).__name__}: {error}"
    )
