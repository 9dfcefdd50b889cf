"""Monitors of chassis, pedals, steering servo and wheel sensors: commands compared with measurements.

Stuck wheels are found only where another angle than theirs is needed: a rear axle stuck straight is found in the next
bend.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.monitors import (
    ChassisBelief,
    Dwell,
    PedalBelief,
    PedalsBelief,
    Watch,
    WheelBelief,
    as_watch,
    beyond,
    counted_step_s,
    curvature,
    front_angle,
    step_dwell,
    yaw_gain,
)

SLOWEST_MPS = 1.0
"""Below it the gyro's bias is as large as the yaw rate of a bend."""
SMOOTHED_S = 0.25
STUCK_S = 0.6
"""Time until wheels count as stuck; with the smoothing a fault is found within 1 s."""
LOST_S = 0.1
RATE_RADPS = 0.012
CURVATURE_PER_M = 0.006
TURN_SHARE = 0.12
"""Allowed difference of gyro and model: bias and noise, curvature due to ruts, and a share of the turn itself for
calibration. A rear axle stuck straight removes almost four tenths of the turn.
"""


class ChassisWatchState(NamedTuple):
    """State carried from tick to tick: smoothed yaw rates, rad/s, that the gyro exceeds the model by, and that the
    model expects; findings."""

    excess_radps: float = 0.0
    expected_radps: float = 0.0
    stuck: Dwell = Dwell()
    lost: Dwell = Dwell()


