"""This project's swarm on the jitted direct score over the whole box, from uniform starts: no coarse stage."""

import argparse

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from benchmarks.peers.jax_score import BoxScore, make_peer
from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import HardSet
from lgprjax.pso import SwarmConfig, run_swarm


def build(hard_set: HardSet, chosen: argparse.Namespace) -> Peer:
    """The peer on a hard set."""
    config = SwarmConfig(chosen.particles, chosen.iterations)

    def search(key: Key[Array, ""], score: BoxScore) -> Float[Array, " 5"]:
        first, second = jax.random.split(key)
        start = jax.random.uniform(first, (config.particles, 5), minval=-1.0, maxval=1.0)
        return run_swarm(second, start, score, jnp.ones(5, dtype=bool), config=config).position

    setting = f"{'full' if chosen.full else 'band'} {chosen.particles}x{chosen.iterations}"
    evaluations = chosen.particles * (chosen.iterations + 1)
    return make_peer(hard_set, "direct_swarm", setting, evaluations, chosen.full, search)


def main() -> None:
    """The program."""
    chosen = arguments("direct_swarm", 256, 40).parse_args()
    work(chosen, lambda hard_set: build(hard_set, chosen))


if __name__ == "__main__":
    main()
