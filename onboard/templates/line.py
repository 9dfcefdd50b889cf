"""One end of a line over TCP: what the three templates share. The runtime connects to ``socket://HOST:PORT``.

A serial device serves as well: replace the socket by ``serial.Serial``; the bytes are the same.
"""

import select
import socket
import time

from lgprjax.wire import Frame, FrameParser, FrameVerdict, Receiver, RefusedBytes, Sender, draw_session


class Line:
    """A device's end of a line.

    Args:
        name: of the line, as in data_schema/wire.toml: radar, drive_by_wire or controller.
        port: TCP port to listen at; 0 takes a free one. The address is printed.
        bind: interface.
    """

    def __init__(self, name: str, port: int, bind: str = "127.0.0.1") -> None:
        self._name = name
        self._listener = socket.create_server((bind, port))
        self._listener.setblocking(False)
        self._host: socket.socket | None = None
        self._sender = Sender(draw_session())
        self._parser, self._receiver = FrameParser(), Receiver(name, "host")
        self.mode = 0
        self.refused = 0
        self.bad_in_a_row = 0
        print(f"socket://{bind}:{self._listener.getsockname()[1]}", flush=True)

    def take(self) -> list[tuple[Frame, int]]:
        """Frames of the host that may be acted upon, each with its arrival, ns of this computer's monotonic clock."""
        self._accept()
        if self._host is None or not select.select([self._host], [], [], 0.0)[0]:
            return []
        try:
            data = self._host.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._hang_up()
            return []
        now_ns, accepted = time.monotonic_ns(), []
        for item in self._parser.feed(data):
            good = not isinstance(item, RefusedBytes) and self._receiver.accept(item, now_ns) is FrameVerdict.ACCEPTED
            self.refused += not good
            self.bad_in_a_row = 0 if good else self.bad_in_a_row + 1
            if good and isinstance(item, Frame):
                self.mode = item.mode
                accepted.append((item, now_ns))
        return accepted

    def send(self, name: str, stamp_ns: int | None = None, ttl_ms: int = 0, **fields: float | bytes) -> None:
        """A frame to the host; what it does not read in time is lost, as on a wire. ``stamp_ns``: else now."""
        mono_ns = time.monotonic_ns() if stamp_ns is None else stamp_ns
        raw = self._sender.frame(name, fields, mode=self.mode, mono_ns=mono_ns, ttl_ms=ttl_ms)
        if self._host is not None:
            try:
                self._host.sendall(raw)
            except OSError:
                self._hang_up()

    def _accept(self) -> None:
        try:
            host, _ = self._listener.accept()
        except BlockingIOError:
            return
        self._hang_up()
        # Sending waits for 50 ms at most, and then lets the host go: it connects again.
        host.settimeout(0.05)
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._host = host
        self._parser, self._receiver = FrameParser(), Receiver(self._name, "host")

    def _hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None
