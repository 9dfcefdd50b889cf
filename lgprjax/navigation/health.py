"""Health of the navigation: from the sources' observations in a tick to one of three reactions, with reasons.

Nothing is switched here. A filter leaves out what its gates reject; health decides whether the rest is enough to drive
on. A stop is requested as long as its reason lasts: the mode machine ensures that a stopped vehicle does not set off by
itself.
"""

import math
from enum import IntEnum, IntFlag
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.navigation.counter_steer_filter import FilterInfo, FilterState
from lgprjax.navigation.counter_steer_model import SPEED, position_sigma_m, step_local
from lgprjax.navigation.observations import GNSS, HEADING, LGPR, ODOMETER, LgprObservation, MotionInput, Observations
from lgprjax.vehicle import VehiclePose

# Limits of the navigation's health.


class HealthRules(NamedTuple):
    """Limits; scalars, or one value a source in the order of ``SOURCES``.

    Attributes:
        silent_s: without an observation for longer, a source is silent; infinite for a source that the vehicle lacks.
        lost_s: without an accepted observation for longer, a source does not bound the error.
        rejects: consecutive rejections after which a source is reported.
        coarse_m: standard deviation, larger axis, above which GNSS is coarse.
        consistent_nis: mean normalised innovation squared of GNSS, over some 20 positions, above which its errors are
            larger than it states; 2 is expected.
        stuck_m: distance driven with an unchanged GNSS position.
        risk: probability of a false match up to which a scan is evidence of the map's ground; that of a fix.
        faded_share: share of the scans of ``fading_s`` without such evidence above which the ground has faded.
        fading_s: length of that sliding share.
        conflict_stop_s: a conflict between GNSS and LGPR that lasts longer requests a stop.
        free_cross_m, slow_cross_m, stop_cross_m: cross-track standard deviation above which the speed is capped, at
            which the cap is ``degraded_mps``, and that stops.
        stop_speed_mps: standard deviation of the speed above which it is unknown.
        degrade_frame_m, stop_frame_m: remaining motion of the slewed path.
        longest_step_s: longest valid tick.
        least_fixes: accepted fixes within ``fading_s`` that a lock needs.
        hold_s: time for which a reason is reported after it last held, and for which a source must have bounded the
            error before faults of the other one cost no speed, so that the speed cap does not flicker.
        degraded_mps: speed cap while degraded.
    """

    silent_s: Float[Array, "4"]
    lost_s: Float[Array, "4"]
    rejects: Int32[Array, "4"]
    coarse_m: Float[Array, ""]
    consistent_nis: Float[Array, ""]
    stuck_m: Float[Array, ""]
    risk: Float[Array, ""]
    faded_share: Float[Array, ""]
    fading_s: Float[Array, ""]
    conflict_stop_s: Float[Array, ""]
    free_cross_m: Float[Array, ""]
    slow_cross_m: Float[Array, ""]
    stop_cross_m: Float[Array, ""]
    stop_speed_mps: Float[Array, ""]
    degrade_frame_m: Float[Array, ""]
    stop_frame_m: Float[Array, ""]
    longest_step_s: Float[Array, ""]
    least_fixes: Float[Array, ""]
    hold_s: Float[Array, ""]
    degraded_mps: Float[Array, ""]


