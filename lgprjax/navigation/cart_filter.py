"""The filter of a cart with GNSS alone: no wheel speeds, no INS (the hand cart of MF section 4).

| state | how it moves |
| --- | --- |
| x, y, yaw of the reference point | along an arc of the present speed and curvature |
| speed | random walk, the quicker the larger |
| curvature | Gauss-Markov over the way: a line at 0.1 m/s bends as it does at 0.5 m/s |
| slow GNSS error x, y | Gauss-Markov over time, in sigmas of what the fix reports |

The heading is the course, so it is known only while the cart surely moves forward. Fixes cannot tell a cart that is
turned on the spot, nor one that is pushed backwards: as soon as it may stand the heading is given up, and started anew
on the next straight way. A record is made afterwards, from both ends of each way (``smooth_cart``); live, some seconds
late (``cart_live``).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation import kalman
from lgprjax.navigation.kalman import Innovation, reach, turned, wrap_yaw
from lgprjax.navigation.observations import (
    GNSS,
    NEVER_S,
    GateRules,
    GateState,
    GnssObservation,
    advance_gates,
    default_rules,
    init_gates,
    judge,
)
from lgprjax.navigation.skid_filter import LEAST_FIX_VARIANCE, fix_variance, other_receiver
from lgprjax.navigation.skid_model import UNKNOWN_YAW_VARIANCE

CART_STATES = ("x_m", "y_m", "yaw_rad", "speed_mps", "curvature_radpm", "slow_error_x", "slow_error_y")
"""Names of the states, in order."""
X, Y, YAW, SPEED, CURVATURE, SLOW_X, SLOW_Y = range(7)

PAIRS = 4
"""Number of courses in the history of the heading start; twice as many fixes are kept."""
_STRAIGHT_RADPM = 0.05
"""Curvature of a way on which the courses of pairs 0.5 m apart differ by 1.5° RMS."""
_PACE_SHARE = 0.2
_MOST_BEND = 3.0
"""Largest turn since the middle of the history, in RMS of its courses: on an arc they are 0.56 of the curvature a pair
apart, and the end is 3.5 half pairs of way on."""


class CartModel(NamedTuple):
    """Geometry and noises. Every field is a float32 scalar that may be traced and tuned.

    Attributes:
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the reference point.
        speed_noise, speed_share: random walk of the speed, m/s/√s: a least one, and that as a share of the speed.
        curvature_sigma_radpm, curvature_m: standard deviation and correlation length of the way's curvature.
        yaw_noise, side_noise, along_noise: random walk of yaw and position with the way, rad/√m and m/√m.
        slip_ahead_m: standard deviation of where ahead of the reference point the body does not move aside: little for
            an axle's middle, a tenth of a metre for tracks.
        standing_sigmas: a speed of no more than so many of its sigmas may be none.
        silent_s: without a fix for longer, the cart may have stood, and been turned, unseen.
        notice_s: within such a time a stop is noticed; afterwards no heading is used that was given up within it.
        gnss_slow_share, gnss_slow_s, gnss_scale, oldest_fix_s: see ``SkidModel``.
        initial_position_m, initial_speed_mps: standard deviations at the start; the heading is unknown then.
        start_pair_m, start_rms_rad: least way between two fixes of the heading start, and the largest RMS of its
            courses (MF: 0.5 m, 1.5°).
        lost_yaw_rad: standard deviation of the heading from which on it counts as unknown.
    """

    gnss_x_m: Float[Array, "..."]
    gnss_y_m: Float[Array, "..."]
    speed_noise: Float[Array, "..."]
    speed_share: Float[Array, "..."]
    curvature_sigma_radpm: Float[Array, "..."]
    curvature_m: Float[Array, "..."]
    yaw_noise: Float[Array, "..."]
    side_noise: Float[Array, "..."]
    along_noise: Float[Array, "..."]
    slip_ahead_m: Float[Array, "..."]
    standing_sigmas: Float[Array, "..."]
    silent_s: Float[Array, "..."]
    notice_s: Float[Array, "..."]
    gnss_slow_share: Float[Array, "..."]
    gnss_slow_s: Float[Array, "..."]
    gnss_scale: Float[Array, "..."]
    oldest_fix_s: Float[Array, "..."]
    initial_position_m: Float[Array, "..."]
    initial_speed_mps: Float[Array, "..."]
    start_pair_m: Float[Array, "..."]
    start_rms_rad: Float[Array, "..."]
    lost_yaw_rad: Float[Array, "..."]


CartEstimate = kalman.Estimate
"""Of the states in the order of ``CART_STATES``."""


class CartFilterState(NamedTuple):
    """State between ticks.

    Attributes:
        estimate: at the tick's end.
        gates: of GNSS.
        known: whether the heading may be used.
        kept_m: the last fixes at least a pair's way apart, the newest last; kept_variance: that they reported, m²;
            taken: how many there are; kept_s: since the newest was taken; pace_mps: from the one before to the newest.
        fix_m, fix_s, fix_variance: the newest fix, how long before the tick's end it was taken, and what it reported.
    """

    estimate: CartEstimate
    gates: GateState
    known: Bool[Array, "..."]
    kept_m: Float[Array, "... 8 2"]
    kept_variance: Float[Array, "... 8"]
    taken: Int[Array, "..."]
    kept_s: Float[Array, "..."]
    pace_mps: Float[Array, "..."]
    fix_m: Float[Array, "... 2"]
    fix_s: Float[Array, "..."]
    fix_variance: Float[Array, "..."]


class CartInfo(NamedTuple):
    """Outcome of a tick.

    Attributes:
        heading_known: the yaw may be used; heading_started: it became known in this tick.
        nis: normalised innovation squared of the fix; zero if none was offered.
        offered, accepted, reacquired: of the fix, see ``SkidFilterInfo``.
        broken: a state was let go: nothing may be carried back across this tick.
    """

    heading_known: Bool[Array, "..."]
    heading_started: Bool[Array, "..."]
    nis: Float[Array, "..."]
    offered: Bool[Array, "..."]
    accepted: Bool[Array, "..."]
    reacquired: Bool[Array, "..."]
    broken: Bool[Array, "..."]


class SmoothedCart(NamedTuple):
    """A drive as a record may have it; a leading axis of ticks.

    Attributes:
        pose: x_m, y_m and yaw_rad at each tick's end; covariance: of them.
        known: whether they may be used.
    """

    pose: Float[Array, "... 3"]
    covariance: Float[Array, "... 3 3"]
    known: Bool[Array, "..."]


def cart_model(*, gnss_x_m: float, gnss_y_m: float, slip_ahead_m: float = 0.02) -> CartModel:
    """A cart pulled at walking pace or slower, with RTK GNSS; the noises are assumptions of usual size.

    Ways that bend with a radius of 3 m now and then (one sigma), over some 2 m; a start within a second or two; 1.5 cm
    aside in a metre; a cart that stands may have been turned by any angle within a few seconds.

    Args:
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the reference point.
        slip_ahead_m: see ``CartModel``.
    """
    one = jnp.float32
    return CartModel(
        gnss_x_m=one(gnss_x_m),
        gnss_y_m=one(gnss_y_m),
        speed_noise=one(0.03),
        speed_share=one(0.2),
        curvature_sigma_radpm=one(0.3),
        curvature_m=one(2.0),
        yaw_noise=one(0.01),
        side_noise=one(0.010),
        along_noise=one(0.010),
        slip_ahead_m=one(slip_ahead_m),
        standing_sigmas=one(2.0),
        silent_s=one(3.5),
        notice_s=one(6.0),
        gnss_slow_share=one(0.4),
        gnss_slow_s=one(60.0),
        gnss_scale=one(1.0),
        oldest_fix_s=one(1.0),
        initial_position_m=one(1.0),
        initial_speed_mps=one(0.5),
        start_pair_m=one(0.5),
        start_rms_rad=one(0.02618),
        lost_yaw_rad=one(0.35),
    )


def cart_rules() -> GateRules:
    """Gates for GNSS at 1 Hz, re-acquired after the sixth consecutive rejection: no second source can confirm."""
    rules = default_rules()
    return rules._replace(reacquire_after=rules.reacquire_after.at[GNSS].set(5), forget_s=jnp.float32(5.0))


def init_cart(model: CartModel, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> CartFilterState:
    """The filter at the start: approximate position, heading unknown."""
    zero, never = jnp.float32(0.0), jnp.float32(NEVER_S)
    sigmas = jnp.stack([
        model.initial_position_m, model.initial_position_m, jnp.sqrt(jnp.float32(UNKNOWN_YAW_VARIANCE)),
        model.initial_speed_mps, model.curvature_sigma_radpm, jnp.float32(1.0), jnp.float32(1.0),
    ])  # fmt: skip
    mean = jnp.zeros(len(CART_STATES), jnp.float32).at[X].set(x_m).at[Y].set(y_m)
    rows = 2 * PAIRS
    return CartFilterState(
        estimate=CartEstimate(mean, jnp.diag(sigmas * sigmas)),
        gates=init_gates(),
        known=jnp.asarray(False),
        kept_m=jnp.zeros((rows, 2), jnp.float32),
        kept_variance=jnp.zeros(rows, jnp.float32),
        taken=jnp.int32(0),
        kept_s=zero,
        pace_mps=zero,
        fix_m=jnp.full(2, never),
        fix_s=never,
        fix_variance=zero,
    )


def cart_pose_covariance(model: CartModel, estimate: CartEstimate) -> Float[Array, "... 3 3"]:
    """Covariance of x, y and yaw, with what the filter takes for granted: that the body points along its way.

    In a bend it points aside by the curvature times ``slip_ahead_m``. One antenna cannot tell that from a turn; a
    filter that carries it as a state believes to have learnt it.
    """
    mean = estimate.mean
    cos, sin = jnp.cos(mean[..., YAW]), jnp.sin(mean[..., YAW])
    x, y = turned(cos, sin, (model.gnss_x_m, model.gnss_y_m))
    by_slip = jnp.stack([y, -x, jnp.ones_like(x)], axis=-1) * mean[..., CURVATURE, None]
    aside = model.slip_ahead_m**2 * by_slip[..., :, None] * by_slip[..., None, :]
    return estimate.covariance[..., : YAW + 1, : YAW + 1] + aside


def step_cart(
    model: CartModel, rules: GateRules, state: CartFilterState, step_s: Float[Array, ""], fix: GnssObservation
) -> tuple[CartFilterState, CartInfo]:
    """One tick: on along the arc, then the fix if there is one. Unbatched; use ``vmap`` for more.

    Args:
        model, rules: of the filter.
        state: at the tick's start.
        step_s: length of the tick; one that is not finite and positive counts as zero.
        fix: taken within the tick, or before and late; a slot that is not valid may hold anything.
    """
    step_s = jnp.where(jnp.isfinite(step_s) & (step_s > 0.0), step_s, 0.0)
    estimate = kalman.predict(state.estimate.covariance, _transition(model, state.estimate.mean, step_s))
    gates = advance_gates(rules, state.gates, step_s)
    fix_s = state.fix_s + step_s
    place = jnp.stack([fix.x_m, fix.y_m])
    offered = _fix_usable(model, fix, fix_s) & jnp.any(place != state.fix_m)
    variance = fix_variance(fix, offered)
    other = offered & other_receiver(variance, state.fix_variance)

    kept, takes = _keep(model, state, place, variance, offered, jnp.where(offered, fix.age_s, 0.0), step_s)
    yaw, yaw_variance, ready = _course(model, kept)
    starts = takes & ready & ~state.known
    known = state.known | starts
    zero, one = jnp.float32(0.0), jnp.float32(1.0)
    # With the heading goes what was estimated through it: speed and curvature.
    mean = estimate.mean
    lost = {YAW: zero, SPEED: jnp.abs(mean[SPEED]) - mean[SPEED], CURVATURE: -mean[CURVATURE]}
    spread = {
        YAW: jnp.float32(UNKNOWN_YAW_VARIANCE),
        SPEED: model.initial_speed_mps**2,
        CURVATURE: model.curvature_sigma_radpm**2,
    }
    estimate = kalman.reopen(estimate, lost, spread, offered & ~known)
    mean = estimate.mean
    turn = {YAW: wrap_yaw(yaw - mean[YAW]), SPEED: kept.pace_mps - mean[SPEED], CURVATURE: -mean[CURVATURE]}
    straight = {
        YAW: yaw_variance,
        SPEED: (_PACE_SHARE * kept.pace_mps) ** 2 + model.speed_noise**2,
        CURVATURE: jnp.float32(_STRAIGHT_RADPM**2),
    }
    estimate = kalman.wrapped(kalman.reopen(estimate, turn, straight, starts))
    slow = {SLOW_X: -estimate.mean[SLOW_X], SLOW_Y: -estimate.mean[SLOW_Y]}
    estimate = kalman.reopen(estimate, slow, {SLOW_X: one, SLOW_Y: one}, other)

    innovation = _fix_innovation(model, estimate, fix, offered)
    free = ~known | starts
    nis = jnp.where(free, 0.0, kalman.weigh(estimate, innovation).nis)
    seen = jnp.where(offered, place, 0.0)
    verdict, gates = judge(rules, gates, GNSS, offered, nis, seen, seen - innovation.residual)
    moves = {X: innovation.residual[0], Y: innovation.residual[1]}
    variances = {X: one + 100.0 * innovation.noise[0, 0], Y: one + 100.0 * innovation.noise[1, 1]}
    opened = verdict.reacquired | (offered & free)
    estimate = kalman.reopen(estimate, moves, variances, opened)
    again = _fix_innovation(model, estimate, fix, offered)
    estimate = kalman.wrapped(kalman.correct(estimate, again, kalman.weigh(estimate, again), verdict.accepted))
    mean, covariance = estimate

    # Written so that what is no number counts as neither known nor moving.
    moves_on = mean[SPEED] > model.standing_sigmas * jnp.sqrt(covariance[SPEED, SPEED])
    held = known & (covariance[YAW, YAW] <= model.lost_yaw_rad**2) & (moves_on | ~offered)
    held = held & (gates.since_accepted_s[GNSS] <= model.silent_s)
    stopped = known & ~held
    after = kept._replace(
        estimate=estimate,
        gates=gates,
        known=held,
        taken=jnp.where(stopped, 0, kept.taken),
        fix_m=jnp.where(offered, place, state.fix_m),
        fix_s=jnp.where(offered, fix.age_s, fix_s),
        fix_variance=jnp.where(offered, variance, state.fix_variance),
    )
    broken = opened | starts | other | ~held
    return after, CartInfo(
        heading_known=held,
        heading_started=starts & held,
        nis=nis,
        offered=offered,
        accepted=verdict.accepted,
        reacquired=verdict.reacquired,
        broken=broken,
    )


def smooth_cart(
    model: CartModel, rules: GateRules, step_s: float | Float[Array, ""], fixes: GnssObservation
) -> SmoothedCart:
    """A drive smoothed from both its ends; unbatched, use ``vmap`` for more.

    Each heading start needs some metres of straight way before it knows. In a log they are there twice: the drive is
    gone through forward in time and backward, each pass smoothed (Rauch et al. 1965) as far as it knows its heading,
    and where the one does not know, the other may. Neither is used within ``notice_s`` before it gave its heading up.

    Args:
        model, rules: of the filter.
        step_s: length of every tick.
        fixes: of each tick, taken within it.
    """
    tick_s = jnp.asarray(step_s, jnp.float32)
    ahead = _one_way(model, rules, tick_s, fixes)
    flipped = jax.tree.map(lambda leaf: jnp.flip(leaf, axis=0), fixes)
    mirrored = model._replace(gnss_x_m=-model.gnss_x_m, gnss_y_m=-model.gnss_y_m)
    behind = _one_way(mirrored, rules, tick_s, flipped._replace(age_s=tick_s - flipped.age_s))
    # Backward in time the cart goes tail first, and a tick ends where it began.
    back: SmoothedCart = jax.tree.map(lambda leaf: jnp.roll(jnp.flip(leaf, axis=0), -1, axis=0), behind)
    yaw = wrap_yaw(back.pose[:, YAW] + jnp.pi)
    back = SmoothedCart(back.pose.at[:, YAW].set(yaw), back.covariance, back.known.at[-1].set(False))
    first = ahead.known[:, None]
    return SmoothedCart(
        jnp.where(first, ahead.pose, back.pose),
        jnp.where(first[..., None], ahead.covariance, back.covariance),
        ahead.known | back.known,
    )


def _one_way(model: CartModel, rules: GateRules, step_s: Float[Array, ""], fixes: GnssObservation) -> SmoothedCart:
    """A pass through a drive, smoothed."""

    def forward(state: CartFilterState, fix: GnssObservation) -> tuple[CartFilterState, tuple[CartEstimate, CartInfo]]:
        after, info = step_cart(model, rules, state, step_s, fix)
        return after, (after.estimate, info)

    first = jnp.argmax(fixes.valid)
    start = init_cart(model, jnp.nan_to_num(fixes.x_m[first]), jnp.nan_to_num(fixes.y_m[first]))
    filtered, info = jax.lax.scan(forward, start, fixes)[1]

    def back(later: CartEstimate, before: CartEstimate, broken: Bool[Array, ""]) -> CartEstimate:
        return step_back_cart(model, later, before, step_s, broken)

    smoothed = kalman.smooth(filtered, back, (info.broken,))

    def since(left_s: Float[Array, ""], known: Array) -> tuple[Float[Array, ""], Float[Array, ""]]:
        left_s = jnp.where(known, left_s + step_s, 0.0)
        return left_s, left_s

    stays_s = jax.lax.scan(since, jnp.float32(0.0), info.heading_known, reverse=True)[1]
    return SmoothedCart(smoothed.mean[:, : YAW + 1], cart_pose_covariance(model, smoothed), stays_s > model.notice_s)


def _transition(model: CartModel, mean: Float[Array, " 7"], step_s: Float[Array, ""]) -> kalman.Transition:
    """A tick at the states before it."""
    # The way sets noises and how far the curvature fades; for the derivatives it is no function of the states.
    way = jnp.abs(mean[SPEED]) * step_s
    ages = jnp.stack([way / model.curvature_m, *[step_s / model.gnss_slow_s] * 2])

    def move(mean: Float[Array, " 7"], noise: Float[Array, " 7"]) -> Float[Array, " 7"]:
        travel = mean[SPEED] * step_s
        turn = mean[CURVATURE] * travel
        zero = jnp.zeros_like(turn)
        ahead, left = reach(travel, turn, zero, zero, zero)
        x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), (ahead + noise[0], left + noise[1]))
        moved = jnp.stack([mean[X] + x, mean[Y] + y, wrap_yaw(mean[YAW] + turn + noise[2]), mean[SPEED] + noise[3]])
        return jnp.concatenate([moved, mean[CURVATURE:] * jnp.exp(-ages) + noise[4:]])

    by_way = jnp.stack([model.along_noise, model.side_noise, model.yaw_noise]) * jnp.sqrt(way)
    surges = (model.speed_noise + model.speed_share * jnp.abs(mean[SPEED])) * jnp.sqrt(step_s)
    fresh = jnp.sqrt(-jnp.expm1(-2.0 * ages)).at[0].multiply(model.curvature_sigma_radpm)
    return kalman.linearise(move, mean, jnp.concatenate([by_way, surges[None], fresh]))


def step_back_cart(
    model: CartModel, later: CartEstimate, before: CartEstimate, step_s: Float[Array, ""], broken: Bool[Array, ""]
) -> CartEstimate:
    """The smoothed estimate a tick before ``later``; across a broken tick that is ``before`` itself.

    Args:
        model: of the filter.
        later: smoothed, at the tick's end.
        before: filtered, at its start.
        step_s: its length.
        broken: see ``CartInfo``.
    """
    return kalman.wrapped(kalman.step_back(later, before, _transition(model, before.mean, step_s), broken))


def _fix_usable(model: CartModel, fix: GnssObservation, newest_s: Float[Array, ""]) -> Bool[Array, ""]:
    timely = (fix.age_s >= 0.0) & (fix.age_s <= model.oldest_fix_s) & (fix.age_s < newest_s - 0.001)
    xx, xy, yy = fix.covariance[0, 0], fix.covariance[0, 1], fix.covariance[1, 1]
    return kalman.usable(fix) & timely & (xx >= 0.0) & (yy >= 0.0) & (xx * yy >= xy * xy)


def _fix_innovation(
    model: CartModel, estimate: CartEstimate, fix: GnssObservation, offered: Bool[Array, ""]
) -> Innovation:
    """Of the antenna's position, back along the arc to when it was taken."""
    scale2 = model.gnss_scale * model.gnss_scale
    slow_x, slow_y = (
        jnp.sqrt(scale2 * model.gnss_slow_share * jnp.where(offered, fix.covariance[axis, axis], 0.0))
        for axis in (0, 1)
    )
    age_s = jnp.where(offered, fix.age_s, 0.0)
    # The turn since the fix is held fixed: a late fix must not correct the curvature through the antenna's lever.
    turn = -age_s * estimate.mean[SPEED] * estimate.mean[CURVATURE]

    def expect(mean: Float[Array, " 7"]) -> Float[Array, " 2"]:
        way = reach(-age_s * mean[SPEED], turn, jnp.zeros_like(turn), model.gnss_x_m, model.gnss_y_m)
        x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), way)
        return jnp.stack([mean[X] + x + slow_x * mean[SLOW_X], mean[Y] + y + slow_y * mean[SLOW_Y]])

    least = LEAST_FIX_VARIANCE * jnp.eye(2, dtype=jnp.float32)
    white = scale2 * (1.0 - model.gnss_slow_share) * fix.covariance + least
    return kalman.innovation_of(estimate.mean, expect, jnp.stack([fix.x_m, fix.y_m]), white, offered)


