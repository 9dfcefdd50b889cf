"""evosax' particle swarm on the jitted direct score, asked and told inside one scan; clipped to the box by hand.

Its swarm knows one global best and no walls. Constants are those of the constriction, as for the other swarms.
"""

import argparse

import jax
import jax.numpy as jnp
from evosax.algorithms import PSO
from jaxtyping import Array, Float, Key

from benchmarks.peers.jax_score import BoxScore, make_peer
from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import HardSet


def build(hard_set: HardSet, chosen: argparse.Namespace) -> Peer:
    """The peer on a hard set."""
    swarm = PSO(population_size=chosen.particles, solution=jnp.zeros(5))
    constants = swarm.default_params.replace(inertia_coeff=0.7298, cognitive_coeff=1.49618, social_coeff=1.49618)

    def search(key: Key[Array, ""], score: BoxScore) -> Float[Array, " 5"]:
        first, second, third = jax.random.split(key, 3)
        start = jax.random.uniform(first, (chosen.particles, 5), minval=-1.0, maxval=1.0)
        state = swarm.init(second, start, -score(start), constants)

        def turn(state: object, key: Key[Array, ""]) -> tuple[object, None]:
            ask, tell = jax.random.split(key)
            asked, state = swarm.ask(ask, state, constants)
            inside = jnp.clip(asked, -1.0, 1.0)
            state, _ = swarm.tell(tell, inside, -score(inside), state, constants)
            return state, None

        end, _ = jax.lax.scan(turn, state, jax.random.split(third, chosen.iterations))
        return jnp.asarray(end.best_solution)

    setting = f"{'full' if chosen.full else 'band'} {chosen.particles}x{chosen.iterations}"
    evaluations = chosen.particles * (chosen.iterations + 1)
    return make_peer(hard_set, "evosax_peer", setting, evaluations, chosen.full, search)


def main() -> None:
    """The program."""
    chosen = arguments("evosax_peer", 256, 40).parse_args()
    work(chosen, lambda hard_set: build(hard_set, chosen))


if __name__ == "__main__":
    main()
