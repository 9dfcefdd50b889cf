"""Watches of a skid-steer vehicle: the tool and the tracks against what they were told, the INS's turns, the stops."""

import math

import pytest

from lgprjax.autopilot.monitors import Severity, Watch, describe
from lgprjax.run_records import StopBits
from lgprjax.runtime.control.senses import LocalAttitude, TurnRate
from lgprjax.runtime.control.skid.senses import InsTurns
from lgprjax.runtime.control.skid.watches import (
    SKID_FINDINGS,
    SkidFound,
    ToolBelief,
    ToolReading,
    ToolWatchState,
    TrackWatchState,
    step_tool_watch,
    step_track_watch,
    stops_of,
)

BELIEF = ToolBelief(0.15, 0.03)
RIGHT, OFF, SHALLOW = ToolReading(True, 0.16), ToolReading(False, 0.15), ToolReading(True, 0.11)
STEP_S = 0.02


def seconds_until(
    readings: list[ToolReading | None], *, commanded_on: bool = True, speed_mps: float = 0.4
) -> tuple[float, SkidFound]:
    """Time to the first finding, and which; infinite where there is none."""
    state = ToolWatchState()
    for number, reading in enumerate(readings, 1):
        state, found = step_tool_watch(
            BELIEF, state, reading, commanded_on=commanded_on, speed_mps=speed_mps, step_s=STEP_S
        )
        if found:
            return number * STEP_S, found
    return math.inf, SkidFound(0)


@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        (OFF, SkidFound.TOOL_OFF),
        (SHALLOW, SkidFound.TOOL_DEPTH),
        (ToolReading(True, 0.19), SkidFound.TOOL_DEPTH),
        (None, SkidFound.TOOL_OFF | SkidFound.TOOL_DEPTH),
    ],
)
def test_a_tool_that_worked_and_does_not_is_found_within_a_fifth_of_a_second(
    wrong: ToolReading | None, found: SkidFound
) -> None:
    right: list[ToolReading | None] = [RIGHT] * 5
    seconds, seen = seconds_until([*right, *[wrong] * 50])
    assert seconds - 5 * STEP_S <= 0.12
    assert seen == found


def test_a_tool_has_time_to_rise_to_its_speed_but_not_more() -> None:
    rising: list[ToolReading | None] = [OFF] * 70
    assert seconds_until(rising)[0] == math.inf
    assert 1.5 <= seconds_until([*rising, *[OFF] * 30])[0] <= 1.7


def test_a_tool_that_is_told_off_or_stands_is_no_fault() -> None:
    assert seconds_until([OFF] * 200, commanded_on=False)[0] == math.inf
    assert seconds_until([OFF] * 200, speed_mps=0.01)[0] == math.inf
    assert seconds_until([OFF] * 200, speed_mps=math.nan)[0] < 2.0


@pytest.mark.parametrize(
    ("told", "measured", "drives", "found"),
    [
        ((0.4, 0.4), (0.0, 0.4), True, SkidFound.LEFT_DEAD),
        ((0.4, -0.4), (0.4, 0.4), True, SkidFound.RIGHT_DEAD),
        ((0.4, 0.4), (math.nan, 0.4), True, SkidFound.LEFT_DEAD),
        ((0.4, 0.4), (0.3, 0.35), True, SkidFound(0)),
        ((0.05, 0.05), (0.0, 0.0), True, SkidFound(0)),
        ((0.4, 0.4), (0.0, 0.0), False, SkidFound(0)),
    ],
)
def test_a_track_that_does_not_follow_is_found(
    told: tuple[float, float], measured: tuple[float, float], drives: bool, found: SkidFound
) -> None:
    state, seen, seconds = TrackWatchState(), SkidFound(0), 0.0
    while not seen and seconds < 2.0:
        state, seen = step_track_watch(state, commanded_mps=told, measured_mps=measured, drives=drives, step_s=STEP_S)
        seconds += STEP_S
    assert seen == found
    assert not found or seconds == pytest.approx(0.5)


def test_turns_by_attitudes_are_told_ten_times_a_second_and_across_half_a_turn() -> None:
    turns, told = InsTurns(), []
    for number in range(51):
        yaw = math.remainder(3.1 + 0.002 * number, math.tau)
        turn = turns.take(LocalAttitude(1_000_000_000 + number * 20_000_000, yaw, 0.0), [TurnRate(0, 5.0)])
        if turn is not None:
            told.append(turn)
    assert len(told) == 10
    assert sum(turn.turn_rad for turn in told) == pytest.approx(0.1)
    assert sum(turn.span_s for turn in told) == pytest.approx(1.0)


def test_turns_by_rates_are_summed_and_not_across_a_gap() -> None:
    turns, told = InsTurns(), []
    for number in range(60):
        arrival_ns = number * 20_000_000 + (0 if number < 30 else 3_000_000_000)
        turn = turns.take(None, [TurnRate(arrival_ns, 0.1)])
        if turn is not None:
            told.append(turn)
    assert all(turn.turn_rad == pytest.approx(0.1 * turn.span_s) for turn in told)
    assert sum(turn.span_s for turn in told) < 1.2
    assert len(told) == 10


def test_every_finding_has_words_a_severity_and_its_stop() -> None:
    assert set(SKID_FINDINGS) == set(SkidFound)
    for bit in SkidFound:
        assert describe(bit, SKID_FINDINGS) == [SKID_FINDINGS[bit].text]
        if SKID_FINDINGS[bit].severity is Severity.STOP:
            assert stops_of(bit, Watch(0))
    assert stops_of(SkidFound(0), Watch.LINE_SILENT) == StopBits.BOX
    assert stops_of(SkidFound.EDGE | SkidFound.TOOL_OFF, Watch(0)) == StopBits.EDGE | StopBits.TOOL
