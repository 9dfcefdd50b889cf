"""The last filter on commands: range, rate, finite numbers, age. It is independent of their origin.

A command that is not finite or too old is replaced by the last good one for one step. If the next one is bad too, the
limiter switches to its default, requests manual mode, and stays there until it is restarted. This is common to all
vehicles (``_judge`` and ``_send``); limits and default are specific.

Front-wheel steering and pedals: the default is throttle idle, brake rising to its default, steering from the last good
angle to straight at a slow rate of its own. Both pedals are never pressed together; the brake wins. Releasing a pedal
is never slowed.

Skid steering and tool: the default is the tool off at once, both wheels to a stop along the arc that they are on.
"""

from enum import IntFlag
from functools import reduce
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32


class Limited(IntFlag):
    """Changes that the limiter made to a command."""

    FRONT_RANGE = 1
    FRONT_RATE = 2
    THROTTLE_RANGE = 4
    THROTTLE_RATE = 8
    BRAKE_RANGE = 16
    BRAKE_RATE = 32
    BOTH_PEDALS = 64
    NOT_FINITE = 128
    STALE = 256
    MANUAL_REQUESTED = 512


class Command(NamedTuple):
    """Command to the drive-by-wire box.

    Attributes:
        front_rad: angle of the front wheels.
        throttle, brake: 0 to 1.
    """

    front_rad: Float[Array, "..."]
    throttle: Float[Array, "..."]
    brake: Float[Array, "..."]


class LimiterRules(NamedTuple):
    """Rules of the limiter, float32 scalars or one value per batch element.

    Attributes:
        largest_front_rad: largest front angle, to either side.
        front_rate_radps: largest rate of the front wheels.
        throttle_rate_per_s, brake_rate_per_s: largest rates of pressing the pedals.
        oldest_s: largest age of a command's pose.
        default_brake: brake if commands fail.
        release_rate_radps: rate at which the wheels return to straight if commands fail.
    """

    largest_front_rad: Float[Array, "..."]
    front_rate_radps: Float[Array, "..."]
    throttle_rate_per_s: Float[Array, "..."]
    brake_rate_per_s: Float[Array, "..."]
    oldest_s: Float[Array, "..."]
    default_brake: Float[Array, "..."]
    release_rate_radps: Float[Array, "..."]


class SkidLimited(IntFlag):
    """Changes that the limiter made to a command."""

    LEFT_RANGE = 1
    LEFT_RATE = 2
    RIGHT_RANGE = 4
    RIGHT_RATE = 8
    TOOL_RANGE = 16
    DEPTH_RANGE = 32
    NOT_FINITE = 64
    STALE = 128
    MANUAL_REQUESTED = 256


class SkidCommand(NamedTuple):
    """Command to the drive box.

    Attributes:
        left_mps, right_mps: wheel speeds, negative backward.
        tool: 1 tool on, 0 off.
        depth_m: depth of the tool below the ground.
    """

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]
    tool: Float[Array, "..."]
    depth_m: Float[Array, "..."]


class SkidLimiterRules(NamedTuple):
    """Rules of the limiter, float32 scalars or one value per batch element.

    Attributes:
        largest_wheel_mps: largest speed of either side, forward and backward.
        wheel_rate_mps2: largest change of a side's speed.
        deepest_m: largest depth of the tool; it is never commanded above the ground.
        oldest_s: largest age of a command's pose.
        release_rate_mps2: deceleration of the faster wheel if commands fail.
    """

    largest_wheel_mps: Float[Array, "..."]
    wheel_rate_mps2: Float[Array, "..."]
    deepest_m: Float[Array, "..."]
    oldest_s: Float[Array, "..."]
    release_rate_mps2: Float[Array, "..."]


AnyCommand = TypeVar("AnyCommand", Command, SkidCommand)


class LimiterState(NamedTuple):
    """State of the limiter from step to step.

    Attributes:
        last: last command sent.
        missed: the last command was bad.
        failed: two in a row were bad; it stays with the default.
    """

    last: Command
    missed: Bool[Array, "..."]
    failed: Bool[Array, "..."]


class SkidLimiterState(NamedTuple):
    """The same for a skid-steer vehicle.

    Attributes:
        last: last command sent.
        missed: the last command was bad.
        failed: two in a row were bad; it stays with the default.
    """

    last: SkidCommand
    missed: Bool[Array, "..."]
    failed: Bool[Array, "..."]


