"""The last filter on commands: range, rate, finite numbers, age. It is independent of their origin.

A command that is not finite or too old is replaced by the last good one for one step. If the next one is bad too, the
limiter switches to its default, requests manual mode, and stays there until it is restarted. This is common to all
vehicles: ``limit_command`` takes the command record of any vehicle; limits and default are methods of its rules.

Front-wheel steering and pedals: the default is throttle idle, brake rising to its default, steering from the last good
angle to straight at a slow rate of its own. Both pedals are never pressed together; the brake wins. Releasing a pedal
is never slowed.

Skid steering and tool: the default is the tool off at once, both wheels to a stop along the arc that they are on.
"""

from enum import IntFlag
from functools import reduce
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

AnyCommand = TypeVar("AnyCommand", bound=tuple[Any, ...])
"""A vehicle's command record: a ``NamedTuple`` of numbers, each a scalar or one value per batch element."""


class CommandRules(Protocol[AnyCommand]):
    """Limits and default of a vehicle's commands; ``LimiterRules`` and ``SkidLimiterRules`` are two."""

    @property
    def oldest_s(self) -> Float[Array, "..."]:
        """Largest age of a command's pose."""

    def within(
        self, last: AnyCommand, command: AnyCommand, step_s: Float[Array, "..."]
    ) -> tuple[AnyCommand, tuple[Bool[Array, "..."], ...]]:
        """The command within its limits, and for every limit whether it was applied, from the lowest bit on.

        Args:
            last: last command sent.
            command: wanted command, finite.
            step_s: time since the last command sent, not negative.
        """

    def default(self, last: AnyCommand, step_s: Float[Array, "..."]) -> AnyCommand:
        """One step further towards the command that is sent if commands fail."""


class LimiterState(NamedTuple, Generic[AnyCommand]):
    """State of the limiter from step to step.

    Attributes:
        last: last command sent.
        missed: the last command was bad.
        failed: two in a row were bad; it stays with the default.
    """

    last: AnyCommand
    missed: Bool[Array, "..."]
    failed: Bool[Array, "..."]


def init_limiter(command: AnyCommand) -> LimiterState[AnyCommand]:
    """State after a good command: the vehicle as it is."""
    first, *_ = command
    no = jnp.zeros_like(first, jnp.bool_)
    return LimiterState(command, no, no)


