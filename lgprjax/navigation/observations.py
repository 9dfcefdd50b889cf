"""Inputs of the filter in a tick, and the gates that an observation must pass.

A slot that is not valid may hold anything, NaN too. An age counts back from the tick's end to the moment of measuring.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

SOURCES = ("gnss", "heading", "odometer", "lgpr")
"""Sources in the order in which a tick takes them, and in which every array over sources counts."""
GNSS, HEADING, ODOMETER, LGPR = range(4)


class MotionInput(NamedTuple):
    """Motion input of a tick.

    Attributes:
        yaw_rate_radps: measured by the gyro, bias included; the mean over the tick.
        step_s: length of the tick.
    """

    yaw_rate_radps: Float[Array, "..."]
    step_s: Float[Array, "..."]


class GnssObservation(NamedTuple):
    """Position of the antenna in the map's frame, including the GNSS error.

    Attributes:
        x_m, y_m: position.
        covariance: of its white noise, m²; the slow error is the model's.
        age_s: at the tick's end.
        valid: whether there is one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    covariance: Float[Array, "... 2 2"]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class HeadingObservation(NamedTuple):
    """Yaw of the body from two antennas or an INS.

    Attributes:
        yaw_rad: any full turns more or less.
        variance: rad².
        age_s: at the tick's end.
        valid: whether there is one.
    """

    yaw_rad: Float[Array, "..."]
    variance: Float[Array, "..."]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class OdometerObservation(NamedTuple):
    """Forward speed by the wheels over the tick, scale error included.

    Attributes:
        speed_mps: negative in reverse.
        variance: m²/s².
        valid: whether there is one.
    """

    speed_mps: Float[Array, "..."]
    variance: Float[Array, "..."]
    valid: Bool[Array, "..."]


class LgprObservation(NamedTuple):
    """Pose of the array's centre in the map's frame, off by the LGPR error.

    Attributes:
        x_m, y_m: position.
        yaw_rad: any full turns more or less.
        covariance: of x, y and yaw, from the correlation's peak; what neighbouring fixes share is the model's.
        age_s: at the tick's end by the stamp; the filter adds its estimate of the clock.
        valid: whether there is one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class Observations(NamedTuple):
    """A tick's slots, in the order of ``SOURCES``."""

    gnss: GnssObservation
    heading: HeadingObservation
    odometer: OdometerObservation
    lgpr: LgprObservation


def no_observations() -> Observations:
    """Unbatched slots, all empty."""
    zero, one, no = jnp.float32(0.0), jnp.float32(1.0), jnp.asarray(False)
    return Observations(
        GnssObservation(zero, zero, jnp.eye(2, dtype=jnp.float32), zero, no),
        HeadingObservation(zero, one, zero, no),
        OdometerObservation(zero, one, no),
        LgprObservation(zero, zero, zero, jnp.eye(3, dtype=jnp.float32), zero, no),
    )


# Gating of observations: a chi-square gate for each source, and re-acquisition of rejected sources.
#
# An observation whose normalised innovation squared exceeds its source's threshold is rejected. A source rejected
# repeatedly while no other source of position is accepted is re-acquired, so that a wrong filter cannot shut out the
# truth; if another source of position keeps agreeing with the filter, it is a conflict instead, which is counted and
# judged elsewhere. A position that does not change while the vehicle drives is never re-acquired.

NEVER_S = 1e6
"""Time since an event that has not happened yet."""


class GateRules(NamedTuple):
    """Thresholds and counts of the gates.

    Attributes:
        thresholds: largest normalised innovation squared that is accepted, by source.
        reacquire_after: rejects in a row, by source, after which the next one is taken.
        forget_s: a source silent for longer starts with no rejects.
        conflict_sigmas: a GNSS error beyond so many of its standard deviations is a conflict with LGPR.
    """

    thresholds: Float[Array, "... 4"]
    reacquire_after: Int[Array, "... 4"]
    forget_s: Float[Array, "..."]
    conflict_sigmas: Float[Array, "..."]


class GateState(NamedTuple):
    """What the gates remember, by source where there are four values.

    Attributes:
        rejects: in a row.
        alone: the last of them during which no other source of position was accepted.
        since_accepted_s, since_offered_s: ``NEVER_S`` and more before the first.
        first_fix_m, first_seen_m: of GNSS and of LGPR, the first position rejected alone, and what the filter expected.
        conflict_s: for how long GNSS and LGPR have disagreed.
    """

    rejects: Int[Array, "... 4"]
    alone: Int[Array, "... 4"]
    since_accepted_s: Float[Array, "... 4"]
    since_offered_s: Float[Array, "... 4"]
    first_fix_m: Float[Array, "... 2 2"]
    first_seen_m: Float[Array, "... 2 2"]
    conflict_s: Float[Array, "..."]


class GateVerdict(NamedTuple):
    """On one observation.

    Attributes:
        accepted: by the gate, or taken back.
        reacquired: taken back although beyond the threshold.
    """

    accepted: Bool[Array, "..."]
    reacquired: Bool[Array, "..."]