class _Judged(NamedTuple):
    """Verdict on a command; ``step_s`` is never negative."""

    finite: Bool[Array, "..."]
    fresh: Bool[Array, "..."]
    bad: Bool[Array, "..."]
    failed: Bool[Array, "..."]
    step_s: Float[Array, "..."]


def init_limiter(front_rad: Float[Array, "..."]) -> LimiterState:
    """State with both pedals released and the present front angle."""
    free, no = jnp.zeros_like(front_rad), jnp.zeros_like(front_rad, jnp.bool_)
    return LimiterState(Command(front_rad, free, free), no, no)


def limit_command(
    rules: LimiterRules,
    state: LimiterState,
    command: Command,
    age_s: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> tuple[LimiterState, Command, Int32[Array, "..."]]:
    """State, the command to send, and changes to it as bits of ``Limited``.

    Args:
        rules: limits.
        state: state of the last step.
        command: wanted command.
        age_s: age of the command's pose; a negative age (of a broken clock) counts as too old.
        step_s: time since the last command sent; if it is not positive or NaN, no change is allowed.
    """
    last, judged = state.last, _judge(state, command, age_s, rules.oldest_s, step_s)
    step = judged.step_s

    turn, largest = rules.front_rate_radps * step, rules.largest_front_rad
    front_ranged = jnp.clip(command.front_rad, -largest, largest)
    front = jnp.clip(front_ranged, last.front_rad - turn, last.front_rad + turn)
    throttle_ranged, brake_ranged = jnp.clip(command.throttle, 0.0, 1.0), jnp.clip(command.brake, 0.0, 1.0)
    throttle = jnp.minimum(throttle_ranged, last.throttle + rules.throttle_rate_per_s * step)
    brake = jnp.minimum(brake_ranged, last.brake + rules.brake_rate_per_s * step)
    # Neither is negative: a pedal is pressed where it is not zero.
    both = jnp.logical_and(throttle.astype(jnp.bool_), brake.astype(jnp.bool_))
    limited = Command(front, jnp.where(both, 0.0, throttle), brake)

    limits = (
        (Limited.FRONT_RANGE, jnp.not_equal(front_ranged, command.front_rad)),
        (Limited.FRONT_RATE, jnp.not_equal(front, front_ranged)),
        (Limited.THROTTLE_RANGE, jnp.not_equal(throttle_ranged, command.throttle)),
        (Limited.THROTTLE_RATE, jnp.not_equal(throttle, throttle_ranged)),
        (Limited.BRAKE_RANGE, jnp.not_equal(brake_ranged, command.brake)),
        (Limited.BRAKE_RATE, jnp.not_equal(brake, brake_ranged)),
        (Limited.BOTH_PEDALS, both),
    )
    sent, bits = _send(judged, last, limited, _default(rules, last, step), Limited, limits)
    return LimiterState(sent, judged.bad, judged.failed), sent, bits


def _default(rules: LimiterRules, last: Command, step_s: Float[Array, "..."]) -> Command:
    """One step further towards straight wheels and the brake's default, the throttle idle at once."""
    turn = rules.release_rate_radps * step_s
    rising = jnp.minimum(rules.default_brake, last.brake + rules.brake_rate_per_s * step_s)
    # A brake pressed harder than its default is not released.
    brake = jnp.maximum(rising, last.brake)
    return Command(last.front_rad - jnp.clip(last.front_rad, -turn, turn), jnp.zeros_like(brake), brake)


def init_skid_limiter(
    left_mps: Float[Array, "..."], right_mps: Float[Array, "..."], depth_m: Float[Array, "..."]
) -> SkidLimiterState:
    """State with the present wheel speeds, and the tool off."""
    off, no = jnp.zeros_like(left_mps), jnp.zeros_like(left_mps, jnp.bool_)
    return SkidLimiterState(SkidCommand(left_mps, right_mps, off, depth_m), no, no)


def limit_skid_command(
    rules: SkidLimiterRules,
    state: SkidLimiterState,
    command: SkidCommand,
    age_s: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> tuple[SkidLimiterState, SkidCommand, Int32[Array, "..."]]:
    """State, the command to send, and changes to it as bits of ``SkidLimited``.

    Args:
        rules: limits.
        state: state of the last step.
        command: wanted command.
        age_s: age of the command's pose; a negative age (of a broken clock) counts as too old.
        step_s: time since the last command sent; if it is not positive or NaN, no change of the wheels is allowed.
    """
    last, judged = state.last, _judge(state, command, age_s, rules.oldest_s, step_s)
    step = judged.step_s

    change, largest = rules.wheel_rate_mps2 * step, rules.largest_wheel_mps
    left_ranged, right_ranged = (jnp.clip(wheel, -largest, largest) for wheel in command[:2])
    left = jnp.clip(left_ranged, last.left_mps - change, last.left_mps + change)
    right = jnp.clip(right_ranged, last.right_mps - change, last.right_mps + change)
    # Anything except exactly 1 is off.
    tool = jnp.where(command.tool >= 1.0, 1.0, 0.0)
    depth = jnp.clip(command.depth_m, 0.0, rules.deepest_m)
    limited = SkidCommand(left, right, tool, depth)

    limits = (
        (SkidLimited.LEFT_RANGE, jnp.not_equal(left_ranged, command.left_mps)),
        (SkidLimited.LEFT_RATE, jnp.not_equal(left, left_ranged)),
        (SkidLimited.RIGHT_RANGE, jnp.not_equal(right_ranged, command.right_mps)),
        (SkidLimited.RIGHT_RATE, jnp.not_equal(right, right_ranged)),
        (SkidLimited.TOOL_RANGE, jnp.not_equal(tool, command.tool)),
        (SkidLimited.DEPTH_RANGE, jnp.not_equal(depth, command.depth_m)),
    )
    sent, bits = _send(judged, last, limited, _skid_default(rules, last, step), SkidLimited, limits)
    return SkidLimiterState(sent, judged.bad, judged.failed), sent, bits


def slowed(
    left_mps: Float[Array, "..."], right_mps: Float[Array, "..."], change_mps: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Slow the faster wheel by an amount and the other in proportion: the arc stays the same."""
    fastest = jnp.maximum(jnp.abs(left_mps), jnp.abs(right_mps))
    # At rest the quotient is infinite or no number: fmax makes zero of both.
    share = jnp.fmax(1.0 - change_mps / fastest, 0.0)
    return share * left_mps, share * right_mps


def _skid_default(rules: SkidLimiterRules, last: SkidCommand, step_s: Float[Array, "..."]) -> SkidCommand:
    """One step further towards a stop."""
    left, right = slowed(last.left_mps, last.right_mps, rules.release_rate_mps2 * step_s)
    return SkidCommand(left, right, jnp.zeros_like(left), last.depth_m)


def _judge(
    state: LimiterState | SkidLimiterState,
    command: Command | SkidCommand,
    age_s: Float[Array, "..."],
    oldest_s: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> _Judged:
    finite = jnp.isfinite(jnp.stack(command)).all(0)
    fresh = jnp.logical_and(age_s >= 0.0, age_s <= oldest_s)
    bad = jnp.logical_not(jnp.logical_and(finite, fresh))
    failed = jnp.logical_or(state.failed, jnp.logical_and(state.missed, bad))
    # For zero and NaN this yields zero.
    return _Judged(finite, fresh, bad, failed, jnp.fmax(step_s, 0.0))


def _send(
    judged: _Judged,
    last: AnyCommand,
    limited: AnyCommand,
    default: AnyCommand,
    flag_type: type[Limited] | type[SkidLimited],
    limits: tuple[tuple[Limited | SkidLimited, Bool[Array, "..."]], ...],
) -> tuple[AnyCommand, Int32[Array, "..."]]:
    """A good command within its limits, the last one in place of a bad one, the default from the second on."""
    good = jnp.logical_not(jnp.logical_or(judged.bad, judged.failed))
    sent = _pick(good, limited, _pick(judged.failed, default, last))
    faults = (
        (flag_type.NOT_FINITE, jnp.logical_not(judged.finite)),
        (flag_type.STALE, jnp.logical_not(judged.fresh)),
        (flag_type.MANUAL_REQUESTED, judged.failed),
    )
    # A replaced command was not limited.
    bits = jnp.bitwise_or(jnp.where(good, _bits(limits), 0), _bits(faults))
    return sent, bits


def _bits(flags: tuple[tuple[Limited | SkidLimited, Bool[Array, "..."]], ...]) -> Int32[Array, "..."]:
    return reduce(jnp.bitwise_or, (jnp.where(is_set, jnp.int32(flag), jnp.int32(0)) for flag, is_set in flags))


def _pick(choice: Bool[Array, "..."], chosen: AnyCommand, other: AnyCommand) -> AnyCommand:
    picked: AnyCommand = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked
