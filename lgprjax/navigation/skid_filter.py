"""The filter of a skid-steer vehicle: one tick of prediction, delta heading, fix, and the heading's start or restart.

Wheels in every tick, INS and GNSS when available (MF section 2). Algebra and gates are shared with the filter of the
counter-steered vehicle.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation import kalman
from lgprjax.navigation.kalman import Innovation, reach, turned, wrap_yaw
from lgprjax.navigation.observations import (
    GNSS,
    HEADING,
    NEVER_S,
    GateRules,
    GateState,
    GnssObservation,
    advance_gates,
    default_rules,
    init_gates,
    judge,
)
from lgprjax.navigation.skid_model import (
    DRIFT,
    SLIP_AHEAD,
    SLOW_X,
    SLOW_Y,
    TURNED,
    UNKNOWN_YAW_VARIANCE,
    YAW,
    DeltaHeading,
    SkidEstimate,
    SkidModel,
    SkidMotion,
    SkidObservations,
    X,
    Y,
    init_skid_estimate,
    predict_skid,
    skid_rates,
)
from lgprjax.vehicle import VehiclePose, WheelSpeeds

# Expected observations of GNSS and INS for a skid-steer vehicle, and their validity.

LEAST_FIX_VARIANCE = 1e-6
"""Least sigma of a fix: a millimetre, whatever it reports."""
_LARGEST_BEND_RADPM = 0.05
"""On a tighter arc than 20 m the course of a pair of fixes is no heading."""


class InsEpoch(NamedTuple):
    """The end of the last delta heading, from which the next one counts.

    Attributes:
        since_s: time since then.
        yaw_rate_radps: of the body then.
    """

    since_s: Float[Array, "..."]
    yaw_rate_radps: Float[Array, "..."]


class HeadingChange(NamedTuple):
    """Validity of a tick's delta heading.

    Attributes:
        usable: it continues from the last one received, and is a turn that the vehicle can make.
        ends: a span ends here, used or not, and the next one counts from it.
        late_s: the tick's end after the span's.
    """

    usable: Bool[Array, "..."]
    ends: Bool[Array, "..."]
    late_s: Float[Array, "..."]


def antenna_reach(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion, age_s: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The antenna some time before the tick's end, forward and left of the midpoint at the end."""
    speed_mps, yaw_rate_radps = skid_rates(model, estimate, motion)
    ahead = estimate.mean[SLIP_AHEAD]
    return reach(-age_s * speed_mps, -age_s * yaw_rate_radps, ahead, model.gnss_x_m, model.gnss_y_m)


def fix_innovation(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion, fix: GnssObservation, offered: Bool[Array, ""]
) -> Innovation:
    """Of the antenna's position: of the variance that a fix reports a share is slow, the rest is white.

    Args:
        model, estimate, motion: at the tick's end.
        fix: arbitrary if not offered.
        offered: whether it is usable.
    """
    scale2 = model.gnss_scale * model.gnss_scale
    slow_x, slow_y = (jnp.sqrt(scale2 * model.gnss_slow_share * _variance(fix, axis, offered)) for axis in (0, 1))
    # The way since the fix is held fixed: a fix at most a second old must not correct scale and slip through its age.
    at = antenna_reach(model, estimate, motion, jnp.where(offered, fix.age_s, 0.0))

    def expect(mean: Float[Array, " 12"]) -> Float[Array, " 2"]:
        x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), at)
        return jnp.stack([mean[X] + x + slow_x * mean[SLOW_X], mean[Y] + y + slow_y * mean[SLOW_Y]])

    least = LEAST_FIX_VARIANCE * jnp.eye(2, dtype=jnp.float32)
    white = scale2 * (1.0 - model.gnss_slow_share) * fix.covariance + least
    return kalman.innovation_of(estimate.mean, expect, jnp.stack([fix.x_m, fix.y_m]), white, offered)