def health_rules(
    *, gnss_period_s: float, heading_period_s: float, odometer_period_s: float, lgpr_period_s: float, risk: float
) -> HealthRules:
    """Rules for sources of given periods, in s, infinite for one that the vehicle lacks, and the risk of a fix.

    A source is silent after 1.5 periods of GNSS, 3 scans of LGPR, and after 0.2 s without heading or 0.5 s without
    odometry, though no sooner than after 1.5 of their periods. The budget of 0.3 m, cross-track, is the 1 ft of the
    Husky's requirements, minus the error during the stop.

    The ground has faded when most scans give no evidence: the typical scan no longer distinguishes the map's ground
    from other ground. The correlation itself does not show that; rain lowers it far without approaching the noise
    floor. A share near one would react only when LGPR is silent, and the stretches without a fix that good ground has
    too, a scan in ten, stay well below a half.
    """
    gnss, lgpr = 1.5 * gnss_period_s, 3.0 * lgpr_period_s
    heading, odometer = max(0.2, 1.5 * heading_period_s), max(0.5, 1.5 * odometer_period_s)
    one = jnp.float32
    lost = (max(0.5, 2.5 * gnss_period_s), heading, odometer, max(0.5, lgpr))
    return HealthRules(
        silent_s=jnp.asarray([gnss, heading, odometer, lgpr], jnp.float32),
        # A source that the vehicle lacks is not silent, and bounds nothing.
        lost_s=jnp.asarray([0.5 if math.isinf(each) else each for each in lost], jnp.float32),
        rejects=jnp.asarray([1, 2, 3, 2], jnp.int32),
        coarse_m=one(0.1),
        # Errors of 1.7 times what is stated.
        consistent_nis=one(6.0),
        stuck_m=one(0.5),
        risk=one(risk),
        faded_share=one(0.5),
        fading_s=one(2.0),
        conflict_stop_s=one(10.0),
        free_cross_m=one(0.1),
        slow_cross_m=one(0.15),
        stop_cross_m=one(0.25),
        stop_speed_mps=one(0.5),
        degrade_frame_m=one(0.3),
        stop_frame_m=one(1.0),
        longest_step_s=one(0.2),
        # Five fixes that agree with each other and with the way driven are no chance.
        least_fixes=one(5.0),
        hold_s=one(1.0),
        degraded_mps=one(2.0),
    )


# Reactions to faults of the navigation, and the faults that are distinguished.


class Reaction(IntEnum):
    """Reaction of the vehicle; the larger one wins."""

    CONTINUE = 0
    DEGRADE = 1
    """Drive on below the speed cap."""
    STOP = 2
    """Controlled stop: throttle idle, ramped brake, steer on along the last valid local path."""


class Reason(IntFlag):
    """Reasons; several may hold at once; the order of the bits is that of the rules in ``health``."""

    NON_FINITE = 1
    """The estimate holds a non-finite number."""
    BAD_STEP = 2
    """The clock stopped, went back or jumped."""
    GNSS_SILENT = 4
    GNSS_STUCK = 8
    """The receiver repeats one position while the vehicle moves."""
    GNSS_COARSE = 16
    """The receiver itself reports a large error: float or single instead of fixed."""
    GNSS_REJECTED = 32
    HEADING_SILENT = 64
    HEADING_REJECTED = 128
    ODOMETER_SILENT = 256
    ODOMETER_REJECTED = 512
    LGPR_SILENT = 1024
    LGPR_REJECTED = 2048
    LGPR_FADED = 4096
    """The scans match the map less and less: wet soil, frost, or changed ground."""
    CONFLICT = 8192
    """GNSS and LGPR give different places, both with confidence."""
    REACQUIRED = 16384
    """A rejected source was re-acquired, because the filter itself must have been wrong."""
    FRAME_BEHIND = 32768
    """The path in the local frame has not yet reached its target."""
    UNCERTAIN = 65536
    """The filter's cross-track sigma is large: the speed follows it."""
    POSITION_LOST = 131072
    """Neither GNSS nor LGPR: dead reckoning. Requests a stop."""
    HEADING_LOST = 262144
    """No heading and no fix that would give one. Requests a stop."""
    SPEED_LOST = 524288
    """The speed is unknown. Requests a stop."""
    CONFLICT_LASTS = 1048576
    """The conflict has lasted. Requests a stop."""
    FRAME_FAR = 2097152
    """The path is too far from its target. Requests a stop."""
    TOO_UNCERTAIN = 4194304
    """The cross-track error exceeds the budget. Requests a stop."""
    GNSS_INCONSISTENT = 8388608
    """Positions scatter more than the receiver states."""


