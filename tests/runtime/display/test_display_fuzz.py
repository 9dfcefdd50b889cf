"""Malformed messages, by the thousand, at a display that runs: it serves on, grows little, and asks for nothing."""

import json
import random
import socket
import struct
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect

from lgprjax.runtime.display.pages import HTTP_LIFE_S, MOST_CONNECTIONS
from runtime.display.malformed import BAD_ROUTE, GOOD_ROUTE, frame, malformed_frame, malformed_http, upgrade, wish
from runtime.display.served_page import READY, ServedPage, serve

LARGEST_GROWTH_KB = 30_000
LONGEST_SILENCE_S = 2.0  # of its heartbeat, on a machine that others use as well


class Seen(NamedTuple):
    """What a bombardment showed: messages sent, good requests among them, memory, the heartbeat's longest silence."""

    messages: int
    wishes: int
    growth_kb: int
    silence_s: float
    took_s: float


def line_to(served: ServedPage) -> socket.socket:
    line = socket.create_connection(("127.0.0.1", served.port), timeout=5.0)
    # Closing frees the port at once: there are fewer of them than messages.
    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    return line


def watch(served: ServedPage) -> ClientConnection:
    """A good visitor."""
    return connect(f"ws://{served.host}/socket", additional_headers={"Origin": f"http://{served.host}"}, proxy=None)


def send_http(served: ServedPage, draw: random.Random) -> None:
    with line_to(served) as line:
        message = malformed_http(served.host, draw)
        line.sendall(message)
        line.settimeout(0.02)
        try:
            answer = line.recv(4096)
        except (TimeoutError, ConnectionError):
            return
        assert not answer.startswith(b"HTTP/1.1 500"), answer
        assert not answer.startswith(b"HTTP/1.1 101"), (message, answer)


def open_socket(line: socket.socket, served: ServedPage, draw: random.Random) -> str:
    """Shake hands; the session of the server's hello, which is the first text after it."""
    line.sendall(upgrade(served.host, draw))
    answer = b""
    while b"}" not in answer:
        part = line.recv(4096)
        assert part, answer
        answer += part
    assert answer.startswith(b"HTTP/1.1 101"), answer
    text = answer[answer.index(b"\r\n\r\n") + 6 :]
    return str(json.loads(text[: text.index(b"}") + 1])["session"])


def await_answer(line: socket.socket) -> None:
    """Until the server answered or ended the connection: closed earlier, it would drop the request unread."""
    line.settimeout(1.0)
    answer = b""
    while b'"answer"' not in answer:
        part = line.recv(4096)
        if not part:
            return
        answer = answer[-16:] + part


def send_frames(served: ServedPage, draw: random.Random) -> tuple[int, int]:
    """A connection with up to eight messages; how many were sent, and how many of them were good requests."""
    sent = wishes = number = 0
    with line_to(served) as line:
        session = open_socket(line, served, draw)
        try:
            for _ in range(draw.randint(1, 8)):
                if draw.random() < 0.05:
                    number += 1
                    wishes += 1
                    # The second one has the number of the first, which was taken or refused a moment before.
                    again = frame(wish(session, number, BAD_ROUTE), draw)
                    line.sendall(frame(wish(session, number, GOOD_ROUTE), draw) + again)
                    await_answer(line)
                else:
                    line.sendall(malformed_frame(session, number, draw))
                sent += 1
            # Last, because it may swallow what follows.
            line.sendall(draw.randbytes(draw.randint(0, 300)))
            line.settimeout(0.002)
            line.recv(4096)
        except (TimeoutError, ConnectionError):
            pass
    return sent, wishes


def bombard(served: ServedPage, messages: int, seed: int) -> Seen:
    draw = random.Random(seed)
    start_kb, begun_s = served.resident_kb(), time.monotonic()
    sent = wishes = looked = 0
    silence_s = growth_kb = 0.0
    while sent < messages:
        if draw.random() < 0.5:
            send_http(served, draw)
            sent += 1
        else:
            more, good = send_frames(served, draw)
            sent, wishes = sent + more, wishes + good
        if sent - looked > 50:
            looked = sent
            silence_s = max(silence_s, served.beat_age_s())
            growth_kb = max(growth_kb, served.resident_kb() - start_kb)
            assert served.process.poll() is None, served.errors.read_text()
    return Seen(sent, wishes, int(growth_kb), silence_s, time.monotonic() - begun_s)


