"""The display process as the supervisor starts it, with this side of its rings."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from lgprjax.run_records import Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.display.pages import HTTP_LIFE_S
from lgprjax.runtime.process import RINGS, Heartbeats, ProcessStage
from lgprjax.runtime.ring import Ring

CONFIG = """
name = "testing"
vehicle = "x.vehicle.toml"
map = "x.map.h5"
routes = ["x.map.h5"]
[ports]
drive_by_wire = {{ url = "/dev/null" }}
controller = {{ url = "/dev/null" }}
gnss = {{ url = "/dev/null" }}
radar = {{ url = "/dev/null" }}
[display]
port = {port}
{display}
"""
PROGRAM = """
import sys
from pathlib import Path
from lgprjax.runtime.config import read_config
from lgprjax.runtime.display import pages
from lgprjax.runtime.display.program import run
from lgprjax.runtime.process import Started
pages.HTTP_LIFE_S = float(sys.argv[3])
run(Started("display", read_config(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[2]), False))
"""
MEADOW = {"name": "meadow", "length_m": 412.0, "problem": None}
QUARRY = {"name": "quarry", "length_m": 1609.0, "problem": None}
BROKEN: dict[str, Any] = {"name": "old road", "length_m": 88.0, "problem": "too tight a curve"}
DRIVING: dict[str, Any] = {
    "tick": 5120,
    "time_s": 102.4,
    "mode": "SPEED",
    "mode_since_s": 31.0,
    "warnings": [],
    "refusal": "NONE",
    "refusal_text": "",
    "faults": [],
    "route": "meadow",
    "routes": [MEADOW, QUARRY, BROKEN],
    "speed_mps": 4.43,
    "set_speed_mps": 4.5,
    "cap_mps": 4.5,
    "cross_track_m": 0.07,
    "to_go_m": 287.0,
    "heading_error_deg": 0.4,
    "correlation": 0.93,
    "code": "ok",
    "ok_share": 0.98,
    "sigma_along_m": 0.05,
    "sigma_cross_m": 0.02,
    "pose": [100.0, 10.0, 0.3],
    "gnss_pose": [100.9, 11.6, 0.31],
    "reaction": "CONTINUE",
    "reasons": [],
    "front_rad": 0.03,
    "throttle": 0.3,
    "brake": 0.0,
    "override": False,
    "estop": False,
    "processes": dict.fromkeys(("control", "registration", "recorder", "display", "monitor"), "ready"),
    "monitor": {"free_mb": 48200.0, "memory_mb": 1630.0, "hottest_c": 61.0},
    "recording": {"lost": 0},
    "path": None,
}
READY = DRIVING | {"mode": "READY", "speed_mps": 0.0, "set_speed_mps": None}


def state_record(state: dict[str, Any], mono_ns: int | None = None) -> bytes:
    """A state as the control process puts it."""
    at_ns = time.monotonic_ns() if mono_ns is None else mono_ns
    return pack(Record(RecordKind.STATE, Source.CONTROL, 7, at_ns, json.dumps(state).encode()))


class ServedPage:
    """A running display.

    Attributes:
        state: told to it ten times a second while it is not ``None``; shape: of the tool, likewise.
        start_s: processor time that it took until it was ready.
    """

    def __init__(self, folder: Path, display: str, port: int, http_life_s: float) -> None:
        self.state: dict[str, Any] | None = None
        self.shape: dict[str, Any] | None = None
        self.folder = folder
        self.errors = folder / "errors.txt"
        config = folder / "CONFIG.toml"
        config.write_text(CONFIG.format(display=display, port=port))
        self._states = Ring.create(folder / "state", RINGS["state"])
        self._requests = Ring.create(folder / "requests", RINGS["requests"])
        self._worked = Ring.create(folder / "worked", RINGS["worked"])
        self._beats = Heartbeats(folder)
        begun_s = time.monotonic()
        with self.errors.open("wb") as errors:
            command = [sys.executable, "-c", PROGRAM, str(config), str(folder), str(http_life_s)]
            self.process = subprocess.Popen(command, stderr=errors, stdout=errors)
        self._ended = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)
        try:
            while self.stage() is not ProcessStage.READY:
                if self.process.poll() is not None or time.monotonic() - begun_s > 60.0:
                    raise AssertionError(f"the display did not start: {self.errors.read_text()}")
                time.sleep(0.01)
        except AssertionError:
            self.process.kill()
            self.process.wait()
            raise
        used = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        self.start_s = (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")
        self.url = (folder / "display.url").read_text()
        self.host = urlsplit(self.url).netloc
        self.port = int(self.host.rsplit(":", 1)[1])
        self._teller.start()

    def show_worked(self, worked: dict[str, Any]) -> None:
        """Tell what of a field is worked, as the coverage process does."""
        payload = json.dumps(worked).encode()
        self._worked.put(pack(Record(RecordKind.WORKED, Source.COVERAGE, 0, time.monotonic_ns(), payload)))

    def show(self, state: dict[str, Any]) -> None:
        """Tell a state at once, and again and again."""
        self.state = state
        time.sleep(0.2)

    def stage(self) -> ProcessStage:
        """By its heartbeat."""
        return self._beats.read("display").stage

    def beat_age_s(self) -> float:
        """How long ago it beat."""
        return (time.monotonic_ns() - self._beats.read("display").mono_ns) * 1e-9

    def resident_kb(self) -> int:
        """Its memory."""
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") // 1024

    def requests(self) -> list[dict[str, Any]]:
        """What it asked the control process for since the last call."""
        records = [unpack(message) for message in self._requests.take()]
        assert all(record.kind is RecordKind.REQUEST and record.source is Source.DISPLAY for record in records)
        return [json.loads(record.payload) for record in records]

    def end(self) -> int:
        """SIGTERM; its exit status."""
        self._ended.set()
        if self._teller.is_alive():
            self._teller.join()
        self.process.terminate()
        try:
            return self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def _tell(self) -> None:
        while not self._ended.wait(0.1):
            if self.state is not None:
                self._states.put(state_record(self.state))
            if self.shape is not None:
                self.show_worked(self.shape)


@contextmanager
def serve(folder: Path, display: str = "", port: int = 0, http_life_s: float = HTTP_LIFE_S) -> Iterator[ServedPage]:
    """A display process for as long as the block lasts; it ends unfinished requests after ``http_life_s``."""
    served = ServedPage(folder, display, port, http_life_s)
    try:
        yield served
    finally:
        served.end()