STOPPING = (
    Reason.NON_FINITE
    | Reason.POSITION_LOST
    | Reason.HEADING_LOST
    | Reason.SPEED_LOST
    | Reason.CONFLICT_LASTS
    | Reason.FRAME_FAR
    | Reason.TOO_UNCERTAIN
)
"""Reasons that request a stop; the others degrade."""
OF_GNSS = Reason.GNSS_SILENT | Reason.GNSS_STUCK | Reason.GNSS_COARSE | Reason.GNSS_REJECTED | Reason.GNSS_INCONSISTENT
"""Faults of GNSS: they degrade only while LGPR does not bound the error."""
OF_LGPR = Reason.LGPR_SILENT | Reason.LGPR_REJECTED | Reason.LGPR_FADED
"""Faults of LGPR: they degrade only while GNSS does not bound the error."""


__all__ = [
    "Health",
    "HealthRules",
    "HealthState",
    "Reaction",
    "Reason",
    "health_rules",
    "init_health",
    "step_health",
]

_BINS = 10  # of the sliding share


class HealthState(NamedTuple):
    """State carried from tick to tick.

    Attributes:
        gnss_x_m, gnss_y_m: last GNSS position.
        stuck_m, repeated_m: distance driven since it changed, and up to its last repetition: between two positions of a
            fast vehicle there is none yet, which is not stuck.
        unproven, scans, fixes: scans without evidence of the map's ground, all, and accepted fixes, in each tenth of
            the sliding share, the newest first.
        bin_s: since the newest tenth began.
        fix_way_m: driven since the last fix that counts among ``fixes``.
        held_s: remaining time for which each reason, in the order of its bits, is reported.
        gnss_nis: mean normalised innovation squared of GNSS, over some 20 positions.
        bounded_s: for how long GNSS and LGPR have each bounded the error.
    """

    gnss_x_m: Float[Array, ""]
    gnss_y_m: Float[Array, ""]
    stuck_m: Float[Array, ""]
    repeated_m: Float[Array, ""]
    unproven: Float[Array, "10"]
    scans: Float[Array, "10"]
    fixes: Float[Array, "10"]
    bin_s: Float[Array, ""]
    fix_way_m: Float[Array, ""]
    held_s: Float[Array, "24"]
    gnss_nis: Float[Array, ""]
    bounded_s: Float[Array, "2"]


class Health(NamedTuple):
    """Request to the vehicle.

    Attributes:
        reaction: a ``Reaction``.
        reasons: bits of ``Reason``.
        speed_cap_mps: infinite, by the cross-track sigma, the degraded speed, or 0 for a stop.
        bounded: LGPR alone bounds the error, and has done so for a while: a vehicle may be engaged and driven by it.
        gnss_bounded: GNSS alone does.
    """

    reaction: Int32[Array, ""]
    reasons: Int32[Array, ""]
    speed_cap_mps: Float[Array, ""]
    bounded: Bool[Array, ""]
    gnss_bounded: Bool[Array, ""]


def init_health() -> HealthState:
    """Before the first tick."""
    zero, bins = jnp.float32(0.0), jnp.zeros(_BINS, jnp.float32)
    unknown = jnp.float32(jnp.nan)
    held_s, neither_s = jnp.zeros(len(Reason), jnp.float32), jnp.zeros(2, jnp.float32)
    expected = jnp.float32(_EXPECTED_NIS)
    return HealthState(
        gnss_x_m=unknown,
        gnss_y_m=unknown,
        stuck_m=zero,
        repeated_m=zero,
        unproven=bins,
        scans=bins,
        fixes=bins,
        bin_s=zero,
        fix_way_m=zero,
        held_s=held_s,
        gnss_nis=expected,
        bounded_s=neither_s,
    )


