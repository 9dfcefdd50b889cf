"""Watches against numbers by hand, and against numbers that are none."""

import math

import pytest

from lgprjax.autopilot.chassis_monitors import (
    PedalReading,
    PedalWatchState,
    ServoWatchState,
    WheelAngles,
    init_wheel_sensors,
    step_pedal_watch,
    step_servo_watch,
    step_wheel_sensors,
)
from lgprjax.autopilot.monitors import (
    ChassisBelief,
    PedalBelief,
    PedalsBelief,
    Watch,
    WheelBelief,
    curvature,
    front_angle,
    linear_wheel_map,
    proportional_rear,
    yaw_gain,
)
from lgprjax.autopilot.position_monitors import MonitoredPosition, OdometerWatchState, step_odometer_watch

WHEEL = WheelBelief(linear_wheel_map(2.5, -2.0, 0.5), 10_000.0, 0.5, 0.15, 0.5, 0.06, 0.003, 0.005, 24.0, 10.0)
PEDALS = PedalsBelief(PedalBelief(0.1, 0.05, 3.0, 0.6), PedalBelief(0.2, 0.06, 6.0, 0.25), 0.15, 0.03)


def test_a_falling_potentiometer_is_read_and_beyond_its_map_says_nothing() -> None:
    for volts, angle_rad in ((2.5, 0.0), (1.5, 0.5), (3.5, -0.5), (1.4, 0.55)):
        assert front_angle(WHEEL, volts) == pytest.approx(angle_rad)
    for volts in (0.0, 5.0, 1.3, math.nan, math.inf):
        assert math.isnan(front_angle(WHEEL, volts))


def test_the_turn_of_a_counter_steered_vehicle() -> None:
    chassis = ChassisBelief(3.8, proportional_rear(0.6), 20.0)
    assert curvature(chassis, -0.2) == pytest.approx(-(math.tan(0.2) + math.tan(0.12)) / 3.8)
    assert yaw_gain(chassis, -20.0) == pytest.approx(0.5)


def test_a_wheel_refitted_off_by_a_tooth_shows_with_a_kept_zero() -> None:
    for kept, expected in ((math.nan, Watch(0)), (-700.0, Watch.WHEEL_SENSORS_APART)):
        state, bits = init_wheel_sensors(kept), Watch(0)
        for _ in range(20):
            state, angles, bits = step_wheel_sensors(WHEEL, state, 2.3, 1_000.0, 0.02)
        assert bits == expected
        assert angles.front_rad == pytest.approx(0.1)
        assert angles.encoder_rad == pytest.approx(0.1 if math.isnan(kept) else 0.17)


def test_an_encoder_that_is_no_number_is_found_before_it_was_ever_read() -> None:
    state, bits = init_wheel_sensors(), Watch(0)
    for _ in range(8):
        state, _, bits = step_wheel_sensors(WHEEL, state, 2.5, math.nan, 0.02)
    assert bits == Watch.WHEEL_SENSORS_APART


def servo(ticks: int, wheels: WheelAngles, command_rad: float, supply_v: float = 24.0, engaged: bool = True) -> Watch:
    state, bits = ServoWatchState(), Watch(0)
    for _ in range(ticks):
        state, bits = step_servo_watch(
            WHEEL, state, wheels, supply_v, engaged=engaged, command_rad=command_rad, step_s=0.02
        )
    return bits


NOTHING = WheelAngles(math.nan, math.nan)


def test_a_servo_that_stands_or_of_which_nothing_is_known_is_found() -> None:
    known = WheelAngles(0.0, 0.0)
    for wheels, command in ((NOTHING, 0.0), (known, math.nan), (known, 0.5), (WheelAngles(math.nan, 0.0), 0.5)):
        assert Watch.SERVO_WEAK in servo(60, wheels, command)


def test_wheels_beyond_their_limit_run_away() -> None:
    assert Watch.STEERING_RUNAWAY in servo(12, WheelAngles(0.54, 0.54), 0.5)


def test_a_low_supply_is_found_engaged_or_not() -> None:
    for supply_v in (18.0, math.nan):
        assert servo(11, WheelAngles(0.0, 0.0), 0.0, supply_v) == Watch.SUPPLY_LOW
        assert servo(11, WheelAngles(0.0, 0.0), 0.0, supply_v, engaged=False) == Watch.SUPPLY_LOW


