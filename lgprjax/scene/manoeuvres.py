"""Manoeuvres of calibration drives: what driver or servo are told, over time.

Angles are of the front wheels, left positive; a half turn of the steering wheel is the share of the way from lock to
lock that its turns say.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEP_S = 0.01
ACCELERATION_MPS2 = 0.8
HAND_RADPS = 0.25


class Manoeuvre(NamedTuple):
    """What a vehicle is told, at the simulation's steps.

    Attributes:
        time_s: from 0, every ``STEP_S``.
        wanted_rad: front angle: the servo's command or, by hand, what the steering wheel is turned to.
        speed_mps: held by the driver, negative in reverse; without meaning where the pedals are commanded.
        supply_v: at the servo.
        by_hand: the wheels follow the steering wheel with no more than the play.
        throttle, brake: commands, 0 to 1; None where the driver holds the speed.
    """

    time_s: Float[np.ndarray, " step"]
    wanted_rad: Float[np.ndarray, " step"]
    speed_mps: Float[np.ndarray, " step"]
    supply_v: Float[np.ndarray, " step"]
    by_hand: bool
    throttle: Float[np.ndarray, " step"] | None = None
    brake: Float[np.ndarray, " step"] | None = None


class _Script:
    """Angle and speed as straight lines between knots of time."""

    def __init__(self, angle_rad: float = 0.0) -> None:
        self.time_s, self.angle_rad, self.speed_mps = [0.0], [angle_rad], [0.0]

    def go(self, after_s: float, *, angle_rad: float | None = None, speed_mps: float | None = None) -> None:
        """Within the time from the last knot to another angle, another speed, or neither."""
        self.time_s.append(self.time_s[-1] + after_s)
        self.angle_rad.append(self.angle_rad[-1] if angle_rad is None else angle_rad)
        self.speed_mps.append(self.speed_mps[-1] if speed_mps is None else speed_mps)

    def steer(self, angle_rad: float) -> None:
        """At the pace of a driver's hands."""
        self.go(abs(angle_rad - self.angle_rad[-1]) / HAND_RADPS + STEP_S, angle_rad=angle_rad)

    def speed_up(self, speed_mps: float) -> None:
        """Or down."""
        self.go(abs(speed_mps - self.speed_mps[-1]) / ACCELERATION_MPS2 + STEP_S, speed_mps=speed_mps)

    def drive(self, length_m: float, speed_mps: float) -> None:
        """From standstill to standstill; on a short way the speed is not reached."""
        peak = min(abs(speed_mps), np.sqrt(abs(length_m) * ACCELERATION_MPS2))
        self.speed_up(float(np.copysign(peak, speed_mps)))
        self.go(max(abs(length_m) / peak - peak / ACCELERATION_MPS2, 0.0) + STEP_S)
        self.speed_up(0.0)

    def manoeuvre(self, *, by_hand: bool) -> Manoeuvre:
        time_s = np.arange(int(np.floor(self.time_s[-1] / STEP_S)) + 1) * STEP_S
        angle = np.interp(time_s, self.time_s, self.angle_rad)
        return Manoeuvre(
            time_s, angle, np.interp(time_s, self.time_s, self.speed_mps), np.full(time_s.size, 24.0), by_hand
        )


def half_turn_angles(largest_rad: float, lock_to_lock_turns: float) -> Float[np.ndarray, " stop"]:
    """Front angles at every half turn of the steering wheel, from full left through straight to full right."""
    step_rad = largest_rad / lock_to_lock_turns
    count = int(np.floor(lock_to_lock_turns + 1e-9))
    inner = step_rad * np.arange(count, -count - 1, -1)
    return np.unique(np.concatenate([[largest_rad], inner, [-largest_rad]]).round(12))[::-1]


def drive_straight(length_m: float, speed_mps: float, *, weave_rad: float = 0.0, weave_m: float = 20.0) -> Manoeuvre:
    """A straight line by hand; the driver's corrections swing the wheels, one swing in so many metres of way."""
    script = _Script()
    script.go(2.0)
    script.drive(length_m, speed_mps)
    script.go(2.0)
    told = script.manoeuvre(by_hand=True)
    way_m = np.cumsum(told.speed_mps) * STEP_S
    return told._replace(wanted_rad=weave_rad * np.cos(2 * np.pi * way_m / weave_m) * (told.speed_mps != 0.0))


def turn_standing(largest_rad: float, lock_to_lock_turns: float, *, pause_s: float = 3.0) -> Manoeuvre:
    """Standing still, the steering wheel from full right to full left and back in half turns with pauses."""
    leftward = half_turn_angles(largest_rad, lock_to_lock_turns)[::-1]
    script = _Script(float(leftward[0]))
    script.go(pause_s)
    for angle in [*leftward[1:], *leftward[-2::-1]]:
        script.steer(float(angle))
        script.go(pause_s)
    return script.manoeuvre(by_hand=True)