def step_health(
    rules: HealthRules,
    state: HealthState,
    filter_state: FilterState,
    filter_info: FilterInfo,
    observations: Observations,
    lgpr_p_false: Float[Array, ""],
    frame_left_m: Float[Array, ""],
    step_s: Float[Array, ""],
) -> tuple[HealthState, Health]:
    """Health after a tick; unbatched, use ``vmap`` for more.

    Args:
        rules: limits.
        state: before the tick.
        filter_state, filter_info: of ``step_filter``, after the same tick.
        observations: of the tick.
        lgpr_p_false: probability that foreign ground would have matched the tick's scan as well, whether the match
            became a fix or not; NaN without a match.
        frame_left_m: remainder from ``slew_frame``.
        step_s: length of the tick.
    """
    sound_step = (step_s > 0.0) & (step_s <= rules.longest_step_s)
    passed_s = jnp.where(sound_step, step_s, 0.0)
    state = _listened(rules, state, filter_state, filter_info, observations, lgpr_p_false, passed_s)
    seen = _seen(rules, state, filter_state, filter_info, observations, frame_left_m, sound_step)
    held_s = jnp.where(seen, rules.hold_s, jnp.maximum(state.held_s - passed_s, 0.0))
    reported = seen | (held_s > 0.0)
    bits = jnp.asarray([reason.value for reason in Reason], jnp.int32)
    reasons = jnp.sum(jnp.where(reported, bits, 0), dtype=jnp.int32)
    bounded_s = jnp.where(_bounds(rules, state, filter_state, reported), state.bounded_s + passed_s, 0.0)
    by_gnss, by_lgpr = bounded_s >= rules.hold_s
    excused = jnp.where(by_lgpr, OF_GNSS.value, 0) | jnp.where(by_gnss, OF_LGPR.value, 0)
    slows = reasons & ~excused
    stops = (reasons & jnp.int32(STOPPING.value)) != 0
    reaction = jnp.where(stops, Reaction.STOP.value, jnp.where(slows != 0, Reaction.DEGRADE.value, 0))
    faulty = (slows & ~jnp.int32(Reason.UNCERTAIN.value)) != 0
    cap = jnp.minimum(jnp.where(faulty, rules.degraded_mps, jnp.inf), _cap_mps(rules, filter_state))
    cap = jnp.where(stops, 0.0, cap).astype(jnp.float32)
    state = state._replace(held_s=held_s, bounded_s=bounded_s)
    return state, Health(reaction.astype(jnp.int32), reasons, cap, by_lgpr, by_gnss)


def _cap_mps(rules: HealthRules, filter_state: FilterState) -> Float[Array, ""]:
    """Speed cap by the cross-track sigma, whichever source bounds it: none up to ``free_cross_m``; beyond, inversely
    proportional to the excess, through ``degraded_mps`` at ``slow_cross_m``.
    """
    _, cross_m = position_sigma_m(filter_state.estimate)
    excess_m = cross_m - rules.free_cross_m
    by_excess = rules.degraded_mps * (rules.slow_cross_m - rules.free_cross_m) / jnp.maximum(excess_m, 1e-6)
    return jnp.where(excess_m > 0.0, by_excess, jnp.inf)


_MOVING_MPS = 0.1
_OWN_WAY_M = 0.03
"""Way from one fix to the next that is an observation of its own."""

_EXPECTED_NIS, _NIS_SHARE, _LARGEST_NIS = 2.0, 0.05, 20.0
_AGAINST_BOTH = Reason.NON_FINITE | Reason.BAD_STEP | Reason.CONFLICT | Reason.REACQUIRED | Reason.TOO_UNCERTAIN
"""Reasons for which neither source bounds the error."""


def _bounds(
    rules: HealthRules, state: HealthState, filter_state: FilterState, reported: Bool[Array, "24"]
) -> Bool[Array, "2"]:
    """Whether GNSS and LGPR each bound the error now: accepted lately and nothing against it; enough fixes of LGPR."""
    against = jnp.asarray([[bool(reason & (_AGAINST_BOTH | own)) for reason in Reason] for own in (OF_GNSS, OF_LGPR)])
    lost = filter_state.gates.since_accepted_s > rules.lost_s
    enough = jnp.stack([jnp.asarray(True), state.fixes.sum() >= rules.least_fixes])
    return ~(reported[None] & against).any(axis=1) & ~jnp.stack([lost[GNSS], lost[LGPR]]) & enough


