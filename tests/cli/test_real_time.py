"""Whether a machine keeps real time: measured for a moment, and judged."""

import pytest

from lgprjax.cli import real_time
from lgprjax.cli.real_time import RealTime, look_at_onboard, measure_real_time


@pytest.mark.parametrize(
    ("largest_late_s", "behind", "keeps"),
    [(0.004, 0.0, True), (0.03, 0.01, True), (0.09, 0.0, False), (0.03, 0.5, False), (2.5, 0.96, False)],
)
def test_lateness_decides(largest_late_s: float, behind: float, keeps: bool) -> None:
    found = RealTime(largest_late_s, behind)
    assert found.keeps is keeps
    assert ("too busy or slow" in found.line) is not keeps


def test_three_processes_work_for_a_moment() -> None:
    found = measure_real_time(0.2)
    assert found.largest_late_s > 0.0
    assert 0.0 <= found.behind <= 1.0


def test_work_that_no_machine_does_in_time_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    # Spawned processes import the module anew: the work is passed to them.
    monkeypatch.setattr(real_time, "_UNITS", (20_000, 1))
    assert not measure_real_time(0.2).keeps


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
    assert f"{scans_hz:.0f} scans a second searched, 126 asked" in found[0].found
    assert all(bool(finding.advice) == (finding.verdict == "look") for finding in found)
