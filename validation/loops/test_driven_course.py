"""A mile with full registration in the loop, five courses in each of seven conditions."""

from collections.abc import Callable

import pytest

from benchmarks.course_drive import CONDITIONS, drive_one
from lgprjax.simulation.loop import MILE_M


@pytest.mark.parametrize("seed", range(2, 7))
@pytest.mark.parametrize("name", CONDITIONS)
def test_a_mile(name: str, seed: int, record_property: Callable[[str, object], None]) -> None:
    figures = drive_one(CONDITIONS[name], seed, MILE_M)
    for key, value in figures.items():
        if key != "fixes":
            record_property(key, value)
    assert figures["finished"]
    assert figures["engaged_share"] >= 0.95
    assert figures["rms_m"] <= CONDITIONS[name].rms_goal_m
    assert figures["largest_m"] <= 0.9144
    assert figures["wrong_fixes"] == 0
    assert figures["largest_steering_step_rad"] <= 1.0001 * figures["steering_limit_rad"]