def turn_innovation(
    model: SkidModel,
    estimate: SkidEstimate,
    motion: SkidMotion,
    epoch: InsEpoch,
    delta: DeltaHeading,
    received: HeadingChange,
) -> Innovation:
    """Of the turn since the last delta heading, exact at any tick: the state ``turned`` has accumulated it.

    Args:
        model, estimate, motion: at the tick's end.
        epoch: end of the last one.
        delta: arbitrary if not usable.
        received: from ``hear``.
    """
    span = jnp.where(received.usable, delta.span_s, 0.0)
    _, yaw_rate_radps = skid_rates(model, estimate, motion)

    # The turn since the span's end is held fixed: the INS corrects what was counted, not the wheels' rate.
    def expect(mean: Float[Array, " 12"]) -> Float[Array, " 1"]:
        return (mean[TURNED] - received.late_s * yaw_rate_radps + mean[DRIFT] * span)[None]

    # The end of a span within its tick is unknown: its turn is uncertain if the rate changed between two ends.
    doubt = model.ins_clock_s * (yaw_rate_radps - epoch.yaw_rate_radps)
    by_turn = model.ins_turn_noise**2 * jnp.abs(expect(estimate.mean))
    noise = model.ins_noise**2 * span + doubt * doubt + by_turn
    return kalman.innovation_of(estimate.mean, expect, delta.turn_rad[None], noise[:, None], received.usable)


def hear(model: SkidModel, epoch: InsEpoch, motion: SkidMotion, delta: DeltaHeading) -> HeadingChange:
    """Whether a delta heading continues from the end of the last one.

    One that is due is used. One long after its span follows a lost one: the count starts anew. One long before the end
    of its span is a repeat.

    Args:
        model: for the fastest turn.
        epoch: end of the last one, at the tick's end.
        motion: the tick's.
        delta: of the tick.
    """
    sound = kalman.usable(delta) & (delta.span_s > 0.0)
    span = jnp.where(sound, delta.span_s, 1.0)
    late = epoch.since_s - span
    possible = jnp.abs(delta.turn_rad) <= model.fastest_turn_radps * span
    # One half a span early is a repeat; half a span late, if a tick is as long, it is still due.
    early = late < -jnp.minimum(1.5 * motion.step_s, 0.4 * span)
    due = ~early & (late <= jnp.minimum(1.5 * motion.step_s, 0.6 * span))
    ends = sound & ~early
    return HeadingChange(sound & due & possible, ends, jnp.where(due, jnp.clip(late, 0.0, motion.step_s), 0.0))


def fix_usable(model: SkidModel, fix: GnssObservation, newest_s: Float[Array, ""]) -> Bool[Array, ""]:
    """Finite, with a plausible error, neither too old nor from the future, and newer than the newest so far.

    Args:
        model: for the oldest fix.
        fix: of the tick.
        newest_s: how long before the tick's end the newest fix so far was taken.
    """
    # Two numbers that differ by rounding are the same time.
    timely = (fix.age_s >= 0.0) & (fix.age_s <= model.oldest_fix_s) & (fix.age_s < newest_s - 0.001)
    xx, xy, yy = fix.covariance[0, 0], fix.covariance[0, 1], fix.covariance[1, 1]
    return kalman.usable(fix) & timely & (xx >= 0.0) & (yy >= 0.0) & (xx * yy >= xy * xy)


def fix_variance(fix: GnssObservation, offered: Bool[Array, ""]) -> Float[Array, ""]:
    """Variance of an axis that a fix reports, the mean of both; zero where it is not offered."""
    return 0.5 * (_variance(fix, 0, offered) + _variance(fix, 1, offered))


_OTHER_RECEIVER = 4.0


def other_receiver(variance: Float[Array, "..."], before: Float[Array, "..."]) -> Bool[Array, "..."]:
    """Whether a fix's reported variance differs so much from the one before that they share no slow error."""
    return (variance > _OTHER_RECEIVER * before) | (before > _OTHER_RECEIVER * variance)


def _variance(fix: GnssObservation, axis: int, offered: Bool[Array, ""]) -> Float[Array, ""]:
    return jnp.where(offered, fix.covariance[axis, axis], 0.0)


# Update by a delta heading for a skid-steer vehicle: always used, with added uncertainty beyond the gate.
#
# Wheels slip, so that a turn beyond the gate is taken from the INS; the disagreement is added to the uncertainty, so
# that a faulty INS costs accuracy but not consistency.