def check(served: ServedPage, seen: Seen) -> None:
    """It did nothing that it was not rightly asked for, and is as it was."""
    asked = Counter(json.dumps(request) for request in served.requests())
    assert asked.keys() == {json.dumps({"select_route": GOOD_ROUTE})}, asked
    # Most of the others share a connection with a message that ends it.
    assert seen.wishes // 10 < asked.total() <= seen.wishes
    assert seen.growth_kb < LARGEST_GROWTH_KB
    assert seen.silence_s < LONGEST_SILENCE_S
    assert served.errors.read_text() == ""
    assert httpx.get(served.url, trust_env=False).status_code == 200
    with watch(served) as line:
        session = json.loads(line.recv(5.0))["session"]
        line.send(json.dumps({"session": session, "number": 1, "select_route": BAD_ROUTE}))
        while json.loads(line.recv(5.0)).get("kind") != "answer":
            pass
    assert served.requests() == [{"select_route": BAD_ROUTE}]


@pytest.mark.parametrize(
    "messages",
    [pytest.param(3_000, id="share"), pytest.param(100_000, id="whole", marks=pytest.mark.campaign)],
)
def test_malformed_messages(tmp_path: Path, messages: int, capsys: pytest.CaptureFixture[str]) -> None:
    with serve(tmp_path) as served:
        served.show(READY)
        bombard(served, 300, seed=1)
        served.requests()
        seen = bombard(served, messages, seed=2)
        check(served, seen)
    with capsys.disabled():
        print(f"\n{seen}")


def open_files(served: ServedPage) -> int:
    return len(list(Path(f"/proc/{served.process.pid}/fd").iterdir()))


def test_connections_that_say_nothing(tmp_path: Path) -> None:
    with serve(tmp_path) as served, ExitStack() as opened:
        before = open_files(served)
        viewer = opened.enter_context(watch(served))
        begun_s = time.monotonic()
        for _ in range(3 * MOST_CONNECTIONS):
            opened.enter_context(line_to(served)).sendall(b"GET / HTTP/1.1\r\nHost: ")
        # Who was there before goes on being told, ten times a second. What is too much goes within the next moments.
        for _ in range(5):
            viewer.recv(2.0)
        # On a busy machine the server itself comes late to it, but not as late as their lives end.
        while open_files(served) > before + MOST_CONNECTIONS + 2:
            assert time.monotonic() - begun_s < 0.5 * HTTP_LIFE_S
            viewer.recv(2.0)
        over = 0
        while open_files(served) > before + 1:
            # Connections that still waited to be taken are taken and closed again: more than a moment is too long.
            over = over + 1 if open_files(served) > before + MOST_CONNECTIONS + 2 else 0
            assert over < 20
            assert time.monotonic() - begun_s < HTTP_LIFE_S + 5.0
            viewer.recv(2.0)
        assert time.monotonic() - begun_s > 0.5 * HTTP_LIFE_S
        assert httpx.get(served.url, trust_env=False).status_code == 200


def test_a_viewer_that_reads_nothing(tmp_path: Path) -> None:
    path = [[float(i), 0.123456789 * i] for i in range(400)]
    draw = random.Random(3)
    with serve(tmp_path) as served, line_to(served) as line:
        served.show(READY | {"path": path})
        open_socket(line, served, draw)
        start_kb = served.resident_kb()
        state: dict[str, Any] = READY | {"warnings": ["w" * 2000]}
        ping = frame(b"x" * 125, draw, opcode=9) * 500
        line.settimeout(0.2)
        begun_s, sent = time.monotonic(), 0
        while time.monotonic() - begun_s < 3.0:
            served.state = state | {"path": [[x + sent, y] for x, y in path]}
            try:
                line.sendall(ping)
            except (TimeoutError, ConnectionError):
                break
            sent += 500
        assert sent > 0
        time.sleep(0.3)
        assert served.resident_kb() - start_kb < 5_000
        assert served.beat_age_s() < LONGEST_SILENCE_S
        assert served.process.poll() is None