def step_chassis_watch(
    belief: ChassisBelief,
    state: ChassisWatchState,
    *,
    front_rad: float,
    yaw_rate_radps: float,
    speed_mps: float,
    speed_trusted: bool,
    step_s: float,
) -> tuple[ChassisWatchState, Watch]:
    """State and findings of a tick.

    Args:
        belief: steering geometry.
        state: state of the last tick.
        front_rad: measured angle of the front wheels; without one nothing is judged, which is a separate finding.
        yaw_rate_radps: yaw rate by the gyro, counter-clockwise.
        speed_mps: signed speed.
        speed_trusted: whether the odometer is free of faults.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    lost = step_dwell(state.lost, not math.isfinite(yaw_rate_radps), step_s, on_s=LOST_S)
    judged = speed_trusted and abs(speed_mps) > SLOWEST_MPS and math.isfinite(front_rad)
    if not judged:
        stuck = step_dwell(state.stuck, False, step_s, on_s=STUCK_S)
        return ChassisWatchState(0.0, 0.0, stuck, lost), _bits(stuck, lost)
    if math.isfinite(yaw_rate_radps):
        expected = speed_mps * curvature(belief, front_rad) * yaw_gain(belief, speed_mps)
        share = min(step_s / SMOOTHED_S, 1.0)
        excess = state.excess_radps + share * (yaw_rate_radps - expected - state.excess_radps)
        expected = state.expected_radps + share * (expected - state.expected_radps)
    else:
        excess, expected = state.excess_radps, state.expected_radps
    bound = RATE_RADPS + CURVATURE_PER_M * abs(speed_mps) + TURN_SHARE * abs(expected)
    stuck = step_dwell(state.stuck, beyond(excess, bound), step_s, on_s=STUCK_S)
    return ChassisWatchState(excess, expected, stuck, lost), _bits(stuck, lost)


def _bits(stuck: Dwell, lost: Dwell) -> Watch:
    return as_watch(stuck.on * Watch.REAR_STUCK | lost.on * Watch.YAW_RATE_LOST)


# Throttle and brake against their commands, and the speed against both. Faults 21 and 22.
#
# Positions are compared with the commands of the last quarter of a second, the response time of an actuator. The speed
# is compared with a model of the pedals by an observer that learns the effect of slopes and calibration: an external
# push shows as a speed ahead of it.

ANSWER_TICKS = 13
"""Commands of the last quarter of a second: a position is between them, or moving there."""
OPEN = 0.1
"""A throttle more open than any of these commands, for ``OPEN_S``, is stuck: found within 0.5 s."""
OPEN_S = 0.14
PRESSED = 0.1
HELD_SHARE = 0.4
DEAD_S = 0.04
"""A brake commanded ``PRESSED`` or more throughout, whose pressure is a smaller share of it, is dead: found within
0.3 s.
"""
UNREAD_S = 0.1
RISE_MPS = 0.3
RISE_S = 0.06
"""Largest rise of the speed with a stuck throttle."""
AHEAD_MPS = 0.35
AHEAD_S = 0.06
"""Largest speed ahead of the model: reached after half a second by a sudden push of 1.2 m/s², a slope of 12 %."""
BRAKING_MPS2 = 0.5
"""Brake deceleration above which an external push means a brake without effect."""
ROLLING_MPS = 0.3
LEARN_S = 1.5
"""Time after moving off or engaging for the observer to learn the slope."""
LEAP_MPS = 0.25
"""Change of the speed within a tick that no throttle causes: slipping wheels, or a faulty odometer."""
SPEED_PER_S, PUSH_PER_S2 = 2.0, 2.0
"""Gains of the observer: damped by 0.7, at 1.4 rad/s."""


class PedalModel(NamedTuple):
    """A pedal as in ``vehicle.PedalState``: its position, and the resulting acceleration or deceleration."""

    pressed: float = 0.0
    effect_mps2: float = 0.0


class Observer(NamedTuple):
    """Expected speed, speed received in the last tick, external push, and time for which the vehicle has rolled
    while engaged.
    """

    expected_mps: float = 0.0
    received_mps: float = 0.0
    push_mps2: float = 0.0
    rolled_s: float = 0.0


class PedalWatchState(NamedTuple):
    """State carried from tick to tick.

    Attributes:
        throttles, brakes: commands of the last ticks.
        throttle, brake: states of the pedal models.
        observer: observer of the speed.
        lowest_mps: lowest speed since the throttle was found stuck.
        open, dead, ahead, unbraked, unread, rises: findings.
    """

    throttles: tuple[float, ...] = ()
    brakes: tuple[float, ...] = ()
    throttle: PedalModel = PedalModel()
    brake: PedalModel = PedalModel()
    observer: Observer = Observer()
    lowest_mps: float = math.inf
    open: Dwell = Dwell()
    dead: Dwell = Dwell()
    ahead: Dwell = Dwell()
    unbraked: Dwell = Dwell()
    unread: Dwell = Dwell()
    rises: Dwell = Dwell()


class PedalReading(NamedTuple):
    """Throttle and brake, 0 to 1: as sent, or as measured."""

    throttle: float
    brake: float


def step_pedal_watch(
    belief: PedalsBelief,
    state: PedalWatchState,
    *,
    engaged: bool,
    command: PedalReading,
    measured: PedalReading,
    speed_mps: float,
    speed_trusted: bool,
    step_s: float,
) -> tuple[PedalWatchState, Watch]:
    """State and findings of a tick; ``throttle.effect_mps2`` of the state is used by the odometer's watch.

    Args:
        belief: model of both pedals.
        state: state of the last tick.
        engaged: whether the box holds the pedals engaged.
        command: command sent in the last tick.
        measured: measured positions; while a person drives they replace the command.
        speed_mps: signed speed.
        speed_trusted: whether the odometer is free of faults.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    unread = step_dwell(
        state.unread, not (math.isfinite(measured.throttle) and math.isfinite(measured.brake)), step_s, on_s=UNREAD_S
    )
    acting = command if engaged else measured
    throttle = _press(belief.throttle, state.throttle, acting.throttle, step_s)
    brake = _press(belief.brake, state.brake, acting.brake, step_s)
    pushed_mps2 = throttle.effect_mps2 - brake.effect_mps2 - belief.rolling_mps2
    observer, ahead_mps = _observe(
        state.observer, pushed_mps2, belief.drag_per_s, speed_mps, engaged=engaged, trusted=speed_trusted, step_s=step_s
    )
    throttles = (*state.throttles[-ANSWER_TICKS:], command.throttle) if engaged else ()
    brakes = (*state.brakes[-ANSWER_TICKS:], command.brake) if engaged else ()
    answered = len(brakes) > ANSWER_TICKS
    opens = answered and not measured.throttle <= max(throttles) + OPEN
    pressed = min(brakes) if answered else 0.0
    fails = pressed >= PRESSED and not measured.brake >= HELD_SHARE * pressed
    brakes_now = brake.effect_mps2 > BRAKING_MPS2
    too_fast = ahead_mps > AHEAD_MPS
    opened = step_dwell(state.open, opens, step_s, on_s=OPEN_S)
    dead = step_dwell(state.dead, fails, step_s, on_s=DEAD_S)
    ahead = step_dwell(state.ahead, too_fast and not brakes_now, step_s, on_s=AHEAD_S)
    stuck = opened.on or ahead.on
    # With a throttle known to push against the brake the brake cannot be judged.
    unbraked = step_dwell(state.unbraked, too_fast and brakes_now and not stuck, step_s, on_s=AHEAD_S)
    lowest = _lower(state.lowest_mps, abs(speed_mps)) if stuck else math.inf
    rises = step_dwell(state.rises, stuck and abs(speed_mps) > lowest + RISE_MPS, step_s, on_s=RISE_S)
    state = PedalWatchState(
        throttles=throttles,
        brakes=brakes,
        throttle=throttle,
        brake=brake,
        observer=observer,
        lowest_mps=lowest,
        open=opened,
        dead=dead,
        ahead=ahead,
        unbraked=unbraked,
        unread=unread,
        rises=rises,
    )
    bits = (
        stuck * Watch.THROTTLE_STUCK
        | (dead.on or unbraked.on) * Watch.BRAKE_DEAD
        | unread.on * Watch.PEDAL_UNREAD
        | rises.on * Watch.SPEED_RISES
    )
    return state, as_watch(bits)