def default_rules() -> GateRules:
    """Gates that pass all but one in ten thousand honest observations, and between 2 and 4 s of rejects at usual rates.

    The counts suit GNSS at 5 Hz, a heading at 10 Hz, and odometer and LGPR at 21 Hz.
    """
    return GateRules(
        thresholds=jnp.asarray([18.42, 15.14, 15.14, 21.11], jnp.float32),
        reacquire_after=jnp.asarray([15, 30, 42, 42], jnp.int32),
        forget_s=jnp.float32(2.0),
        conflict_sigmas=jnp.float32(4.0),
    )


def init_gates() -> GateState:
    """Gates that have seen nothing."""
    none = jnp.zeros(len(SOURCES), jnp.int32)
    never = jnp.full(len(SOURCES), NEVER_S, jnp.float32)
    places = jnp.zeros((2, 2), jnp.float32)
    return GateState(
        rejects=none,
        alone=none,
        since_accepted_s=never,
        since_offered_s=never,
        first_fix_m=places,
        first_seen_m=places,
        conflict_s=jnp.float32(0.0),
    )


def advance_gates(rules: GateRules, gates: GateState, step_s: Float[Array, ""]) -> GateState:
    """The gates a tick later, before its observations: time passes, and sources long silent are forgotten."""
    silent = gates.since_offered_s + step_s > rules.forget_s
    return gates._replace(
        rejects=jnp.where(silent, 0, gates.rejects),
        alone=jnp.where(silent, 0, gates.alone),
        since_accepted_s=gates.since_accepted_s + step_s,
        since_offered_s=gates.since_offered_s + step_s,
    )


def judge(
    rules: GateRules,
    gates: GateState,
    source: int,
    offered: Bool[Array, ""],
    nis: Float[Array, ""],
    fix_m: Float[Array, " 2"],
    seen_m: Float[Array, " 2"],
) -> tuple[GateVerdict, GateState]:
    """Whether an observation is used, and the gates that remember it.

    Args:
        rules: of the gates.
        gates: so far.
        source: index in ``SOURCES``.
        offered: whether there is a usable observation.
        nis: its normalised innovation squared.
        fix_m, seen_m: for GNSS and LGPR the position as observed and as expected by the filter; unused for others.
    """
    passes = nis <= rules.thresholds[source]
    alone = gates.alone[source]
    ready = alone >= rules.reacquire_after[source]
    first_fix, first_seen = gates.first_fix_m, gates.first_seen_m
    positions = source in (GNSS, LGPR)
    if positions:
        # A receiver that is stuck gives one place while the filter drives on: it is no truth to go back to.
        row = 0 if source == GNSS else 1
        moved_m = jnp.hypot(*(fix_m - first_fix[row]))
        driven_m = jnp.hypot(*(seen_m - first_seen[row]))
        drives = moved_m >= 0.5 * driven_m - 0.5
        restarts = offered & ~passes & ((alone == 0) | (ready & ~drives))
        ready, alone = ready & drives, jnp.where(restarts, 0, alone)
        first_fix = first_fix.at[row].set(jnp.where(restarts, fix_m, first_fix[row]))
        first_seen = first_seen.at[row].set(jnp.where(restarts, seen_m, first_seen[row]))
    reacquired = offered & ~passes & ready
    accepted = (offered & passes) | reacquired
    rejected = offered & ~accepted
    counted = gates.rejects[source] + 1
    # Any other source's run of rejects is no longer alone once a position was accepted.
    alone_all = jnp.where(accepted, 0, gates.alone) if positions else gates.alone
    return GateVerdict(accepted, reacquired), GateState(
        rejects=gates.rejects.at[source].set(
            jnp.where(rejected, counted, jnp.where(accepted, 0, gates.rejects[source]))
        ),
        alone=alone_all.at[source].set(jnp.where(rejected, alone + 1, jnp.where(accepted, 0, gates.alone[source]))),
        since_accepted_s=gates.since_accepted_s.at[source].set(
            jnp.where(accepted, 0.0, gates.since_accepted_s[source])
        ),
        since_offered_s=gates.since_offered_s.at[source].set(jnp.where(offered, 0.0, gates.since_offered_s[source])),
        first_fix_m=first_fix,
        first_seen_m=first_seen,
        conflict_s=gates.conflict_s,
    )


def count_conflict(
    rules: GateRules, gates: GateState, gnss_error_sigmas: Float[Array, ""], step_s: Float[Array, ""]
) -> GateState:
    """The gates after a tick's observations, with the time for which GNSS and LGPR have disagreed.

    They disagree while one is being rejected and the other was accepted lately, or while both are accepted only by
    way of a GNSS error that is beyond belief: a slow drift passes every single gate.

    Args:
        rules: of the gates.
        gates: after the last source.
        gnss_error_sigmas: size of the estimated GNSS error over its standard deviation at rest.
        step_s: length of the tick.
    """
    lately = gates.since_accepted_s <= rules.forget_s
    one_out = ((gates.rejects[GNSS] > 0) & lately[LGPR]) | ((gates.rejects[LGPR] > 0) & lately[GNSS])
    far = lately[GNSS] & lately[LGPR] & (gnss_error_sigmas > rules.conflict_sigmas)
    return gates._replace(conflict_s=jnp.where(one_out | far, gates.conflict_s + step_s, 0.0))
