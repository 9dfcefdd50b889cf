"""The direct score in JAX for the peers that search with it: bilinear map under the antennas, r over channels."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from benchmarks.peers.worker import Peer
from benchmarks.registration import CHANNEL_LEFT_M, LIGHT_SPEED_M_PER_NS, SAMPLE_INTERVAL_NS, HardSet

_PER_M = 2.0 / LIGHT_SPEED_M_PER_NS
_MARGIN = 8

BoxScore = Callable[[Float[Array, "particle 5"]], Float[Array, " particle"]]
BoxSearch = Callable[[Key[Array, ""], BoxScore], Float[Array, " 5"]]
"""A search of the box [-1, 1]^5 for the highest score."""


class Constants(NamedTuple):
    """Arrays of a hard set that a jitted score takes.

    Attributes:
        rows: numbers of each node of each map.
        basis: samples to numbers of the band.
        omega: rad/ns.
        origin_m, cell_m: of the grid.
        centre, half_width: of the box.
    """

    rows: Float[Array, "map node number"]
    basis: Float[Array, "sample coefficient"]
    omega: Float[Array, " half"]
    origin_m: Float[Array, "2"]
    cell_m: Float[Array, "2"]
    centre: Float[Array, "5"]
    half_width: Float[Array, "5"]


def make_peer(hard_set: HardSet, name: str, setting: str, evaluations: int, full: bool, search: BoxSearch) -> Peer:
    """A peer that runs ``search`` on the direct score: one scan a call, or scans one after another in one call."""
    maps, _, cross, numbers = hard_set.ground.shape
    flat = hard_set.ground.reshape(maps, -1, numbers)
    basis = hard_set.basis.astype(np.float32)
    constants = Constants(
        *(
            jnp.asarray(part, dtype=jnp.float32)
            for part in (
                flat @ basis.T if full else flat,
                *(basis, hard_set.omega, hard_set.origin_m, hard_set.cell_m),
                *(hard_set.prior[0], hard_set.half_width),
            )
        )
    )

    def one(
        constants: Constants, place: Int[Array, ""], samples: Float[Array, "channel sample"], key: Key[Array, ""]
    ) -> Float[Array, " 5"]:
        live = samples if full else samples @ constants.basis

        def score(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
            return correlation(constants, place, cross, live, constants.centre + constants.half_width * u, full)

        return constants.centre + constants.half_width * search(key, score)

    single = jax.jit(one)
    many = jax.jit(lambda constants, scans: jax.lax.map(lambda scan: one(constants, *scan), scans))
    key = jax.random.key(1)

    def locate_all(problems: Int[np.ndarray, " problem"]) -> Float[np.ndarray, "problem 5"]:
        keys = jax.random.split(key, len(problems))
        places = jnp.asarray(hard_set.map_index[problems])
        return np.asarray(many(constants, (places, hard_set.scans[problems], keys)))

    def locate(place: int, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        return np.asarray(single(constants, jnp.asarray(place), samples, key))

    return Peer(name, setting, evaluations, lambda _: None, locate, locate_all)


def correlation(
    constants: Constants,
    place: Int[Array, ""],
    cross: int,
    live: Float[Array, "channel number"],
    pose: Float[Array, "particle 5"],
    full: bool,
) -> Float[Array, " particle"]:
    """r of a scan with map ``place`` at each pose; the map reaches beyond the box, so nothing is masked."""
    left = jnp.asarray(CHANNEL_LEFT_M, dtype=jnp.float32)
    cos, sin = jnp.cos(pose[:, 3, None]), jnp.sin(pose[:, 3, None])
    x = (pose[:, 0, None] - sin * left - constants.origin_m[0]) / constants.cell_m[0]
    y = (pose[:, 1, None] + cos * left - constants.origin_m[1]) / constants.cell_m[1]
    i, j = x.astype(jnp.int32), y.astype(jnp.int32)
    a, b = (x - i)[..., None], (y - j)[..., None]
    node = i * cross + j
    rows = constants.rows
    ground = rows[place, node] * ((1 - a) * (1 - b)) + rows[place, node + 1] * ((1 - a) * b)
    ground += rows[place, node + cross] * (a * (1 - b)) + rows[place, node + cross + 1] * (a * b)
    delay_ns = _PER_M * (pose[:, 2, None] - constants.centre[2] + left * jnp.sin(pose[:, 4, None]))
    shifted = _earlier_samples(live, delay_ns) if full else _earlier_band(live, delay_ns, constants.omega)
    product = jnp.sum(shifted * ground, axis=(-2, -1))
    power = jnp.sum(ground**2, axis=(-2, -1)) * jnp.sum(shifted**2, axis=(-2, -1))
    return product / jnp.sqrt(power + 1e-30)


def _earlier_band(
    live: Float[Array, "channel number"], delay_ns: Float[Array, "particle channel"], omega: Float[Array, " half"]
) -> Float[Array, "particle channel number"]:
    angle = delay_ns[..., None] * omega
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    real, imaginary = live[None, :, : len(omega)], live[None, :, len(omega) :]
    return jnp.concatenate([real * cos - imaginary * sin, imaginary * cos + real * sin], axis=-1)


def _earlier_samples(
    live: Float[Array, "channel number"], delay_ns: Float[Array, "particle channel"]
) -> Float[Array, "particle channel number"]:
    """Linear interpolation in time; circular, as the map's frequencies are."""
    later = delay_ns / SAMPLE_INTERVAL_NS
    first = jnp.floor(later)
    part = (later - first)[..., None]
    samples = live.shape[1]
    padded = jnp.concatenate([live[:, -_MARGIN:], live, live[:, :_MARGIN]], axis=1)

    def cut(row: Float[Array, " wide"], begin: Int[Array, ""]) -> Float[Array, " window"]:
        return jax.lax.dynamic_slice(row, (begin + _MARGIN,), (samples + 1,))

    near = jax.vmap(jax.vmap(cut), in_axes=(None, 0))(padded, first.astype(jnp.int32))
    return (1 - part) * near[..., :-1] + part * near[..., 1:]