def _keep(
    model: CartModel,
    state: CartFilterState,
    place_m: Float[Array, " 2"],
    variance: Float[Array, ""],
    offered: Bool[Array, ""],
    age_s: Float[Array, ""],
    step_s: Float[Array, ""],
) -> tuple[CartFilterState, Bool[Array, ""]]:
    """The history of the heading start with a fix far enough from the last one."""
    since_s = state.kept_s + step_s
    apart_m = jnp.hypot(*(place_m - state.kept_m[-1]))
    takes = offered & ((state.taken == 0) | (apart_m >= model.start_pair_m))
    # A gap in the way: what lay between may have been a turn.
    far = takes & (apart_m > 3.0 * model.start_pair_m)
    taken = jnp.where(takes, jnp.minimum(jnp.where(far, 0, state.taken) + 1, 2 * PAIRS), state.taken)
    kept_m = jnp.where(takes, jnp.concatenate([state.kept_m[1:], place_m[None]]), state.kept_m)
    kept_variance = jnp.where(takes, jnp.append(state.kept_variance[1:], variance), state.kept_variance)
    pace_mps = jnp.where(takes, apart_m / jnp.maximum(since_s - age_s, 0.1), state.pace_mps)
    held = state._replace(
        kept_m=kept_m,
        kept_variance=kept_variance,
        taken=taken,
        kept_s=jnp.where(takes, age_s, since_s),
        pace_mps=pace_mps,
    )
    return held, takes


