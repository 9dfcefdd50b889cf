"""The devices' ports: pseudo-terminals and a listening socket, none of which can hold the devices up."""

import json
import os
import select
import socket
import tty
from collections.abc import Callable
from functools import partial
from pathlib import Path

from lgprjax.formats.atomic import atomic_output

_SERIAL = ("drive_by_wire", "controller", "gnss")
_SERIAL_WAITS, _RADAR_WAITS = 4096, 1 << 18
_READ = 1 << 16


class _Outlet:
    """A way out. What the host does not read is dropped, whole messages only."""

    def __init__(self, most: int) -> None:
        self.waiting = bytearray()
        self.dropped = 0
        self._most = most

    def put(self, data: bytes) -> None:
        if len(self.waiting) + len(data) > self._most:
            self.dropped += 1
        else:
            self.waiting += data

    def flush(self, write: Callable[[bytes], int]) -> None:
        while self.waiting:
            try:
                sent = write(bytes(self.waiting))
            except BlockingIOError:
                return
            del self.waiting[:sent]


class Ports:
    """Three pseudo-terminals and a socket on the loopback.

    Args:
        renewed: told when another host connects to the radar.
    """

    def __init__(self, renewed: Callable[[], None]) -> None:
        self._renewed = renewed
        self._masters: dict[int, str] = {}
        self._slaves: list[int] = []
        self._names: dict[str, str] = {}
        self._outlets = {line: _Outlet(_SERIAL_WAITS) for line in _SERIAL} | {"radar": _Outlet(_RADAR_WAITS)}
        for line in _SERIAL:
            # Our own hold on the slave: the master lives on when the host lets go of it.
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._masters[master] = line
            self._slaves.append(slave)
            self._names[line] = os.ttyname(slave)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._names["radar"] = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._radar: socket.socket | None = None

    @property
    def dropped(self) -> int:
        """Messages that the host left unread."""
        return sum(outlet.dropped for outlet in self._outlets.values())

    def announce(self, path: Path) -> None:
        """Write the ports' addresses by line, JSON.

        Raises:
            InputError: it cannot be written.
        """
        with atomic_output(path, force=True) as temporary:
            temporary.write_text(json.dumps(self._names), encoding="utf-8")

    def send(self, line: str, data: bytes) -> None:
        """A message to the host, where somebody listens."""
        if line != "radar" or self._radar is not None:
            self._outlets[line].put(data)

    def exchange(self, wait_s: float) -> list[tuple[str, bytes]]:
        """Write what waits, and read what comes within ``wait_s``: (line, bytes)."""
        for master, line in self._masters.items():
            self._outlets[line].flush(partial(os.write, master))
        if self._radar is not None:
            try:
                self._outlets["radar"].flush(self._radar.send)
            except OSError:
                self._hang_up()
        sources: list[int | socket.socket] = [*self._masters, self._listener]
        if self._radar is not None:
            sources.append(self._radar)
        ready, _, _ = select.select(sources, [], [], wait_s)
        told = []
        for source in ready:
            if source is self._listener:
                self._accept()
            elif isinstance(source, int):
                told.append((self._masters[source], os.read(source, _READ)))
            elif source is self._radar:
                told += [("radar", data) for data in self._hear()]
        return told

    def close(self) -> None:
        """Let go of all ports."""
        self._hang_up()
        self._listener.close()
        for handle in (*self._masters, *self._slaves):
            os.close(handle)

    def _accept(self) -> None:
        """Another host takes the place of the one before."""
        try:
            radar, _ = self._listener.accept()
        except OSError:
            return
        self._hang_up()
        radar.setblocking(False)
        radar.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._radar = radar
        self._renewed()

    def _hear(self) -> list[bytes]:
        assert self._radar is not None
        try:
            data = self._radar.recv(_READ)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._hang_up()
            return []
        return [data]

    def _hang_up(self) -> None:
        if self._radar is not None:
            self._radar.close()
            self._radar = None
        self._outlets["radar"].waiting.clear()