def _lower(lowest_mps: float, speed_mps: float) -> float:
    """The lower speed; NaN is ignored."""
    return speed_mps if speed_mps < lowest_mps else lowest_mps


def _observe(
    observer: Observer,
    pushed_mps2: float,
    drag_per_s: float,
    speed_mps: float,
    *,
    engaged: bool,
    trusted: bool,
    step_s: float,
) -> tuple[Observer, float]:
    """The observer after a tick, and by how much the speed is ahead of it: 0 if unknown."""
    speed = abs(speed_mps)
    if not (trusted and speed > ROLLING_MPS):
        known = speed if math.isfinite(speed) else 0.0
        return Observer(known, known), 0.0
    if abs(speed - observer.received_mps) > LEAP_MPS:
        return observer._replace(expected_mps=speed, received_mps=speed), 0.0
    expected = observer.expected_mps + (pushed_mps2 - drag_per_s * speed + observer.push_mps2) * step_s
    ahead = speed - expected
    rolled_s = observer.rolled_s + step_s if engaged else 0.0
    observer = Observer(
        expected + SPEED_PER_S * step_s * ahead, speed, observer.push_mps2 + PUSH_PER_S2 * step_s * ahead, rolled_s
    )
    return observer, ahead if rolled_s > LEARN_S else 0.0


def _press(belief: PedalBelief, pedal: PedalModel, position: float, step_s: float) -> PedalModel:
    """A pedal after a tick at a position; unchanged if that is NaN."""
    if not math.isfinite(position):
        return pedal
    taut = position - belief.pre_tension
    pressed = max(min(max(pedal.pressed, taut), taut + belief.dead_zone), 0.0)
    wanted = belief.gain_mps2 * pressed
    left = math.exp(-step_s / belief.lag_s) if belief.lag_s > 0.0 else 0.0
    return PedalModel(pressed, wanted + left * (pedal.effect_mps2 - wanted))


# Potentiometer and encoder of the steering, compared with each other and with their ranges.
#
# Faults 15 and 16. The encoder's zero differs at every start: it is learnt from the potentiometer's first good
# readings, or given, if the box keeps it. A wheel refitted one tooth off is found at once with a kept zero, otherwise
# from the yaw rate (above).