def _course(model: CartModel, kept: CartFilterState) -> tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]]:
    """Mean course of the pairs of fixes, its variance as a heading now, and whether the way was straight (MF)."""
    ways = kept.kept_m[PAIRS:] - kept.kept_m[:PAIRS]
    total = ways.sum(axis=0)
    nowhere = jnp.all(total == 0.0)
    course = jnp.arctan2(total[1], jnp.where(nowhere, 1.0, total[0]))
    lengths = jnp.maximum(jnp.hypot(ways[:, 0], ways[:, 1]), model.start_pair_m)
    cross = jnp.cos(course) * ways[:, 1] - jnp.sin(course) * ways[:, 0]
    ahead = jnp.cos(course) * ways[:, 0] + jnp.sin(course) * ways[:, 1]
    rms = jnp.sqrt(jnp.mean(jnp.arctan2(cross, jnp.where((ahead == 0.0) & (cross == 0.0), 1.0, ahead)) ** 2))
    base_m = lengths.mean()
    white = 2.0 * model.gnss_scale**2 * kept.kept_variance.mean() / PAIRS
    aside = model.side_noise**2 * base_m
    variance = (white + aside) / (base_m * base_m) + (_MOST_BEND * rms) ** 2
    ready = (kept.taken >= 2 * PAIRS) & (rms <= model.start_rms_rad) & jnp.all(ahead > 0.0)
    return course, variance, ready
