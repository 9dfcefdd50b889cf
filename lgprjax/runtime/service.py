"""Connection to the service manager: no process outlives the supervisor, and the manager is notified.

Standard library only, because it is imported first.
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

    The recorder gets SIGTERM, so that it writes waiting messages; the others are killed at once: a silent line sets the
    actuators to their defaults.
    """
    after = signal.SIGTERM if name == "recorder" else signal.SIGKILL
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(after), 0, 0, 0)
    supervisor = os.environ.get(SUPERVISOR)
    # It may have died before the request to the kernel.
    if supervisor is not None and int(supervisor) != os.getppid():
        sys.exit(1)


class Notifier:
    """Notifies the service manager; without one it does nothing. It never blocks and never raises.

    A datagram that does not fit into the manager's socket is dropped: the next one repeats it.

    Args:
        address: address of the socket, with ``@`` first in the abstract name space; by default ``NOTIFY_SOCKET`` of the
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
        """Feed the watchdog; called only by the control loop, once per tick."""
        self._send("WATCHDOG=1")

    def watchdog_within(self, limit_s: float) -> None:
        """Set the time, in seconds from now, after which the watchdog triggers without being fed."""
        self._send(f"WATCHDOG_USEC={max(1, round(limit_s * 1e6))}")

    def status(self, text: str) -> None:
        """Set the text shown by ``systemctl status``."""
        self._send(f"STATUS={_one_line(text)}")

    def stopping(self) -> None:
        """The service is stopping."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """End the notifications."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with suppress(OSError, ValueError):
                self._socket.sendto(message.encode("utf-8", "replace"), self._address)


def watchdog_s() -> float | None:
    """The time limit of the service manager's watchdog, seconds; ``None`` without one."""
    with suppress(KeyError, ValueError):
        limit_s = int(os.environ["WATCHDOG_USEC"]) / 1e6
        return limit_s if limit_s > 0.0 else None
    return None


def _one_line(text: str) -> str:
    # A separate line would be read as another assignment.
    return " ".join(text.split())