def drive_palm_tree(
    wheelbase_m: float,
    rear_ratio: float,
    largest_rad: float,
    lock_to_lock_turns: float,
    *,
    speed_mps: float = 1.5,
    arc_turns: float = 0.25,
    longest_m: float = 25.0,
    pause_s: float = 2.0,
) -> Manoeuvre:
    """The palm tree by hand: full left, an arc forward, back in reverse, half a turn less, …, full right.

    Args:
        wheelbase_m, rear_ratio: for the length of an arc.
        arc_turns: of a full circle: 0.125 to 0.5.
        longest_m: of an arc that is nearly straight.
    """
    angles = half_turn_angles(largest_rad, lock_to_lock_turns)
    script = _Script(float(angles[0]))
    script.go(pause_s)
    for angle in angles:
        script.steer(float(angle))
        script.go(pause_s)
        curvature = abs(np.tan(angle) + np.tan(rear_ratio * angle)) / wheelbase_m
        length_m = min(2.0 * np.pi * arc_turns / max(curvature, 1e-9), longest_m)
        script.drive(length_m, speed_mps)
        script.go(pause_s)
        script.drive(length_m, -speed_mps)
        script.go(pause_s)
    return script.manoeuvre(by_hand=True)


def drive_turns(
    speeds_mps: Sequence[float], angles_rad: Sequence[float], *, hold_s: float = 12.0, by_hand: bool = True
) -> Manoeuvre:
    """Turning tests: each speed at each angle, held; straight on between."""
    script = _Script()
    script.go(1.0)
    for speed in speeds_mps:
        script.speed_up(speed)
        for angle in angles_rad:
            script.steer(angle)
            script.go(hold_s)
            script.steer(0.0)
            script.go(1.0)
    script.speed_up(0.0)
    script.go(1.0)
    return script.manoeuvre(by_hand=by_hand)


def step_steering(
    sizes_rad: Sequence[float],
    *,
    speed_mps: float = 0.0,
    hold_s: float = 3.0,
    sweep_rad: float = 0.0,
    sweep_hz: tuple[float, float] = (0.05, 1.0),
    sweep_s: float = 40.0,
) -> Manoeuvre:
    """The servo's command stepped to each size and its opposite and back, then swept in rising frequency."""
    script = _Script()
    script.go(1.0)
    if speed_mps != 0.0:
        script.speed_up(speed_mps)
    for size in sizes_rad:
        for angle in (size, -size, 0.0):
            script.go(0.0, angle_rad=angle)
            script.go(hold_s)
    start_s = script.time_s[-1]
    if sweep_rad != 0.0:
        script.go(sweep_s)
        script.go(hold_s)
    stop_s = script.time_s[-1]
    if speed_mps != 0.0:
        script.speed_up(0.0)
    script.go(1.0)
    told = script.manoeuvre(by_hand=False)
    along_s = np.clip(told.time_s - start_s, 0.0, sweep_s)
    turns = sweep_hz[0] * along_s + 0.5 * (sweep_hz[1] - sweep_hz[0]) * along_s**2 / sweep_s
    swept = (told.time_s >= start_s) & (told.time_s < min(start_s + sweep_s, stop_s))
    return told._replace(wanted_rad=told.wanted_rad + sweep_rad * np.sin(2.0 * np.pi * turns) * swept)


def step_pedals(
    throttles: Sequence[float], brakes: Sequence[float], *, back: float = 0.15, hold_s: float = 4.0
) -> Manoeuvre:
    """From standstill, each throttle and brake in turn: throttle, a little of it back, coast, brake, half of it back.

    Args:
        throttles, brakes: commands, one of each a run.
        back: by which a command is taken back before it is released.
        hold_s: of each throttle; brakes and standstill are held as long at most.
    """
    throttle_parts, brake_parts = [np.zeros(100)], [np.zeros(100)]
    hold = round(hold_s / STEP_S)
    for throttle, brake in zip(throttles, brakes, strict=True):
        run = [(throttle, 0.0, hold), (max(throttle - back, 0.0), 0.0, hold // 2), (0.0, 0.0, hold // 2)]
        run += [(0.0, brake, hold // 4), (0.0, max(brake - back, 0.0), hold // 4), (0.0, 1.0, hold), (0.0, 0.0, hold)]
        throttle_parts += [np.full(steps, told) for told, _, steps in run]
        brake_parts += [np.full(steps, told) for _, told, steps in run]
    throttle_told, brake_told = np.concatenate(throttle_parts), np.concatenate(brake_parts)
    zero = np.zeros(throttle_told.size)
    time_s = np.arange(zero.size) * STEP_S
    return Manoeuvre(time_s, zero, zero, np.full(zero.size, 24.0), True, throttle_told, brake_told)