def _listened(
    rules: HealthRules,
    state: HealthState,
    filter_state: FilterState,
    filter_info: FilterInfo,
    observations: Observations,
    lgpr_p_false: Float[Array, ""],
    passed_s: Float[Array, ""],
) -> HealthState:
    """The unchanged position, its scatter and the sliding share, updated to this tick."""
    gnss = observations.gnss
    changed = filter_info.offered[GNSS] & ((gnss.x_m != state.gnss_x_m) | (gnss.y_m != state.gnss_y_m))
    # A silent receiver is not stuck: it has its own rule.
    received = filter_state.gates.since_offered_s[GNSS] <= rules.silent_s[GNSS]
    moved_m = jnp.where(received, jnp.abs(filter_state.estimate.mean[SPEED]) * passed_s, 0.0)
    stuck_m = jnp.where(changed, 0.0, state.stuck_m + moved_m)
    repeated_m = jnp.where(filter_info.offered[GNSS], stuck_m, state.repeated_m)
    full = state.bin_s + passed_s >= rules.fading_s / _BINS
    matched = ~jnp.isnan(lgpr_p_false)
    # At standstill one match is reported repeatedly: no fix is added, and earlier ones are kept.
    speed_mps = jnp.abs(filter_state.estimate.mean[SPEED])
    moving = speed_mps >= _MOVING_MPS
    way_m = state.fix_way_m + jnp.where(moving, speed_mps * passed_s, 0.0)
    own = filter_info.accepted[LGPR] & (way_m >= _OWN_WAY_M)
    return state._replace(
        gnss_x_m=jnp.where(changed, gnss.x_m, state.gnss_x_m),
        gnss_y_m=jnp.where(changed, gnss.y_m, state.gnss_y_m),
        stuck_m=stuck_m,
        repeated_m=repeated_m,
        unproven=_pushed(state.unproven, jnp.where(lgpr_p_false > rules.risk, 1.0, 0.0), full),
        scans=_pushed(state.scans, jnp.where(matched, 1.0, 0.0), full),
        fixes=_pushed(state.fixes, own.astype(jnp.float32), full & moving),
        fix_way_m=jnp.where(own, 0.0, way_m),
        # One jump is no scatter: it has its own rule.
        gnss_nis=jnp.where(
            filter_info.offered[GNSS],
            state.gnss_nis + _NIS_SHARE * (jnp.clip(filter_info.nis[GNSS], 0.0, _LARGEST_NIS) - state.gnss_nis),
            state.gnss_nis,
        ),
        bin_s=jnp.where(full, 0.0, state.bin_s + passed_s),
    )


