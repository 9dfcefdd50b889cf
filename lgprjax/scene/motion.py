"""Positions of the vehicle and of each antenna at any time of a drive along a road: host, float64."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.radar.array import ArrayGeometry
from lgprjax.scene.road import (
    Road,
    Waves,
    draw_waves,
    follow_centre,
    local_to_road,
    road_to_local,
    roughness_value,
    straight_road,
    surface_up,
    wave_slope,
    wave_value,
)

ARC_STEP_M = 0.02


@dataclass(frozen=True)
class DrivePlan:
    """Plan of a drive in the road frame (``scene/road.py``).

    Attributes:
        start_m, stop_m: along-track interval of the body origin, start < stop.
        direction: +1 drives from start to stop, -1 from stop to start.
        speed_mps, scan_rate_hz: constant over the drive; the speed is that of the body origin along its path.
        lane_m: mean cross-track place of the body origin, positive to the left of a vehicle driving +1.
        wander_m, wander_wavelength_m: rms of the lateral wander about the lane and its range of wavelengths.
        height_sigma_m, roll_sigma_rad, bounce_wavelength_m: smooth motion of the body on its springs.
    """

    start_m: float
    stop_m: float
    direction: int = 1
    speed_mps: float = 4.5
    scan_rate_hz: float = 126.0
    lane_m: float = 0.0
    wander_m: float = 0.03
    wander_wavelength_m: tuple[float, float] = (8.0, 40.0)
    height_sigma_m: float = 0.01
    roll_sigma_rad: float = 0.3 * np.pi / 180
    bounce_wavelength_m: tuple[float, float] = (3.0, 20.0)


class DriveMotion(NamedTuple):
    """A drive's course: everything ``poses_at`` needs."""

    plan: DrivePlan
    wander: Waves
    height: Waves
    roll: Waves
    arc_along_m: Float[np.ndarray, " node"]
    arc_length_m: Float[np.ndarray, " node"]
    road: Road

    @property
    def duration_s(self) -> float:
        """Time from one end to the other."""
        return float(self.arc_length_m[-1]) / self.plan.speed_mps


def plan_motion(plan: DrivePlan, seed: int, road: Road | None = None) -> DriveMotion:
    """Draws wander and bounce from the seed and measures the path's length, slopes included.

    Args:
        road: the one driven along; None for a straight, flat, smooth one to the east.

    Raises:
        ValueError: start is not before stop, the direction is not +1 or -1, speed or scan rate is not positive,
            the drive leaves the road, or its lane passes beyond the centre of a curve.
    """
    if not plan.start_m < plan.stop_m:
        raise ValueError(f"start_m {plan.start_m} is not before stop_m {plan.stop_m}")
    if plan.direction not in (-1, 1):
        raise ValueError(f"direction is +1 or -1, not {plan.direction}")
    if not (plan.speed_mps > 0 and plan.scan_rate_hz > 0):
        raise ValueError(f"speed {plan.speed_mps} m/s and scan rate {plan.scan_rate_hz} Hz must be positive")
    if road is None:
        road = straight_road(max(plan.stop_m, 1.0))
    elif plan.start_m < road.along_m[0] or plan.stop_m > road.along_m[-1]:
        raise ValueError(f"the drive leaves the road, [{road.along_m[0]:.1f}, {road.along_m[-1]:.1f}] m along")
    rng = np.random.default_rng([seed, 2])
    wander = draw_waves(rng, plan.wander_m, plan.wander_wavelength_m)
    height = draw_waves(rng, plan.height_sigma_m, plan.bounce_wavelength_m)
    roll = draw_waves(rng, plan.roll_sigma_rad, plan.bounce_wavelength_m)
    nodes = max(2, int(np.ceil((plan.stop_m - plan.start_m) / ARC_STEP_M)) + 1)
    along = np.linspace(plan.start_m, plan.stop_m, nodes)
    middle = 0.5 * (along[1:] + along[:-1])
    forward = 1.0 - follow_centre(road, middle).curvature_per_m * (plan.lane_m + wave_value(wander, middle))
    if np.any(forward <= 0.0):
        raise ValueError(f"the lane at {plan.lane_m} m is beyond the centre of a curve")
    rise = np.diff(surface_up(road, along, plan.lane_m + wave_value(wander, along))) / np.diff(along)
    stretch = np.hypot(np.hypot(forward, wave_slope(wander, middle)), rise)
    length = np.append(0.0, np.cumsum(stretch * np.diff(along)))
    return DriveMotion(
        plan=plan, wander=wander, height=height, roll=roll, arc_along_m=along, arc_length_m=length, road=road
    )


def scan_times(motion: DriveMotion) -> Float[np.ndarray, " scan"]:
    """Time of each scan, s: the first at 0, the last no later than the drive's end."""
    rate = motion.plan.scan_rate_hz
    return np.arange(int(np.floor(motion.duration_s * rate)) + 1) / rate


