"""The heading against the way driven: confirmed, contradicted, or not known yet."""

import math

import pytest

from lgprjax.autopilot.monitors import Watch
from lgprjax.autopilot.position_monitors import HeadingCheck, HeadingWatchState, MonitoredPosition, step_heading_watch

COURSE = 2.9
"""Near π, where angles wrap."""
BEGUN_S = 1000.0


def drive(
    heading_rad: float,
    *,
    way_m: float = 3.0,
    odometer_sign: float = 1.0,
    leap_m: float = 0.0,
    sigma_m: float = 0.01,
    fix_heading_rad: float | None = None,
    turn_radpm: float = 0.0,
) -> tuple[HeadingWatchState, Watch]:
    """A way at 1 m/s, the odometer at 431 m; positions seven ticks apart, each one and a half ticks old.

    ``heading_rad`` is where the way begins, and turns with it.
    """
    state, bits = HeadingWatchState(), Watch(0)
    ticks = round(way_m / 0.02)
    for tick in range(ticks + 1):
        position = None
        if tick >= 2 and tick % 7 == 0:
            at_m = 0.02 * (tick - 1.5) + (leap_m if tick > ticks // 2 else 0.0)
            middle, chord_m = COURSE + 0.5 * turn_radpm * at_m, at_m
            if turn_radpm:
                chord_m = 2.0 / turn_radpm * math.sin(0.5 * turn_radpm * at_m)
            x_m, y_m = 500.0 + chord_m * math.cos(middle), 300.0 + chord_m * math.sin(middle)
            position = MonitoredPosition(BEGUN_S + 0.02 * (tick - 1.5), x_m, y_m, sigma_m)
        state, bits = step_heading_watch(
            state,
            time_s=BEGUN_S + 0.02 * tick,
            odometer_m=431.0 + odometer_sign * 0.02 * tick,
            heading_rad=heading_rad + turn_radpm * 0.02 * tick,
            position=position,
            fix_heading_rad=fix_heading_rad,
        )
    return state, bits


def test_a_heading_along_the_way_is_confirmed_and_a_reversed_one_contradicted() -> None:
    for off_deg in (0.0, 25.0, -25.0):
        state, bits = drive(COURSE + math.radians(off_deg))
        assert (state.check, bits) == (HeadingCheck.CONFIRMED, Watch(0)), off_deg
    for off_deg in (180.0, 100.0, -120.0):
        state, bits = drive(COURSE + math.radians(off_deg))
        assert (state.check, bits) == (HeadingCheck.CONTRADICTED, Watch.HEADING_CONTRADICTED), off_deg


@pytest.mark.parametrize("turn_radpm", [0.5, -0.5])
def test_on_an_arc_the_heading_in_its_middle_counts(turn_radpm: float) -> None:
    for off_deg in (0.0, 20.0, -20.0):
        heading_rad = COURSE + math.radians(off_deg)
        assert drive(heading_rad, turn_radpm=turn_radpm)[0].check is HeadingCheck.CONFIRMED
    assert drive(COURSE + math.pi, turn_radpm=turn_radpm)[0].check is HeadingCheck.CONTRADICTED


def test_in_reverse_the_heading_points_back() -> None:
    assert drive(COURSE + math.pi, odometer_sign=-1.0)[0].check is HeadingCheck.CONFIRMED
    assert drive(COURSE, odometer_sign=-1.0)[0].check is HeadingCheck.CONTRADICTED


@pytest.mark.parametrize(
    "told", [{"way_m": 1.4}, {"leap_m": 5.0, "way_m": 2.0}, {"sigma_m": 0.5}, {"sigma_m": math.nan}]
)
def test_too_short_a_way_a_leap_or_poor_positions_say_nothing(told: dict[str, float]) -> None:
    for heading_rad in (COURSE, COURSE + math.pi):
        state, bits = drive(heading_rad, **told)
        assert state.check is HeadingCheck.UNCONFIRMED
        assert bits == Watch.HEADING_UNCONFIRMED


@pytest.mark.parametrize("leap_m", [*range(-8, 9), -3.3, -2.7])
def test_a_jump_of_gnss_turns_no_heading_round(leap_m: float) -> None:
    """Back by twice the way driven, positions look as if the vehicle had driven in reverse."""
    for way_m in (2.0, 3.0, 4.5, 8.0):
        assert drive(COURSE, leap_m=leap_m, way_m=way_m)[0].check is not HeadingCheck.CONTRADICTED
        assert drive(COURSE + math.pi, leap_m=leap_m, way_m=way_m)[0].check is not HeadingCheck.CONFIRMED


def test_an_angle_between_or_none_says_nothing() -> None:
    for off_deg in (60.0, math.nan):
        assert drive(COURSE + math.radians(off_deg))[0].check is HeadingCheck.UNCONFIRMED


def test_a_fix_confirms_or_contradicts_at_standstill() -> None:
    assert drive(COURSE, way_m=0.02, fix_heading_rad=COURSE + 0.02)[1] == Watch(0)
    assert drive(COURSE, way_m=0.02, fix_heading_rad=COURSE + 3.0)[1] == Watch.HEADING_CONTRADICTED
    assert drive(COURSE, way_m=0.02, fix_heading_rad=math.nan)[1] == Watch.HEADING_UNCONFIRMED


def test_an_odometer_that_is_no_number_says_nothing() -> None:
    assert drive(COURSE, odometer_sign=math.nan)[1] == Watch.HEADING_UNCONFIRMED
