"""What is written is brought to the disk beside the recorder's loop, which a slow disk must not hold up."""

import os
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path


class DiskSync:
    """A thread that brings files to the disk, in the order in which it is asked.

    Args:
        longest_s: that one of its calls may take.
    """

    def __init__(self, longest_s: float = 10.0) -> None:
        self._longest_s = longest_s
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._error: OSError | None = None
        self._since_s: float | None = None
        # Each is counted up by one thread only.
        self._asked = self._done = 0
        self._thread = threading.Thread(target=self._run, name="disk-sync", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether something asked for is not on the disk yet."""
        return self._asked > self._done

    def data(self, file: int) -> None:
        """Ask for a file's data."""
        self._ask(lambda: os.fdatasync(file))

    def finish(self, file: int) -> None:
        """Ask for a file whole, and that it be closed."""
        self._ask(lambda: _finish(file))

    def folder(self, path: Path) -> None:
        """Ask for a folder's entries."""
        self._ask(lambda: sync_folder(path))

    def check(self) -> None:
        """Hear of what failed.

        Raises:
            OSError: a call failed, or takes longer than ``longest_s``.
        """
        since_s = self._since_s
        if self._error is not None:
            raise self._error
        if since_s is not None and time.monotonic() - since_s > self._longest_s:
            raise TimeoutError(f"the disk took nothing for {self._longest_s:g} s")

    def drain(self) -> None:
        """Wait until everything asked for is on the disk, at most ``longest_s``.

        Raises:
            OSError: as ``check``.
        """
        self._jobs.put(None)
        self._thread.join(self._longest_s)
        if self._error is None and self._thread.is_alive():
            raise TimeoutError(f"the disk took nothing for {self._longest_s:g} s")
        self.check()

    def _ask(self, job: Callable[[], None]) -> None:
        self._asked += 1
        self._jobs.put(job)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._since_s = time.monotonic()
            try:
                job()
            except OSError as error:
                self._error = error
                return
            self._since_s = None
            self._done += 1


def sync_folder(path: Path) -> None:
    """Bring a folder's entries to the disk."""
    _finish(os.open(path, os.O_RDONLY | os.O_DIRECTORY))


def _finish(file: int) -> None:
    try:
        os.fsync(file)
    finally:
        os.close(file)