def odometer(
    ticks: int,
    *,
    gnss_mps: float,
    commanded_mps: float,
    thrust_mps2: float = 0.0,
    jump_m: float = 0.0,
    back_at: int = 10_000,
    heading_confirmed: bool = True,
) -> Watch:
    """A straight way by GNSS at 7 Hz and by the wheels; GNSS jumps at tick 70, and back at another."""
    heading_rad, begun_s = 2.2, 1000.0
    state, bits = OdometerWatchState(), Watch(0)
    for tick in range(ticks):
        at_s = 0.02 * tick
        way_m = gnss_mps * at_s + (jump_m if 70 < tick <= back_at else 0.0)
        x_m, y_m = way_m * math.cos(heading_rad) - 70.0, way_m * math.sin(heading_rad) + 400.0
        position = MonitoredPosition(begun_s + at_s, x_m, y_m, 0.01)
        state, bits = step_odometer_watch(
            state,
            time_s=begun_s + at_s,
            odometer_m=431.0 + commanded_mps * at_s,
            speed_mps=commanded_mps,
            heading_rad=heading_rad,
            heading_confirmed=heading_confirmed,
            position=position if tick % 7 == 0 and math.isfinite(gnss_mps) else None,
            thrust_mps2=thrust_mps2,
            step_s=0.02,
        )
    return bits


@pytest.mark.parametrize(
    ("gnss_mps", "commanded_mps", "bit"),
    [
        (2.0, 0.0, Watch.ODOMETER_DEAD),
        (2.0, -2.0, Watch.ODOMETER_REVERSED),
        (2.0, 3.0, Watch.ODOMETER_SLIPS),
        (2.0, 2.05, Watch(0)),
        (-1.5, -1.5, Watch(0)),
        (2.0, math.nan, Watch.ODOMETER_DEAD | Watch.SPEED_UNKNOWN),
        # A receiver that repeats its position is not the odometer's fault.
        (0.0, 2.0, Watch(0)),
    ],
)
def test_the_odometer_against_gnss(gnss_mps: float, commanded_mps: float, bit: Watch) -> None:
    assert odometer(75, gnss_mps=gnss_mps, commanded_mps=commanded_mps) == bit


@pytest.mark.parametrize(
    ("gnss_mps", "commanded_mps", "bit"),
    [(-2.0, 2.0, Watch(0)), (2.0, 2.0, Watch(0)), (2.0, 0.0, Watch.ODOMETER_DEAD), (-2.0, 3.0, Watch.ODOMETER_SLIPS)],
)
def test_before_the_heading_is_confirmed_a_wrong_sign_may_be_its_own(
    gnss_mps: float, commanded_mps: float, bit: Watch
) -> None:
    assert odometer(75, gnss_mps=gnss_mps, commanded_mps=commanded_mps, heading_confirmed=False) == bit


def test_a_jump_of_gnss_is_no_fault_of_the_odometer() -> None:
    for jump_m in (0.3, 3.0, 30.0):
        for ticks in range(71, 140, 14):
            for back_at in (80, 90, 10_000):
                found = odometer(ticks, gnss_mps=2.0, commanded_mps=2.0, jump_m=jump_m, back_at=back_at)
                assert found == Watch(0)


def test_without_gnss_throttle_tells_of_a_dead_odometer() -> None:
    found = odometer(56, gnss_mps=math.nan, commanded_mps=0.0, thrust_mps2=2.0)
    assert found == Watch.ODOMETER_DEAD | Watch.SPEED_UNKNOWN
    assert odometer(56, gnss_mps=math.nan, commanded_mps=0.0, thrust_mps2=1.0) == Watch(0)


def test_a_brake_that_is_no_number_is_dead_where_it_is_needed() -> None:
    for brake, expected in ((0.0, Watch.PEDAL_UNREAD), (0.5, Watch.PEDAL_UNREAD | Watch.BRAKE_DEAD)):
        state, bits = PedalWatchState(), Watch(0)
        for _ in range(20):
            state, bits = step_pedal_watch(
                PEDALS,
                state,
                engaged=True,
                command=PedalReading(0.0, brake),
                measured=PedalReading(0.0, math.nan),
                speed_mps=math.nan,
                speed_trusted=True,
                step_s=0.02,
            )
        assert bits == expected
