"""Common parts of all monitors: a bit for each finding, its severity and message, and persistence times."""

import functools
import math
import operator
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeVar

from lgprjax.autopilot.modes import MOTIONS, Event, MeasuredSpeed

BitsT = TypeVar("BitsT", bound=IntFlag)


class Severity(IntEnum):
    """Reaction to a finding; the largest one wins."""

    CONTINUE = 0
    """Shown and recorded."""
    DEGRADE = 1
    """Drive on slowly."""
    STOP = 2
    """Controlled stop: throttle idle, ramped brake, steer on along the path."""
    MANUAL = 3
    """Actuators to their defaults, warn, the operator drives."""
    EMERGENCY = 4
    """The box cuts the actuators' power and brakes."""


class Finding(NamedTuple):
    """A row of a table of findings.

    Attributes:
        severity: reaction while the computer drives.
        text: for the operator.
        refuses: inhibits engaging.
    """

    severity: Severity
    text: str
    refuses: bool


class Watch(IntFlag):
    """One bit a finding; times from onset to bit are given with the watches."""

    POTENTIOMETER_RANGE = 1 << 0
    POTENTIOMETER_STUCK = 1 << 1
    WHEEL_SENSORS_APART = 1 << 2
    SERVO_WEAK = 1 << 3
    SERVO_DEAD = 1 << 4
    SUPPLY_LOW = 1 << 5
    STEERING_RUNAWAY = 1 << 6
    REAR_STUCK = 1 << 7
    YAW_RATE_LOST = 1 << 8
    ODOMETER_DEAD = 1 << 9
    ODOMETER_REVERSED = 1 << 10
    ODOMETER_SLIPS = 1 << 11
    SPEED_UNKNOWN = 1 << 12
    THROTTLE_STUCK = 1 << 13
    SPEED_RISES = 1 << 14
    BRAKE_DEAD = 1 << 15
    BRAKE_UNTESTED = 1 << 16
    PEDAL_UNREAD = 1 << 17
    LINE_SILENT = 1 << 18
    BAD_FRAMES = 1 << 19
    DEFAULTS_ACT = 1 << 20
    BUS_OFF = 1 << 21
    SECOND_SENDER = 1 << 22
    ACTUATOR_FAULT = 1 << 23
    OFF_PATH = 1 << 24
    FAR_OFF_PATH = 1 << 25
    OVERRIDE_CONTACTS = 1 << 26
    CONTROLLER_SILENT = 1 << 27
    TORQUE_UNREAD = 1 << 28
    HEADING_UNCONFIRMED = 1 << 29
    HEADING_CONTRADICTED = 1 << 30
    ABOVE_LIMIT = 1 << 31


