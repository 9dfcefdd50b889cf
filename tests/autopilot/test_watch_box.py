"""The box's status, the path, and the motion: small watches, case by case."""

import math

import numpy as np

from lgprjax.autopilot.modes import Event
from lgprjax.autopilot.monitors import (
    Dwell,
    LineWatchState,
    MotionState,
    PathWatchState,
    Watch,
    counted_step_s,
    step_dwell,
    step_line_watch,
    step_motion,
    step_path_watch,
)

TESTED = 128


def line(ticks: int, age_s: float = 0.01, box: int = TESTED, held: int = 3, told: int = 3) -> list[Watch]:
    state, found = LineWatchState(), []
    for _ in range(ticks):
        state, bits = step_line_watch(
            state, status_age_s=age_s, box_state=box, box_engaged=held, commanded_engaged=told, step_s=0.02
        )
        found.append(bits)
    return found


def test_a_sound_box_gives_no_finding() -> None:
    assert set(line(50)) == {Watch(0)}
    assert set(line(50, held=0, told=0, box=TESTED | 1)) == {Watch(0)}


def test_a_silent_box_is_found_at_once() -> None:
    for age_s in (0.101, math.inf, math.nan, -0.01):
        assert line(1, age_s=age_s) == [Watch.LINE_SILENT]


def test_what_the_box_says_of_the_line_is_found_at_once() -> None:
    for state, bit in ((2, Watch.BAD_FRAMES), (4, Watch.SECOND_SENDER), (64, Watch.BUS_OFF)):
        assert line(1, box=TESTED | state) == [bit]


def test_a_fault_of_an_actuator_is_found_when_it_lasts_longer_than_a_sag() -> None:
    for state in (8, 16, 32, 256):
        assert line(11, box=TESTED | state) == [Watch(0)] * 9 + [Watch.ACTUATOR_FAULT] * 2


def test_a_box_that_lets_go_is_found_within_a_tenth_of_a_second() -> None:
    for found in (line(6, box=TESTED | 1), line(6, held=1)):
        assert found == [Watch(0)] * 4 + [Watch.DEFAULTS_ACT] * 2


def test_an_untested_brake_is_told() -> None:
    assert line(1, box=0) == [Watch.BRAKE_UNTESTED]


def path(offsets_m: list[float], state: PathWatchState | None = None) -> list[Watch]:
    state, found = state or PathWatchState(), []
    for offset_m in offsets_m:
        state, bits = step_path_watch(state, engaged=True, cross_track_m=offset_m, step_s=0.02)
        found.append(bits)
    return found


def test_on_the_way_to_the_path_nothing_is_found() -> None:
    assert set(path([5.0] * 100 + [0.2] * 10)) == {Watch(0)}


def test_once_there_a_foot_and_a_yard_are_found_within_a_tenth_of_a_second() -> None:
    for side in (-1.0, 1.0):
        found = path([0.0, *[side * 0.31] * 4])
        assert found == [Watch(0)] * 3 + [Watch.OFF_PATH] * 2
        found = path([0.0, *[side * 0.92] * 4])
        assert found == [Watch(0)] * 3 + [Watch.OFF_PATH | Watch.FAR_OFF_PATH] * 2
        assert set(path([0.0, *[side * 0.30] * 50])) == {Watch(0)}


def test_an_offset_that_is_no_number_is_far_off_from_the_first() -> None:
    assert path([math.nan] * 3)[-1] == Watch.FAR_OFF_PATH
    assert path([0.0, *[math.nan] * 3])[-1] == Watch.OFF_PATH | Watch.FAR_OFF_PATH


def test_a_finding_goes_after_a_second_on_the_path_and_at_the_end_of_engaging() -> None:
    found = path([0.0, *[0.5] * 4, *[0.0] * 60])
    assert found[53] == Watch.OFF_PATH
    assert found[-1] == Watch(0)
    state = step_path_watch(PathWatchState(True, Dwell(0.0, True)), engaged=False, cross_track_m=9.0, step_s=0.02)
    assert state == (PathWatchState(), Watch(0))


def motion(speeds_mps: list[float], state: MotionState | None = None) -> tuple[MotionState, list[Event]]:
    state, events = state or MotionState(), []
    for speed_mps in speeds_mps:
        state, found = step_motion(state, speed_mps=speed_mps, fastest_engage_mps=4.5, step_s=0.02)
        events += found
    return state, events


def test_motion_is_told_when_it_changes() -> None:
    state, events = motion([0.0] * 5 + [2.0] * 50 + [-2.0] * 100 + [0.0] * 200 + [5.0] * 200)
    assert events == [Event.STANDING, Event.MOVING, Event.STANDING, Event.MOVING, Event.TOO_FAST]
    assert motion([4.4] * 200, state)[1] == []
    assert motion([4.2] * 200, state)[1] == [Event.MOVING]


def test_noise_at_standstill_tells_nothing() -> None:
    noise = [0.06 * (-1) ** tick for tick in range(200)]
    assert motion(noise)[1] == [Event.STANDING]


def test_an_unknown_speed_is_too_fast_to_engage() -> None:
    state, _ = motion([1.0] * 50)
    assert motion([math.nan] * 4, state)[1] == []
    state, events = motion([math.nan] * 5, state)
    assert events == [Event.TOO_FAST]
    assert motion([1.0] * 2, state)[1] == [Event.MOVING]


def test_a_tick_counts_for_no_more_than_two_and_one_of_no_known_length_as_one() -> None:
    for step_s in (0.0, 1e-9, 0.02, 0.0401, 1e9, math.inf, -math.inf, -1e9):
        assert 0.0 <= counted_step_s(step_s) <= 0.04
    assert counted_step_s(math.nan) == counted_step_s(-1.0) == 0.02


def test_a_dwell_is_on_after_three_in_a_row_and_off_after_five() -> None:
    holds = (np.random.default_rng(5).random(2000) < np.repeat([0.3, 0.8, 0.5, 0.15], 500)).tolist()
    dwell, on, changes = Dwell(), False, 0
    for at in range(len(holds)):
        dwell = step_dwell(dwell, holds[at], 0.02, on_s=0.06, off_s=0.1)
        was = on
        if not on and at >= 2 and all(holds[at - 2 : at + 1]):
            on = True
        elif on and at >= 4 and not any(holds[at - 4 : at + 1]):
            on = False
        changes += on != was
        assert dwell.on == on
    assert changes > 20
