"""A line to a device: a thread reads, stamps and parses incoming data, and sends outgoing frames."""

import contextlib
import os
import select
import socket
import termios
import threading
import time
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import serial

from lgprjax.wire import KEPT, Frame, FrameParser, FrameVerdict, Receiver, RefusedBytes

_WAIT_S = 0.02
_REOPEN_S = 0.5
_CHUNK = 65536
_TO_SEND = 4
_SEND_WITHIN_NS = 100_000_000
_REFUSED_KEPT = 64

Item = TypeVar("Item", covariant=True)


@runtime_checkable
class Parser(Protocol[Item]):
    """Extracts messages from a stream of bytes."""

    def feed(self, data: bytes) -> Sequence[Item | RefusedBytes]:
        """Complete messages, and refused bytes."""


@dataclass(frozen=True, slots=True)
class Arrival(Generic[Item]):
    """An arrival with its time by this computer's monotonic clock: a message, or refused bytes or frame."""

    mono_ns: int
    item: Item


class Port(Generic[Item]):
    """One line. Nothing here raises or blocks except ``close``: a missing line is retried continuously.

    Args:
        source: ``records.Source`` of the arrivals.
        url: a serial device, or ``socket://host:port``.
        baud: baud rate of a serial device.
        parser: parser of incoming bytes.
        receiver: rules that accept or refuse frames.
        capacity: largest number of messages waiting for ``take``; the oldest are dropped.

    Attributes:
        opened: whether the line is open.
        problem: reason why the line is not open, ``""`` if it is.
        openings: number of times it was opened.
        last_arrival_ns: arrival of the last accepted message, ns; 0 before the first.
        lost: number of messages not taken in time.
        unsent: number of frames not sent: too old, or replaced by newer ones.
        refused: number of refusals, by ``Reason`` or ``FrameVerdict``.
    """

    def __init__(
        self,
        source: int,
        url: str,
        baud: int,
        parser: Parser[Item],
        *,
        receiver: Receiver | None = None,
        capacity: int = 512,
    ) -> None:
        if "://" in url and not url.startswith("socket://"):
            raise ValueError(f"{url}: a serial device or socket://host:port expected")
        self.source, self.url, self.receiver = source, url, receiver
        self.opened, self.problem, self.openings = False, "not opened yet", 0
        self.last_arrival_ns, self.lost, self.unsent = 0, 0, 0
        self.refused: Counter[int] = Counter()
        self._baud, self._parser = baud, parser
        self._arrivals: deque[Arrival[Item]] = deque(maxlen=capacity)
        self._refused: deque[Arrival[RefusedBytes]] = deque()
        self._to_send: deque[tuple[int, bytes]] = deque(maxlen=_TO_SEND)
        self._rest, self._rest_ns, self._begun = b"", 0, False  # of the frame that is being sent
        self._ending = threading.Event()
        self._woken, self._wake = os.pipe()
        os.set_blocking(self._woken, False)
        os.set_blocking(self._wake, False)
        self._thread = threading.Thread(target=self._run, name=f"port {url}", daemon=True)
        self._thread.start()

    @staticmethod
    def frames(source: int, url: str, baud: int, line: str, *, capacity: int = 512) -> "Port[Frame]":
        """The port of a line of ``data_schema/wire.toml``: ``radar``, ``drive_by_wire`` or ``controller``."""
        return Port(source, url, baud, FrameParser(), receiver=Receiver(line), capacity=capacity)

    def take(self) -> list[Arrival[Item]]:
        """Arrivals since the last call, oldest first."""
        return [self._arrivals.popleft() for _ in range(len(self._arrivals))]

    def take_refused(self) -> list[Arrival[RefusedBytes]]:
        """The first refusals since the last call, for the recorder."""
        return [self._refused.popleft() for _ in range(len(self._refused))]

    def write(self, data: bytes) -> bool:
        """Queue a frame; returns ``False`` if the line is not open. The newest frames win."""
        if not self.opened:
            return False
        if len(self._to_send) == _TO_SEND:
            self.unsent += 1
        self._to_send.append((time.monotonic_ns(), data))
        with contextlib.suppress(BlockingIOError):  # a full pipe wakes as well
            os.write(self._wake, b"\0")
        return True

    def close(self) -> None:
        """Close the line and end its thread."""
        if not self._ending.is_set():
            self._ending.set()
            with contextlib.suppress(BlockingIOError):
                os.write(self._wake, b"\0")
            self._thread.join()
            os.close(self._woken)
            os.close(self._wake)

    def _run(self) -> None:
        while not self._ending.is_set():
            again_s = time.monotonic() + _REOPEN_S
            try:
                line = _open(self.url, self._baud)
            except (OSError, ValueError, termios.error) as error:
                self.problem = str(error)
            else:
                self.opened, self.problem = True, ""
                self.openings += 1
                try:
                    self._serve(line.fileno())
                except OSError as error:
                    self.problem = error.strerror or str(error)
                self.opened = False
                self._to_send.clear()
                self._rest = b""
                again_s = time.monotonic() + _REOPEN_S
                _close(line)
            self._ending.wait(max(0.0, again_s - time.monotonic()))
        self.problem = "closed"

    def _serve(self, fd: int) -> None:
        while not self._ending.is_set():
            waits = [fd] if self._rest or self._to_send else []
            readable, _, _ = select.select([fd, self._woken], waits, [], _WAIT_S)
            if self._woken in readable:
                os.read(self._woken, _CHUNK)
            self._send(fd)
            if fd in readable:
                data = os.read(fd, _CHUNK)
                if not data:
                    raise OSError("the other end closed the connection")
                self._receive(data, time.monotonic_ns())
        self._send(fd)  # the last message of a process releases the actuators

    def _receive(self, data: bytes, arrival_ns: int) -> None:
        for item in self._parser.feed(data):
            if isinstance(item, RefusedBytes):
                self._refuse(item, arrival_ns)
                continue
            if self.receiver is not None and isinstance(item, Frame):
                verdict = self.receiver.accept(item, arrival_ns)
                if verdict is not FrameVerdict.ACCEPTED:
                    self._refuse(RefusedBytes(verdict, item.raw[:KEPT]), arrival_ns)
                    continue
            if len(self._arrivals) == self._arrivals.maxlen:
                self.lost += 1
            self._arrivals.append(Arrival(arrival_ns, item))
            self.last_arrival_ns = arrival_ns

    def _refuse(self, refused: RefusedBytes, arrival_ns: int) -> None:
        self.refused[refused.reason] += 1
        if len(self._refused) < _REFUSED_KEPT:
            self._refused.append(Arrival(arrival_ns, refused))

    def _send(self, fd: int) -> None:
        """Send as much as the line accepts now; a begun frame is always finished."""
        while True:
            if self._rest and not self._begun and time.monotonic_ns() - self._rest_ns > _SEND_WITHIN_NS:
                self.unsent += 1
                self._rest = b""
            if not self._rest:
                if not self._to_send:
                    return
                self._rest_ns, self._rest = self._to_send.popleft()
                self._begun = False
                continue
            try:
                sent = os.write(fd, self._rest)
            except BlockingIOError:
                return
            self._begun = self._begun or sent > 0
            self._rest = self._rest[sent:]


def _open(url: str, baud: int) -> Any:
    """The open line; its descriptor never blocks.

    Raises:
        OSError, ValueError, termios.error: it cannot be opened.
    """
    device = "://" not in url
    line = serial.serial_for_url(url, baudrate=baud, timeout=0, exclusive=True if device else None)
    os.set_blocking(line.fileno(), False)
    if not device:
        # A frame goes out at once; a peer that vanished silently is noticed within seconds.
        with socket.socket(fileno=os.dup(line.fileno())) as held:
            held.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            held.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in (("TCP_KEEPIDLE", 1), ("TCP_KEEPINTVL", 1), ("TCP_KEEPCNT", 3)):
                if hasattr(socket, option):
                    held.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
    return line


def _close(line: Any) -> None:
    # pyserial leaves a socket open after its peer has gone.
    held = getattr(line, "_socket", None)
    with contextlib.suppress(OSError):
        line.close()
    if held is not None:
        held.close()
