"""Commanded manoeuvres of a calibration through the control loop: modes, limits, and everything that must end them.

The vehicle, its box and its receiver are the tests' own (``calibrated_vehicle``); the simulated devices come last.
"""

import copy
import math
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canon.course_loop import OnboardLoop
from canon.course_moments import Moment
from lgprjax.autopilot import EngagementInhibit, Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.runtime.control.manoeuvre import ManoeuvreKind, load_manoeuvre
from lgprjax.runtime.control.manoeuvre_programs import PedalProgram
from lgprjax.runtime.words import ARRIVED
from lgprjax.simulation.devices.faults import FAULTS as FAULTS_OF_DEVICES
from lgprjax.simulation.devices.faults import Schedule, read_items
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.loop.off_road import OffRoad
from pedalled_plant import PlantNumbers
from runtime.calibrated_vehicle import TICK_S, CalibratedVehicle, Told, config_of

STEERING, PEDALS, CUT = 1, 2, 4
AMPLITUDE_RAD, FASTEST_MPS = 0.2, 3.5
Change = Callable[[CalibratedVehicle], None]


def within_limits(vehicle: CalibratedVehicle, *, unproven_mps: float = 2.0) -> None:
    """What holds of every command, whatever happens."""
    calibration = vehicle.config.calibration
    assert calibration is not None
    before = None
    widest = 0.0
    for told in vehicle.told:
        own = told.engage & (STEERING | PEDALS)
        assert math.isfinite(told.front_rad + told.throttle + told.brake), told
        assert not own or told.mode in (Mode.STEERING, Mode.SPEED), told
        assert told.engage & STEERING or not told.engage & PEDALS, told
        if calibration.commands == "steering":
            assert told.engage in (0, STEERING, CUT), told
        if not told.engage & PEDALS:
            assert told.throttle == told.brake == 0.0, told
        assert told.throttle == 0.0 or told.brake == 0.0, told
        if own:
            # Wheels that were turned further when they were engaged come back.
            widest = max(calibration.amplitude_rad, min(widest, abs(told.front_rad) + 0.05))
            assert abs(told.front_rad) <= widest + 1e-6, told
        else:
            widest = abs(told.angle_rad) + 0.01
        if own and before is not None and before.engage & own == own:
            assert abs(told.front_rad - before.front_rad) <= 2.0 * TICK_S + 1e-5, told
            assert told.throttle - before.throttle <= 1.0 * TICK_S + 1e-5, told
            assert told.brake - before.brake <= 4.0 * TICK_S + 1e-5, told
        if told.engage & PEDALS and not told.proven:
            assert abs(told.speed_mps) <= unproven_mps, told
        before = told


def free(ticks: list[Told]) -> bool:
    return not any(told.engage & (STEERING | PEDALS) for told in ticks)


def released_s(ticks: list[Told]) -> float:
    """Seconds until nothing is engaged, for good."""
    held = [at for at, told in enumerate(ticks) if told.engage & (STEERING | PEDALS)]
    return (held[-1] + 1 if held else 0) * TICK_S


def idle_s(ticks: list[Told]) -> float:
    """Seconds until the throttle is released, for good."""
    pressed = [at for at, told in enumerate(ticks) if told.throttle > 0.0]
    return (pressed[-1] + 1 if pressed else 0) * TICK_S


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

PEDAL_PARTS: dict[str, Callable[[Told], bool]] = {
    "at rest": lambda told: told.brake > 0.3,
    "probing": lambda told: told.throttle > 0.15,
    "proving": lambda told: told.runs == -1 and told.speed_mps > 0.8,
    "pressing": lambda told: told.runs == 0 and told.speed_mps > 2.0,
    "braking": lambda told: told.runs == 0 and told.speed_mps > 1.0 and told.brake > 0.3,
    "late": lambda told: told.runs == 5 and told.speed_mps > 2.0,
}


def in_part(part: str) -> CalibratedVehicle:
    """A manoeuvre of the pedals in a part of it, of the steering in a step or in its sweep; a copy, to go on with."""
    return copy.deepcopy(_in_part(part))


@cache
def _in_part(part: str) -> CalibratedVehicle:
    if part in PEDAL_PARTS:
        vehicle = CalibratedVehicle("pedals").engaged()
        vehicle.until(PEDAL_PARTS[part], 120.0)
        return vehicle
    vehicle = CalibratedVehicle("steering").engaged()
    vehicle.run({"step": 20.0, "sweep": 50.0}[part])
    return vehicle


def press(button: str) -> Change:
    return lambda vehicle: vehicle.pressed.add(button)


def set_to(**attributes: Any) -> Change:
    def change(vehicle: CalibratedVehicle) -> None:
        for name, value in attributes.items():
            setattr(vehicle, name, value)

    return change


RELEASES: dict[str, tuple[Change, float]] = {
    "override": (press("override"), 0.02),
    "emergency stop": (press("estop"), 0.02),
    "hands on the wheel": (set_to(torque_nm=6.0), 0.1),
    "torque that is no number": (set_to(torque_nm=math.nan), 0.1),
    "foot on the brake": (set_to(foot=True), 0.6),
    "silent controller": (set_to(controller=False), 0.16),
    "silent box": (set_to(box=False), 0.16),
    "restarted box": (CalibratedVehicle.restart_box, 0.2),
    "box with a fault": (set_to(state=128 | 16), 0.3),
    "second sender": (set_to(state=128 | 4), 0.04),
    "potentiometer open": (set_to(potentiometer_v=5.5), 0.2),
}


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


# Sensors and actuators that fail while the pedals are commanded.


def moved_m(ticks: list[Told]) -> float:
    return max(told.way_m for told in ticks) - ticks[0].way_m


FAULTS: dict[str, tuple[Change, tuple[str, ...], float, float]] = {
    # What goes wrong, in which parts, seconds until the throttle is idle for good, and the fastest allowed since then.
    "odometer dead": (set_to(wheels_gain=0.0), ("at rest", "probing", "proving", "pressing", "braking"), 12.0, 3.2),
    "odometer reversed": (set_to(wheels_gain=-1.0), ("at rest", "probing", "proving", "pressing"), 12.0, 2.9),
    "odometer shows half": (set_to(wheels_gain=0.5), ("at rest", "proving", "pressing"), 26.0, 2.9),
    "wheels spin": (set_to(wheels_gain=3.0), ("at rest", "pressing"), 22.0, 2.9),
    "speed zero, way sound": (set_to(shown={"speed_mps": 0.0}), ("at rest", "probing", "pressing"), 12.0, 2.9),
    "speed held": (set_to(shown={"speed_mps": 0.2}), ("at rest", "probing", "pressing"), 12.0, 2.9),
    "speed no number": (set_to(shown={"speed_mps": math.nan}), ("at rest", "probing", "pressing"), 0.02, 2.9),
    "way no number": (set_to(shown={"odometer_m": math.nan}), ("at rest", "probing", "pressing"), 0.02, 2.9),
    "GNSS silent": (set_to(gnss=False), ("at rest", "probing", "pressing", "braking"), 1.2, 3.2),
    "GNSS coarse": (set_to(gnss_sigma_m=2.5), ("probing", "pressing"), 0.12, 2.9),
    "GNSS held": (set_to(gnss_held=0.0), ("at rest", "proving", "pressing"), 26.0, 2.9),
    "GNSS jumps": (set_to(gnss_m=3.0), ("at rest", "proving", "pressing"), 0.12, 2.9),
    "throttle stuck": (set_to(throttle_stuck=0.5), ("at rest", "probing"), 0.5, 0.6),
    "throttle stuck at speed": (set_to(throttle_stuck=0.7), ("pressing",), 0.5, 3.5),
    "no brake pressure": (set_to(brake_lost=True), ("at rest", "braking"), 0.5, 2.9),
    "wheels turn by themselves": (set_to(servo_radps=0.5), ("at rest", "probing", "pressing"), 0.6, 2.9),
    "pedals without numbers": (set_to(shown={"throttle": math.nan}), ("probing", "pressing"), 0.14, 2.9),
}


@pytest.mark.parametrize(("fault", "part"), [(name, part) for name, (_, parts, *_) in FAULTS.items() for part in parts])
def test_a_fault_ends_the_pedals_before_the_vehicle_is_fast(fault: str, part: str) -> None:
    vehicle = in_part(part)
    change, _, within_s, fastest_mps = FAULTS[fault]
    begins = vehicle.last
    change(vehicle)
    ticks = vehicle.until(lambda told: told.engage & 3 == 0 or told.time_s > begins.time_s + within_s, within_s + 1.0)
    ticks += vehicle.run(2.0)
    assert idle_s(ticks) <= within_s + 1e-9, (vehicle.last, vehicle.events[-3:])
    assert max(abs(told.speed_mps) for told in ticks) <= max(fastest_mps, begins.speed_mps), fault
    if not begins.proven and not vehicle.throttle_stuck:
        assert max(abs(told.speed_mps) for told in ticks) < 2.0
    # Idle throttle and brake until it stands, or the operator's, or cut.
    pressed = [told for told in ticks[round(idle_s(ticks) / TICK_S) + 20 :] if told.engage & PEDALS]
    assert all(told.brake > 0.2 for told in pressed)
    assert not any(told.throttle > 0.0 for told in vehicle.press("plus"))
    within_limits(vehicle, unproven_mps=3.0 if vehicle.throttle_stuck else 2.0)


@pytest.mark.parametrize("part", ["probing", "pressing"])
def test_a_vehicle_whose_wheels_say_that_it_stands_is_braked_until_the_operator_comes(part: str) -> None:
    """Not handed over for a standstill that positions contradict."""
    vehicle = in_part(part)
    vehicle.wheels_gain = 0.0
    ticks = vehicle.run(14.0)
    assert vehicle.plant.speed_mps == 0.0
    assert vehicle.last.engage == STEERING | PEDALS
    assert vehicle.last.brake == pytest.approx(0.6)
    told = [why for event in vehicle.events for why in event.get("why", ())]
    assert "wheels and GNSS give different speeds" in told
    assert moved_m(ticks) < 6.0
    assert released_s(vehicle.press("override")) == 0.0


def test_wheels_are_compared_since_the_last_standstill_and_a_moment_apart_is_enough() -> None:
    vehicle = in_part("late")
    vehicle.wheels_gain = 0.0
    assert idle_s(vehicle.run(3.0)) <= 0.6
    vehicle = in_part("pressing")
    vehicle.gnss_m = 3.0
    # A single position.
    vehicle.run(0.1)
    vehicle.gnss_m = 0.0
    assert idle_s(vehicle.run(3.0)) == 0.0
    assert "wheels and GNSS give different speeds" in [why for event in vehicle.events for why in event.get("why", ())]


def test_a_speed_or_a_way_that_is_no_number_is_told() -> None:
    for name in ("speed_mps", "odometer_m"):
        vehicle = in_part("pressing")
        vehicle.shown = {name: math.nan}
        vehicle.run(0.1)
        assert [event["why"] for event in vehicle.events if event.get("event") == "HEALTH_STOP"][-1] == [
            "speed unknown"
        ]


def test_a_throttle_stuck_wide_open_is_cut() -> None:
    vehicle = in_part("pressing")
    vehicle.throttle_stuck = 1.0
    vehicle.plant.numbers = PlantNumbers(throttle_mps2=6.0)
    vehicle.until(lambda told: told.engage == CUT, 3.0)
    assert vehicle.last.watch & Watch.SPEED_RISES
    within_limits(vehicle)
    vehicle.run(6.0)
    assert vehicle.plant.speed_mps == 0.0


def test_a_vehicle_that_is_faster_than_it_should_be_is_cut() -> None:
    """Whatever pushes it."""
    for part, limit_mps in (("proving", 2.0), ("pressing", FASTEST_MPS + 1.0)):
        vehicle = in_part(part)
        vehicle.plant.numbers = PlantNumbers(slope=-0.25)
        ticks = vehicle.until(lambda told: told.engage == CUT, 1.5)
        assert vehicle.last.watch & Watch.SPEED_RISES
        assert max(told.speed_mps for told in ticks) < limit_mps + 0.2


