"""The runtime's benchmark: starts and drive become records; what does not run is said; no process is left."""

import json
import math
import shutil
import time
from pathlib import Path

import pytest

from benchmarks import runtime
from benchmarks.runtime import RuntimePlan, run_runtime

_FIGURES = {
    "scan_to_command_p99_ms": 90.0,
    "scan_to_command_p50_ms": 30.0,
    "period_p99_9_ms": 21.5,
    "largest_gap_scans": 2,
    "tracking_rms_m": 0.05,
    "memory_mb": 1500.0,
}


def test_records_say_what_is_met_and_what_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = iter((31.0, 7.5, 7.0))
    runs = tmp_path / "runs" / "1"
    runs.mkdir(parents=True)

    def drive(config: Path, _for_s: float, out: Path | None) -> str:
        text = config.read_text(encoding="utf-8")
        assert "length_m = 77.0" in text
        assert "../" not in text
        if out is not None:
            out.write_text(json.dumps(_FIGURES), encoding="utf-8")
            (runs / "timing.png").write_bytes(b"picture")
        return f"ready after {next(ready)} s\n"

    monkeypatch.setattr(runtime, "_run", drive)
    picture = tmp_path / "t.png"
    found = run_runtime(RuntimePlan(length_m=77.0, for_s=0.3, picture=picture), tmp_path, print)
    assert found.not_measured == []
    assert found.figures == _FIGURES
    records = {record.key.removeprefix("runtime/"): record for record in found.records}
    # The bare loop truly ran beside it: how late this machine lets it be is not known here.
    assert records["period_above_bare_ms"].value < 21.5
    met = {key: record.met for key, record in records.items() if record.goal is not None}
    assert met == {
        "start_cold_s": False,
        "start_warm_s": True,
        "sensor_to_servo_p99_ms": True,
        "period_above_bare_ms": records["period_above_bare_ms"].value <= 4.0,
        "largest_gap_scans": False,
        "tracking_rms_m": True,
    }
    # What the run did not tell is no number.
    assert math.isnan(records["ok_share"].value)
    assert picture.read_bytes() == b"picture"


# A supervisor that never ends in order, and a recorder in a group of its own that writes for a while after it.
_STUBBORN = """
import pathlib, signal, subprocess, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
folder = pathlib.Path(sys.argv[2]).parent
recorder = (
    "import pathlib, signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\\n"
    "while True: (pathlib.Path({!r}) / str(time.monotonic_ns())).touch(); time.sleep(0.002)"
)
subprocess.Popen([sys.executable, "-c", recorder.format(str(folder))], process_group=0)
print("run: here", flush=True)
time.sleep(60)
"""


def test_no_process_of_a_run_that_takes_too_long_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder can be removed; the benchmark says what did not run, and ends."""
    monkeypatch.setattr(runtime, "_CODE", _STUBBORN)
    monkeypatch.setattr(runtime, "_LIMIT_S", 0.5)
    monkeypatch.setattr(runtime, "_ENDING_S", 0.3)
    folder = tmp_path / "bench"
    folder.mkdir()
    began_s = time.monotonic()
    told = runtime._run(folder / "bench.run.toml", 0.5, None)
    assert time.monotonic() - began_s < 20.0
    assert told.startswith("run: here\n")
    assert "1 s" in runtime._last(told)
    assert len(list(folder.iterdir())) > 1
    shutil.rmtree(folder)
    time.sleep(0.1)
    assert not folder.exists()
    monkeypatch.setattr(runtime, "_run", lambda *_: told)
    folder.mkdir()
    found = run_runtime(RuntimePlan(for_s=0.1), folder, print)
    assert [line.partition(":")[0] for line in found.not_measured] == ["cold start", "warm start", "drive"]
    assert (found.records, found.figures) == ([], {})