FINDINGS = {
    Watch.POTENTIOMETER_RANGE: Finding(
        Severity.MANUAL, "wheel potentiometer: open, shorted or out of range", refuses=True
    ),
    Watch.POTENTIOMETER_STUCK: Finding(
        Severity.MANUAL, "wheel potentiometer: stuck while the encoder turns", refuses=True
    ),
    Watch.WHEEL_SENSORS_APART: Finding(
        Severity.MANUAL, "wheel potentiometer and encoder disagree: wheel refitted or a sensor slipped", refuses=True
    ),
    Watch.SERVO_WEAK: Finding(
        Severity.DEGRADE, "steering servo is slow: wheel angles lag behind the command", refuses=False
    ),
    Watch.SERVO_DEAD: Finding(Severity.MANUAL, "steering servo does not follow its command", refuses=True),
    Watch.SUPPLY_LOW: Finding(Severity.DEGRADE, "supply voltage of the steering servo is low", refuses=False),
    Watch.STEERING_RUNAWAY: Finding(
        Severity.MANUAL, "steering moves away from its command: servo power cut", refuses=True
    ),
    Watch.REAR_STUCK: Finding(
        Severity.STOP, "yaw rate does not match the wheel angles: rear steering stuck?", refuses=True
    ),
    Watch.YAW_RATE_LOST: Finding(Severity.DEGRADE, "no yaw rate: the rear steering cannot be monitored", refuses=False),
    Watch.ODOMETER_DEAD: Finding(Severity.DEGRADE, "odometer does not count while the vehicle moves", refuses=False),
    Watch.ODOMETER_REVERSED: Finding(Severity.DEGRADE, "odometer counts in the wrong direction", refuses=False),
    Watch.ODOMETER_SLIPS: Finding(Severity.DEGRADE, "odometer and GNSS disagree: wheels slip?", refuses=False),
    Watch.SPEED_UNKNOWN: Finding(Severity.STOP, "speed unknown: odometer bad and no GNSS", refuses=True),
    # Throttle idle and brake is a controlled stop; the box's cut is for a speed that rises nevertheless.
    Watch.THROTTLE_STUCK: Finding(Severity.STOP, "throttle stuck open: braking", refuses=True),
    Watch.SPEED_RISES: Finding(
        Severity.EMERGENCY, "throttle stuck open and speed rises: drive power cut", refuses=True
    ),
    Watch.BRAKE_DEAD: Finding(Severity.EMERGENCY, "brake has no effect: drive power cut", refuses=True),
    Watch.BRAKE_UNTESTED: Finding(Severity.CONTINUE, "braking test has not passed", refuses=True),
    Watch.PEDAL_UNREAD: Finding(Severity.STOP, "throttle or brake position is not a number", refuses=True),
    Watch.LINE_SILENT: Finding(Severity.MANUAL, "drive-by-wire box is silent", refuses=True),
    Watch.BAD_FRAMES: Finding(Severity.MANUAL, "drive-by-wire box: three bad frames in a row", refuses=True),
    Watch.DEFAULTS_ACT: Finding(Severity.MANUAL, "drive-by-wire box uses its default settings", refuses=True),
    Watch.BUS_OFF: Finding(Severity.MANUAL, "drive-by-wire box: bus off", refuses=True),
    Watch.SECOND_SENDER: Finding(Severity.MANUAL, "another source commands the drive-by-wire box", refuses=True),
    Watch.ACTUATOR_FAULT: Finding(
        Severity.MANUAL, "drive-by-wire box reports a servo, throttle, brake or power fault", refuses=True
    ),
    Watch.OFF_PATH: Finding(Severity.DEGRADE, "more than 1 ft off the path", refuses=False),
    Watch.FAR_OFF_PATH: Finding(Severity.STOP, "more than 3 ft off the path", refuses=False),
    Watch.OVERRIDE_CONTACTS: Finding(Severity.MANUAL, "override button: wire cut or contact stuck", refuses=True),
    Watch.CONTROLLER_SILENT: Finding(Severity.MANUAL, "operator controller is silent", refuses=True),
    Watch.TORQUE_UNREAD: Finding(Severity.MANUAL, "steering torque of the operator is not a number", refuses=True),
    Watch.HEADING_UNCONFIRMED: Finding(Severity.CONTINUE, "heading not confirmed yet: drive two metres", refuses=True),
    Watch.HEADING_CONTRADICTED: Finding(
        Severity.MANUAL, "heading contradicts the direction of travel: reversed?", refuses=True
    ),
    Watch.ABOVE_LIMIT: Finding(Severity.STOP, "driven faster than the speed limit for 5 s", refuses=True),
}
"""Of the vehicle and its operator. The documentation's table of findings is made from it."""


_NOTHING = Watch(0)

REFUSING = functools.reduce(operator.or_, (bit for bit, finding in FINDINGS.items() if finding.refuses))
"""Findings that inhibit engaging."""


def as_watch(bits: int) -> Watch:
    """Bits as findings. Most ticks have none, and creating a flag takes longer than the rest of a watch."""
    return Watch(bits) if bits else _NOTHING


def severity_of(bits: BitsT, findings: Mapping[BitsT, Finding]) -> Severity:
    """The largest severity of findings; CONTINUE for none."""
    return max((findings[bit].severity for bit in bits), default=Severity.CONTINUE)


def describe(bits: BitsT, findings: Mapping[BitsT, Finding]) -> list[str]:
    """Findings in plain words, the most severe first."""
    found = sorted((-findings[bit].severity, bit, findings[bit].text) for bit in bits)
    return [text for _, _, text in found]


# Persistence of conditions: turns readings of single ticks into a finding, and keeps it from flickering.

NOMINAL_STEP_S = 0.02
LONGEST_STEP_S = 0.04
"""Largest time counted for one tick, because a reading after a pause has no extra weight."""


