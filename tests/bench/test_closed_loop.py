"""Records of the closed-loop benchmark from made-up figures: goals on the right side, kinds kept apart."""

from typing import Any

import pytest

from benchmarks.closed_loop import FULL_LOOP, Drives, day_records, drive_records, many_records


def _figures(**more: Any) -> dict[str, Any]:
    return {
        "rms_m": 0.06,
        "largest_m": 0.2,
        "within_foot": 1.0,
        "way_m": 1600.0,
        "relative_cross_mean_m": 0.02,
        "located_cross_rms_m": 0.03,
        "switch_cross_rms_m": 0.04,
        "gnss_ins_cross_rms_m": 0.2,
        "nees_position": 0.9,
        "nees_yaw": 1.1,
        "ok_share": 0.9,
        "wrong_fixes": 0,
        "degraded_share": 0.01,
        "finished": True,
        "speed_mps": 4.4,
        "largest_steering_step_rad": 0.02,
        "steering_limit_rad": 0.024,
        "seconds": 200.0,
        **more,
    }


def test_the_worst_drive_decides() -> None:
    group = Drives("42 Hz", (1, 2), 3)
    records = {r.key: r for r in drive_records([(group, _figures()), (group, _figures(rms_m=0.12, within_foot=0.98))])}
    assert records["42 Hz: tracking, worst RMS"].value == 0.12
    assert records["42 Hz: tracking, worst RMS"].met is False
    assert records["42 Hz: tracking, mean RMS"].value == pytest.approx(0.09)
    assert records["42 Hz: tracking, largest"].met is True
    assert records["42 Hz: length within a foot, least"].met is False
    assert records["42 Hz: largest steering step / limit"].value == pytest.approx(0.02 / 0.024)


def test_a_drive_that_did_not_arrive_is_seen() -> None:
    records = {r.key: r for r in drive_records([(Drives("126 Hz", (1,), 1), _figures(finished=False))])}
    assert records["126 Hz: finished"].met is False


def test_days_are_told_beside_what_was_published() -> None:
    done = [
        (Drives("42 Hz", (2,), 3), _figures()),
        (Drives("snow", (2,), 3, weather="snow"), _figures(relative_cross_mean_m=0.31)),
        (Drives("switch", (2,), 3, fusion="switch"), _figures(relative_cross_mean_m=9.0)),
    ]
    records = {r.key: r for r in day_records(done)}
    assert records["clear: relative accuracy"].value == 0.02
    assert records["snow: relative accuracy"].goal == 0.29
    assert records["snow: relative accuracy"].met is False
    assert not any(key.startswith("rain") for key in records)


def test_a_thousand_kilometres_are_reckoned_from_what_ran() -> None:
    found = {
        "kilometres": 500.0,
        "seconds": 120.0,
        "first_block_s": 30.0,
        "times_real_time": 900.0,
        "rms_m": 0.05,
        "rms_95_m": 0.06,
        "largest_m": 0.3,
        "within_foot": 1.0,
        "nees_position": 1.0,
        "nees_yaw": 1.0,
        "stopped": 0.0,
        "peak_rss_mb": 900.0,
    }
    records = {r.key: r for r in many_records(found)}
    assert records["error model: 1,000 km take"].value == pytest.approx(4.0)
    assert records["error model: 1,000 km take"].met is True


def test_the_plan_has_every_seed_once() -> None:
    groups = FULL_LOOP.drives
    seeds = sorted(seed for group in groups if group.name in ("42 Hz", "126 Hz") for seed in group.seeds)
    assert seeds == list(range(1, 21))