class Fate(NamedTuple):
    """Outcome of one observation.

    Attributes:
        nis: normalised innovation squared; zero if nothing was offered.
        offered: valid, finite, new and in time.
        accepted: used.
        reacquired: used although beyond the gate.
    """

    nis: Float[Array, ""]
    offered: Bool[Array, ""]
    accepted: Bool[Array, ""]
    reacquired: Bool[Array, ""]


class HeadingUpdate(NamedTuple):
    """Estimate, gates and the end of the last delta heading after a tick's, and its outcome.

    Attributes:
        counted: the estimate before the count of the turn starts anew; ends: whether it does.
    """

    estimate: SkidEstimate
    gates: GateState
    epoch: InsEpoch
    fate: Fate
    counted: SkidEstimate
    ends: Bool[Array, ""]


def update_turn(
    model: SkidModel,
    rules: GateRules,
    estimate: SkidEstimate,
    gates: GateState,
    epoch: InsEpoch,
    motion: SkidMotion,
    delta: DeltaHeading,
) -> HeadingUpdate:
    """The estimate after the tick's delta heading, if there is one, and the start of the next one's turn.

    Args:
        model, rules: of the filter.
        estimate, gates, epoch: at the tick's end, before it.
        motion: the tick's; its numbers are finite.
        delta: may hold anything where it is not valid.
    """
    received = hear(model, epoch, motion, delta)
    innovation = turn_innovation(model, estimate, motion, epoch, delta, received)
    weighed = kalman.weigh(estimate, innovation)
    nowhere = jnp.zeros(2, jnp.float32)
    verdict, gates = judge(rules, gates, HEADING, received.usable, weighed.nis, nowhere, nowhere)
    used = kalman.correct(estimate, innovation, weighed, verdict.accepted & ~verdict.reacquired)
    # Beyond the gate the wheel states are not updated, and half of the disagreement is added to the sigma itself, not
    # to its square: disagreements of one cause have one sign.
    apart = jnp.where(verdict.reacquired, innovation.residual[0], 0.0)
    half, sigma = 0.5 * jnp.abs(apart), jnp.sqrt(jnp.maximum(used.covariance[YAW, YAW], 0.0))
    doubted = used.covariance.at[YAW, YAW].add(half * (half + 2.0 * sigma))
    counted = kalman.wrapped(SkidEstimate(used.mean.at[YAW].add(apart), doubted))
    _, yaw_rate_radps = skid_rates(model, counted, motion)
    begun = received.late_s * yaw_rate_radps - counted.mean[TURNED]
    begins = kalman.reopen(counted, {TURNED: begun}, {TURNED: jnp.zeros_like(begun)}, received.ends)
    ended = InsEpoch(
        jnp.where(received.ends, received.late_s, epoch.since_s),
        jnp.where(received.ends, yaw_rate_radps, epoch.yaw_rate_radps),
    )
    fate = Fate(weighed.nis, received.usable, verdict.accepted, verdict.reacquired)
    return HeadingUpdate(begins, gates, ended, fate, counted, received.ends)


# The first heading of a vehicle without a compass: from pairs of fixes while driving straight (MF section 2).
#
# The vehicle's own track is dead reckoned in a frame of its own from wheels and INS. Fixes and the antenna's places in
# that frame make pairs; the turn from the one to the other is the heading, whatever the lever of the antenna and
# whether the vehicle went forward or back. The pairs share no fix and lie apart, so that the RMS about their mean tells
# an error.

PAIRS = 4
"""Number of headings in the history; twice as many fixes are kept."""
_ODD_LENGTH = 0.25
"""Fixes whose distance differs this much from the distance driven indicate a fault of receiver or wheels."""


class HeadingStart(NamedTuple):
    """A straight track and its fixes, the newest last.

    Attributes:
        known: whether the filter's heading counts as known.
        own: pose of the midpoint in the frame of the track, which begins with the track.
        time_s: since the track began.
        fix_m: the fixes kept.
        antenna_m: the antenna's places in the frame of the track then.
        own_yaw_rad: yaw in that frame then.
        fix_variance: their reported variance, m², the mean of both axes.
        fix_s: when they were taken.
        taken: how many have been kept.
    """

    known: Bool[Array, "..."]
    own: VehiclePose
    time_s: Float[Array, "..."]
    fix_m: Float[Array, "... 8 2"]
    antenna_m: Float[Array, "... 8 2"]
    own_yaw_rad: Float[Array, "... 8"]
    fix_variance: Float[Array, "... 8"]
    fix_s: Float[Array, "... 8"]
    taken: Int[Array, "..."]


