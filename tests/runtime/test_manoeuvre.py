"""Commanded manoeuvres of a calibration through the control loop: modes, limits, and the operator who ends them."""

import math

import pytest

from lgprjax.autopilot import EngagementInhibit, Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.runtime.words import ARRIVED
from runtime.calibrated_vehicle import TICK_S, CalibratedVehicle
from runtime.manoeuvre_cases import (
    AMPLITUDE_RAD,
    CUT,
    PEDALS,
    RELEASES,
    STEERING,
    Change,
    free,
    idle_s,
    in_part,
    released_s,
    set_to,
    within_limits,
)

# Whole manoeuvres, as they should be.


@pytest.fixture(scope="module")
def steered() -> CalibratedVehicle:
    vehicle = CalibratedVehicle("steering").engaged()
    vehicle.until(lambda told: told.mode is Mode.MANUAL, 75.0)
    return vehicle


@pytest.fixture(scope="module")
def pedalled() -> CalibratedVehicle:
    vehicle = CalibratedVehicle("pedals", area_m=400.0).engaged()
    vehicle.until(lambda told: told.mode is Mode.MANUAL, 200.0)
    return vehicle


def test_steering_turns_the_wheels_and_never_has_a_pedal(steered: CalibratedVehicle) -> None:
    within_limits(steered)
    engaged = [told for told in steered.told if told.engage]
    assert {told.engage for told in engaged} == {STEERING}
    assert len(engaged) * TICK_S == pytest.approx(71.0, abs=0.5)
    assert max(told.front_rad for told in engaged) == pytest.approx(AMPLITUDE_RAD, abs=1e-3)
    assert min(told.front_rad for told in engaged) == pytest.approx(-AMPLITUDE_RAD, abs=1e-3)
    assert steered.plant.way_m == 0.0
    assert not any(told.watch & ~Watch.BRAKE_UNTESTED for told in steered.told[10:])


def test_pedals_drive_from_standstill_to_standstill_with_straight_wheels(pedalled: CalibratedVehicle) -> None:
    within_limits(pedalled)
    engaged = [told for told in pedalled.told if told.engage & PEDALS]
    assert {told.engage for told in engaged} == {STEERING | PEDALS}
    assert all(abs(told.front_rad) < 1e-3 for told in engaged)
    assert not any(told.watch for told in pedalled.told[10:])
    assert engaged[-1].runs == 12
    assert max(told.speed_mps for told in engaged) > 3.0
    assert pedalled.plant.way_m < 400.0


@pytest.mark.parametrize("name", ["steered", "pedalled"])
def test_what_is_complete_cannot_be_engaged_again(name: str, request: pytest.FixtureRequest) -> None:
    vehicle: CalibratedVehicle = request.getfixturevalue(name)
    over = next(event for event in vehicle.events if event.get("event") == "ROUTE_OFF")
    assert over["why"] == [ARRIVED[-1]]
    vehicle.press("override")
    assert vehicle.last.mode is Mode.READY
    assert free(vehicle.press("steering"))
    assert vehicle.core.modes.state.inhibit is EngagementInhibit.OFF_ROUTE
    assert vehicle.kind.inhibit_text() == ARRIVED[-1]
    assert free(vehicle.press("plus"))


# The operator, the lines and the processes end it, wherever it is.


@pytest.mark.parametrize("part", ["step", "probing", "pressing", "braking"])
@pytest.mark.parametrize("cause", RELEASES)
def test_no_command_after_what_gives_the_vehicle_back(part: str, cause: str) -> None:
    vehicle = in_part(part)
    change, within_s = RELEASES[cause]
    change(vehicle)
    # It goes on for as long as it takes: nothing comes back by itself.
    ticks = vehicle.run(1.5)
    assert released_s(ticks) <= within_s + 1e-9, vehicle.events[-3:]
    # A foot releases the pedals at once.
    assert idle_s(ticks) <= min(within_s, 0.2) + 1e-9
    assert ticks[-1].mode not in (Mode.STEERING, Mode.SPEED)
    assert (ticks[-1].engage == CUT) == (cause == "emergency stop")
    # Nor when it is over, until the operator engages anew.
    vehicle.pressed.clear()
    vehicle.torque_nm, vehicle.foot, vehicle.controller, vehicle.box, vehicle.state = 0.0, False, True, True, 128
    vehicle.potentiometer_v = math.nan
    assert free(vehicle.run(0.6))
    assert free(vehicle.press("plus"))
    within_limits(vehicle)


