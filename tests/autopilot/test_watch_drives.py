"""The watches over ten minutes of a sound vehicle, and over each fault at twenty moments of them."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from autopilot.watch_faults import CASES, MOMENTS
from lgprjax.autopilot.monitors import Watch

TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def told() -> dict[str, Any]:
    """What the drives told."""
    done = subprocess.run(
        [sys.executable, "-m", "autopilot.watch_faults"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS)])},
        stdout=subprocess.PIPE,
        check=True,
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_nothing_is_found_in_ten_minutes_of_a_sound_vehicle(told: dict[str, Any]) -> None:
    assert told["found_late"] == [0]
    # Before, the heading has yet to be confirmed, and nothing else is found.
    assert told["found"] == [0, int(Watch.HEADING_UNCONFIRMED)]


def test_the_drives_are_varied(told: dict[str, Any]) -> None:
    assert told["slowest_mps"] < -1.0
    assert told["fastest_mps"] > 4.4
    assert told["standing_ticks"] > 500
    assert told["widest_rad"] > 0.3
    assert told["handed_over"] > 15


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_found_in_time(name: str, told: dict[str, Any]) -> None:
    times_s = told["times_s"][name]
    assert len(times_s) == MOMENTS
    assert max(times_s) <= CASES[name].within_s + 1e-9


def test_a_tick_of_all_watches_is_short(told: dict[str, Any]) -> None:
    # A tenth of a millisecond on a quiet machine; the bound is for a busy one.
    assert told["tick_us"] < 400.0
