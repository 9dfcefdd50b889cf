"""The display as a process: how it starts, beats, ends, and what it cannot start with."""

import json
import socket
import time
from pathlib import Path

import httpx
from websockets.sync.client import connect

from lgprjax.runtime.display.program import run
from lgprjax.runtime.process import ProcessStage, Started
from lgprjax.runtime.ring import Ring
from refusals import refused
from runtime.display.display_config import config_with
from runtime.display.served_page import DRIVING, serve


def test_starts_beats_tells_and_ends(tmp_path: Path) -> None:
    with serve(tmp_path) as served:
        assert served.start_s < 1.5
        ring = Ring(tmp_path / "state")
        for message in (b"", b"\x00" * 15, b"\xff" * 4000, b"[" * 100_000):
            ring.put(message)
        served.show(DRIVING | {"path": [[0.0, 0.0], [5.0, 1.0]]})
        ages_s = []
        for _ in range(20):
            ages_s.append(served.beat_age_s())
            time.sleep(0.01)
        assert max(ages_s) < 1.0
        assert len(set(ages_s)) == 20
        address, own = f"ws://{served.host}/socket", {"Origin": f"http://{served.host}"}
        with connect(address, additional_headers=own, proxy=None) as viewer:
            viewer.recv(5.0)
            # Ten times a second, with its age: the page knows when it is old.
            said = [json.loads(viewer.recv(5.0)) for _ in range(11)]
            assert 0.6 < said[-1]["sent_s"] - said[0]["sent_s"] < 3.0
            assert [("path" in one) for one in said] == [True] + [False] * 10
            assert sorted(one["age_s"] for one in said)[5] < 0.3
            served.state = None
            time.sleep(0.6)
            while json.loads(viewer.recv(5.0))["age_s"] < 0.5:
                pass
            # An open page does not hold up the end.
            begun_s = time.monotonic()
            assert served.end() == 0
            assert time.monotonic() - begun_s < 3.0
        assert served.stage() is ProcessStage.ENDING
        assert served.errors.read_text() == ""


def test_started_again_at_the_same_address_after_being_killed(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    with serve(first) as served:
        port = served.port
        httpx.get(served.url, trust_env=False)
        served.process.kill()
        served.process.wait()
        with serve(second, port=port) as again:
            assert again.port == port
            assert httpx.get(again.url, trust_env=False).status_code == 200


def test_an_address_in_use_is_told(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        started = Started("display", config_with(port=port), tmp_path, tmp_path, after_death=False)
        with refused("display", found=f"127.0.0.1:{port}"):
            run(started)


def test_no_address_for_others_without_a_token(tmp_path: Path) -> None:
    started = Started("display", config_with(host="0.0.0.0", port=0), tmp_path, tmp_path, after_death=False)
    with refused("display.token"):
        run(started)
    assert not (tmp_path / "display.url").exists()