class Dwell(NamedTuple):
    """Persistence of a finding.

    Attributes:
        seconds: time for which its condition has held, or, once on, has not.
        on: the finding is set.
    """

    seconds: float = 0.0
    on: bool = False


def counted_step_s(step_s: float) -> float:
    """Counted time of a tick: its length up to the longest; the nominal one if it is negative or NaN."""
    return min(step_s, LONGEST_STEP_S) if step_s >= 0.0 else NOMINAL_STEP_S


def step_dwell(dwell: Dwell, holds: bool, step_s: float, *, on_s: float, off_s: float = 1.0) -> Dwell:
    """Dwell that turns on after its condition held for ``on_s``, and off after it did not hold for ``off_s``."""
    if holds == dwell.on:
        return dwell if dwell.seconds == 0.0 else Dwell(0.0, dwell.on)
    seconds = dwell.seconds + step_s
    # Sums of steps may fall short of their limit by rounding.
    if seconds >= (off_s if dwell.on else on_s) - 1e-9:
        return Dwell(0.0, holds)
    return Dwell(seconds, dwell.on)


def beyond(value: float, bound: float) -> bool:
    """Whether a magnitude exceeds its bound; NaN does."""
    return not abs(value) <= bound


def wrap_rad(angle_rad: float) -> float:
    """An angle between −π and π; NaN stays NaN."""
    return math.remainder(angle_rad, math.tau) if math.isfinite(angle_rad) else math.nan


# Standing, moving, or too fast to engage, for the mode machine. Fault 30.

STANDING_MPS, MOVING_MPS = 0.05, 0.12
SMOOTHED_S = 0.2
TOO_FAST_MARGIN_MPS = 0.2
UNKNOWN_S = 0.1

_EVENTS = {motion: event for event, motion in MOTIONS.items()}


class MotionState(NamedTuple):
    """State between ticks: the last reported motion, the smoothed speed, and the time for which it was unknown."""

    motion: MeasuredSpeed = MeasuredSpeed.UNKNOWN
    speed_mps: float = 0.0
    unknown_s: float = 0.0


