"""What GNSS and INS would observe if the estimate of a skid-steer vehicle were right, and what of it is usable."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.arc_reach import reach, turned
from lgprjax.navigation.kalman import Innovation, innovation_of, usable
from lgprjax.navigation.observations import GnssObservation
from lgprjax.navigation.skid_model import DRIFT, SLIP_AHEAD, SLOW_X, SLOW_Y, TURNED, YAW, SkidEstimate, SkidModel, X, Y
from lgprjax.navigation.skid_motion import skid_rates
from lgprjax.navigation.skid_observations import DeltaHeading, SkidMotion

LEAST_FIX_VARIANCE = 1e-6
"""No fix is better than a millimetre, whatever it reports."""


class InsEpoch(NamedTuple):
    """The end of the last delta heading, from which the next one counts.

    Attributes:
        since_s: how long ago it was.
        yaw_rate_radps: of the body then.
    """

    since_s: Float[Array, "..."]
    yaw_rate_radps: Float[Array, "..."]


class Heard(NamedTuple):
    """What a tick's delta heading is good for.

    Attributes:
        usable: it counts from the last one that was heard, and is a turn that the vehicle can make.
        ends: a span ends here, used or not, and the next one counts from it.
        late_s: the tick's end after the span's.
    """

    usable: Bool[Array, "..."]
    ends: Bool[Array, "..."]
    late_s: Float[Array, "..."]


def antenna_reach(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion, age_s: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The antenna a while before the tick's end, forward and left of where the midpoint stands at the end."""
    speed_mps, yaw_rate_radps = skid_rates(model, estimate, motion)
    ahead = estimate.mean[SLIP_AHEAD]
    return reach(-age_s * speed_mps, -age_s * yaw_rate_radps, ahead, model.gnss_x_m, model.gnss_y_m).at_m


def fix_innovation(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion, fix: GnssObservation, offered: Bool[Array, ""]
) -> Innovation:
    """Of the antenna's position: of the variance that a fix reports a share is slow, the rest is white.

    Args:
        model, estimate, motion: at the tick's end.
        fix: may hold anything where it is not offered.
        offered: whether it is usable.
    """
    slow_x, slow_y = (jnp.sqrt(model.gnss_slow_share * _variance(fix, axis, offered)) for axis in (0, 1))
    at = antenna_reach(model, estimate, motion, jnp.where(offered, fix.age_s, 0.0))
    mean = estimate.mean
    x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), at)
    one = jnp.float32(1.0)
    rows = ({X: one, YAW: -y, SLOW_X: slow_x}, {Y: one, YAW: x, SLOW_Y: slow_y})
    expected = jnp.stack([mean[X] + x + slow_x * mean[SLOW_X], mean[Y] + y + slow_y * mean[SLOW_Y]])
    least = LEAST_FIX_VARIANCE * jnp.eye(2, dtype=mean.dtype)
    white = (1.0 - model.gnss_slow_share) * fix.covariance + least
    return innovation_of(jnp.stack([fix.x_m, fix.y_m]) - expected, rows, white, offered)


def turn_innovation(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion, epoch: InsEpoch, delta: DeltaHeading, heard: Heard
) -> Innovation:
    """Of the turn since the last delta heading, exact at any tick: the state ``turned`` has counted it all the way.

    Args:
        model, estimate, motion: at the tick's end.
        epoch: end of the last one.
        delta: may hold anything where it is not usable.
        heard: from ``hear``.
    """
    span = jnp.where(heard.usable, delta.span_s, 0.0)
    _, yaw_rate_radps = skid_rates(model, estimate, motion)
    expected = estimate.mean[TURNED] - heard.late_s * yaw_rate_radps + estimate.mean[DRIFT] * span
    # Where in its tick a span ends is not told: its turn is in doubt if the rate changed between two ends.
    doubt = model.ins_clock_s * (yaw_rate_radps - epoch.yaw_rate_radps)
    noise = model.ins_noise**2 * span + doubt * doubt
    row = {TURNED: jnp.float32(1.0), DRIFT: span}
    return innovation_of((delta.turn_rad - expected)[None], (row,), noise[None, None], heard.usable)


def hear(model: SkidModel, epoch: InsEpoch, motion: SkidMotion, delta: DeltaHeading) -> Heard:
    """Whether a delta heading counts from the end of the last one.

    One that is due is used. One that comes long after its span has lost another before it: the count starts anew. One
    that comes long before its span has passed is a repeat.

    Args:
        model: for the fastest turn.
        epoch: end of the last one, at the tick's end.
        motion: the tick's.
        delta: of the tick.
    """
    sound = usable(delta) & (delta.span_s > 0.0)
    span = jnp.where(sound, delta.span_s, 1.0)
    late = epoch.since_s - span
    possible = jnp.abs(delta.turn_rad) <= model.fastest_turn_radps * span
    # One that comes half a span early is a repeat; half a span late, where a tick is as long, it is still due.
    early = late < -jnp.minimum(1.5 * motion.step_s, 0.4 * span)
    due = ~early & (late <= jnp.minimum(1.5 * motion.step_s, 0.6 * span))
    ends = sound & ~early
    return Heard(sound & due & possible, ends, jnp.where(due, jnp.clip(late, 0.0, motion.step_s), 0.0))


def fix_usable(model: SkidModel, fix: GnssObservation, newest_s: Float[Array, ""]) -> Bool[Array, ""]:
    """Finite, with an error that can be, neither too old nor from the future, and newer than the newest so far.

    Args:
        model: for the oldest fix.
        fix: of the tick.
        newest_s: how long before the tick's end the newest fix so far was taken.
    """
    # Two numbers that differ by rounding are the same moment.
    timely = (fix.age_s >= 0.0) & (fix.age_s <= model.oldest_fix_s) & (fix.age_s < newest_s - 0.001)
    xx, xy, yy = fix.covariance[0, 0], fix.covariance[0, 1], fix.covariance[1, 1]
    return usable(fix) & timely & (xx >= 0.0) & (yy >= 0.0) & (xx * yy >= xy * xy)


def fix_variance(fix: GnssObservation, offered: Bool[Array, ""]) -> Float[Array, ""]:
    """Variance of an axis that a fix reports, the mean of both; zero where it is not offered."""
    return 0.5 * (_variance(fix, 0, offered) + _variance(fix, 1, offered))


def _variance(fix: GnssObservation, axis: int, offered: Bool[Array, ""]) -> Float[Array, ""]:
    return jnp.where(offered, fix.covariance[axis, axis], 0.0)