def _seen(
    rules: HealthRules,
    state: HealthState,
    filter_state: FilterState,
    filter_info: FilterInfo,
    observations: Observations,
    frame_left_m: Float[Array, ""],
    sound_step: Bool[Array, ""],
) -> Bool[Array, "24"]:
    """Reasons of this tick, in the order of their bits."""
    estimate, gates = filter_state.estimate, filter_state.gates
    _, cross_m = position_sigma_m(estimate)
    finite = jnp.isfinite(estimate.mean).all() & jnp.isfinite(estimate.covariance).all()
    silent = gates.since_offered_s > rules.silent_s
    rejected = gates.rejects >= rules.rejects
    lost = gates.since_accepted_s > rules.lost_s
    covariance = observations.gnss.covariance
    coarse = observations.gnss.valid & (
        jnp.maximum(covariance[0, 0], covariance[1, 1]) > rules.coarse_m * rules.coarse_m
    )
    # A receiver that repeats itself while the vehicle moves is wrong for certain, and contradicts nobody.
    stuck = state.repeated_m > rules.stuck_m
    conflict_s = jnp.where(stuck, 0.0, gates.conflict_s)
    faded = state.unproven.sum() > rules.faded_share * state.scans.sum()
    no_heading = (silent[HEADING] | rejected[HEADING]) & lost[HEADING]
    speed_variance = estimate.covariance[SPEED, SPEED]
    seen = {
        Reason.NON_FINITE: ~finite,
        Reason.BAD_STEP: ~sound_step,
        Reason.GNSS_SILENT: silent[GNSS],
        Reason.GNSS_STUCK: stuck,
        Reason.GNSS_COARSE: coarse,
        Reason.GNSS_REJECTED: rejected[GNSS],
        Reason.HEADING_SILENT: silent[HEADING],
        Reason.HEADING_REJECTED: rejected[HEADING],
        Reason.ODOMETER_SILENT: silent[ODOMETER],
        Reason.ODOMETER_REJECTED: rejected[ODOMETER],
        Reason.LGPR_SILENT: silent[LGPR],
        Reason.LGPR_REJECTED: rejected[LGPR],
        Reason.LGPR_FADED: faded,
        Reason.CONFLICT: conflict_s > 0.0,
        Reason.REACQUIRED: filter_info.reacquired.any(),
        # A value that is not finite is within no limit.
        Reason.FRAME_BEHIND: ~(frame_left_m <= rules.degrade_frame_m),
        Reason.UNCERTAIN: ~(cross_m <= rules.free_cross_m),
        Reason.POSITION_LOST: lost[GNSS] & lost[LGPR],
        Reason.HEADING_LOST: no_heading & lost[LGPR],
        Reason.SPEED_LOST: speed_variance > rules.stop_speed_mps * rules.stop_speed_mps,
        Reason.CONFLICT_LASTS: conflict_s > rules.conflict_stop_s,
        Reason.FRAME_FAR: ~(frame_left_m <= rules.stop_frame_m),
        Reason.TOO_UNCERTAIN: ~(cross_m <= rules.stop_cross_m),
        Reason.GNSS_INCONSISTENT: state.gnss_nis > rules.consistent_nis,
    }
    return jnp.stack([seen[reason] for reason in Reason])


def _pushed(bins: Float[Array, "10"], value: Float[Array, ""], full: Bool[Array, ""]) -> Float[Array, "10"]:
    """A value added to the newest bin, after a new one was begun if the last is full."""
    begun = jnp.concatenate([jnp.zeros(1, jnp.float32), bins[:-1]])
    bins = jnp.where(full, begun, bins)
    return bins.at[0].add(value)


# The Husky's own fusion (LL): the LGPR-corrected pose while the correlation is good enough, else that of GNSS/INS.
#
# A good fix replaces the pose; between fixes it is propagated by dead reckoning. Details that LL leaves open are chosen
# here. Whether a fix is good enough is judged by the probability that foreign ground would have matched as well,
# because the meaning of a correlation differs between grounds. A fix must be better to take over than to stay, and
# after the last good fix it is propagated for a while before GNSS/INS takes over again. The pose jumps where the
# sources differ: the drifting frame handles that, as for any other estimate.

_HYSTERESIS = 0.01
"""To take over, a match needs a hundredth of the false-match probability required to stay. At a risk of 1e-4 two
decades are about one standard deviation of a normal noise floor: its tail falls there by 1.9 decades each, by 2.3 where
the match is the best of some hundred places."""


class SwitchSettings(NamedTuple):
    """Thresholds of the switch, and the place of the array. Scalars.

    Attributes:
        enter_p_false: probability of a false match up to which a fix lets LGPR take over.
        stay_p_false: up to which a fix is good enough once LGPR is used; at least ``enter_p_false``.
        hold_s: time for which the pose is propagated after the last good fix.
        zero_slip_m: from the rear axle forward to the point that moves along the body axis.
        array_x_m, array_y_m: the array's centre in the body, forward and left of the rear axle.
    """

    enter_p_false: Float[Array, "..."]
    stay_p_false: Float[Array, "..."]
    hold_s: Float[Array, "..."]
    zero_slip_m: Float[Array, "..."]
    array_x_m: Float[Array, "..."]
    array_y_m: Float[Array, "..."]


