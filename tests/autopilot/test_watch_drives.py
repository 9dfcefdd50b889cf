"""The watches over six minutes of a sound vehicle, and over each fault at eight moments of them."""

import pytest

from autopilot.watch_faults import CASES, check_sound_vehicle, found_times_s

DRIVES, MOMENTS = 3, 8


def test_nothing_is_found_of_a_sound_vehicle() -> None:
    check_sound_vehicle(DRIVES)


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_found_in_time(name: str) -> None:
    times_s = found_times_s(DRIVES, CASES[name], MOMENTS)
    assert len(times_s) == MOMENTS
    assert max(times_s) <= CASES[name].within_s + 1e-9