@pytest.mark.parametrize("part", ["step", "probing", "pressing"])
@pytest.mark.parametrize("process", ["display", "recorder"])
def test_without_page_or_recording_it_ends(part: str, process: str) -> None:
    vehicle = in_part(part)
    vehicle.tell({"died": process})
    ticks = vehicle.run(6.0)
    # Steering hands over; pedals brake to a standstill first.
    assert idle_s(ticks) <= 0.04
    assert released_s(ticks) <= (0.04 if part == "step" else 4.0)
    assert part == "step" or abs(ticks[round(released_s(ticks) / TICK_S) - 1].speed_mps) < 0.15
    vehicle.press("override")
    assert vehicle.last.mode is Mode.READY
    assert free(vehicle.press("steering"))
    within_limits(vehicle)


def test_a_relaunched_control_process_commands_nothing_by_itself() -> None:
    vehicle = in_part("pressing")
    vehicle.restart(after_death=True)
    ticks = vehicle.run(5.0)
    assert free(ticks)
    assert ticks[-1].mode is Mode.ERROR
    assert free(vehicle.press("steering", "plus"))
    vehicle.foot = True
    vehicle.press("override")
    vehicle.run(3.0)
    vehicle.foot = False
    assert vehicle.run(0.2)[-1].mode is Mode.READY, vehicle.events[-3:]
    vehicle.press("steering")
    vehicle.press("plus")
    assert vehicle.last.mode is Mode.SPEED
    # It knows nothing of the brake: everything begins again.
    assert (vehicle.last.proven, vehicle.last.runs) == (False, -2)
    within_limits(vehicle)


def test_power_that_was_cut_stays_cut_over_a_relaunch() -> None:
    vehicle = in_part("probing")
    vehicle.press("estop", seconds=0.3)
    vehicle.restart(after_death=True)
    assert all(told.engage in (0, CUT) for told in vehicle.run(1.0))
    assert vehicle.last.engage == CUT


# What is engaged again begins again.


def test_after_an_override_pedals_begin_at_rest_and_from_no_throttle() -> None:
    for part in ("probing", "proving", "pressing", "braking"):
        vehicle = in_part(part)
        runs, proven = vehicle.last.runs, vehicle.last.proven
        vehicle.press("override")
        vehicle.foot = True
        vehicle.run(4.0)
        vehicle.foot = False
        vehicle.run(0.2)
        vehicle.press("steering")
        vehicle.press("plus")
        assert vehicle.last.mode is Mode.SPEED, vehicle.events[-2:]
        assert (vehicle.last.runs, vehicle.last.proven) == (runs, proven)
        ticks = vehicle.run(1.7)
        assert all(told.throttle == 0.0 for told in ticks)
        assert ticks[-1].brake == pytest.approx(0.4)
        if not proven:
            assert max(told.throttle for told in vehicle.run(2.0)) < 0.08
        within_limits(vehicle)


def test_after_a_tap_of_the_brake_plus_begins_at_rest() -> None:
    vehicle = in_part("pressing")
    vehicle.foot = True
    vehicle.run(0.3)
    vehicle.foot = False
    ticks = vehicle.run(1.0)
    assert {told.engage for told in ticks} == {STEERING}
    # Rolling at two metres a second it cannot be engaged.
    vehicle.press("plus")
    assert vehicle.last.engage == STEERING
    vehicle.plant.speed_mps = 0.0
    vehicle.run(1.5)
    vehicle.press("plus")
    assert vehicle.last.engage == STEERING | PEDALS
    assert all(told.throttle == 0.0 and told.brake > 0.0 for told in vehicle.run(1.6))
    within_limits(vehicle)


def test_an_interrupted_steering_begins_again() -> None:
    vehicle = in_part("sweep")
    first = [told.front_rad for told in vehicle.told if told.engage][:400]
    vehicle.press("override")
    ticks = vehicle.press("steering") + vehicle.run(9.0)
    again = [told.front_rad for told in ticks if told.engage][:400]
    # The wheels come back from where they were first.
    assert again[45:] == pytest.approx(first[45:], abs=1e-6)


# It is engaged only at standstill, with everything that it needs.


