"""The monitor on made-up machines and on this one."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lgprjax.run_records import Record, RecordKind, Source, unpack
from lgprjax.runtime import monitor
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.main import process_command
from lgprjax.runtime.monitor import Condition, look_at_computer, warnings_of
from lgprjax.runtime.process import RINGS, Heartbeats, ProcessStage
from lgprjax.runtime.ring import Ring
from runtime.supervised_run import LIMIT_S, write_config

WELL = Condition(5000.0, 2000.0, {"control": 300.0}, 0.5, 50.0, 0.0)


@pytest.fixture
def config(tmp_path: Path) -> RuntimeConfig:
    return read_config(write_config(tmp_path))


def put(root: Path, file: str, text: str) -> None:
    path = root / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_a_made_up_machine_is_read(tmp_path: Path) -> None:
    put(tmp_path, "proc/meminfo", "MemTotal: 4000000 kB\nMemFree: 1 kB\nMemAvailable:    1000000 kB\n")
    put(tmp_path, "proc/41/statm", "9999 2500 100 1 0 1 0\n")
    put(tmp_path, "sys/class/thermal/thermal_zone0/temp", "61500\n")
    put(tmp_path, "sys/class/thermal/thermal_zone1/temp", "-274000\n")
    put(tmp_path, "sys/class/hwmon/hwmon3/temp1_input", "72250\n")
    put(tmp_path, "sys/class/hwmon/hwmon3/temp2_input", "no sensor\n")
    put(tmp_path, "sys/class/hwmon/hwmon3/temp3_input", "999000\n")
    (tmp_path / "sys/class/hwmon/hwmon4/temp1_input").mkdir(parents=True)
    found = look_at_computer(tmp_path, {"control": 41, "recorder": 42, "display": 0}, 0.0004, tmp_path)
    assert found.memory_mb == 1024.0
    assert found.rss_mb == {"control": round(2500 * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)}
    assert found.hottest_c == 72.25
    assert found.clock_step_s == 0.0


def test_what_a_machine_does_not_say_is_none(tmp_path: Path) -> None:
    found = look_at_computer(tmp_path / "card pulled", {"control": 1}, -3600.0, tmp_path)
    assert (found.free_mb, found.memory_mb, found.hottest_c, found.rss_mb) == (None, None, None, {})
    assert found.clock_step_s == -3600.0


def test_this_machine_is_read(tmp_path: Path) -> None:
    found = look_at_computer(tmp_path, {"this": os.getpid()}, 0.0)
    room = os.statvfs(tmp_path)
    assert found.free_mb == pytest.approx(room.f_bavail * room.f_frsize / 1e6, rel=0.2)
    status = Path("/proc/self/status").read_text()
    rss_kb = int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")))
    assert found.rss_mb["this"] == pytest.approx(rss_kb * 1024 / 1e6, rel=0.1)


def test_each_bound_has_its_warning(config: RuntimeConfig) -> None:
    assert warnings_of(WELL, config) == []
    at_bounds: dict[str, Any] = {"free_mb": 500.0, "memory_mb": 300.0, "hottest_c": 95.0}
    unknown: dict[str, Any] = {"memory_mb": None, "hottest_c": None}
    for change in (at_bounds, unknown):
        assert warnings_of(WELL._replace(**change), config) == []
    beyond: list[tuple[dict[str, Any], str]] = [
        ({"free_mb": 499.0}, "499"),
        ({"free_mb": None}, ""),
        ({"memory_mb": 299.0}, "299"),
        ({"hottest_c": 96.0}, "96"),
        ({"clock_step_s": -1.0}, "-1.000"),
    ]
    for change, number in beyond:
        (warning,) = warnings_of(WELL._replace(**change), config)
        assert number in warning


def test_a_step_of_the_clock_of_the_day_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    before_s = monitor._clock_ahead_s()
    shifted = SimpleNamespace(time_ns=lambda: time.time_ns() + 2_500_000_000, monotonic_ns=time.monotonic_ns)
    monkeypatch.setattr(monitor, "time", shifted)
    assert monitor._clock_ahead_s() - before_s == pytest.approx(2.5, abs=0.02)


def test_the_process_beats_reports_every_second_and_ends(config: RuntimeConfig, tmp_path: Path) -> None:
    rings = tmp_path / "rings"
    rings.mkdir()
    beats = Heartbeats(rings)
    ring = Ring.create(rings / "monitor", RINGS["monitor"])
    root = str(Path(__file__).parents[2])
    began_s = time.monotonic()
    with subprocess.Popen(
        process_command("monitor", config, rings, tmp_path, False),
        env={**os.environ, "PYTHONPATH": root},
        stderr=subprocess.PIPE,
    ) as process:
        records: list[Record] = []
        while len(records) < 2 and time.monotonic() - began_s < LIMIT_S:
            records += [unpack(message) for message in ring.take()]
            time.sleep(0.01)
        beat = beats.read("monitor")
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=LIMIT_S)
        assert (process.returncode, errors) == (0, b"")
    assert [(record.kind, record.source) for record in records] == [(RecordKind.MONITOR, Source.MONITOR)] * 2
    assert 0.8 < (records[1].mono_ns - records[0].mono_ns) / 1e9 < 2.0
    content = json.loads(records[1].payload)
    assert set(content) == {*Condition._fields, "warnings"}
    assert set(content["rss_mb"]) == {"monitor", "supervisor"}
    assert (beat.stage, beat.pid) == (ProcessStage.READY, process.pid)
    assert beats.read("monitor").stage == ProcessStage.ENDING


def test_what_runs_beside_imports_nothing_that_computes() -> None:
    """A process that starts anew must be ready in a moment, and small."""
    code = """
import sys, lgprjax.runtime.port, lgprjax.runtime.gnss, lgprjax.runtime.stamps, lgprjax.runtime.recorder
print(*({"jax", "numpy", "h5py"} & set(sys.modules)), sep=",")
import lgprjax.runtime.monitor, lgprjax.runtime.supervisor
print(*({"jax", "h5py", "pandas", "starlette"} & set(sys.modules)), sep=",")
import lgprjax.runtime.display.program
print(*({"jax", "h5py", "pandas"} & set(sys.modules)), sep=",")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines() == ["", "", ""]