def limit_command(
    rules: CommandRules[AnyCommand],
    state: LimiterState[AnyCommand],
    command: AnyCommand,
    age_s: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> tuple[LimiterState[AnyCommand], AnyCommand, Int32[Array, "..."]]:
    """State, the command to send, and changes to it as bits: those of the rules, then the three of every limiter.

    The three are ``NOT_FINITE``, ``STALE`` and ``MANUAL_REQUESTED``, as ``Limited`` and ``SkidLimited`` name them.

    Args:
        rules: limits.
        state: state of the last step.
        command: wanted command.
        age_s: age of the command's pose; a negative age (of a broken clock) counts as too old.
        step_s: time since the last command sent; if it is not positive or NaN, nothing that has a rate may change.
    """
    last = state.last
    finite = jnp.isfinite(jnp.stack(command)).all(0)
    fresh = jnp.logical_and(age_s >= 0.0, age_s <= rules.oldest_s)
    bad = jnp.logical_not(jnp.logical_and(finite, fresh))
    failed = jnp.logical_or(state.failed, jnp.logical_and(state.missed, bad))
    # For zero and NaN this yields zero.
    step = jnp.fmax(step_s, 0.0)
    limited, limits = rules.within(last, command, step)
    # A good command within its limits, the last one in place of a bad one, the default from the second on.
    good = jnp.logical_not(jnp.logical_or(bad, failed))
    sent = _pick(good, limited, _pick(failed, rules.default(last, step), last))
    # A replaced command was not limited.
    faults = (jnp.logical_not(finite), jnp.logical_not(fresh), failed)
    bits = _bits((*(jnp.logical_and(good, limit) for limit in limits), *faults))
    return LimiterState(sent, bad, failed), sent, bits


def limit_while_engaged(
    rules: CommandRules[AnyCommand],
    state: LimiterState[AnyCommand],
    command: AnyCommand,
    age_s: Float[Array, "..."],
    step_s: Float[Array, "..."],
    engaged: Bool[Array, "..."],
    measured: AnyCommand,
) -> tuple[LimiterState[AnyCommand], Int32[Array, "..."]]:
    """State of the limiter, whose last command is sent, and its bits.

    Not engaged, no command is sent: the limiter tracks the vehicle as measured.

    Args:
        rules, state, command, age_s, step_s: see ``limit_command``.
        engaged: whether the computer commands the vehicle.
        measured: command that leaves the vehicle as it is; where it is not finite the last one stays.
    """
    known = jax.tree.map(lambda now, last: jnp.where(jnp.isfinite(now), now, last), measured, state.last)
    limited, _, bits = limit_command(rules, state, command, age_s, step_s)
    return _pick(engaged, limited, init_limiter(known)), jnp.where(engaged, bits, 0)


def bounded(
    wanted: Float[Array, "..."], last: Float[Array, "..."], largest: Float[Array, "..."], change: Float[Array, "..."]
) -> tuple[Float[Array, "..."], tuple[Bool[Array, "..."], Bool[Array, "..."]]]:
    """A number of a command within its range and rate, and whether each was applied.

    Args:
        wanted, last: number of the wanted command, and of the last one sent.
        largest: largest magnitude.
        change: largest change in a step, not negative.
    """
    ranged = jnp.clip(wanted, -largest, largest)
    rated = jnp.clip(ranged, last - change, last + change)
    return rated, (jnp.not_equal(ranged, wanted), jnp.not_equal(rated, ranged))


def _bits(flags: tuple[Bool[Array, "..."], ...]) -> Int32[Array, "..."]:
    bits = (jnp.where(is_set, jnp.int32(2**place), jnp.int32(0)) for place, is_set in enumerate(flags))
    return reduce(jnp.bitwise_or, bits)


_Tree = TypeVar("_Tree")


def _pick(choice: Bool[Array, "..."], chosen: _Tree, other: _Tree) -> _Tree:
    picked: _Tree = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked


# Front-wheel steering and pedals.


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

    def within(
        self, last: Command, command: Command, step_s: Float[Array, "..."]
    ) -> tuple[Command, tuple[Bool[Array, "..."], ...]]:
        """The command within its limits; see ``CommandRules``."""
        front, steered = bounded(
            command.front_rad, last.front_rad, self.largest_front_rad, self.front_rate_radps * step_s
        )
        throttle_ranged, brake_ranged = jnp.clip(command.throttle, 0.0, 1.0), jnp.clip(command.brake, 0.0, 1.0)
        throttle = jnp.minimum(throttle_ranged, last.throttle + self.throttle_rate_per_s * step_s)
        brake = jnp.minimum(brake_ranged, last.brake + self.brake_rate_per_s * step_s)
        # Neither is negative: a pedal is pressed where it is not zero.
        both = jnp.logical_and(throttle.astype(jnp.bool_), brake.astype(jnp.bool_))
        limits = (
            *steered,
            jnp.not_equal(throttle_ranged, command.throttle),
            jnp.not_equal(throttle, throttle_ranged),
            jnp.not_equal(brake_ranged, command.brake),
            jnp.not_equal(brake, brake_ranged),
            both,
        )
        return Command(front, jnp.where(both, 0.0, throttle), brake), limits

    def default(self, last: Command, step_s: Float[Array, "..."]) -> Command:
        """One step further towards straight wheels and the brake's default, the throttle idle at once."""
        turn = self.release_rate_radps * step_s
        rising = jnp.minimum(self.default_brake, last.brake + self.brake_rate_per_s * step_s)
        # A brake pressed harder than its default is not released.
        brake = jnp.maximum(rising, last.brake)
        return Command(last.front_rad - jnp.clip(last.front_rad, -turn, turn), jnp.zeros_like(brake), brake)


def released(front_rad: Float[Array, "..."]) -> Command:
    """Command with both pedals released, the front wheels at an angle."""
    free = jnp.zeros_like(front_rad)
    return Command(front_rad, free, free)


# Skid steering and tool.


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

    def within(
        self, last: SkidCommand, command: SkidCommand, step_s: Float[Array, "..."]
    ) -> tuple[SkidCommand, tuple[Bool[Array, "..."], ...]]:
        """The command within its limits; see ``CommandRules``."""
        change, largest = self.wheel_rate_mps2 * step_s, self.largest_wheel_mps
        left, left_limits = bounded(command.left_mps, last.left_mps, largest, change)
        right, right_limits = bounded(command.right_mps, last.right_mps, largest, change)
        # Anything except exactly 1 is off.
        tool = jnp.where(command.tool >= 1.0, 1.0, 0.0)
        depth = jnp.clip(command.depth_m, 0.0, self.deepest_m)
        limits = (
            *left_limits,
            *right_limits,
            jnp.not_equal(tool, command.tool),
            jnp.not_equal(depth, command.depth_m),
        )
        return SkidCommand(left, right, tool, depth), limits

    def default(self, last: SkidCommand, step_s: Float[Array, "..."]) -> SkidCommand:
        """One step further towards a stop on the same arc, the tool off at once."""
        left, right = slowed(last.left_mps, last.right_mps, self.release_rate_mps2 * step_s)
        return SkidCommand(left, right, jnp.zeros_like(left), last.depth_m)


def slowed(
    left_mps: Float[Array, "..."], right_mps: Float[Array, "..."], change_mps: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Slow the faster wheel by an amount and the other in proportion: the arc stays the same."""
    fastest = jnp.maximum(jnp.abs(left_mps), jnp.abs(right_mps))
    # At rest the quotient is infinite or no number: fmax makes zero of both.
    share = jnp.fmax(1.0 - change_mps / fastest, 0.0)
    return share * left_mps, share * right_mps