@pytest.mark.parametrize(("part", "slope"), [("proving", -0.02), ("braking", -0.02), ("pressing", -0.03)])
def test_a_brake_without_effect_is_cut(part: str, slope: float) -> None:
    """Its pressure is good, its pads are not."""
    vehicle = in_part(part)
    vehicle.plant.numbers = PlantNumbers(brake_mps2=0.0, slope=slope)
    vehicle.until(lambda told: told.engage == CUT, 12.0)
    assert vehicle.last.watch & Watch.BRAKE_DEAD
    within_limits(vehicle)
    vehicle.foot = True
    vehicle.press("override")
    vehicle.plant.numbers, vehicle.foot = PlantNumbers(), False
    vehicle.run(6.0)
    vehicle.press("override")
    # Not before it has been repaired, and calibration begun again.
    assert free(vehicle.press("steering"))
    assert "the brake does not slow the vehicle" in vehicle.kind.inhibit_text()


def test_what_was_wrong_is_forgotten_with_the_override_except_a_brake() -> None:
    vehicle = CalibratedVehicle("pedals", PlantNumbers(throttle_mps2=0.0)).engaged()
    vehicle.until(lambda told: told.mode is Mode.MANUAL, 30.0)
    assert any("does not reach 0.25 m/s" in str(event.get("why")) for event in vehicle.events)
    vehicle.plant.numbers = PlantNumbers()
    vehicle.press("override")
    vehicle.press("steering")
    vehicle.press("plus")
    assert vehicle.last.mode is Mode.SPEED
    vehicle.until(lambda told: told.proven, 40.0)
    within_limits(vehicle)


def test_a_slope_on_which_it_rolls_backward_ends_it() -> None:
    vehicle = CalibratedVehicle("pedals", PlantNumbers(slope=0.06))
    vehicle.parked = True
    # It is braked until it stands, and the operator's then.
    ticks = vehicle.engaged().until(lambda told: told.mode is Mode.MANUAL, 8.0)
    assert min(told.speed_mps for told in ticks) > -0.5
    assert moved_m(ticks) - min(told.way_m for told in ticks) < 0.6
    assert abs(vehicle.last.speed_mps) < 0.1
    assert any("rolls backward" in str(event.get("why")) for event in vehicle.events)


# Ground.


@pytest.mark.parametrize(
    ("numbers", "area_m", "gain"),
    [
        (PlantNumbers(), 60.0, 1.0),
        (PlantNumbers(throttle_mps2=8.0), 60.0, 1.0),
        (PlantNumbers(), 90.0, 0.92),
        (PlantNumbers(slope=-0.03), 80.0, 1.0),
        (PlantNumbers(brake_mps2=2.0), 100.0, 1.0),
    ],
)
def test_it_does_not_leave_its_stretch(numbers: PlantNumbers, area_m: float, gain: float) -> None:
    vehicle = CalibratedVehicle("pedals", numbers, area_m=area_m)
    vehicle.wheels_gain = gain
    vehicle.engaged()
    ticks = vehicle.until(lambda told: told.mode is Mode.MANUAL, 150.0)
    assert 0.25 * area_m < moved_m(ticks) <= area_m
    assert abs(vehicle.plant.speed_mps) < 0.15
    assert any("turn round by hand" in str(event.get("why")) for event in vehicle.events)
    within_limits(vehicle)
    # Turned round by hand, the stretch counts anew, and the runs go on.
    runs = vehicle.last.runs
    vehicle.press("override")
    vehicle.press("steering")
    vehicle.press("plus")
    assert vehicle.last.mode is Mode.SPEED, vehicle.events[-2:]
    vehicle.run(2.0)
    assert vehicle.last.runs == runs


def test_a_run_ends_where_the_vehicle_can_still_stop_on_the_stretch() -> None:
    vehicle = in_part("pressing")
    began_m = next(told.way_m for told in vehicle.told if told.engage & PEDALS)
    # At two metres a second it takes five.
    vehicle.odometer_m += 197.0 - (vehicle.plant.way_m - began_m)
    ticks = vehicle.until(lambda told: told.mode is Mode.MANUAL, 6.0)
    assert idle_s(ticks) <= 0.02
    assert moved_m(ticks) < 4.0
    within_limits(vehicle)


