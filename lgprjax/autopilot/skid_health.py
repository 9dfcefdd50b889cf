"""Health of a skid-steer vehicle's navigation: one of three reactions, and why. See ``navigation/health``.

GNSS that is gone is no reason to stop: wheels and INS carry the pose on, and its own uncertainty says when that has to
end.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from lgprjax.navigation.gates import GateState
from lgprjax.navigation.observations import GNSS, HEADING
from lgprjax.navigation.reaction import STOPPING, Reaction, Reason
from lgprjax.navigation.skid_filter import SkidFilterInfo
from lgprjax.navigation.skid_model import SkidEstimate, X, Y


class SkidHealthRules(NamedTuple):
    """Limits, float32 scalars.

    Attributes:
        gnss_silent_s, heading_silent_s: without an observation for longer, the source is silent.
        degrade_sigma_m, stop_sigma_m: standard deviation of the position, larger axis, that degrades, and that stops.
        longest_step_s: longest tick that the clock may report.
        degraded_mps: speed cap while degraded.
    """

    gnss_silent_s: Float[Array, "..."]
    heading_silent_s: Float[Array, "..."]
    degrade_sigma_m: Float[Array, "..."]
    stop_sigma_m: Float[Array, "..."]
    longest_step_s: Float[Array, "..."]
    degraded_mps: Float[Array, "..."]


class SkidHealth(NamedTuple):
    """What is asked of the vehicle.

    Attributes:
        reaction: a ``Reaction``.
        reasons: bits of ``Reason``.
        speed_cap_mps: infinite, the degraded speed, or 0 for a stop.
        sigma_m: standard deviation of the position, larger axis.
    """

    reaction: Int32[Array, ""]
    reasons: Int32[Array, ""]
    speed_cap_mps: Float[Array, ""]
    sigma_m: Float[Array, ""]


def default_skid_health() -> SkidHealthRules:
    """For GNSS at 1 Hz and an INS at 10 Hz; the stop is the 0.3 m of dead reckoning that the fault list allows."""
    return SkidHealthRules(*(jnp.float32(value) for value in (1.5, 0.5, 0.15, 0.3, 0.2, 0.3)))


def judge_skid_health(
    rules: SkidHealthRules,
    estimate: SkidEstimate,
    gates: GateState,
    info: SkidFilterInfo,
    step_s: Float[Array, ""],
) -> SkidHealth:
    """Health after a tick; one lane, more by ``vmap``.

    Args:
        rules: limits.
        estimate, gates, info: of the filter, after the same tick.
        step_s: length of the tick.
    """
    finite = jnp.isfinite(estimate.mean).all() & jnp.isfinite(estimate.covariance).all()
    sigma_m = position_sigma(estimate)
    seen = {
        Reason.NON_FINITE: ~finite,
        Reason.BAD_STEP: ~((step_s > 0.0) & (step_s <= rules.longest_step_s)),
        Reason.GNSS_SILENT: gates.since_offered_s[GNSS] > rules.gnss_silent_s,
        Reason.GNSS_REJECTED: gates.rejects[GNSS] > 0,
        Reason.HEADING_SILENT: gates.since_offered_s[HEADING] > rules.heading_silent_s,
        Reason.HEADING_REJECTED: gates.rejects[HEADING] > 1,
        Reason.UNCERTAIN: sigma_m > rules.degrade_sigma_m,
        Reason.HEADING_LOST: ~info.heading_known,
        # Written so that a sigma that is no number stops.
        Reason.TOO_UNCERTAIN: ~(sigma_m <= rules.stop_sigma_m),
    }
    reasons = jnp.int32(0)
    for reason, holds in seen.items():
        reasons = reasons | jnp.where(holds, jnp.int32(reason.value), jnp.int32(0))
    stops = (reasons & jnp.int32(STOPPING.value)) != 0
    some = reasons != 0
    reaction = jnp.where(stops, Reaction.STOP.value, jnp.where(some, Reaction.DEGRADE.value, Reaction.CONTINUE.value))
    cap = jnp.where(stops, 0.0, jnp.where(some, rules.degraded_mps, jnp.inf)).astype(jnp.float32)
    return SkidHealth(reaction.astype(jnp.int32), reasons, cap, sigma_m)


def position_sigma(estimate: SkidEstimate) -> Float[Array, ""]:
    """Standard deviation of the position along its larger axis, m."""
    covariance = estimate.covariance
    xx, xy, yy = covariance[X, X], covariance[X, Y], covariance[Y, Y]
    return jnp.sqrt(0.5 * (xx + yy) + jnp.hypot(0.5 * (xx - yy), xy))
