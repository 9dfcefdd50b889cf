"""Supervisor and service manager: no process outlives the one, and the other is told how it goes.

Nothing but the standard library: it comes first.
"""

import ctypes
import os
import signal
import socket
import sys
from contextlib import suppress

_PR_SET_PDEATHSIG = 1

SUPERVISOR = "LGPRJAX_SUPERVISOR"
"""Variable of the environment: process number of the supervisor that started this process."""


def die_with_parent(name: str) -> None:
    """Let the kernel end this process when its supervisor's main thread ends.

    The recorder is asked, so that it writes what waits; the others go at once: a silent line sets the actuators to
    their defaults.
    """
    after = signal.SIGTERM if name == "recorder" else signal.SIGKILL
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(after), 0, 0, 0)
    supervisor = os.environ.get(SUPERVISOR)
    # It may have died before the kernel was told.
    if supervisor is not None and int(supervisor) != os.getppid():
        sys.exit(1)


class Notifier:
    """Speaks to the service manager; without one it says nothing. It never waits and never raises.

    A datagram that the manager's full socket does not take is let go: the next one says the same.

    Args:
        address: of the socket, ``@`` first for one in the abstract name space; by default ``NOTIFY_SOCKET`` of the
            environment.
    """

    def __init__(self, address: str | None = None) -> None:
        found = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        self._address = "\0" + found[1:] if found.startswith("@") else found
        self._socket: socket.socket | None = None
        if self._address:
            with suppress(OSError):
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
                self._socket.setblocking(False)

    def ready(self, text: str) -> None:
        """The service is up; ``text`` is its status."""
        self._send(f"READY=1\nSTATUS={_one_line(text)}")

    def watchdog(self) -> None:
        """The control loop went round: called by that loop and by nothing else."""
        self._send("WATCHDOG=1")

    def watchdog_within(self, limit_s: float) -> None:
        """How long the watchdog may now go without being fed, counted from here, seconds."""
        self._send(f"WATCHDOG_USEC={max(1, round(limit_s * 1e6))}")

    def status(self, text: str) -> None:
        """What a person reads in ``systemctl status``."""
        self._send(f"STATUS={_one_line(text)}")

    def stopping(self) -> None:
        """The service goes down in good order."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Nothing is said after this."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with suppress(OSError, ValueError):
                self._socket.sendto(message.encode("utf-8", "replace"), self._address)


def watchdog_s() -> float | None:
    """The time that the service manager's watchdog allows, seconds; ``None`` where it watches nothing."""
    with suppress(KeyError, ValueError):
        limit_s = int(os.environ["WATCHDOG_USEC"]) / 1e6
        return limit_s if limit_s > 0.0 else None
    return None


def _one_line(text: str) -> str:
    # A line of its own would be read as another assignment.
    return " ".join(text.split())