def test_ground_is_used_by_wheels_or_positions_whichever_went_farther() -> None:
    for shift_m, most_m in ((-30.0, 0.0), (40.0, 40.0)):
        vehicle = in_part("late")
        began_m = next(told.way_m for told in vehicle.told if told.engage & STEERING)
        vehicle.odometer_m += shift_m
        vehicle.run(0.02)
        assert vehicle.kind._gone_m == pytest.approx(vehicle.plant.way_m - began_m + most_m, abs=0.5)


def test_a_stretch_that_no_run_fits_on_is_refused_at_rest() -> None:
    vehicle = CalibratedVehicle("pedals", area_m=30.0).ready()
    ticks = vehicle.press("steering") + vehicle.press("plus") + vehicle.run(3.0)
    assert all(told.throttle == 0.0 for told in ticks)
    assert vehicle.last.mode is Mode.MANUAL


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


# Anything, in any order.


def happens(vehicle: CalibratedVehicle, rng: random.Random) -> None:
    """A change, or everything well again."""
    vehicle.pressed.clear()
    if rng.random() < 0.45:
        vehicle.torque_nm, vehicle.foot, vehicle.controller, vehicle.box, vehicle.state = 0.0, False, True, True, 128
        vehicle.shown, vehicle.wheels_gain, vehicle.gnss, vehicle.gnss_sigma_m = {}, 1.0, True, 0.014
        vehicle.gnss_held = vehicle.potentiometer_v = math.nan
        vehicle.gnss_m = vehicle.servo_radps = 0.0
        vehicle.brake_lost = False
        vehicle.tell({"ready": "display"}, {"ready": "recorder"})
        return
    change = rng.choice([change for change, _ in RELEASES.values()] + [fault[0] for fault in FAULTS.values()])
    if rng.random() < 0.15:
        vehicle.restart(after_death=True)
    elif rng.random() < 0.1:
        vehicle.tell({"died": rng.choice(["display", "recorder"])})
    else:
        change(vehicle)
    vehicle.throttle_stuck = 0.0


@pytest.mark.parametrize("seed", range(6))
def test_whatever_happens_the_operator_alone_engages_and_nothing_outlasts_the_override(seed: int) -> None:
    rng = random.Random(seed)
    vehicle = CalibratedVehicle(rng.choice(["pedals", "pedals", "steering"]))
    vehicle.ready()
    while vehicle.time_s < 60.0:
        if vehicle.last.mode is Mode.READY and rng.random() < 0.7:
            vehicle.press("steering")
            vehicle.press("plus")
        elif vehicle.last.mode in (Mode.MANUAL, Mode.ERROR, Mode.EMERGENCY_STOP):
            ticks = vehicle.press("override")
            assert free(ticks)
        else:
            happens(vehicle, rng)
        before = vehicle.last
        pressed = frozenset(vehicle.pressed)
        ticks = vehicle.run(rng.choice([0.1, 0.4, 2.0, 5.0]))
        if {"override", "estop"} & pressed and vehicle.controller:
            assert free(ticks)
        # Buttons that nobody pressed engage nothing.
        for told in ticks:
            assert told.engage & ~before.engage & (STEERING | PEDALS) in (0, PEDALS), told
            # A stop takes the brake, never the throttle.
            assert not (told.engage & ~before.engage & PEDALS and told.throttle > 0.0), told
            before = told
    within_limits(vehicle, unproven_mps=2.2)


# Against the simulated devices: their box, their lines, their faults.

PRESSES: list[dict[str, Any]] = [
    {"at_s": 1.0, "do": "press", "button": "steering"},
    {"after": {"mode": 3, "for_s": 1.0}, "do": "press", "button": "plus"},
]


@pytest.fixture(scope="module")
def level() -> CourseWorld:
    """Level ground."""
    return CourseWorld(OffRoad(2, 40.0, 3), SITE_FRAME, weather="clear", drive_seed=3, level=True)