@pytest.mark.parametrize(
    ("commands", "change"),
    [
        ("steering", lambda vehicle: setattr(vehicle.plant, "speed_mps", 1.0)),
        ("pedals", lambda vehicle: setattr(vehicle.plant, "speed_mps", 0.6)),
        ("steering", set_to(shown={"speed_mps": math.nan})),
        ("pedals", set_to(shown={"speed_mps": math.nan})),
        ("pedals", set_to(gnss=False)),
        ("pedals", set_to(gnss_sigma_m=2.5)),
        ("steering", set_to(torque_nm=6.0)),
        ("pedals", set_to(foot=True)),
        ("steering", set_to(potentiometer_v=5.5)),
        ("pedals", set_to(state=128 | 32)),
        ("pedals", set_to(state=0)),
        ("pedals", set_to(shown={"brake": math.nan})),
    ],
)
def test_it_is_not_engaged(commands: str, change: Change) -> None:
    vehicle = CalibratedVehicle(commands).ready()
    change(vehicle)
    vehicle.run(0.8)
    vehicle.press("steering")
    ticks = vehicle.press("plus") + vehicle.run(0.5)
    assert free(ticks), vehicle.last
    assert all(told.throttle == told.brake == 0.0 for told in ticks)


def test_checks_wait_for_positions_and_the_braking_test() -> None:
    for change in (set_to(gnss=False), set_to(gnss_sigma_m=2.5), set_to(state=0)):
        vehicle = CalibratedVehicle("pedals")
        change(vehicle)
        vehicle.run(3.0)
        assert vehicle.last.mode is Mode.CHECKS
    # Nothing of that concerns a manoeuvre at standstill: no brake is pressed for it either.
    vehicle = CalibratedVehicle("steering")
    vehicle.gnss, vehicle.state = False, 0
    vehicle.engaged()
    assert vehicle.last.engage == STEERING


# The wheels.


def test_wheels_that_stand_at_their_stop_come_back() -> None:
    vehicle = CalibratedVehicle("steering")
    vehicle.angle_rad = -0.5
    vehicle.engaged()
    ticks = vehicle.run(3.0)
    assert vehicle.last.mode is Mode.STEERING, vehicle.events[-2:]
    assert abs(ticks[40].angle_rad) < 0.25
    within_limits(vehicle)


@pytest.mark.parametrize(("start_rad", "within_s"), [(0.0, 2.0), (0.3, 1.0), (-0.45, 0.6)])
def test_wheels_that_go_out_further_end_it(start_rad: float, within_s: float) -> None:
    vehicle = CalibratedVehicle("steering")
    vehicle.angle_rad = start_rad
    vehicle.ready()
    vehicle.servo_radps = math.copysign(0.25, start_rad)
    vehicle.press("steering")
    assert vehicle.last.engage == STEERING
    vehicle.until(lambda told: told.mode is Mode.ERROR, within_s)
    assert vehicle.last.watch & Watch.STEERING_RUNAWAY
    assert abs(vehicle.angle_rad) < max(AMPLITUDE_RAD, abs(start_rad)) + 0.22


def test_wheels_that_are_not_straight_are_not_driven_with() -> None:
    vehicle = CalibratedVehicle("pedals")
    vehicle.angle_rad, vehicle.servo = 0.1, False
    vehicle.ready()
    vehicle.press("steering")
    vehicle.press("plus")
    ticks = vehicle.run(1.0)
    assert vehicle.last.mode is Mode.ERROR
    assert all(told.throttle == 0.0 for told in ticks)


@pytest.mark.parametrize(
    ("change", "moves"),
    [
        (lambda vehicle: setattr(vehicle.plant, "speed_mps", 2.5), True),
        (lambda vehicle: setattr(vehicle.plant, "speed_mps", -2.5), True),
        (set_to(shown={"speed_mps": math.nan}), True),
        (lambda vehicle: setattr(vehicle.plant, "speed_mps", 1.5), False),
    ],
)
def test_steering_that_begins_to_be_driven_ends(change: Change, moves: bool) -> None:
    vehicle = in_part("step")
    change(vehicle)
    ticks = vehicle.run(0.5)
    assert (released_s(ticks) <= 0.02) is moves
    within_limits(vehicle)


def test_a_smaller_amplitude_is_kept_and_a_larger_one_is_that_of_the_vehicle() -> None:
    for stated, most in ((0.1, 0.1), (0.6, 0.8 * 0.5236)):
        vehicle = CalibratedVehicle("steering", amplitude_rad=stated).engaged()
        ticks = vehicle.run(22.0)
        assert max(told.front_rad for told in ticks) == pytest.approx(most, abs=1e-3)
        assert not any(told.watch for told in ticks)
