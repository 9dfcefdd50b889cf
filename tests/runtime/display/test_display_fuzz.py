"""Malformed messages, silent connections and readers at a display that runs: it serves on and grows little.

A hundred thousand messages: ``validation/damage/test_display.py``.
"""

import random
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx

from lgprjax.runtime.display.pages import MOST_CONNECTIONS
from runtime.display.served_page import READY, ServedPage, serve
from validation.damage.bombardment import LONGEST_SILENCE_S, check_malformed, line_to, open_socket, watch
from validation.damage.malformed import frame


def test_malformed_messages(tmp_path: Path) -> None:
    check_malformed(tmp_path, 800)


def open_files(served: ServedPage) -> int:
    return len(list(Path(f"/proc/{served.process.pid}/fd").iterdir()))


def test_connections_that_say_nothing(tmp_path: Path) -> None:
    life_s = 6.0
    with serve(tmp_path, http_life_s=life_s) as served, ExitStack() as opened:
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
            assert time.monotonic() - begun_s < 0.5 * life_s
            viewer.recv(2.0)
        over = 0
        while open_files(served) > before + 1:
            # Connections that still waited to be taken are taken and closed again: more than a moment is too long.
            over = over + 1 if open_files(served) > before + MOST_CONNECTIONS + 2 else 0
            assert over < 20
            assert time.monotonic() - begun_s < life_s + 5.0
            viewer.recv(2.0)
        assert time.monotonic() - begun_s > 0.5 * life_s
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
        while time.monotonic() - begun_s < 1.5:
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
