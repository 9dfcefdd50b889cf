"""Malformed messages at a display that runs: it serves on, grows little, and asks for nothing."""

import json
import random
import socket
import struct
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import httpx
from websockets.sync.client import ClientConnection, connect

from runtime.display.served_page import READY, ServedPage, serve
from validation.damage.malformed import BAD_ROUTE, GOOD_ROUTE, frame, malformed_frame, malformed_http, upgrade, wish

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


def check_malformed(folder: Path, messages: int) -> Seen:
    """Send so many to a display of its own, after some that fill its caches."""
    with serve(folder) as served:
        served.show(READY)
        bombard(served, 300, seed=1)
        served.requests()
        seen = bombard(served, messages, seed=2)
        check(served, seen)
    return seen
