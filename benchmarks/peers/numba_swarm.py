"""A particle swarm in Numba on the direct score: wide, short, ring of two neighbours to each side, constriction.

Constants and walls are those of ``lgprjax.pso``. One scan runs serially or over particles in parallel, whichever the
warm-up finds faster; many scans run in parallel, a scan a thread.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

import time
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numba import njit, prange

from benchmarks.peers.numba_score import make_search
from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import HardSet

_INERTIA, _ATTRACTION, _CAP = 0.7298, 1.49618, 0.5
_SERIES = np.uint64(0x9E3779B97F4A7C15)


@njit
def _mixed(seed):
    """A well-mixed start for the random stream of a particle (finaliser of splitmix64)."""
    z = seed * _SERIES + _SERIES
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (z ^ (z >> np.uint64(31))) | np.uint64(1)


@njit
def _next(state):
    """Xorshift: the state after; its upper and lower halves are two uniform numbers."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    return state ^ (state << np.uint64(17))


@njit
def _upper(state):
    return np.float64(state >> np.uint64(32)) * 2.0**-32


@njit
def _lower(state):
    return np.float64(state & np.uint64(0xFFFFFFFF)) * 2.0**-32


@njit(fastmath=True)
def _start(particle, seed, position, velocity, state):
    stream = _mixed(np.uint64(seed) * np.uint64(1 << 20) + np.uint64(particle))
    for d in range(5):
        stream = _next(stream)
        position[particle, d] = 2.0 * _upper(stream) - 1.0
        # Half the way to another random place.
        velocity[particle, d] = 0.5 * (2.0 * _lower(stream) - 1.0 - position[particle, d])
    state[particle] = stream


@njit(fastmath=True)
def _move(particle, position, velocity, state, best, best_score):
    particles = len(best_score)
    leader = particle
    for shift in (-2, -1, 1, 2):
        other = (particle + shift) % particles
        if best_score[other] > best_score[leader]:
            leader = other
    stream = state[particle]
    for d in range(5):
        stream = _next(stream)
        x = position[particle, d]
        v = _INERTIA * velocity[particle, d]
        v += _ATTRACTION * _upper(stream) * (best[particle, d] - x) + _ATTRACTION * _lower(stream) * (
            best[leader, d] - x
        )
        v = min(_CAP, max(-_CAP, v))
        x += v
        if x > 1.0:
            x, v = 2.0 - x, -0.5 * v
        elif x < -1.0:
            x, v = -2.0 - x, -0.5 * v
        position[particle, d], velocity[particle, d] = x, v
    state[particle] = stream


def make_kernels(score: Any, prepare: Any) -> tuple[Any, Any, Any]:
    """Swarms on a score: serial, parallel over particles, and many scans in parallel."""

    @njit(fastmath=True)
    def keep_better(position, found, best, best_score):
        for particle in range(len(found)):
            if found[particle] > best_score[particle]:
                best_score[particle] = found[particle]
                best[particle] = position[particle]

    @njit(fastmath=True)
    def serial(rows, cross, frame, live, length, particles, iterations, seed):
        position, velocity = np.empty((particles, 5)), np.empty((particles, 5))
        best, best_score = np.empty((particles, 5)), np.full(particles, -np.float32(3.0))
        state, found = np.empty(particles, np.uint64), np.empty(particles, np.float32)
        for particle in range(particles):
            _start(particle, seed, position, velocity, state)
        for turn in range(iterations + 1):
            for particle in range(particles):
                if turn > 0:
                    _move(particle, position, velocity, state, best, best_score)
                found[particle] = score(rows, cross, frame, live, length, position[particle])
            keep_better(position, found, best, best_score)
        return best[np.argmax(best_score)]

    @njit(fastmath=True, parallel=True)
    def wide(rows, cross, frame, live, length, particles, iterations, seed):
        position, velocity = np.empty((particles, 5)), np.empty((particles, 5))
        best, best_score = np.empty((particles, 5)), np.full(particles, -np.float32(3.0))
        state, found = np.empty(particles, np.uint64), np.empty(particles, np.float32)
        for first in range(particles):
            _start(first, seed, position, velocity, state)
        for turn in range(iterations + 1):
            for index in prange(particles):
                particle = np.int64(index)  # unsigned before, and a float once a shift is added
                if turn > 0:
                    _move(particle, position, velocity, state, best, best_score)
                found[particle] = score(rows, cross, frame, live, length, position[particle])
            keep_better(position, found, best, best_score)
        return best[np.argmax(best_score)]

    @njit(fastmath=True, parallel=True)
    def many(rows, cross, frame, heard, ramp, length, particles, iterations, seeds):
        out = np.empty((len(seeds), 5))
        for scan in prange(len(seeds)):
            live = prepare(heard[scan], ramp)
            out[scan] = serial(rows, cross, frame, live, length, particles, iterations, seeds[scan])
        return out

    return serial, wide, many


def build(hard_set: HardSet, particles: int, iterations: int, full: bool, threads: int) -> Peer:
    """The peer on a hard set."""
    search = make_search(hard_set, full)
    serial, wide, many = make_kernels(search.score, search.prepare)
    centre, half_width = hard_set.prior[0], hard_set.half_width
    size = (particles, iterations)

    def run(kernel: Any, place: int, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        live = search.prepare(search.hear(samples), search.ramp)
        u = kernel(search.rows[place], search.cross, search.frame, live, search.length, *size, 1)
        return np.asarray(centre + half_width * u)

    chosen = serial
    if threads > 1:
        chosen = min((serial, wide), key=lambda kernel: _clock(run, kernel, hard_set))

    def locate_all(problems: Int[np.ndarray, " problem"]) -> Float[np.ndarray, "problem 5"]:
        poses = np.empty((len(problems), 5))
        for place in np.unique(hard_set.map_index[problems]):
            here = hard_set.map_index[problems] == place
            scans = hard_set.scans[problems[here]]
            map_of = (search.rows[place], search.cross, search.frame)
            poses[here] = many(*map_of, search.hear(scans), search.ramp, search.length, *size, 1 + problems[here])
        return np.asarray(centre + half_width * poses)

    setting = f"{'full' if full else 'band'} {particles}x{iterations}"
    evaluations = particles * (iterations + 1)
    return Peer("numba_swarm", setting, evaluations, lambda _: None, lambda place, s: run(chosen, place, s), locate_all)


def _clock(run: Any, kernel: Any, hard_set: HardSet) -> float:
    taken = []
    for problem in range(5):
        begin = time.perf_counter()
        run(kernel, int(hard_set.map_index[problem]), hard_set.scans[problem])
        taken.append(time.perf_counter() - begin)
    return min(taken)


def main() -> None:
    """The program."""
    chosen = arguments("numba_swarm", 256, 40).parse_args()
    work(chosen, lambda hard_set: build(hard_set, chosen.particles, chosen.iterations, chosen.full, chosen.threads))


if __name__ == "__main__":
    main()
