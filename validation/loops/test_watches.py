"""The watches over ten minutes of a sound vehicle, and over each fault at twenty moments of them."""

from collections.abc import Callable

import pytest

from autopilot.watch_faults import CASES, check_sound_vehicle, found_times_s

DRIVES, MOMENTS = 5, 20


def test_nothing_is_found_of_a_sound_vehicle() -> None:
    check_sound_vehicle(DRIVES)


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_found_in_time(name: str, record_property: Callable[[str, object], None]) -> None:
    times_s = found_times_s(DRIVES, CASES[name], MOMENTS)
    record_property("latest_s", round(max(times_s), 2))
    assert max(times_s) <= CASES[name].within_s + 1e-9