RANGE_S = 0.06
"""Time out of range after which it is open or shorted: found within 0.1 s; single spikes pass."""
MOVED_RAD = 0.025
"""Encoder motion during which the potentiometer must move by more than ``STILL_RAD``; play and noise are smaller."""
STILL_RAD = 0.01
ENCODER_STUCK_S = 0.04
APART_RAD = 0.03
"""Largest disagreement: noise, play and errors of the map together are half of it."""
APART_S = 0.16
LEARN_TICKS = 10
LEAP_RAD = 0.03
"""Encoder motion within a tick that no servo makes: a jump of the count, which does not implicate the potentiometer."""


class WheelSensorState(NamedTuple):
    """State carried from tick to tick.

    Attributes:
        zero_counts: encoder reading at straight wheels; NaN until learnt.
        learnt: readings that went into ``learnt_counts``, the sum of their zeros.
        still_rad, since_rad: potentiometer where it last moved, and the encoder then.
        encoder_rad: last tick's.
        range, stuck, apart: findings.
    """

    zero_counts: float = math.nan
    learnt: int = 0
    learnt_counts: float = 0.0
    still_rad: float = math.nan
    since_rad: float = math.nan
    encoder_rad: float = math.nan
    range: Dwell = Dwell()
    stuck: Dwell = Dwell()
    apart: Dwell = Dwell()


class WheelAngles(NamedTuple):
    """Front wheel angle, rad, by potentiometer and by encoder; NaN if unknown."""

    front_rad: float
    encoder_rad: float


def init_wheel_sensors(zero_counts: float = math.nan) -> WheelSensorState:
    """Initial state at a start of the box, with the encoder's stored zero or, usually, an unknown one."""
    return WheelSensorState(zero_counts=zero_counts)


def step_wheel_sensors(
    belief: WheelBelief, state: WheelSensorState, potentiometer_v: float, encoder_counts: float, step_s: float
) -> tuple[WheelSensorState, WheelAngles, Watch]:
    """State, angles and findings of a tick.

    Args:
        belief: calibrated steering.
        state: state of the last tick.
        potentiometer_v, encoder_counts: readings in the box's newest status.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    front = front_angle(belief, potentiometer_v)
    zero, learnt, learnt_counts = state.zero_counts, state.learnt, state.learnt_counts
    counts_are = math.isfinite(encoder_counts)
    if learnt < LEARN_TICKS and not math.isfinite(zero) and counts_are and math.isfinite(front):
        learnt, learnt_counts = learnt + 1, learnt_counts + encoder_counts - belief.encoder_counts_per_rad * front
        zero = learnt_counts / learnt if learnt == LEARN_TICKS else zero
    encoder = (encoder_counts - zero) / belief.encoder_counts_per_rad if counts_are else math.nan
    judged = math.isfinite(zero) or not counts_are

    leapt = beyond(encoder - state.encoder_rad, LEAP_RAD)
    moved = beyond(front - state.still_rad, STILL_RAD)
    still, since = (front, encoder) if leapt or moved else (state.still_rad, state.since_rad)
    out = step_dwell(state.range, math.isnan(front), step_s, on_s=RANGE_S)
    stuck = step_dwell(state.stuck, abs(encoder - since) > MOVED_RAD, step_s, on_s=ENCODER_STUCK_S)
    apart = step_dwell(state.apart, judged and beyond(front - encoder, APART_RAD), step_s, on_s=APART_S)
    state = WheelSensorState(
        zero_counts=zero,
        learnt=learnt,
        learnt_counts=learnt_counts,
        still_rad=still,
        since_rad=since,
        encoder_rad=encoder,
        range=out,
        stuck=stuck,
        apart=apart,
    )
    bits = (
        out.on * Watch.POTENTIOMETER_RANGE | stuck.on * Watch.POTENTIOMETER_STUCK | apart.on * Watch.WHEEL_SENSORS_APART
    )
    return state, WheelAngles(front, encoder), as_watch(bits)


# The steering servo against its command: weak, stalled, running away, or short of supply. Faults 17 and 18.
#
# A model of the servo (delay, dead band, lag, rate, play) follows the commands; wheels that lag behind it by more than
# timing and calibration explain are slow. A runaway needs no model: the wheels move away from every command that could
# act now. Neither is judged before the servo has had time to respond to its first command after engaging; until then
# the model follows the wheels.

LAG_RAD = 0.045
"""Largest lag behind the model: 30 ms of timing error at full rate and a supply sag of 50 ms are smaller."""
WEAK_S = 0.2
WEAK_OFF_S = 5.0
STALL_RAD = 0.01
"""Wheels that have moved by less, for ``STALL_S`` behind the model, are stalled."""
STALL_S = 0.3
LOST_RAD = 0.2
SERVO_LOST_S = 0.1
"""A lag this large for this long cannot be compensated by the look-ahead."""
SUPPLY_SHARE = 0.6
"""Share of the range from the stall voltage to the nominal one below which the supply is low."""
SUPPLY_S = 0.2
AWAY_RAD = 0.02
AWAY_TICKS = 4
"""Wheels that moved away from their commands by more within so many ticks (0.25 rad/s) run away."""
AWAY_S = 0.04
LIMIT_RAD = 0.03
"""Wheels beyond their largest angle by more run away too."""
LATE_S = 0.06
"""Margin of the servo's delay: commands since delay plus margin may act now."""
ANSWER_S = 0.1
"""Time in addition to its delay for a servo to respond to the first command after engaging."""


