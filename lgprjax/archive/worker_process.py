"""One worker process and the connection to it: asked, answered, found dead, ended."""

import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from multiprocessing import Pipe

from lgprjax.archive.job_key import ArchiveRun, Job
from lgprjax.errors import InputError

_ENDING_S = 10.0  # a compile cannot be interrupted


class WorkerDiedError(Exception):
    """A worker ended before it answered; one line says how."""


class WorkerProcess:
    """A process that registers drives.

    Args:
        program: its command line, to which the number of its connection's descriptor is added.
        environment: it is started with.

    Attributes:
        number: of the process.
        drive: that it has now; empty for none.
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
                # What a terminal sends reaches the pool alone, which ends its workers in order.
                start_new_session=True,
            )
        self.number = self._process.pid

    def begin(self, run: ArchiveRun) -> None:
        """Hand it the run. Raises ``InputError`` where it may not begin, ``WorkerDiedError`` where it ended."""
        answer = self._asked(run)
        if isinstance(answer, InputError):
            raise answer

    def do(self, job: Job, attempt: int) -> InputError | None:
        """Have a drive registered: why it failed, or None. Raises ``WorkerDiedError`` where it ended over it."""
        self.drive = job.name
        answer = self._asked((job, attempt))
        self.drive = ""
        assert answer is None or isinstance(answer, InputError)
        return answer

    def interrupt(self) -> None:
        """As by Ctrl-C: what it is writing is given up in order."""
        self._process.send_signal(signal.SIGINT)

    def await_end(self) -> None:
        """Wait until it ends; kill it where it does not."""
        try:
            self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def end(self) -> None:
        """Close the connection, on which it ends."""
        self._connection.close()
        self.await_end()
        self._said.close()

    def _asked(self, what: object) -> object:
        try:
            self._connection.send(what)
            return self._connection.recv()
        except (EOFError, OSError):
            raise WorkerDiedError(self._death()) from None

    def _death(self) -> str:
        """How it ended, in a line."""
        try:
            status = self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            return "a closed connection"
        if status < 0:
            return f"signal {-status} ({signal.strsignal(-status)})"
        self._said.seek(0)
        last = (self._said.read().decode(errors="replace").strip().splitlines() or [""])[-1]
        return f"exit {status}" + (f": {last}" if last else "")