def place_on_road(
    motion: DriveMotion, time_s: Float[np.ndarray, "*time"]
) -> tuple[Float[np.ndarray, "*time"], Float[np.ndarray, "*time"]]:
    """(along_m, cross_m) of the body origin."""
    plan = motion.plan
    run_m = plan.speed_mps * np.asarray(time_s)
    length_m = run_m if plan.direction > 0 else motion.arc_length_m[-1] - run_m
    along = np.interp(length_m, motion.arc_length_m, motion.arc_along_m)
    # A channel's own instant may be just past the last node; the road continues.
    beyond_m = np.minimum(length_m, 0.0) + np.maximum(length_m - motion.arc_length_m[-1], 0.0)
    along += beyond_m / (1.0 - follow_centre(motion.road, along).curvature_per_m * plan.lane_m)
    return along, plan.lane_m + wave_value(motion.wander, along)


def poses_at(motion: DriveMotion, time_s: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time 5"]:
    """The body origin's pose (east_m, north_m, height_m, yaw_rad, roll_rad).

    The body origin is the rear axle, which runs along its own heading: yaw is the path's tangent (of any branch).
    Height is that above the vehicle's place at rest on the road, which carries it up and down hills
    (``ground_up_at``); roll is the vehicle's own and the road's bank.
    """
    plan = motion.plan
    along, cross = place_on_road(motion, time_s)
    centre = follow_centre(motion.road, along)
    east, north, _ = road_to_local(motion.road, along, cross)
    slope = plan.direction * wave_slope(motion.wander, along)
    forward = plan.direction * (1.0 - centre.curvature_per_m * cross)
    yaw = centre.yaw_rad + np.arctan2(slope, forward)
    roll = plan.direction * (wave_value(motion.roll, along) + wave_value(motion.road.bank_rad, along))
    return np.stack([east, north, wave_value(motion.height, along), yaw, roll], axis=-1)


def ground_up_at(motion: DriveMotion, time_s: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time"]:
    """Height, above the road's start, of the ground below the body origin: the base of the ellipsoidal height."""
    return surface_up(motion.road, *place_on_road(motion, time_s))


def place_antennas(
    poses: Float[np.ndarray, "scan channel 5"], array: ArrayGeometry
) -> Float[np.ndarray, "scan channel 3"]:
    """(east_m, north_m, height) of each channel, given the body's pose at its instant.

    Height is h + y sin(roll) (docs/conventions.md): roll is positive right side down, so the left end rises. On a
    flat road it is that above the ground; ``antennas_on_road`` says it for any.
    """
    east, north, height, yaw, roll = np.moveaxis(poses, -1, 0)
    x_m, y_m = array.x_m[None], array.y_m[None] * np.cos(roll)
    return np.stack(
        [
            east + x_m * np.cos(yaw) - y_m * np.sin(yaw),
            north + x_m * np.sin(yaw) + y_m * np.cos(yaw),
            array.height_m + height + array.y_m[None] * np.sin(roll),
        ],
        axis=-1,
    )


def antennas_on_road(
    motion: DriveMotion, time_s: Float[np.ndarray, " scan"], array: ArrayGeometry
) -> Float[np.ndarray, "scan channel 3"]:
    """(along_m, cross_m, height above the ground) of each channel at its own instant, for the renderer.

    Each antenna is projected onto the road separately, because a curve leads away from under the body ahead of the rear
    axle. The vehicle is on the road's plane, so grade and bank do not change the height; the roughness below the
    antenna, the same on every drive and in both directions, does.
    """
    instant_s = time_s[:, None] + array.time_offset_s[None]
    poses = poses_at(motion, instant_s)
    along, _ = place_on_road(motion, instant_s)
    antenna_m = place_antennas(poses, array)
    guess_m = along + motion.plan.direction * array.x_m[None]
    road_along, road_cross = local_to_road(motion.road, antenna_m[..., 0], antenna_m[..., 1], guess_m)
    bank = motion.plan.direction * wave_value(motion.road.bank_rad, along)
    height = array.height_m + poses[..., 2] + array.y_m[None] * np.sin(poses[..., 4] - bank)
    return np.stack(
        [road_along, road_cross, height - roughness_value(motion.road.roughness, road_along, road_cross)], -1
    )


# Manoeuvres of calibration drives: commands to driver or servo over time.
#
# Angles are of the front wheels, left positive; a half turn of the steering wheel is the share of the way from lock to
# lock that its turns say.

STEP_S = 0.01
ACCELERATION_MPS2 = 0.8
HAND_RADPS = 0.25


class Manoeuvre(NamedTuple):
    """Commands to a vehicle at the simulation's steps.

    Attributes:
        time_s: times from 0, every ``STEP_S``.
        wanted_rad: front angle: the servo's command or, by hand, the angle of the steering wheel.
        speed_mps: speed held by the driver, negative in reverse; unused if the pedals are commanded.
        supply_v: supply voltage at the servo; 24 V in the functions below that do not know the vehicle.
        by_hand: whether the wheels follow the steering wheel, with the play only.
        throttle, brake: pedal commands, 0 to 1; ``None`` if the driver holds the speed.
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
        """Steer to an angle at the rate of a driver's hands."""
        self.go(abs(angle_rad - self.angle_rad[-1]) / HAND_RADPS + STEP_S, angle_rad=angle_rad)

    def speed_up(self, speed_mps: float) -> None:
        """Change to a speed, faster or slower."""
        self.go(abs(speed_mps - self.speed_mps[-1]) / ACCELERATION_MPS2 + STEP_S, speed_mps=speed_mps)

    def drive(self, length_m: float, speed_mps: float) -> None:
        """Drive from standstill to standstill; over a short distance the speed is not reached."""
        peak = min(abs(speed_mps), np.sqrt(abs(length_m) * ACCELERATION_MPS2))
        self.speed_up(float(np.copysign(peak, speed_mps)))
        self.go(max(abs(length_m) / peak - peak / ACCELERATION_MPS2, 0.0) + STEP_S)
        self.speed_up(0.0)

    def manoeuvre(self, *, by_hand: bool) -> Manoeuvre:
        time_s = np.arange(int(np.floor(self.time_s[-1] / STEP_S)) + 1) * STEP_S
        angle = np.interp(time_s, self.time_s, self.angle_rad)
        return Manoeuvre(
            time_s=time_s,
            wanted_rad=angle,
            speed_mps=np.interp(time_s, self.time_s, self.speed_mps),
            supply_v=np.full(time_s.size, 24.0),
            by_hand=by_hand,
        )


def half_turn_angles(largest_rad: float, lock_to_lock_turns: float) -> Float[np.ndarray, " stop"]:
    """Front angles at every half turn of the steering wheel, from full left through straight to full right."""
    step_rad = largest_rad / lock_to_lock_turns
    count = int(np.floor(lock_to_lock_turns + 1e-9))
    inner = step_rad * np.arange(count, -count - 1, -1)
    return np.unique(np.concatenate([[largest_rad], inner, [-largest_rad]]).round(12))[::-1]


def drive_straight(length_m: float, speed_mps: float, *, weave_rad: float = 0.0, weave_m: float = 20.0) -> Manoeuvre:
    """A straight line by hand; the driver's corrections swing the wheels with a wavelength of travel."""
    script = _Script()
    script.go(2.0)
    script.drive(length_m, speed_mps)
    script.go(2.0)
    commanded = script.manoeuvre(by_hand=True)
    way_m = np.cumsum(commanded.speed_mps) * STEP_S
    return commanded._replace(wanted_rad=weave_rad * np.cos(2 * np.pi * way_m / weave_m) * (commanded.speed_mps != 0.0))


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
        wheelbase_m, rear_ratio: wheelbase and rear ratio, which give the length of an arc.
        arc_turns: arc as a share of a full circle, 0.125 to 0.5.
        longest_m: longest length of a nearly straight arc.
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
    commanded = script.manoeuvre(by_hand=False)
    along_s = np.clip(commanded.time_s - start_s, 0.0, sweep_s)
    turns = sweep_hz[0] * along_s + 0.5 * (sweep_hz[1] - sweep_hz[0]) * along_s**2 / sweep_s
    swept = (commanded.time_s >= start_s) & (commanded.time_s < min(start_s + sweep_s, stop_s))
    return commanded._replace(wanted_rad=commanded.wanted_rad + sweep_rad * np.sin(2.0 * np.pi * turns) * swept)


def step_pedals(
    throttles: Sequence[float], brakes: Sequence[float], *, back: float = 0.15, hold_s: float = 4.0
) -> Manoeuvre:
    """From standstill, each throttle and brake in turn: throttle, slight release, coast, brake, partial release.

    Args:
        throttles, brakes: commands, one pair per run.
        back: reduction of a command before it is released.
        hold_s: time for which each throttle is held; brakes and standstill are held as long at most.
    """
    throttle_parts, brake_parts = [np.zeros(100)], [np.zeros(100)]
    hold = round(hold_s / STEP_S)
    for throttle, brake in zip(throttles, brakes, strict=True):
        run = [(throttle, 0.0, hold), (max(throttle - back, 0.0), 0.0, hold // 2), (0.0, 0.0, hold // 2)]
        run += [(0.0, brake, hold // 4), (0.0, max(brake - back, 0.0), hold // 4), (0.0, 1.0, hold), (0.0, 0.0, hold)]
        throttle_parts += [np.full(steps, commanded) for commanded, _, steps in run]
        brake_parts += [np.full(steps, commanded) for _, commanded, steps in run]
    throttle_commanded, brake_commanded = np.concatenate(throttle_parts), np.concatenate(brake_parts)
    zero = np.zeros(throttle_commanded.size)
    time_s = np.arange(zero.size) * STEP_S
    return Manoeuvre(
        time_s=time_s,
        wanted_rad=zero,
        speed_mps=zero,
        supply_v=np.full(zero.size, 24.0),
        by_hand=True,
        throttle=throttle_commanded,
        brake=brake_commanded,
    )
