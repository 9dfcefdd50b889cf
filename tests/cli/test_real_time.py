"""Whether a machine keeps real time: measured for a moment, and judged."""

import json
import math
import re
import struct
from pathlib import Path

import pytest

from canon.commands import succeed
from formats.run_log_sample import head_bytes, record_bytes
from lgprjax.cli.installation import look_at_onboard
from lgprjax.simulation import real_time
from lgprjax.simulation.lock_step import Progress
from lgprjax.simulation.real_time import RealTime, RunWatch, StuckWatch, measure_real_time


@pytest.mark.parametrize(
    ("largest_late_s", "behind", "keeps"),
    [(0.03, 0.01, True), (0.09, 0.0, False), (0.03, 0.5, False)],
)
def test_lateness_decides(largest_late_s: float, behind: float, keeps: bool) -> None:
    assert RealTime(largest_late_s, behind).keeps is keeps


def test_work_that_no_machine_does_in_time_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    # Spawned processes import the module anew: the work is passed to them.
    monkeypatch.setattr(real_time, "_UNITS", (20_000, 1))
    found = measure_real_time(0.2)
    assert not found.keeps
    assert found.largest_late_s > 0.0
    assert 0.0 <= found.behind <= 1.0


@pytest.mark.parametrize(
    ("scans_hz", "measured", "verdicts"),
    [
        (420.0, RealTime(0.002, 0.0), ["good", "good"]),
        (150.0, RealTime(0.002, 0.0), ["look", "good"]),
        (60.0, RealTime(0.9, 0.4), ["look", "look"]),
    ],
)
def test_a_machine_is_judged_by_what_was_measured(
    monkeypatch: pytest.MonkeyPatch, scans_hz: float, measured: RealTime, verdicts: list[str]
) -> None:
    monkeypatch.setattr(real_time, "measure_search", lambda: scans_hz)
    monkeypatch.setattr(real_time, "measure_real_time", lambda: measured)
    found = look_at_onboard()
    assert [finding.verdict for finding in found] == verdicts
    assert all(f"{hz:.0f} " in found[0].found for hz in (scans_hz, 126))
    assert all(bool(finding.advice) == (finding.verdict == "look") for finding in found)
    told = {row["name"]: row["verdict"] for row in json.loads(succeed("doctor", "--onboard", "--json", "-"))}
    assert [told[finding.name] for finding in found] == verdicts


def test_a_recording_that_grows_is_watched_for_arrival(tmp_path: Path) -> None:
    """Found wherever the record of it is cut between two looks; another end of a route is none."""
    watch = RunWatch(tmp_path)
    assert not watch.arrived()
    driven = _event(1, "SPEED", "CRUISE_PLUS", [])
    chosen = _event(2, "SPEED", "ROUTE_OFF", ["another route was chosen"])
    arrived = _event(3, "SPEED", "ROUTE_OFF", ["the end of the route is reached"])
    whole = head_bytes(0, 0) + driven + chosen
    (tmp_path / "0000.lgprun").write_bytes(whole)
    assert not watch.arrived()
    for cut in (10, arrived.index(b"ROUTE_OFF") + 4, len(arrived) - 1):
        watch = RunWatch(tmp_path)
        (tmp_path / "0000.lgprun").write_bytes(whole + arrived[:cut])
        assert not watch.arrived()
        (tmp_path / "0000.lgprun").write_bytes(whole + arrived + _event(4, "SPEED", "CRUISE_MINUS", []))
        assert watch.arrived()


def test_the_mode_is_that_of_the_last_event_recorded(tmp_path: Path) -> None:
    watch = RunWatch(tmp_path)
    assert not watch.arrived()
    assert watch.mode == ""
    parts = head_bytes(0, 0) + _event(1, "CHECKS", "BOOT_DONE", [])
    late = _event(2, "ERROR", "CHECKS_FAILED", [])
    for data, mode in (
        (parts, "CHECKS"),
        (parts + late[: late.index(b"ERROR") + 2], "CHECKS"),
        (parts + late, "ERROR"),
        (parts + late, "ERROR"),
    ):
        (tmp_path / "0000.lgprun").write_bytes(data)
        assert not watch.arrived()
        assert watch.mode == mode


@pytest.mark.parametrize(
    ("modes", "leaves_error", "why", "ends_s"),
    [
        # Seconds after all processes are ready: mode.
        ({0.0: "CHECKS", 12.0: "ERROR"}, False, "ERROR", 30.5),
        ({0.0: "CHECKS", 12.0: "ERROR"}, True, "ERROR", 30.5),
        ({0.0: ""}, False, "BOOT", 30.5),
        ({0.0: "CHECKS", 2.0: "READY", 50.0: "ERROR"}, False, "ERROR", 80.0),
        ({0.0: "CHECKS", 2.0: "READY", 50.0: "ERROR"}, True, "", None),
        ({0.0: "CHECKS", 29.0: "READY"}, False, "", None),
        ({0.0: "CHECKS", 2.0: "READY", 50.0: "ERROR", 70.0: "READY", 80.0: "ERROR"}, False, "ERROR", 110.0),
        ({0.0: "EMERGENCY_STOP"}, False, "", None),
    ],
)
def test_a_run_that_never_arrives_is_ended(
    modes: dict[float, str], leaves_error: bool, why: str, ends_s: float | None
) -> None:
    watch, said = StuckWatch(leaves_error=leaves_error), dict[str, float]()
    for half_seconds in range(240):
        at_s = 0.5 * half_seconds
        if found := watch.look(next(m for since, m in reversed(modes.items()) if since <= at_s), 1e4 + at_s):
            said.setdefault(found, at_s)
    assert list(said.values()) == ([] if ends_s is None else [ends_s])
    assert all(why in found for found in said)


def _event(number: int, mode: str, event: str, why: list[str]) -> bytes:
    told = json.dumps({"event": event, "mode": mode, "why": why, "actions": []}).encode()
    return record_bytes(number, struct.pack("<BBHIQ", 8, 10, 0, number, 10**12 + number) + told)


def test_what_is_not_known_yet_is_left_out_of_the_progress() -> None:
    for known, line in (
        (Progress(0.4, "CHECKS", math.nan, math.nan), r"0 s \w+, CHECKS"),
        (Progress(12.0, "SPEED", 2.94, 63.4), r"12 s \w+, SPEED, 2\.9 m/s, 63 m .*"),
    ):
        assert re.fullmatch(line, known.line)
