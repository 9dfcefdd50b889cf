"""Path-following metrics of a rollout, accumulated while it runs, without storing the trajectory."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.kinematics import Chassis, rear_angle


class MetricSums(NamedTuple):
    """Sums carried from step to step.

    Attributes:
        square_m2: sum of squared errors.
        largest_m: error.
        settled_m: travel at which the error was last beyond the tolerance.
        low_m, high_m: signed errors over the last stretch.
        steered_rad: sum of the wheels' movements.
        unreachable: steps whose goal could not be reached.
    """

    square_m2: Float[Array, "..."]
    largest_m: Float[Array, "..."]
    settled_m: Float[Array, "..."]
    low_m: Float[Array, "..."]
    high_m: Float[Array, "..."]
    steered_rad: Float[Array, "..."]
    unreachable: Float[Array, "..."]


class RolloutMetrics(NamedTuple):
    """A rollout in figures. The error is the anchor's distance from the interpolated path.

    Attributes:
        rms_m, largest_m: error over all steps.
        settling_m: travel after which the error stays within the tolerance; the whole travel if it does not.
        cycle_m: half of the error's peak-to-peak value over the last stretch: the amplitude of a limit cycle.
        effort_radpm: movement of the front wheels a metre.
        unreachable_share: share of the steps whose goal cannot be reached within the largest angle.
    """

    rms_m: Float[Array, "..."]
    largest_m: Float[Array, "..."]
    settling_m: Float[Array, "..."]
    cycle_m: Float[Array, "..."]
    effort_radpm: Float[Array, "..."]
    unreachable_share: Float[Array, "..."]


def init_metrics(like: Float[Array, "..."]) -> MetricSums:
    """Sums before the first step; one value for each of ``like``."""
    zero = jnp.zeros_like(like)
    return MetricSums(
        square_m2=zero,
        largest_m=zero,
        settled_m=zero,
        low_m=jnp.full_like(like, jnp.inf),
        high_m=jnp.full_like(like, -jnp.inf),
        steered_rad=zero,
        unreachable=zero,
    )


def step_metrics(
    sums: MetricSums,
    offset_m: Float[Array, "..."],
    travelled_m: Float[Array, "..."],
    late: Bool[Array, "..."],
    steered_rad: Float[Array, "..."],
    reachable: Bool[Array, "..."],
    *,
    tolerance_m: float,
) -> MetricSums:
    """Add one step.

    Args:
        sums: sums so far.
        offset_m: signed offset of the anchor from the path.
        travelled_m: distance from the start, including this step.
        late: whether the step belongs to the last stretch.
        steered_rad: movement of the wheels in the step, not negative.
        reachable: whether the step's goal was reachable.
        tolerance_m: tolerance of the settling distance.
    """
    error = jnp.abs(offset_m)
    return MetricSums(
        square_m2=sums.square_m2 + offset_m * offset_m,
        largest_m=jnp.maximum(sums.largest_m, error),
        # Written so that a NaN error never counts as settled.
        settled_m=jnp.where(error <= tolerance_m, sums.settled_m, travelled_m),
        low_m=jnp.where(late, jnp.minimum(sums.low_m, offset_m), sums.low_m),
        high_m=jnp.where(late, jnp.maximum(sums.high_m, offset_m), sums.high_m),
        steered_rad=sums.steered_rad + steered_rad,
        unreachable=sums.unreachable + jnp.where(reachable, 0.0, 1.0),
    )


def finish_metrics(sums: MetricSums, steps: int, travel_m: Float[Array, "..."]) -> RolloutMetrics:
    """Figures over a number of steps and a travel, which is not negative. RMS and effort have gradients everywhere."""
    square = sums.square_m2 / steps
    some = square > 0.0
    moved = travel_m > 0.0
    return RolloutMetrics(
        jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), square),
        sums.largest_m,
        sums.settled_m,
        0.5 * (sums.high_m - sums.low_m),
        sums.steered_rad / jnp.where(moved, travel_m, 1.0),
        sums.unreachable / steps,
    )


# Robustness of a pursuit law to lag, delay, reversing, dead band and gain errors; linear, about a straight path.
#
# With e the anchor's offset, ψ the heading, a = l − x_c from the zero-slip point to the anchor and D the look-ahead,
# the law asks for κ = −(e/D + ψ) / (D/2 + a) while e' = v ψ + a v κ and ψ' = v κ. A forward anchor stabilises the
# vehicle; reversing makes a negative. All functions take scalars or arrays.

_CUBIC_STEPS = 8


def anchor_lead_m(chassis: Chassis) -> Float[Array, "..."]:
    """a = l − x_c for small angles: distance of the anchor ahead of the zero-slip point."""
    slope = rear_angle(chassis.rear, jnp.zeros_like(chassis.anchor_m))[1]
    return chassis.anchor_m - chassis.wheelbase_m * slope / (1.0 + slope)


def damping(look_ahead_m: Float[Array, "..."], lead_m: Float[Array, "..."]) -> Float[Array, "..."]:
    """Damping ratio without lag, ζ² = (1 + a²/(D (D + 2a))) / 2: 0.707 with the anchor at the zero-slip point."""
    ahead = look_ahead_m * (look_ahead_m + 2.0 * lead_m)
    return jnp.sqrt(0.5 * (1.0 + lead_m * lead_m / ahead))


def phase_margin_rad(
    look_ahead_m: Float[Array, "..."],
    lead_m: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    lag_s: Float[Array, "..."],
    delay_s: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Phase margin of the loop with lag and delay; stable where it is positive.

    Lag and delay together are worse than the sum of their shares of the individual limits.
    """
    crossover, margin = _crossover(look_ahead_m, lead_m, speed_mps, lag_s)
    return margin - delay_s * crossover


def _crossover(
    look_ahead_m: Float[Array, "..."],
    lead_m: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    lag_s: Float[Array, "..."],
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Angular frequency where the open loop's gain is one, and the remaining phase there without a delay.

    The open loop is v ((1 + a/D) s + v/D) / ((D/2 + a) s² (τ s + 1)). Its gain is one at the only positive root
    w = ω² of a cubic; Newton's steps converge to it from above, starting at the root without a lag.
    """
    m = 0.5 * look_ahead_m + lead_m
    slope, offset = speed_mps * (1.0 + lead_m / look_ahead_m), speed_mps * speed_mps / look_ahead_m
    a, b, c = m * m, slope * slope, offset * offset
    w = (b + jnp.sqrt(b * b + 4.0 * a * c)) / (2.0 * a)
    lagged = lag_s * lag_s
    for _ in range(_CUBIC_STEPS):
        value = a * w * w * (1.0 + lagged * w) - b * w - c
        w = w - value / (a * w * (2.0 + 3.0 * lagged * w) - b)
    crossover = jnp.sqrt(w)
    return crossover, jnp.arctan(slope * crossover / offset) - jnp.arctan(lag_s * crossover)
