"""The onboard runtime against simulated devices, in real time on this machine; records.

``python -m benchmarks runtime``.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.records import Record, machine_line
from lgprjax.formats import atomic_output

_PRIORITY = 20
_CODE = "import sys; from lgprjax.cli import main; main(sys.argv[1:])"
_LIMIT_S = 600.0
_ENDING_S = 30.0
"""A supervisor takes up to 15 s to end its processes in their order, the devices some more."""


@dataclass(frozen=True)
class RuntimePlan:
    """How much is measured.

    Attributes:
        length_m: of the course.
        for_s: that it is driven.
        picture: of the times from scan to command, a PNG, replaced if it is there; None for none.
    """

    length_m: float = 1609.0
    for_s: float = 400.0
    picture: Path | None = None


FULL_RUNTIME = RuntimePlan()
QUICK_RUNTIME = RuntimePlan(length_m=150.0, for_s=30.0)


class RuntimeOutcome(NamedTuple):
    """Machine, figures with goals among them, what did not run, and all figures of the run."""

    machine: str
    records: list[Record]
    not_measured: list[str]
    figures: dict[str, Any]


def run_runtime(plan: RuntimePlan, folder: Path, say: Callable[[str], None]) -> RuntimeOutcome:
    """Start cold, start warm, drive.

    Args:
        plan: how much.
        folder: for course, map and recordings.
        say: told what is being done.
    """
    config = _example(folder, plan.length_m)
    failed: list[str] = []
    starts: dict[str, float] = {}
    for name in ("cold", "warm"):
        say(f"{name} start")
        told = _run(config, 1.0, None)
        found = re.search(r"ready after ([0-9.]+) s", told)
        if found is None:
            failed.append(f"{name} start: {_last(told)}")
        else:
            starts[name] = float(found.group(1))
    say(f"driving for {plan.for_s:.0f} s")
    out, bare = folder / "run.json", folder / "bare.json"
    beside = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.bare_loop", str(bare), "--seconds", str(plan.for_s), "--priority",
         str(_PRIORITY)],
    )  # fmt: skip
    try:
        told = _run(config, plan.for_s, out)
        with suppress(subprocess.TimeoutExpired):
            beside.wait(plan.for_s + _ENDING_S)
    finally:
        # It writes into the folder when it ends.
        beside.kill()
        beside.wait()
    if not out.exists():
        return RuntimeOutcome(machine_line(), _starts(starts), [*failed, f"drive: {_last(told)}"], {})
    if not bare.exists():
        failed.append(f"bare loop: its process ended with {beside.returncode}")
    figures: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    if plan.picture is not None:
        # The run draws it itself; of three runs the last one drove.
        drawn = max((folder / "runs").glob("*/timing.png"), key=lambda path: path.stat().st_mtime_ns)
        with atomic_output(plan.picture, force=True) as temporary:
            shutil.copyfile(drawn, temporary)
    periods: dict[str, float] = json.loads(bare.read_text(encoding="utf-8")) if bare.exists() else {}
    records = [*_starts(starts), *_drive(figures, periods.get("p99_9", float("nan")))]
    return RuntimeOutcome(machine_line(), records, failed, figures)


def _starts(starts: dict[str, float]) -> list[Record]:
    goals = {"cold": 30.0, "warm": 8.0}
    note = {"cold": "nothing compiled before", "warm": "compiled programs in the cache"}
    return [
        Record(f"runtime/start_{name}_s", value, "s", "lower", goals[name], f"start to ready, {note[name]}")
        for name, value in starts.items()
    ]


def _drive(figures: dict[str, Any], bare_ms: float) -> list[Record]:
    def told(key: str) -> float:
        return float(figures.get(key, float("nan")))

    return [
        Record("runtime/sensor_to_servo_p99_ms", told("scan_to_command_p99_ms"), "ms", "lower", 100.0,
               "scan's start to the tick that commands with its fix"),
        Record("runtime/sensor_to_servo_p50_ms", told("scan_to_command_p50_ms"), "ms", "lower"),
        Record("runtime/period_above_bare_ms", told("period_p99_9_ms") - bare_ms, "ms", "lower", 4.0,
               f"p99.9 of the control period, {told('period_p99_9_ms'):.2f} ms, less that of a bare loop beside it"),
        Record("runtime/largest_gap_scans", told("largest_gap_scans"), "", "lower", 1.0,
               "largest step from searched scan to searched scan while moving; 1: none missed"),
        Record("runtime/tracking_rms_m", told("tracking_rms_m"), "m", "lower", 0.14, "engaged, true anchor"),
        Record("runtime/tracking_largest_m", told("tracking_largest_m"), "m", "lower"),
        Record("runtime/engaged_way_m", told("engaged_way_m"), "m", "higher"),
        Record("runtime/ok_share", told("ok_share"), "", "higher", None, "of the scans searched"),
        Record("runtime/memory_growth_mb_per_h", told("memory_growth_mb_per_h"), "MB/h", "lower", None,
               f"all processes, second half of the run; {told('memory_mb'):.0f} MB in all"),
        Record("runtime/devices_cpu", told("devices_cpu_share"), "cores", "lower", None, "of the simulated devices"),
    ]  # fmt: skip


def _example(folder: Path, length_m: float) -> Path:
    """The example's configuration and vehicle in a folder of its own."""
    source = Path(__file__).resolve().parents[1] / "onboard"
    vehicle = source.joinpath("made_up.vehicle.toml").read_text(encoding="utf-8")
    (folder / "made_up.vehicle.toml").write_text(vehicle, encoding="utf-8")
    text = source.joinpath("simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("../out/onboard/", "").replace("length_m = 300.0", f"length_m = {length_m}")
    config = folder / "bench.run.toml"
    config.write_text(text, encoding="utf-8")
    return config


def _run(config: Path, for_s: float, out: Path | None) -> str:
    """What ``lgprjax run`` prints. None of its processes is left afterwards: they write into the folder to the end."""
    # In real time however late this machine is: that is what is measured.
    command = [sys.executable, "-c", _CODE, "run", str(config), "--simulate", "--realtime", "--for-s", str(for_s)]
    command += [] if out is None else ["--json", str(out)]
    limit_s = _LIMIT_S + for_s
    # A file takes all that is printed without a reader, and a session of its own tells which processes are the run's.
    with tempfile.TemporaryFile("w+", encoding="utf-8") as told:
        process = subprocess.Popen(command, stdout=told, stderr=subprocess.STDOUT, start_new_session=True)
        late = False
        try:
            process.wait(limit_s)
        except subprocess.TimeoutExpired:
            late = True
        finally:
            _end(process)
        told.seek(0)
        printed = told.read()
    return f"{printed}\nnot done within {limit_s:.0f} s\n" if late else printed


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Ask a run to end in order, as a service manager does; what is left of it after that is killed."""
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_ENDING_S)
    process.kill()
    process.wait()
    # A recorder that has lost its supervisor still writes what waits.
    _wait_for_none(process.pid, _ENDING_S)
    for number in _processes_of(process.pid):
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    _wait_for_none(process.pid, _ENDING_S)


def _wait_for_none(session: int, limit_s: float) -> None:
    until_s = time.monotonic() + limit_s
    while _processes_of(session) and time.monotonic() < until_s:
        time.sleep(0.05)


def _processes_of(session: int) -> list[int]:
    """Numbers of the processes of a session that have not ended; none where the system does not tell."""
    found = []
    for told in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, of = told.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[:4]
            if int(of) == session and state not in "ZX":
                found.append(int(told.parent.name))
    return found


def _last(told: str) -> str:
    return (told.strip().splitlines() or ["no message"])[-1]
