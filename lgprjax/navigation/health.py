"""Health of the navigation: from what each source gave this tick to one of three reactions, and why.

Nothing is switched here. A filter leaves out what its gates reject; health says whether what remains is enough to
drive on. A stop is asked for as long as its reason lasts: that a vehicle which was stopped does not set off by itself
is for the mode machine to see to.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.navigation.filter import FilterInfo, FilterState
from lgprjax.navigation.filter_model import SPEED, position_sigma_m
from lgprjax.navigation.health_rules import HealthRules, health_rules
from lgprjax.navigation.observations import GNSS, HEADING, LGPR, ODOMETER, Observations
from lgprjax.navigation.reaction import STOPPING, Reaction, Reason

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
    """What is carried from tick to tick.

    Attributes:
        gnss_x_m, gnss_y_m: last GNSS position.
        stuck_m: way driven since it changed.
        unproven, scans: scans without evidence of the map's ground, and all, in each tenth of the sliding share, the
            newest first.
        bin_s: since the newest tenth began.
        held_s: how long each reason, in the order of its bits, is still to be reported.
    """

    gnss_x_m: Float[Array, ""]
    gnss_y_m: Float[Array, ""]
    stuck_m: Float[Array, ""]
    unproven: Float[Array, "10"]
    scans: Float[Array, "10"]
    bin_s: Float[Array, ""]
    held_s: Float[Array, "23"]


class Health(NamedTuple):
    """What is asked of the vehicle.

    Attributes:
        reaction: a ``Reaction``.
        reasons: bits of ``Reason``.
        speed_cap_mps: infinite, the degraded speed, or 0 for a stop.
    """

    reaction: Int32[Array, ""]
    reasons: Int32[Array, ""]
    speed_cap_mps: Float[Array, ""]


def init_health() -> HealthState:
    """Before the first tick."""
    zero, bins = jnp.float32(0.0), jnp.zeros(_BINS, jnp.float32)
    unknown = jnp.float32(jnp.nan)
    return HealthState(unknown, unknown, zero, bins, bins, zero, jnp.zeros(len(Reason), jnp.float32))


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
    """Health after a tick; one lane, more by ``vmap``.

    Args:
        rules: limits.
        state: before the tick.
        filter_state, filter_info: of ``step_filter``, after the same tick.
        observations: of the tick.
        lgpr_p_false: probability that ground which is not the map's would have matched the tick's scan as well, whether
            the match became a fix or not; NaN where none was matched.
        frame_left_m: what ``slew_frame`` left.
        step_s: length of the tick.
    """
    sound_step = (step_s > 0.0) & (step_s <= rules.longest_step_s)
    passed_s = jnp.where(sound_step, step_s, 0.0)
    state = _listened(rules, state, filter_state, filter_info, observations, lgpr_p_false, passed_s)
    seen = _seen(rules, state, filter_state, filter_info, observations, frame_left_m, sound_step)
    held_s = jnp.where(seen, rules.hold_s, jnp.maximum(state.held_s - passed_s, 0.0))
    told = seen | (held_s > 0.0)
    bits = jnp.asarray([reason.value for reason in Reason], jnp.int32)
    reasons = jnp.sum(jnp.where(told, bits, 0), dtype=jnp.int32)
    stops = (reasons & jnp.int32(STOPPING.value)) != 0
    reaction = jnp.where(stops, Reaction.STOP.value, jnp.where(reasons != 0, Reaction.DEGRADE.value, 0))
    cap = jnp.where(stops, 0.0, jnp.where(reasons != 0, rules.degraded_mps, jnp.inf)).astype(jnp.float32)
    return state._replace(held_s=held_s), Health(reaction.astype(jnp.int32), reasons, cap)


def _listened(
    rules: HealthRules,
    state: HealthState,
    filter_state: FilterState,
    filter_info: FilterInfo,
    observations: Observations,
    lgpr_p_false: Float[Array, ""],
    passed_s: Float[Array, ""],
) -> HealthState:
    """The unchanged position and the sliding share, brought to this tick."""
    gnss = observations.gnss
    changed = filter_info.offered[GNSS] & ((gnss.x_m != state.gnss_x_m) | (gnss.y_m != state.gnss_y_m))
    # A receiver that is silent is not stuck: its own rule tells that.
    heard = filter_state.gates.since_offered_s[GNSS] <= rules.silent_s[GNSS]
    moved_m = jnp.where(heard, jnp.abs(filter_state.estimate.mean[SPEED]) * passed_s, 0.0)
    full = state.bin_s + passed_s >= rules.fading_s / _BINS
    matched = ~jnp.isnan(lgpr_p_false)
    return state._replace(
        gnss_x_m=jnp.where(changed, gnss.x_m, state.gnss_x_m),
        gnss_y_m=jnp.where(changed, gnss.y_m, state.gnss_y_m),
        stuck_m=jnp.where(changed, 0.0, state.stuck_m + moved_m),
        unproven=_pushed(state.unproven, jnp.where(lgpr_p_false > rules.risk, 1.0, 0.0), full),
        scans=_pushed(state.scans, jnp.where(matched, 1.0, 0.0), full),
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
) -> Bool[Array, "23"]:
    """Reasons that this tick gives, in the order of their bits."""
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
    faded = state.unproven.sum() > rules.faded_share * state.scans.sum()
    no_heading = (silent[HEADING] | rejected[HEADING]) & lost[HEADING]
    speed_variance = estimate.covariance[SPEED, SPEED]
    seen = {
        Reason.NON_FINITE: ~finite,
        Reason.BAD_STEP: ~sound_step,
        Reason.GNSS_SILENT: silent[GNSS],
        Reason.GNSS_STUCK: state.stuck_m > rules.stuck_m,
        Reason.GNSS_COARSE: coarse,
        Reason.GNSS_REJECTED: rejected[GNSS],
        Reason.HEADING_SILENT: silent[HEADING],
        Reason.HEADING_REJECTED: rejected[HEADING],
        Reason.ODOMETER_SILENT: silent[ODOMETER],
        Reason.ODOMETER_REJECTED: rejected[ODOMETER],
        Reason.LGPR_SILENT: silent[LGPR],
        Reason.LGPR_REJECTED: rejected[LGPR],
        Reason.LGPR_FADED: faded,
        Reason.CONFLICT: gates.conflict_s > 0.0,
        Reason.REACQUIRED: filter_info.reacquired.any(),
        Reason.FRAME_BEHIND: frame_left_m > rules.degrade_frame_m,
        Reason.UNCERTAIN: cross_m > rules.degrade_cross_m,
        Reason.POSITION_LOST: lost[GNSS] & lost[LGPR],
        Reason.HEADING_LOST: no_heading & lost[LGPR],
        Reason.SPEED_LOST: speed_variance > rules.stop_speed_mps * rules.stop_speed_mps,
        Reason.CONFLICT_LASTS: gates.conflict_s > rules.conflict_stop_s,
        Reason.FRAME_FAR: frame_left_m > rules.stop_frame_m,
        Reason.TOO_UNCERTAIN: cross_m > rules.stop_cross_m,
    }
    return jnp.stack([seen[reason] for reason in Reason])


def _pushed(bins: Float[Array, "10"], value: Float[Array, ""], full: Bool[Array, ""]) -> Float[Array, "10"]:
    """A value added to the newest bin, after a new one was begun if the last is full."""
    begun = jnp.concatenate([jnp.zeros(1, jnp.float32), bins[:-1]])
    bins = jnp.where(full, begun, bins)
    return bins.at[0].add(value)