def step_motion(
    state: MotionState, *, speed_mps: float, fastest_engage_mps: float, step_s: float
) -> tuple[MotionState, list[Event]]:
    """State, and an event if the motion changed.

    A speed that is NaN for ``UNKNOWN_S`` counts as too fast to engage.

    Args:
        state: state of the last tick.
        speed_mps: signed speed.
        fastest_engage_mps: speed above which engaging is inhibited.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    if math.isfinite(speed_mps):
        share = min(step_s / SMOOTHED_S, 1.0)
        speed, unknown_s = state.speed_mps + share * (speed_mps - state.speed_mps), 0.0
    else:
        speed, unknown_s = state.speed_mps, state.unknown_s + step_s
    fast = fastest_engage_mps - (TOO_FAST_MARGIN_MPS if state.motion is MeasuredSpeed.TOO_FAST else 0.0)
    still = STANDING_MPS if state.motion is MeasuredSpeed.MOVING else MOVING_MPS
    if unknown_s >= UNKNOWN_S or abs(speed) > fast:
        motion = MeasuredSpeed.TOO_FAST
    else:
        motion = MeasuredSpeed.STANDING if abs(speed) <= still else MeasuredSpeed.MOVING
    events = [_EVENTS[motion]] if motion is not state.motion else []
    return MotionState(motion, speed, unknown_s), events


# Distance of the vehicle from its path while the autopilot drives. Fault 31.

FOOT_M = 0.3048
FAR_M = 3 * FOOT_M
OFF_S = 0.06
"""Found within 0.1 s."""
BACK_S = 1.0


class PathWatchState(NamedTuple):
    """State between ticks: whether the vehicle has been on the path since it was engaged, and findings."""

    arrived: bool = False
    off: Dwell = Dwell()
    far: Dwell = Dwell()


def step_path_watch(
    state: PathWatchState, *, engaged: bool, cross_track_m: float, step_s: float
) -> tuple[PathWatchState, Watch]:
    """State and findings of a tick.

    From engaging until the vehicle is first within a foot of the path, only a NaN offset is a finding.

    Args:
        state: state of the last tick.
        engaged: whether the autopilot steers.
        cross_track_m: offset from the path.
        step_s: time since the last tick.
    """
    if not engaged:
        return PathWatchState(), Watch(0)
    step_s = counted_step_s(step_s)
    offset = abs(cross_track_m)
    arrived = state.arrived or offset <= FOOT_M
    known = offset >= 0.0
    off = step_dwell(state.off, arrived and beyond(offset, FOOT_M), step_s, on_s=OFF_S, off_s=BACK_S)
    far = step_dwell(state.far, not known or (arrived and offset > FAR_M), step_s, on_s=OFF_S, off_s=BACK_S)
    return PathWatchState(arrived, off, far), as_watch(off.on * Watch.OFF_PATH | far.on * Watch.FAR_OFF_PATH)


# Speed above the limit where the operator has the pedals: the autopilot cannot slow the vehicle down.

LIMIT_MARGIN_MPS = 0.3
"""Tolerance with which a foot holds a speed."""
ABOVE_S = 5.0
"""Time to read the limit, and to slow down to it from 10 mph to 2 m/s at 0.7 m/s²."""


def step_limit_watch(
    above: Dwell, *, engaged: bool, speed_mps: float, limit_mps: float, step_s: float
) -> tuple[Dwell, Watch]:
    """State and findings of a tick; a speed or limit that is NaN is no finding here.

    Args:
        above: state of the last tick.
        engaged: whether the autopilot steers.
        speed_mps: signed speed.
        limit_mps: fastest speed that route and navigation allow; may be infinite.
        step_s: time since the last tick.
    """
    if not engaged:
        return Dwell(), Watch(0)
    faster = abs(speed_mps) > limit_mps + LIMIT_MARGIN_MPS
    above = step_dwell(above, faster, counted_step_s(step_s), on_s=ABOVE_S)
    return above, as_watch(above.on * Watch.ABOVE_LIMIT)


# The vehicle model of the watches: plain numbers of its calibration.

RANGE_MARGIN_RAD = 0.06
"""Allowed reading of a potentiometer beyond the ends of its map: wheels at their stop, and noise."""


class Knots(NamedTuple):
    """A function by its values at equal steps, linear between them and continued with the end's slope beyond."""

    first: float
    step: float
    values: tuple[float, ...]


class WheelBelief(NamedTuple):
    """Steering as calibrated; angles are those of the front wheels.

    Attributes:
        angle_of_volts: front angle, rad, over potentiometer volts.
        encoder_counts_per_rad: counts of the servo's encoder per radian.
        largest_rad: largest angle to either side.
        lag_s, rate_radps, delay_s, dead_band_rad, backlash_rad, nominal_v, stall_v: as in ``vehicle.Servo``.
    """

    angle_of_volts: Knots
    encoder_counts_per_rad: float
    largest_rad: float
    lag_s: float
    rate_radps: float
    delay_s: float
    dead_band_rad: float
    backlash_rad: float
    nominal_v: float
    stall_v: float


class ChassisBelief(NamedTuple):
    """Steering geometry: the magnitude of counter-steer over the front angle, both rad, and slip."""

    wheelbase_m: float
    rear_of_front: Knots
    characteristic_speed_mps: float


class PedalBelief(NamedTuple):
    """A pedal, as in ``vehicle.Pedal``."""

    pre_tension: float
    dead_zone: float
    gain_mps2: float
    lag_s: float


class PedalsBelief(NamedTuple):
    """Both pedals, and the resistances without them."""

    throttle: PedalBelief
    brake: PedalBelief
    rolling_mps2: float
    drag_per_s: float


def linear_wheel_map(straight_v: float, v_per_rad: float, largest_rad: float) -> Knots:
    """Front angle over volts of a potentiometer without a measured map."""
    ends_v = sorted(straight_v + side * v_per_rad * largest_rad for side in (-1.0, 1.0))
    step_v = ends_v[1] - ends_v[0]
    return Knots(ends_v[0], step_v, tuple((end_v - straight_v) / v_per_rad for end_v in ends_v))


def proportional_rear(ratio: float) -> Knots:
    """Counter-steer at a constant share of the front angle."""
    return Knots(0.0, 1.0, (0.0, ratio))


