"""Records of the closed-loop benchmark from made-up figures: goals on the right side, kinds kept apart."""

from typing import Any

import pytest

from benchmarks.closed_loop import drive_records, many_records


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
        "engaged_share": 0.99,
        "largest_steering_step_rad": 0.02,
        "steering_limit_rad": 0.024,
        "seconds": 200.0,
        **more,
    }


def test_the_worst_drive_decides() -> None:
    done = [("clear", _figures()), ("clear", _figures(rms_m=0.12, engaged_share=0.9, wrong_fixes=2))]
    records = {r.key: r for r in drive_records(done)}
    assert records["clear: tracking, RMS"].value == 0.12
    assert records["clear: tracking, RMS"].met is False
    assert records["clear: tracking, largest"].met is True
    assert records["clear: engaged, of the way"].met is False
    assert records["clear: wrong by over 0.3 m"].value == 2.0
    assert records["clear: wrong by over 0.3 m"].met is False
    assert records["clear: largest steering step / limit"].value == pytest.approx(0.02 / 0.024)


def test_a_drive_that_did_not_arrive_is_seen() -> None:
    records = {r.key: r for r in drive_records([("GNSS off", _figures(finished=False))])}
    assert records["GNSS off: finished"].met is False


def test_days_are_told_beside_what_was_published() -> None:
    done = [("clear", _figures()), ("snow", _figures(relative_cross_mean_m=0.31)), ("GNSS 2 m", _figures())]
    records = {r.key: r for r in drive_records(done)}
    assert records["clear: relative accuracy"].value == 0.02
    assert records["snow: relative accuracy"].goal == 0.29
    assert records["snow: relative accuracy"].met is False
    assert records["GNSS 2 m: relative accuracy"].goal is None
    assert records["GNSS 2 m: speed"].goal is None
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