@pytest.fixture(scope="module")
def staged(level: CourseWorld) -> dict[str, Moment]:
    """The pedals while the throttle rises and at speed, and the steering, of the simulated vehicle."""
    found = {}
    for commands, moments in (
        ("steering", {"steering": lambda loop: loop.time_s > 14.0}),
        (
            "pedals",
            {
                "probing": lambda loop: loop.stage._known.last.throttle > 0.15,
                "pressing": lambda loop: _program(loop).proven and _speed(loop) > 2.0,
            },
        ),
    ):
        config = config_of(commands, area_m=1000.0)
        loaded = load_manoeuvre(config)
        presses = PRESSES[:1] if commands == "steering" else PRESSES
        loop = OnboardLoop(level, config, loaded, presses, [], fixes=False, manoeuvre={"kind": "stand"})
        for name, holds in moments.items():
            assert loop.run(60.0, until=holds), loop.events
            found[name] = Moment(loop, (level, config, loaded))
            loop = found[name].copy()
    return found


def _speed(loop: OnboardLoop) -> float:
    return loop.stage._known.last.speed_mps


def _program(loop: OnboardLoop) -> PedalProgram:
    assert isinstance(loop.core.kind, ManoeuvreKind)
    return loop.core.kind._pedals


@pytest.mark.parametrize(
    ("moment", "fault", "seconds", "fastest_mps"),
    [
        ("probing", {"kind": "odometer_dead"}, 9.0, 1.6),
        ("pressing", {"kind": "odometer_dead"}, 3.0, 3.2),
        ("probing", {"kind": "odometer_reversed"}, 9.0, 1.6),
        ("pressing", {"kind": "odometer_reversed"}, 3.0, 3.2),
        ("pressing", {"kind": "gnss_off"}, 3.0, 3.4),
        ("pressing", {"kind": "gnss_stuck"}, 3.0, 3.2),
        ("pressing", {"kind": "gnss_single"}, 1.0, 3.2),
        ("probing", {"kind": "throttle_stuck", "at": 0.6}, 2.0, 1.6),
        ("pressing", {"kind": "throttle_stuck", "at": 0.8}, 2.0, 3.4),
        ("pressing", {"kind": "brake_dead"}, 8.0, 4.0),
        ("pressing", {"kind": "servo_runaway", "radps": 0.4}, 1.5, 3.2),
        ("steering", {"kind": "servo_runaway", "radps": 0.4}, 2.0, 0.1),
        ("steering", {"kind": "potentiometer_stuck"}, 6.0, 0.1),
        ("steering", {"kind": "potentiometer_open"}, 0.5, 0.1),
        ("pressing", {"kind": "line_silent", "line": "controller"}, 0.5, 3.2),
        ("pressing", {"kind": "line_silent", "line": "drive_by_wire"}, 0.5, 3.2),
        ("pressing", {"kind": "second_master"}, 0.5, 3.2),
        ("pressing", {"kind": "override_wire_cut"}, 0.5, 3.2),
    ],
)
def test_faults_of_the_simulated_devices_end_it(
    staged: dict[str, Moment], moment: str, fault: dict[str, Any], seconds: float, fastest_mps: float
) -> None:
    loop = staged[moment].copy()
    here = {"at_way_m": loop.stage._known.last.travel_m}
    known = read_items(Path("faults"), "", [{**here, **fault}], key="kind", known=FAULTS_OF_DEVICES, lasts_s={})
    loop.stage._wrong = Schedule(known)
    first = len(loop.rows)
    loop.run(seconds)
    rows = loop.rows[first:]
    ended = [at for at, row in enumerate(rows) if not int(row["engage"]) & 3 or row["command"][2] == np.float32(0.6)]
    assert ended, loop.events[-3:]
    for row in rows[ended[0] :]:
        assert row["command"][1] == 0.0
    truth = loop.stage.truth.arrays()
    since = truth["mono_ns"] >= loop.times_ns[first]
    assert np.abs(truth["speed_mps"][since]).max() <= fastest_mps
    # What goes on is a brake.
    goes_on = [row for row in rows[ended[0] + 10 :] if int(row["engage"]) & 2]
    assert all(row["command"][2] > 0.4 for row in goes_on)
    if moment == "steering":
        assert not any(int(row["engage"]) & 2 for row in rows)
