"""Cases of commanded manoeuvres: parts of them, what ends them, faults, and what holds of every command."""

import copy
import math
from collections.abc import Callable
from functools import cache
from typing import Any

from lgprjax.autopilot import Mode
from runtime.calibrated_vehicle import TICK_S, CalibratedVehicle, Told

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


# Parts of manoeuvres, and what ends them.

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