class SwitchState(NamedTuple):
    """State carried from tick to tick; ``pose`` is the result.

    Attributes:
        pose: of the rear axle in the map's frame: the propagated one on LGPR, else that of GNSS/INS.
        on_lgpr: LGPR is used.
        carried: the last good fix, dead reckoned to now; undefined while LGPR is not used.
        since_good_s: since that fix arrived; infinite before the first.
    """

    pose: VehiclePose
    on_lgpr: Bool[Array, "..."]
    carried: VehiclePose
    since_good_s: Float[Array, "..."]


def switch_settings(
    risk: float, *, zero_slip_m: Float[Array, "..."], array_x_m: Float[Array, "..."], array_y_m: Float[Array, "..."]
) -> SwitchSettings:
    """The switch at the risk of a fix; the last good one is carried for a second. Geometry: see ``SwitchSettings``."""
    enter, stay, hold = (jnp.float32(value) for value in (_HYSTERESIS * risk, risk, 1.0))
    return SwitchSettings(enter, stay, hold, zero_slip_m, array_x_m, array_y_m)


def init_switch(gnss_ins_pose: VehiclePose) -> SwitchState:
    """On GNSS/INS, before the first fix."""
    off = jnp.zeros(jnp.shape(gnss_ins_pose.x_m), bool)
    return SwitchState(gnss_ins_pose, off, gnss_ins_pose, jnp.where(off, 0.0, jnp.inf).astype(jnp.float32))


def step_switch(
    settings: SwitchSettings,
    state: SwitchState,
    motion: MotionInput,
    speed_mps: Float[Array, "..."],
    gnss_ins_pose: VehiclePose,
    lgpr: LgprObservation,
    p_false: Float[Array, "..."],
) -> SwitchState:
    """The state after a tick.

    Args:
        settings: thresholds and geometry.
        state: before the tick.
        motion: yaw rate and length of the tick.
        speed_mps: forward, by the odometer.
        gnss_ins_pose: of the rear axle at the tick's end, from GNSS/INS.
        lgpr: the tick's fix of the array's centre, if there is one; brought forward by its age.
        p_false: probability that foreign ground would have matched as well as the fix; with NaN, no fix is good enough.
    """
    rate, slip = motion.yaw_rate_radps, settings.zero_slip_m
    carried = step_local(state.carried, speed_mps, rate, slip, motion.step_s)
    cos, sin = jnp.cos(lgpr.yaw_rad), jnp.sin(lgpr.yaw_rad)
    seen = VehiclePose(
        lgpr.x_m - cos * settings.array_x_m + sin * settings.array_y_m,
        lgpr.y_m - sin * settings.array_x_m - cos * settings.array_y_m,
        lgpr.yaw_rad,
    )
    now = step_local(seen, speed_mps, rate, slip, lgpr.age_s)
    required = jnp.where(state.on_lgpr, settings.stay_p_false, settings.enter_p_false)
    good = lgpr.valid & (p_false <= required) & jnp.isfinite(now.x_m + now.y_m + now.yaw_rad)
    carried = VehiclePose(*(jnp.where(good, new, old) for new, old in zip(now, carried, strict=True)))
    since_s = jnp.where(good, lgpr.age_s, state.since_good_s + motion.step_s)
    # Off LGPR only a fix that is good enough to take over leads back to it.
    on_lgpr = good | (state.on_lgpr & (since_s <= settings.hold_s))
    pose = VehiclePose(*(jnp.where(on_lgpr, ours, other) for ours, other in zip(carried, gnss_ins_pose, strict=True)))
    return SwitchState(pose, on_lgpr, carried, since_s)
