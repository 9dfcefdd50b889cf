"""One step of a closed loop, of any vehicle: the world moves by the last command, then the vehicle decides the next.

A vehicle in its world is an ``Environment`` of two pure functions. Its states are pytrees; ``vmap`` makes many drives.
"""

from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Int, PRNGKeyArray

World = TypeVar("World")
"""State of plant and sensors: the truth."""
Onboard = TypeVar("Onboard")
"""State of what runs on board, and of the driver."""
Command = TypeVar("Command")
"""Command that acts on the vehicle in the next tick."""
Readings = TypeVar("Readings")
Info = TypeVar("Info", covariant=True)


class EnvState(NamedTuple, Generic[World, Onboard, Command]):
    """State from tick to tick.

    Attributes:
        world, onboard, command: see the types of this module.
        tick: number of ticks passed.
    """

    world: World
    onboard: Onboard
    command: Command
    tick: Int[Array, "..."]


class Environment(Protocol[World, Onboard, Command, Readings, Info]):
    """A vehicle in its world."""

    def move(self, world: World, command: Command, tick: Int[Array, ""], key: PRNGKeyArray) -> tuple[World, Readings]:
        """The world a tick later, and what the sensors read then."""

    def decide(self, world: World, onboard: Onboard, readings: Readings) -> tuple[Onboard, Command, Info]:
        """State on board, the command for the next tick, and diagnostics.

        The true ``world`` is the driver's view and the evaluation's; what runs on board has ``readings`` alone.
        """


def init_env(world: World, onboard: Onboard, command: Command) -> EnvState[World, Onboard, Command]:
    """State before the first tick."""
    return EnvState(world, onboard, command, jnp.int32(0))


def env_step(
    env: Environment[World, Onboard, Command, Any, Info], state: EnvState[World, Onboard, Command], key: PRNGKeyArray
) -> tuple[EnvState[World, Onboard, Command], Info]:
    """One tick of one drive.

    Args:
        env: vehicle and world.
        state: state after the last tick.
        key: random key of the tick.
    """
    tick = state.tick + 1
    world, readings = env.move(state.world, state.command, tick, key)
    onboard, command, info = env.decide(world, state.onboard, readings)
    return EnvState(world, onboard, command, tick), info


def run_env(
    env: Environment[World, Onboard, Command, Any, Info],
    state: EnvState[World, Onboard, Command],
    key: PRNGKeyArray,
    ticks: int,
) -> tuple[EnvState[World, Onboard, Command], Info]:
    """Ticks of one drive; diagnostics with a leading axis of ticks."""
    run: tuple[EnvState[World, Onboard, Command], Info] = lax.scan(
        lambda state, key: env_step(env, state, key), state, jax.random.split(key, ticks)
    )
    return run
