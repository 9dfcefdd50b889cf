"""The other ends of lines for the tests: pseudo-terminals and sockets."""

import os
import select
import socket
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from lgprjax.runtime.port import Arrival, Port


def until(holds: Callable[[], Any], within_s: float = 10.0) -> bool:
    """Whether something came to hold in time."""
    end = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.002)
    return True


def taken(port: Port[Any], count: int) -> list[Arrival[Any]]:
    """The next ``count`` messages of a port, or what came within seconds."""
    found: list[Arrival[Any]] = []

    def enough() -> bool:
        found.extend(port.take())
        return len(found) >= count

    until(enough)
    return found


def read_now(fd: int, quiet_s: float = 0.1) -> bytes:
    """All that can be read before nothing comes for ``quiet_s``."""
    data = b""
    while select.select([fd], [], [], quiet_s)[0]:
        data += os.read(fd, 65536)
    return data


class Pty:
    """A pseudo-terminal: ``fd`` is the device's end, ``path`` what the port opens."""

    def __init__(self) -> None:
        self.fd, self._held = os.openpty()
        tty.setraw(self._held)
        self.path = os.ttyname(self._held)

    def close(self) -> None:
        os.close(self.fd)
        os.close(self._held)


@contextmanager
def pty_line() -> Iterator[Pty]:
    """A pseudo-terminal for the length of a test."""
    line = Pty()
    try:
        yield line
    finally:
        line.close()


@contextmanager
def server() -> Iterator[tuple[socket.socket, str]]:
    """A listening socket, and the url that a port is told."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(10.0)
        yield listening, f"socket://127.0.0.1:{listening.getsockname()[1]}"


@contextmanager
def closing(port: Port[Any]) -> Iterator[Port[Any]]:
    """A port that is closed when the test ends."""
    try:
        yield port
    finally:
        port.close()
