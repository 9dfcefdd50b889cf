"""Limits of the navigation's health."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int32


class HealthRules(NamedTuple):
    """Limits; scalars, or one value a source in the order of ``SOURCES``.

    Attributes:
        silent_s: without an observation for longer, a source is silent; infinite for one that the vehicle lacks.
        lost_s: without an accepted observation for longer, a source does not count as one that bounds the error.
        rejects: rejected so many times in a row, a source is reported as such.
        coarse_m: standard deviation, larger axis, above which GNSS is coarse.
        stuck_m: way driven under one unchanged GNSS position.
        risk: probability of a false match up to which a scan is evidence of the map's ground; that of a fix.
        faded_share: share of the scans of ``fading_s`` without such evidence above which the ground has faded.
        fading_s: length of that sliding share.
        conflict_stop_s: a conflict between GNSS and LGPR that lasts longer asks for a stop.
        degrade_cross_m, stop_cross_m: cross-track standard deviation that degrades, and that stops.
        stop_speed_mps: standard deviation of the speed above which it is not known.
        degrade_frame_m, stop_frame_m: what the slewed path may still have to move.
        longest_step_s: longest tick that the clock may report.
        hold_s: a reason is reported for so long after it was last seen, so that the speed cap does not flicker.
        degraded_mps: speed cap while degraded.
    """

    silent_s: Float[Array, "4"]
    lost_s: Float[Array, "4"]
    rejects: Int32[Array, "4"]
    coarse_m: Float[Array, ""]
    stuck_m: Float[Array, ""]
    risk: Float[Array, ""]
    faded_share: Float[Array, ""]
    fading_s: Float[Array, ""]
    conflict_stop_s: Float[Array, ""]
    degrade_cross_m: Float[Array, ""]
    stop_cross_m: Float[Array, ""]
    stop_speed_mps: Float[Array, ""]
    degrade_frame_m: Float[Array, ""]
    stop_frame_m: Float[Array, ""]
    longest_step_s: Float[Array, ""]
    hold_s: Float[Array, ""]
    degraded_mps: Float[Array, ""]


def health_rules(
    *, gnss_period_s: float, heading_period_s: float, odometer_period_s: float, lgpr_period_s: float, risk: float
) -> HealthRules:
    """Rules for sources of given periods, in s, infinite for one that the vehicle lacks, and the risk of a fix.

    A source is silent after 1.5 periods of GNSS, 3 scans of LGPR, and after 0.2 s without heading or 0.5 s without
    odometry, though no sooner than after 1.5 of their periods. The budget of 0.3 m, cross-track, is the 1 ft of the
    Husky's requirements, less what the halt itself takes.

    The ground has faded when more scans than not give no evidence: when the typical scan no longer tells the map's
    ground from other ground. How high a correlation is says nothing of that; rain lowers it far without coming near
    the noise floor. A share near one would tell nothing before LGPR is silent, and stretches without a fix that good
    ground has too, a scan in ten, stay well below a half.
    """
    gnss, lgpr = 1.5 * gnss_period_s, 3.0 * lgpr_period_s
    heading, odometer = max(0.2, 1.5 * heading_period_s), max(0.5, 1.5 * odometer_period_s)
    one = jnp.float32
    return HealthRules(
        silent_s=jnp.asarray([gnss, heading, odometer, lgpr], jnp.float32),
        lost_s=jnp.asarray([max(0.5, 2.5 * gnss_period_s), heading, odometer, max(0.5, lgpr)], jnp.float32),
        rejects=jnp.asarray([1, 2, 3, 2], jnp.int32),
        coarse_m=one(0.1),
        stuck_m=one(0.5),
        risk=one(risk),
        faded_share=one(0.5),
        fading_s=one(2.0),
        conflict_stop_s=one(10.0),
        degrade_cross_m=one(0.15),
        stop_cross_m=one(0.25),
        stop_speed_mps=one(0.5),
        degrade_frame_m=one(0.3),
        stop_frame_m=one(1.0),
        longest_step_s=one(0.2),
        hold_s=one(1.0),
        degraded_mps=one(2.0),
    )