class Way(NamedTuple):
    """A tick's motion by wheels and INS.

    Attributes:
        travel_m, turn_rad: of the body.
        slip_ahead_m: of the point that does not move aside.
        step_s: length of the tick.
    """

    travel_m: Float[Array, "..."]
    turn_rad: Float[Array, "..."]
    slip_ahead_m: Float[Array, "..."]
    step_s: Float[Array, "..."]


class KeptFix(NamedTuple):
    """A fix as input of the heading start.

    Attributes:
        fix_m: position of the antenna.
        reach_m: forward and left of the midpoint at the tick's end, where the antenna was when it was taken.
        turned_rad: the body's turn from then to the tick's end.
        variance: that it reports, m².
        age_s: at the tick's end.
        offered: whether there is one.
    """

    fix_m: Float[Array, " 2"]
    reach_m: tuple[Float[Array, ""], Float[Array, ""]]
    turned_rad: Float[Array, ""]
    variance: Float[Array, ""]
    age_s: Float[Array, ""]
    offered: Bool[Array, ""]


class StartedHeading(NamedTuple):
    """Heading from the pairs.

    Attributes:
        yaw_rad: of the body at the tick's end.
        variance: rad².
        ready: a new fix completed a valid history.
    """

    yaw_rad: Float[Array, ""]
    variance: Float[Array, ""]
    ready: Bool[Array, ""]


def init_heading_start() -> HeadingStart:
    """State before any motion."""
    zero, rows = jnp.float32(0.0), 2 * PAIRS
    many, places = jnp.zeros(rows, jnp.float32), jnp.zeros((rows, 2), jnp.float32)
    own = VehiclePose(zero, zero, zero)
    return HeadingStart(
        known=jnp.asarray(False),
        own=own,
        time_s=zero,
        fix_m=places,
        antenna_m=places,
        own_yaw_rad=many,
        fix_variance=many,
        fix_s=many,
        taken=jnp.int32(0),
    )


def step_heading_start(
    model: SkidModel, start: HeadingStart, way: Way, fix: KeptFix, blind: Bool[Array, ""]
) -> tuple[HeadingStart, StartedHeading]:
    """One tick: continue the track, restart it where it bends, and take a fix far enough from the last.

    Args:
        model: of vehicle and sensors.
        start: its state.
        way: the tick's.
        fix: the tick's.
        blind: without INS: slip of the sides bends the track unnoticed.
    """
    moved = _drive(start, way)
    x, y = turned(jnp.cos(moved.own.yaw_rad), jnp.sin(moved.own.yaw_rad), fix.reach_m)
    antenna = jnp.stack([moved.own.x_m + x, moved.own.y_m + y])
    apart_m = jnp.hypot(*(antenna - moved.antenna_m[-1]))
    bend = jnp.abs(moved.own.yaw_rad - moved.own_yaw_rad[-1])
    straight = (moved.taken == 0) | (bend <= _LARGEST_BEND_RADPM * jnp.maximum(apart_m, model.start_pair_m))
    moved = moved._replace(taken=jnp.where(straight, moved.taken, 0))
    takes = fix.offered & ((moved.taken == 0) | (apart_m >= model.start_pair_m))
    kept = moved._replace(
        fix_m=_push(moved.fix_m, jnp.where(fix.offered, fix.fix_m, 0.0), takes),
        antenna_m=_push(moved.antenna_m, antenna, takes),
        own_yaw_rad=_push(moved.own_yaw_rad, moved.own.yaw_rad - fix.turned_rad, takes),
        fix_variance=_push(moved.fix_variance, fix.variance, takes),
        fix_s=_push(moved.fix_s, moved.time_s - fix.age_s, takes),
        taken=jnp.where(takes, jnp.minimum(moved.taken + 1, 2 * PAIRS), moved.taken),
    )
    found = _heading_of(model, kept, blind)
    return kept, found._replace(ready=found.ready & takes)


