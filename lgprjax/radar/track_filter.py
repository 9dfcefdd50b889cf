"""The track filter: a high-pass along the track that removes what is constant along the drive.

Surface return, antenna ringing and reflections of the vehicle do not change as the vehicle moves; the ground
does. The filter works in metres of travel, not in scans. Maps use the zero-phase form, live scans the causal
one; the causal form serves batch registration and the vehicle alike.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


class LiveFilterState(NamedTuple):
    """Running mean of every channel, carried from scan to scan.

    Attributes:
        mean: running mean of the profile.
        weight: how much travel the mean has seen, 0 (nothing) to 1 (long past the filter's length).
    """

    mean: Float[Array, "channel sample"]
    weight: Float[Array, " channel"]


def init_live_filter(channels: int, samples: int) -> LiveFilterState:
    """State before the first scan."""
    return LiveFilterState(jnp.zeros((channels, samples), jnp.float32), jnp.zeros(channels, jnp.float32))


@jax.jit
def run_live_filter(
    state: LiveFilterState,
    profile: Float[Array, "scan channel sample"],
    valid: Bool[Array, "scan channel"],
    travel_m: Float[Array, " scan"],
    length_m: Float[Array, ""],
) -> tuple[LiveFilterState, Float[Array, "scan channel sample"]]:
    """Subtract a causal running mean over about ``length_m`` metres of travel.

    The mean forgets with travel, not with time: it stands still while the vehicle stands, and travel in
    reverse counts as travel (``travel_m`` is the distance since the last scan, either sign). While little
    has been seen the mean is the plain average so far, so that start-up has no decaying first scan in it.

    Args:
        state: from the scan before.
        profile: profile traces; invalid ones may hold anything finite.
        valid: False leaves a channel's mean alone and returns zeros there.
        travel_m: signed distance travelled since the scan before.
        length_m: the filter's length.

    Returns:
        the state after the last scan, and the filtered profile.
    """

    def step(
        carry: LiveFilterState, scan: tuple[Array, Array, Array]
    ) -> tuple[LiveFilterState, Float[Array, "channel sample"]]:
        traces, ok, moved_m = scan
        # A mean of length L over the past has its centre L/2 back, as has an exponential one of L/2.
        forget = 1.0 - jnp.exp(-jnp.abs(moved_m) / (0.5 * length_m))
        first = ok & (carry.weight == 0.0)
        weight = jnp.where(ok, carry.weight + (1.0 - carry.weight) * forget, carry.weight)
        weight = jnp.where(first, jnp.maximum(forget, 1e-3), weight)
        rate = jnp.where(first, 1.0, jnp.where(ok, forget / jnp.maximum(weight, 1e-6), 0.0))
        mean = carry.mean + rate[:, None] * (jnp.where(ok[:, None], traces, 0.0) - carry.mean)
        out = jnp.where(ok[:, None], traces - mean, 0.0)
        return LiveFilterState(mean, weight), out

    return jax.lax.scan(step, state, (profile, valid, travel_m))


def zero_phase_filter(
    profile: Float[np.ndarray, "scan channel sample"],
    valid: Bool[np.ndarray, "scan channel"],
    stations: int,
) -> Float[np.ndarray, "scan channel sample"]:
    """Subtract the centred running mean over ``2 * (stations // 2) + 1`` equally spaced map stations.

    At the ends, and where stations are missing, the mean is over what there is. Host function: the map is
    built once, from stations that are already uniform in metres.
    """
    half = stations // 2
    count = np.cumsum(valid, axis=0, dtype=np.float64)[..., None]
    total = np.cumsum(np.where(valid[..., None], profile, 0.0), axis=0, dtype=np.float64)
    count, total = (np.concatenate([np.zeros_like(a[:1]), a]) for a in (count, total))
    scans = len(profile)
    last = np.minimum(np.arange(scans) + half + 1, scans)
    first = np.maximum(np.arange(scans) - half, 0)
    mean = (total[last] - total[first]) / np.maximum(count[last] - count[first], 1.0)
    return np.where(valid[..., None], profile - mean, 0.0).astype(np.float32)
