"""The display as a process: how it starts, beats, ends, and what it cannot start with."""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from websockets.sync.client import connect

from lgprjax.errors import InputError
from lgprjax.runtime.display.program import run
from lgprjax.runtime.process import ProcessStage, Started
from lgprjax.runtime.ring import Ring
from runtime.display.display_config import config_with
from runtime.display.served_page import DRIVING, READY, serve


def test_starts_beats_and_ends(tmp_path: Path) -> None:
    with serve(tmp_path) as served:
        assert served.start_s < 1.5
        served.show(DRIVING)
        ages_s = []
        for _ in range(20):
            ages_s.append(served.beat_age_s())
            time.sleep(0.01)
        assert max(ages_s) < 1.0
        assert len(set(ages_s)) == 20
        # An open page does not hold up the end.
        address, own = f"ws://{served.host}/socket", {"Origin": f"http://{served.host}"}
        with connect(address, additional_headers=own, proxy=None) as viewer:
            viewer.recv(5.0)
            begun_s = time.monotonic()
            assert served.end() == 0
            assert time.monotonic() - begun_s < 3.0
        assert served.stage() is ProcessStage.ENDING
        assert served.errors.read_text() == ""


def test_the_state_comes_ten_times_a_second_and_says_its_age(tmp_path: Path) -> None:
    with serve(tmp_path) as served:
        served.show(DRIVING | {"path": [[0.0, 0.0], [5.0, 1.0]]})
        address, own = f"ws://{served.host}/socket", {"Origin": f"http://{served.host}"}
        with connect(address, additional_headers=own, proxy=None) as viewer:
            viewer.recv(5.0)
            said = [json.loads(viewer.recv(5.0)) for _ in range(21)]
            assert 1.2 < said[-1]["sent_s"] - said[0]["sent_s"] < 4.0
            assert [("path" in one) for one in said] == [True] + [False] * 20
            assert sorted(one["age_s"] for one in said)[10] < 0.3
            served.state = None
            time.sleep(0.6)
            while json.loads(viewer.recv(5.0))["age_s"] < 0.5:
                pass


def test_bytes_that_are_no_state_do_no_harm(tmp_path: Path) -> None:
    with serve(tmp_path) as served:
        ring = Ring(tmp_path / "state")
        for message in (b"", b"\x00" * 15, b"\xff" * 4000, b"[" * 100_000):
            ring.put(message)
        served.show(READY)
        address, own = f"ws://{served.host}/socket", {"Origin": f"http://{served.host}"}
        with connect(address, additional_headers=own, proxy=None) as viewer:
            viewer.recv(5.0)
            assert json.loads(viewer.recv(5.0))["state"]["mode"] == "READY"
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
        with pytest.raises(InputError, match=rf"display: expected an address to listen at, found 127.0.0.1:{port}: "):
            run(started)


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_no_address_for_others_without_a_token(tmp_path: Path, host: str) -> None:
    started = Started("display", config_with(host=host, port=0), tmp_path, tmp_path, after_death=False)
    with pytest.raises(InputError, match=r"display\.token"):
        run(started)
    assert not (tmp_path / "display.url").exists()


def test_the_display_computes_nothing() -> None:
    program = (
        "import sys, lgprjax.runtime.display.program; print([n for n in ('jax', 'h5py', 'pandas') if n in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"