def _drive(start: HeadingStart, way: Way) -> HeadingStart:
    """The own pose a tick on; before the first fix the frame stays at the vehicle."""
    nowhere = jnp.zeros_like(way.travel_m)
    at = reach(way.travel_m, way.turn_rad, way.slip_ahead_m, nowhere, nowhere)
    x, y = turned(jnp.cos(start.own.yaw_rad), jnp.sin(start.own.yaw_rad), at)
    begun = start.taken > 0
    ahead = VehiclePose(start.own.x_m + x, start.own.y_m + y, start.own.yaw_rad + way.turn_rad)
    own = VehiclePose(*(jnp.where(begun, value, 0.0) for value in ahead))
    return start._replace(own=own, time_s=jnp.where(begun, start.time_s + way.step_s, 0.0))


def _heading_of(model: SkidModel, start: HeadingStart, blind: Bool[Array, ""]) -> StartedHeading:
    """The mean turn from the pairs of the own frame to those of the fixes, and its quality."""
    own = start.antenna_m[PAIRS:] - start.antenna_m[:PAIRS]
    seen = start.fix_m[PAIRS:] - start.fix_m[:PAIRS]
    crossed = own[:, 0] * seen[:, 1] - own[:, 1] * seen[:, 0]
    along = own[:, 0] * seen[:, 0] + own[:, 1] * seen[:, 1]
    offset = _direction(along.sum(), crossed.sum())
    rms = jnp.sqrt(jnp.mean(wrap_yaw(_direction(along, crossed) - offset) ** 2))
    own_m, seen_m = jnp.hypot(own[:, 0], own[:, 1]), jnp.hypot(seen[:, 0], seen[:, 1])
    as_long = jnp.all(jnp.abs(seen_m - own_m) <= _ODD_LENGTH * own_m)
    full = start.taken >= 2 * PAIRS
    base_m = jnp.where(full, jnp.maximum(own_m.mean(), model.start_pair_m), model.start_pair_m)
    apart_s = jnp.mean(start.fix_s[PAIRS:] - start.fix_s[:PAIRS])
    reported = model.gnss_scale**2 * start.fix_variance.mean()
    white = 2.0 * (1.0 - model.gnss_slow_share) * reported / PAIRS
    slow = -2.0 * model.gnss_slow_share * reported * jnp.expm1(-jnp.maximum(apart_s, 0.0) / model.gnss_slow_s)
    aside = model.side_noise**2 * base_m
    bent = jnp.where(blind, 2.0 * (model.slip_sigma * base_m / model.track_m) ** 2 + model.yaw_noise**2 * base_m, 0.0)
    variance = jnp.maximum((white + slow + aside) / (base_m * base_m) + bent, rms * rms / PAIRS)
    ready = full & as_long & (rms <= model.start_rms_rad)
    return StartedHeading(wrap_yaw(offset + start.own.yaw_rad), variance, ready)