class TimedCommand(NamedTuple):
    """A command with the time at which it was sent."""

    time_s: float
    front_rad: float


class ServoWatchState(NamedTuple):
    """State carried from tick to tick.

    Attributes:
        time_s: sum of the ticks.
        engaged_s: time for which the servo has been engaged.
        sent: commands that act or will act, oldest first.
        motor_rad, wheel_rad: motor and wheel angle of the model.
        wheels: angles of the last ticks, oldest first.
        stalled_rad: wheel angle at the last motion behind the model; NaN while the wheels follow.
        weak, stalled, lost, supply, away: findings.
    """

    time_s: float = 0.0
    engaged_s: float = 0.0
    sent: tuple[TimedCommand, ...] = ()
    motor_rad: float = math.nan
    wheel_rad: float = math.nan
    wheels: tuple[WheelAngles, ...] = ()
    stalled_rad: float = math.nan
    weak: Dwell = Dwell()
    stalled: Dwell = Dwell()
    lost: Dwell = Dwell()
    supply: Dwell = Dwell()
    away: Dwell = Dwell()


def step_servo_watch(
    belief: WheelBelief,
    state: ServoWatchState,
    wheels: WheelAngles,
    supply_v: float,
    *,
    engaged: bool,
    command_rad: float,
    step_s: float,
) -> tuple[ServoWatchState, Watch]:
    """State and findings of a tick.

    Args:
        belief: calibrated steering with its servo.
        state: state of the last tick.
        wheels: measured angles of this tick.
        supply_v: supply voltage of the servo.
        engaged: whether the box holds the steering engaged.
        command_rad: command sent in the last tick.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    time_s = state.time_s + step_s
    engaged_s = state.engaged_s + step_s if engaged else 0.0
    # Without the potentiometer, which is a finding of its own, the encoder still shows whether the wheels turn.
    measured = wheels.front_rad if math.isfinite(wheels.front_rad) else wheels.encoder_rad
    low = belief.stall_v + SUPPLY_SHARE * (belief.nominal_v - belief.stall_v)
    supply = step_dwell(state.supply, not supply_v >= low, step_s, on_s=SUPPLY_S)
    recent = (*state.wheels[-AWAY_TICKS:], wheels)
    if engaged_s <= belief.delay_s + ANSWER_S:
        # Commands sent while the servo was free have no effect; those sent since are pending.
        sent = (*state.sent, TimedCommand(state.time_s, command_rad)) if engaged and math.isfinite(measured) else ()
        state = state._replace(time_s=time_s, engaged_s=engaged_s, sent=sent, motor_rad=measured, wheel_rad=measured)
        state = state._replace(wheels=recent, stalled_rad=math.nan, supply=supply)
        return _settle(state, behind=False, stands=False, lost=False, away=False, step_s=step_s)

    sent = (*state.sent, TimedCommand(state.time_s, command_rad))
    while len(sent) > 1 and sent[1].time_s <= time_s - belief.delay_s - LATE_S:
        sent = sent[1:]
    motor, wheel = _follow(belief, state, _acting(sent, time_s - belief.delay_s), step_s)
    error = measured - wheel
    behind = beyond(error, LAG_RAD) or not math.isfinite(command_rad)
    stalled = state.stalled_rad
    moves = beyond(measured - stalled, STALL_RAD)
    if moves or not behind:
        stalled = measured if behind else math.nan
    state = ServoWatchState(
        time_s=time_s,
        engaged_s=engaged_s,
        sent=sent,
        motor_rad=motor,
        wheel_rad=wheel,
        wheels=recent,
        stalled_rad=stalled,
        weak=state.weak,
        stalled=state.stalled,
        lost=state.lost,
        supply=supply,
        away=state.away,
    )
    return _settle(
        state,
        behind=behind,
        stands=behind and not moves,
        lost=beyond(error, LOST_RAD),
        away=_runs_away(sent, recent) or abs(measured) > belief.largest_rad + LIMIT_RAD,
        step_s=step_s,
    )


def _settle(
    state: ServoWatchState, *, behind: bool, stands: bool, lost: bool, away: bool, step_s: float
) -> tuple[ServoWatchState, Watch]:
    """Findings of what holds in this tick."""
    state = state._replace(
        weak=step_dwell(state.weak, behind, step_s, on_s=WEAK_S, off_s=WEAK_OFF_S),
        stalled=step_dwell(state.stalled, stands, step_s, on_s=STALL_S),
        lost=step_dwell(state.lost, lost, step_s, on_s=SERVO_LOST_S),
        away=step_dwell(state.away, away, step_s, on_s=AWAY_S),
    )
    bits = (
        state.weak.on * Watch.SERVO_WEAK
        | (state.stalled.on or state.lost.on) * Watch.SERVO_DEAD
        | state.supply.on * Watch.SUPPLY_LOW
        | state.away.on * Watch.STEERING_RUNAWAY
    )
    return state, as_watch(bits)


def _acting(sent: tuple[TimedCommand, ...], until_s: float) -> float:
    """The newest command sent until a time; the oldest known if there was none."""
    return next((command.front_rad for command in reversed(sent) if command.time_s <= until_s), sent[0].front_rad)


def _follow(belief: WheelBelief, state: ServoWatchState, target_rad: float, step_s: float) -> tuple[float, float]:
    """Motor and wheels of the model after a tick; unchanged if the target is NaN."""
    largest = belief.largest_rad
    wrong = min(max(target_rad, -largest), largest) - state.motor_rad
    wrong -= min(max(wrong, -belief.dead_band_rad), belief.dead_band_rad)
    turn = wrong * (1.0 - math.exp(-step_s / belief.lag_s)) if belief.lag_s > 0.0 else wrong
    most = belief.rate_radps * step_s
    motor = state.motor_rad + min(max(turn, -most), most) if math.isfinite(target_rad) else state.motor_rad
    play = 0.5 * belief.backlash_rad
    return motor, min(max(state.wheel_rad, motor - play), motor + play)


def _runs_away(sent: tuple[TimedCommand, ...], recent: tuple[WheelAngles, ...]) -> bool:
    """Whether the wheels have left all commands that may act, by both potentiometer and encoder if available."""
    before, now = recent[0], recent[-1]
    turned = beyond(now.front_rad - before.front_rad, AWAY_RAD)
    if not (turned and beyond(now.encoder_rad - before.encoder_rad, AWAY_RAD)):
        return False
    commands = [command.front_rad for command in sent if math.isfinite(command.front_rad)]
    if not commands:
        return False
    ways = [
        _away(then_rad, now_rad, min(commands), max(commands))
        for then_rad, now_rad in zip(before, now, strict=True)
        if math.isfinite(then_rad) and math.isfinite(now_rad)
    ]
    return bool(ways) and (min(ways) > AWAY_RAD or max(ways) < -AWAY_RAD)


def _away(then_rad: float, now_rad: float, low_rad: float, high_rad: float) -> float:
    """Motion of a wheel out of a range, signed; 0 within it or towards it."""
    return max(now_rad - max(then_rad, high_rad), 0.0) + min(now_rad - min(then_rad, low_rad), 0.0)