def knot_value(knots: Knots, place: float) -> float:
    """The function at a place; NaN for NaN."""
    at = (place - knots.first) / knots.step
    if not math.isfinite(at):
        return math.nan
    knot = min(max(math.floor(at), 0), len(knots.values) - 2)
    low, high = knots.values[knot], knots.values[knot + 1]
    return low + (at - knot) * (high - low)


def front_angle(belief: WheelBelief, volts: float) -> float:
    """Angle of the front wheels by the potentiometer, rad; NaN beyond its map by more than the margin."""
    angle = knot_value(belief.angle_of_volts, volts)
    ends = belief.angle_of_volts.values[0], belief.angle_of_volts.values[-1]
    inside = min(ends) - RANGE_MARGIN_RAD <= angle <= max(ends) + RANGE_MARGIN_RAD
    return angle if inside else math.nan


def curvature(belief: ChassisBelief, front_rad: float) -> float:
    """Turn of the vehicle over its travel, 1/m, without slip: κ = (tan φ + tan ψ) / L."""
    return (math.tan(front_rad) + math.tan(knot_value(belief.rear_of_front, front_rad))) / belief.wheelbase_m


def yaw_gain(belief: ChassisBelief, speed_mps: float) -> float:
    """Share of the geometric yaw rate that remains at a speed."""
    return 1.0 / (1.0 + (speed_mps / belief.characteristic_speed_mps) ** 2)


# The drive-by-wire box and its line, by its status. Faults 23, 24 and 41.
#
# Its bits are those of ``drive_status`` in data_schema/wire.toml.

SILENT_S = 0.1
"""Ten statuses of the box, and half of the time after which the box releases by itself."""
HELD_S = 0.1
"""Time after a command to engage within which the box must report that it has engaged."""
FAULT_S = 0.2
"""An actuator's fault must last longer than a short sag of the supply."""


class BoxState(IntFlag):
    """Bits of ``drive_status.state``."""

    DEFAULTS = 1
    BAD_FRAMES = 2
    SECOND_SENDER = 4
    SERVO_FAULT = 8
    THROTTLE_FAULT = 16
    BRAKE_FAULT = 32
    BUS_OFF = 64
    BRAKE_TESTED = 128
    NO_POWER = 256


_BITS = (
    (int(BoxState.BAD_FRAMES), int(Watch.BAD_FRAMES)),
    (int(BoxState.SECOND_SENDER), int(Watch.SECOND_SENDER)),
    (int(BoxState.BUS_OFF), int(Watch.BUS_OFF)),
)
_FAULTS = int(BoxState.SERVO_FAULT | BoxState.THROTTLE_FAULT | BoxState.BRAKE_FAULT | BoxState.NO_POWER)


class LineWatchState(NamedTuple):
    """State between ticks: time for which the box has not engaged as commanded, and has reported a fault."""

    let_go: Dwell = Dwell()
    fault: Dwell = Dwell()


def step_line_watch(
    state: LineWatchState,
    *,
    status_age_s: float,
    box_state: int,
    box_engaged: int,
    commanded_engaged: int,
    step_s: float,
) -> tuple[LineWatchState, Watch]:
    """State and findings of a tick.

    Args:
        state: state of the last tick.
        status_age_s: time since the newest accepted status; infinite before the first.
        box_state, box_engaged: ``state`` and ``engaged`` of that status.
        commanded_engaged: steering and pedals bits of ``engage`` sent in the last tick.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    lets_go = commanded_engaged != 0 and (box_state & BoxState.DEFAULTS != 0 or commanded_engaged & ~box_engaged != 0)
    let_go = step_dwell(state.let_go, lets_go, step_s, on_s=HELD_S)
    fault = step_dwell(state.fault, box_state & _FAULTS != 0, step_s, on_s=FAULT_S, off_s=0.0)
    bits = (
        fault.on * Watch.ACTUATOR_FAULT
        | let_go.on * Watch.DEFAULTS_ACT
        | (not 0.0 <= status_age_s <= SILENT_S) * Watch.LINE_SILENT
    )
    for box_bits, bit in _BITS:
        if box_state & box_bits:
            bits |= bit
    if not box_state & BoxState.BRAKE_TESTED:
        bits |= Watch.BRAKE_UNTESTED
    return LineWatchState(let_go, fault), as_watch(bits)
