"""Ports over pseudo-terminals and sockets: what comes, what goes, lines that vanish, and ends that do not read."""

import errno
import os
import threading
import time
from pathlib import Path

import pytest

from lgprjax.run_records import Source
from lgprjax.runtime.gnss import GnssParser
from lgprjax.runtime.port import Port
from lgprjax.wire import Frame, FrameParser, FrameVerdict, RefusalReason, Sender
from runtime.line_ends import Pty, closing, pty_line, read_now, server, taken, until
from runtime.line_vectors import frame_of, head_of, payload_of

_HDT = b"$GPHDT,12.5,T*03"


def _status(sequence: int, session: int = 7, ttl_ms: int = 0) -> bytes:
    head = head_of(session, sequence, time.monotonic_ns() // 1000, ttl_ms)
    return frame_of(0x30, payload_of("controller_status", {"buttons": sequence % 128}), head)


def _controller(url: str, capacity: int = 512) -> Port[Frame]:
    return Port.frames(Source.CONTROLLER, url, 115200, "controller", capacity=capacity)


def _light(sender: Sender, lit: int = 1) -> bytes:
    return sender.frame("controller_light", {"light": lit}, mode=2, mono_ns=time.monotonic_ns(), ttl_ms=500)


def says(port: Port[Frame], named: str) -> bool:
    """Whether what keeps a port closed comes to name something."""
    return until(lambda: named in port.problem)


def test_both_ways_over_a_pseudo_terminal() -> None:
    with pty_line() as line, closing(_controller(line.path)) as port:
        assert until(lambda: port.opened)
        before_ns = time.monotonic_ns()
        frames = [_status(sequence) for sequence in range(20)]
        for raw in frames:
            os.write(line.fd, raw[:11])
            time.sleep(0.001)
            os.write(line.fd, raw[11:])
        arrivals = taken(port, 20)
        assert [arrival.item.raw for arrival in arrivals] == frames
        times = [arrival.mono_ns for arrival in arrivals]
        assert before_ns < times[0]
        assert times == sorted(times)
        assert port.last_arrival_ns == times[-1] < time.monotonic_ns()
        sent = _light(Sender(9))
        assert port.write(sent)
        assert read_now(line.fd, 0.5) == sent
        assert (port.openings, port.problem, port.lost, port.unsent) == (1, "", 0, 0)
    assert not port.write(sent)


def test_what_is_refused_is_counted_and_kept() -> None:
    with pty_line() as line, closing(_controller(line.path)) as port:
        assert until(lambda: port.opened)
        first = _status(0)
        bad = first[:-1] + bytes([first[-1] ^ 1])
        stream = [first, bad, first, _status(1, session=8), _status(2)]
        os.write(line.fd, b"".join(stream))
        assert [arrival.item.raw for arrival in taken(port, 2)] == [stream[0], stream[4]]
        refused = port.take_refused()
        assert [arrival.item.reason for arrival in refused] == [
            RefusalReason.CRC,
            FrameVerdict.REPEATED,
            FrameVerdict.SECOND_SENDER,
        ]
        assert [arrival.item.data for arrival in refused] == stream[1:4]
        assert port.receiver is not None
        assert port.receiver.missed == 1
        # Of a flood the first is kept, and all is counted.
        for _ in range(20):
            os.write(line.fd, bad * 10)
        assert until(lambda: port.refused[RefusalReason.CRC] == 201)
        assert [arrival.item.data for arrival in port.take_refused()] == [bad] * 64


def test_messages_that_nobody_takes_give_way() -> None:
    with pty_line() as line, closing(_controller(line.path, capacity=16)) as port:
        assert until(lambda: port.opened)
        for sequence in range(100):
            os.write(line.fd, _status(sequence))
        assert until(lambda: port.lost == 84)
        assert [arrival.item.sequence for arrival in port.take()] == list(range(84, 100))


def test_a_socket_that_comes_and_goes() -> None:
    with server() as (listening, url), closing(_controller(url)) as port:
        for opening in range(1, 3):
            line, _ = listening.accept()
            with line:
                line.settimeout(10.0)
                # What comes before the port is open is let go: nobody knows how old it is.
                assert until(lambda: port.opened)
                line.sendall(_status(opening))
                assert [arrival.item.sequence for arrival in taken(port, 1)] == [opening]
                sent = _light(Sender(9))
                assert port.write(sent)
                assert line.recv(4096) == sent
                assert port.openings == opening
            assert until(lambda: not port.opened)
            gone = time.monotonic()
            assert port.problem
        listening.accept()[0].close()
        assert 0.3 < time.monotonic() - gone < 3.0


def test_gnss_over_a_socket() -> None:
    with server() as (listening, url), closing(Port(Source.GNSS, url, 115200, GnssParser())) as port:
        line, _ = listening.accept()
        with line:
            assert until(lambda: port.opened)
            line.sendall(_HDT + b"\r\n" + b"$GPHDT,12.6,T*03\r\n" + _HDT + b"\r\n")
            assert [arrival.item for arrival in taken(port, 2)] == [_HDT, _HDT]
            assert [arrival.item.reason for arrival in port.take_refused()] == [RefusalReason.CRC]


def test_a_device_that_is_pulled_out_and_put_back(tmp_path: Path) -> None:
    path = tmp_path / "controller"
    first = Pty()
    path.symlink_to(first.path)
    with closing(_controller(str(path))) as port:
        assert until(lambda: port.opened)
        os.write(first.fd, _status(1)[:20])
        path.unlink()
        first.close()
        assert until(lambda: not port.opened)
        assert not port.write(b"nobody there")
        with pty_line() as second:
            path.symlink_to(second.path)
            assert until(lambda: port.opened)
            os.write(second.fd, _status(2) + _status(3))
            assert [arrival.item.sequence for arrival in taken(port, 2)] == [2, 3]
            # What could not be sent while nobody was there is not sent now.
            assert read_now(second.fd) == b""


def test_a_device_belongs_to_one_port() -> None:
    with pty_line() as line, closing(_controller(line.path)) as port:
        assert until(lambda: port.opened)
        with closing(_controller(line.path)) as second:
            assert says(second, line.path)
            assert not second.opened
        assert port.opened


def test_what_cannot_be_opened_is_said(tmp_path: Path) -> None:
    nothing, nobody = str(tmp_path / "nothing"), "socket://127.0.0.1:1"
    for url, named in ((nothing, nothing), ("/dev/null", os.strerror(errno.ENOTTY)), (nobody, nobody)):
        with closing(_controller(url)) as port:
            assert says(port, named), port.problem
            assert not port.opened
            assert not port.write(b"x")
    with pytest.raises(ValueError, match="rfc2217://a:1"):
        _controller("rfc2217://a:1")


def test_a_device_that_does_not_read_holds_nobody_up() -> None:
    with pty_line() as line, closing(_controller(line.path)) as port:
        assert until(lambda: port.opened)
        sender = Sender(9)
        longest_s, sent = 0.0, 0
        end = time.monotonic() + 20.0
        while port.unsent < 200 and time.monotonic() < end:
            raw = _light(sender)
            begin = time.thread_time()
            assert port.write(raw)
            longest_s = max(longest_s, time.thread_time() - begin)
            sent += 1
            # It still hears what comes.
            if sent % 10 == 0:
                os.write(line.fd, _status(sent))
                time.sleep(0.001)
        assert longest_s < 0.02
        assert port.unsent >= 200
        assert port.last_arrival_ns > time.monotonic_ns() - 500_000_000
        time.sleep(0.15)
        # What was sent are whole frames; nothing waits that is old by now, but one that was begun.
        parser = FrameParser()
        frames = parser.feed(read_now(line.fd))
        assert parser.counts.total() == 0
        assert len(frames) + port.unsent <= sent
        assert len(frames) + port.unsent >= sent - 5
        last = _light(sender, 0)
        assert port.write(last)
        assert read_now(line.fd, 0.5).endswith(last)


def test_the_last_frame_goes_out_before_a_port_closes() -> None:
    with pty_line() as line:
        port = _controller(line.path)
        assert until(lambda: port.opened)
        threads = threading.active_count()
        last = _light(Sender(9))
        assert port.write(last)
        port.close()
        port.close()
        assert read_now(line.fd, 0.5) == last
        assert threading.active_count() == threads - 1
        assert not port.opened
