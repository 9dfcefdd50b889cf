"""Commanded manoeuvres with sensors and actuators that fail, on short and sloping ground, and with anything at all.

The vehicle, its box and its receiver are the tests' own (``calibrated_vehicle``); the simulated devices come last.
"""

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canon.course_loop import OnboardLoop
from canon.course_moments import Moment
from lgprjax.autopilot import Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.runtime.control.manoeuvre import ManoeuvreKind, load_manoeuvre
from lgprjax.runtime.control.manoeuvre_programs import PedalProgram
from lgprjax.simulation.devices.faults import FAULTS as FAULTS_OF_DEVICES
from lgprjax.simulation.devices.faults import Schedule, read_items
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.loop.off_road import OffRoad
from pedalled_plant import PlantNumbers
from runtime.calibrated_vehicle import TICK_S, CalibratedVehicle, config_of
from runtime.manoeuvre_cases import (
    CUT,
    FASTEST_MPS,
    FAULTS,
    PEDALS,
    RELEASES,
    STEERING,
    free,
    idle_s,
    in_part,
    moved_m,
    released_s,
    within_limits,
)

# Sensors and actuators that fail while the pedals are commanded.


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


@pytest.mark.parametrize("seed", range(4))
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