def _direction(along: Float[Array, "..."], crossed: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle between two directions, zero where there is none."""
    return jnp.arctan2(crossed, jnp.where((along == 0.0) & (crossed == 0.0), 1.0, along))


def _push(rows: Float[Array, "8 ..."], row: Float[Array, "..."], takes: Bool[Array, ""]) -> Float[Array, "8 ..."]:
    """The rows with a new one last where it is taken."""
    return jnp.where(takes, jnp.concatenate([rows[1:], row[None]]), rows)


_BLIND_S = 1.0
"""An INS silent for longer does not support a heading start."""


class LastHeard(NamedTuple):
    """Last data received from each sensor.

    Attributes:
        wheels: finite speeds.
        epoch: of the INS.
        fix_m: position of the newest fix.
        fix_s: how long before the tick's end it was taken.
        fix_variance: that it reported, m²; zero before the first.
    """

    wheels: WheelSpeeds
    epoch: InsEpoch
    fix_m: Float[Array, "... 2"]
    fix_s: Float[Array, "..."]
    fix_variance: Float[Array, "..."]


class SkidFilterState(NamedTuple):
    """The estimate at the tick's end, and the states of gates, heading start and sensors."""

    estimate: SkidEstimate
    gates: GateState
    start: HeadingStart
    last: LastHeard


class SkidFilterInfo(NamedTuple):
    """Outcome of a tick. Where there are two values, they are of GNSS and of the heading.

    Attributes:
        heading_known: the yaw may be used.
        heading_started: it became known in this tick.
        heading_restarted: it was known, and straight fixes replaced it.
        nis: normalised innovation squared; zero if nothing was offered.
        offered: valid, finite, new and in time.
        accepted: used.
        reacquired: used although beyond the gate.
    """

    heading_known: Bool[Array, "..."]
    heading_started: Bool[Array, "..."]
    heading_restarted: Bool[Array, "..."]
    nis: Float[Array, "... 2"]
    offered: Bool[Array, "... 2"]
    accepted: Bool[Array, "... 2"]
    reacquired: Bool[Array, "... 2"]


def skid_rules() -> GateRules:
    """Gates for GNSS at 1 Hz, re-acquired after the sixth consecutive rejection, and for an INS that is always used."""
    rules = default_rules()
    return rules._replace(
        reacquire_after=rules.reacquire_after.at[GNSS].set(5).at[HEADING].set(0), forget_s=jnp.float32(5.0)
    )


def init_skid_filter(model: SkidModel, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> SkidFilterState:
    """The filter at the start: approximate position, heading unknown."""
    zero, never = jnp.float32(0.0), jnp.float32(NEVER_S)
    last = LastHeard(WheelSpeeds(zero, zero), InsEpoch(never, zero), jnp.full(2, never), never, zero)
    return SkidFilterState(init_skid_estimate(model, x_m, y_m), init_gates(), init_heading_start(), last)


def step_skid_filter(
    model: SkidModel, rules: GateRules, state: SkidFilterState, motion: SkidMotion, observations: SkidObservations
) -> tuple[SkidFilterState, SkidFilterInfo]:
    """One tick: the motion, then INS and GNSS. Unbatched; use ``vmap`` for more.

    A non-finite wheel speed is replaced by the last finite one; a tick of invalid length has length zero.

    Args:
        model: of vehicle and sensors.
        rules: of the gates.
        state: at the tick's start.
        motion: over the tick.
        observations: taken within it, or before and late; a slot that is not valid may hold anything.
    """
    motion, turned = hear_turn(model, rules, state, motion, observations.delta_heading)
    step = motion.step_s
    turn = wrap_yaw(turned.estimate.mean[YAW] - state.estimate.mean[YAW])
    wheels = WheelSpeeds(motion.left_mps, motion.right_mps)
    last = state.last._replace(wheels=wheels, epoch=turned.epoch, fix_s=state.last.fix_s + step)
    received = SkidFilterState(turned.estimate, turned.gates, state.start, last)
    return _hear_fix(model, rules, received, motion, turn, observations.gnss, turned.fate)


def hear_turn(
    model: SkidModel, rules: GateRules, state: SkidFilterState, motion: SkidMotion, delta: DeltaHeading
) -> tuple[SkidMotion, HeadingUpdate]:
    """The first half of a tick: the motion, as far as it is finite, and the delta heading."""
    motion = _finite(motion, state.last.wheels)
    epoch = state.last.epoch._replace(since_s=state.last.epoch.since_s + motion.step_s)
    estimate = predict_skid(model, state.estimate, motion)
    gates = advance_gates(rules, state.gates, motion.step_s)
    return motion, update_turn(model, rules, estimate, gates, epoch, motion, delta)


def _finite(motion: SkidMotion, wheels: WheelSpeeds) -> SkidMotion:
    sound = jnp.isfinite(motion.step_s) & (motion.step_s > 0.0)
    return SkidMotion(
        jnp.where(jnp.isfinite(motion.left_mps), motion.left_mps, wheels.left_mps),
        jnp.where(jnp.isfinite(motion.right_mps), motion.right_mps, wheels.right_mps),
        jnp.where(sound, motion.step_s, 0.0),
    )


def _try_start(
    model: SkidModel,
    state: SkidFilterState,
    motion: SkidMotion,
    turn: Float[Array, ""],
    fix: GnssObservation,
    offered: Bool[Array, ""],
) -> tuple[HeadingStart, StartedHeading]:
    """The heading start a tick on: it sees every fix that is offered, also those that a wrong heading shuts out."""
    speed_mps, yaw_rate_radps = skid_rates(model, state.estimate, motion)
    age = jnp.where(offered, fix.age_s, 0.0)
    way = Way(speed_mps * motion.step_s, turn, state.estimate.mean[SLIP_AHEAD], motion.step_s)
    at = antenna_reach(model, state.estimate, motion, age)
    kept = KeptFix(jnp.stack([fix.x_m, fix.y_m]), at, age * yaw_rate_radps, fix_variance(fix, offered), age, offered)
    blind = state.gates.since_accepted_s[HEADING] > _BLIND_S
    return step_heading_start(model, state.start, way, kept, blind)


def _hear_fix(
    model: SkidModel,
    rules: GateRules,
    state: SkidFilterState,
    motion: SkidMotion,
    turn: Float[Array, ""],
    fix: GnssObservation,
    ins: Fate,
) -> tuple[SkidFilterState, SkidFilterInfo]:
    """The tick's fix: to the heading start first, which needs no heading, then past its gate into the estimate."""
    place, before = jnp.stack([fix.x_m, fix.y_m]), state.last
    offered = fix_usable(model, fix, before.fix_s) & jnp.any(place != before.fix_m)
    start, found = _try_start(model, state, motion, turn, fix, offered)
    estimate = state.estimate
    off = wrap_yaw(found.yaw_rad - estimate.mean[YAW])
    limit = jnp.maximum(model.contradiction_rad, 4.0 * jnp.sqrt(found.variance + estimate.covariance[YAW, YAW]))
    starts, restarts = found.ready & ~start.known, found.ready & start.known & (jnp.abs(off) > limit)
    known = start.known | starts
    estimate = kalman.wrapped(kalman.reopen(estimate, {YAW: off}, {YAW: found.variance}, starts | restarts))
    any_yaw, zero, one = jnp.float32(UNKNOWN_YAW_VARIANCE), jnp.float32(0.0), jnp.float32(1.0)
    estimate = kalman.reopen(estimate, {YAW: zero}, {YAW: any_yaw}, offered & ~known)
    variance = fix_variance(fix, offered)
    other = other_receiver(variance, before.fix_variance)
    slow = {SLOW_X: -estimate.mean[SLOW_X], SLOW_Y: -estimate.mean[SLOW_Y]}
    estimate = kalman.reopen(estimate, slow, {SLOW_X: one, SLOW_Y: one}, offered & other)

    innovation = fix_innovation(model, estimate, motion, fix, offered)
    # Without a heading, or with a new one, the place before says nothing: the vehicle is where the fix says.
    free = ~known | starts | restarts
    nis = jnp.where(free, 0.0, kalman.weigh(estimate, innovation).nis)
    seen = jnp.where(offered, place, 0.0)
    verdict, gates = judge(rules, state.gates, GNSS, offered, nis, seen, seen - innovation.residual)
    moves = {X: innovation.residual[0], Y: innovation.residual[1]}
    variances = {X: 1.0 + 100.0 * innovation.noise[0, 0], Y: 1.0 + 100.0 * innovation.noise[1, 1]}
    estimate = kalman.reopen(estimate, moves, variances, verdict.reacquired | (offered & free))
    again = fix_innovation(model, estimate, motion, fix, offered)
    estimate = kalman.correct(estimate, again, kalman.weigh(estimate, again), verdict.accepted)

    # Not "above": a variance that is no number must not count as a known heading.
    known = known & (estimate.covariance[YAW, YAW] <= model.lost_yaw_rad**2)
    last = before._replace(
        fix_m=jnp.where(offered, place, before.fix_m),
        fix_s=jnp.where(offered, fix.age_s, before.fix_s),
        fix_variance=jnp.where(offered, variance, before.fix_variance),
    )
    gnss = Fate(nis, offered, verdict.accepted, verdict.reacquired)
    fates = [jnp.stack(pair) for pair in zip(gnss, ins, strict=True)]
    info = SkidFilterInfo(known, starts & known, restarts, *fates)
    return SkidFilterState(estimate, gates, start._replace(known=known), last), info
