"""A real recorder process for the tests, and what feeds it."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

from lgprjax.formats.run_log import read_run
from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.runtime.config import read_config
from lgprjax.runtime.process import RINGS, Heartbeats, Started
from lgprjax.runtime.recorder import Recorder
from lgprjax.runtime.ring import Ring

LOGS = ("control_log", "registration_log", "supervisor_log")

_CONFIG = """
name = "test"
vehicle = "v.vehicle.toml"
map = "m.map.h5"
routes = ["r.route.toml"]
[ports]
drive_by_wire = { url = "/dev/null" }
controller = { url = "/dev/null" }
gnss = { url = "/dev/null" }
radar = { url = "/dev/null" }
[recording]
"""


class Place(NamedTuple):
    """Where a recorder of the tests works."""

    rings: Path
    run: Path
    config: Path


def make_place(folder: Path, **recording: object) -> Place:
    """Folders and a configuration; ``recording`` are keys of its table of that name."""
    place = Place(folder / "rings", folder / "run", folder / "CONFIG.toml")
    place.rings.mkdir()
    place.config.write_text(_CONFIG + "".join(f"{key} = {value}\n" for key, value in recording.items()))
    return place


def start_recorder(place: Place, *, after_death: bool = False, limit: int | None = None) -> subprocess.Popen[str]:
    """A recorder; ``limit`` is the largest file that it may write, bytes. It is ready when this returns, or ended."""
    program = Path(__file__).with_name("recorder_program.py")
    command = [sys.executable, "-P", str(program), *map(str, place), str(int(after_death)), str(limit or 0)]
    # The interpreter must not look for what the test run has imported.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    before = len(list(place.run.glob("*.lgprun")))
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    until_s = time.monotonic() + 20.0
    while process.poll() is None and len(list(place.run.glob("*.lgprun"))) == before:
        assert time.monotonic() < until_s, "the recorder does not come up"
        time.sleep(0.005)
    return process


def make_recorder(place: Place, *, after_death: bool = False) -> Recorder:
    """A recorder in this process."""
    return Recorder(Started("recorder", read_config(place.config), place.rings, place.run, after_death))


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """End it as the supervisor does; its status and what it said."""
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=20)
    return process.returncode, said


def ring(place: Place, name: str) -> Ring:
    """The writer's end of a ring."""
    return Ring.create(place.rings / name, RINGS[name])


def make_record(
    counter: int, data: bytes = b"", kind: RecordKind = RecordKind.PORT_IN, source: Source = Source.RADAR
) -> bytes:
    """A record as it is put into a ring; its payload begins with a counter."""
    return pack(Record(kind, source, counter, time.monotonic_ns(), counter.to_bytes(8, "little") + data))


class Feeder:
    """Puts records into the rings at the pace of a vehicle: 50 ticks a second and 126 scans of 4 kB.

    Attributes:
        put: what went into each ring, in order.
        beat: the recorder's process and its count of beats when each of them was put.
    """

    def __init__(self, place: Place, seed: int) -> None:
        self.put: dict[str, list[bytes]] = {name: [] for name in LOGS}
        self.beat: dict[str, list[tuple[int, int]]] = {name: [] for name in LOGS}
        self._rings = {name: ring(place, name) for name in LOGS}
        self._beats = Heartbeats(place.rings)
        self._rng = random.Random(seed)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def end(self) -> None:
        """Stop feeding."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        begun_s, ticks, scans = time.monotonic(), 0, 0
        while not self._stop.wait(0.004):
            passed_s = time.monotonic() - begun_s
            while scans < 126 * passed_s:
                self._put("registration_log", self._rng.randbytes(11 * 369))
                scans += 1
            while ticks < 50 * passed_s:
                for size in (4, 64, 40, 90, 12, 30):
                    self._put("control_log", self._rng.randbytes(size))
                if ticks % 5 == 0:
                    self._put("supervisor_log", b"{}")
                ticks += 1

    def _put(self, name: str, data: bytes) -> None:
        message = make_record(len(self.put[name]), data)
        # Told before it is put: a reader may see it at once.
        self.put[name].append(message)
        assert self._rings[name].put(message)
        beat = self._beats.read("recorder")
        self.beat[name].append((beat.pid, beat.count))

    def due(self, name: str) -> int:
        """How many of a ring's messages a recorder that is now dead must have written.

        It beats before each pass over the rings, and once before it is ready: what was there when it began a pass is
        written when it beats again.
        """
        last = self._beats.read("recorder")
        counts = [count if pid == last.pid else 1 for pid, count in list(self.beat[name])]
        return sum(max(1, count) + 2 <= last.count for count in counts)


def recorded(place: Place) -> dict[str, list[bytes]]:
    """What a run's records are, by the ring that they are of: told by the length of their payloads."""
    found: dict[str, list[bytes]] = {name: [] for name in LOGS}
    for _, data in read_run(place.run):
        size = len(data) - len(make_record(0))
        name = "registration_log" if size > 100 else "supervisor_log" if size == 2 else "control_log"
        found[name].append(data)
    return found


def check_kills(folder: Path, kills: int, seed: int) -> None:
    """A recorder killed at random moments under load: what it was fed is on the disk, once and in order."""
    place = make_place(folder, least_free_mb=0, segment_s=1.0)
    rng = random.Random(seed)
    process = start_recorder(place)
    feeder = Feeder(place, seed)
    checked = 0
    try:
        for _ in range(kills):
            time.sleep(rng.uniform(0.0, 0.4))
            process.kill()
            process.communicate()
            found = recorded(place)
            for name in LOGS:
                # None invented, altered, left out or twice; and all that was there two passes before, 0.04 s.
                assert found[name] == feeder.put[name][: len(found[name])]
                assert len(found[name]) >= feeder.due(name)
                checked += feeder.due(name)
            process = start_recorder(place, after_death=True)
    finally:
        feeder.end()
        status = end(process)
    assert status == (0, "")
    assert recorded(place) == feeder.put
    assert checked > 100 * kills
    summary = read_run(place.run).summary
    assert summary.complete
    assert summary.damaged == ()
    assert summary.segments > kills
