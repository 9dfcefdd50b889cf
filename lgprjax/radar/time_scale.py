"""Travel time stretched or shrunk about the surface return: what rain and drought do to a whole profile.

Wet soil slows the wave: an echo that came at t comes at s + scale (t - s), s the surface's travel time. A profile is
band-limited and sampled finer than its band needs, so sinc interpolation brings it back.
"""

from collections.abc import Callable
from functools import cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.radar.coefficients import LIGHT_SPEED_M_PER_NS
from lgprjax.radar.time_domain import ChainSettings, profile_operator


def time_scale_matrix(
    samples: int, kept: int, sample_interval_ns: float, *, scale: float, about_ns: float
) -> Float[np.ndarray, "sample kept"]:
    """Profile samples to those of the same ground with the stretching taken back; a factor for an operator's right.

    Args:
        samples: of the stretched profile.
        kept: of the profile as the map has it.
        sample_interval_ns: of both.
        scale: how much longer the way in the ground takes today than when the map was made.
        about_ns: travel time of the surface, which stays.

    Raises:
        ValueError: the scale is not above zero.
    """
    if not scale > 0:
        raise ValueError(f"a time scale is above zero, not {scale}")
    map_ns = np.arange(kept) * sample_interval_ns
    today_ns = np.where(map_ns > about_ns, about_ns + scale * (map_ns - about_ns), map_ns)
    return np.asarray(np.sinc(today_ns[None, :] / sample_interval_ns - np.arange(samples)[:, None]))


def stretched_samples(kept: int, scale: float) -> int:
    """Samples that a profile of today needs for ``kept`` of the map: its stretch, and the interpolation's skirt."""
    return int(np.ceil(kept * max(scale, 1.0))) + 8


def stretched_operator(
    recorded: Callable[[int], Float[Array, "recorded sample"]],
    kept: int,
    sample_interval_ns: float,
    *,
    scale: float,
    height_m: float,
) -> Float[Array, "recorded kept"]:
    """A recording's matrix to the profile samples of a map that was made when the ground was drier or wetter.

    Args:
        recorded: number of profile samples to the recording's own matrix.
        kept: samples of the map's profiles.
        sample_interval_ns: of both.
        scale: see ``time_scale_matrix``; 1 leaves the matrix as it is.
        height_m: of the array above the surface, whose return stays.
    """
    if scale == 1.0:
        return recorded(kept)
    samples = stretched_samples(kept, scale)
    about_ns = 2.0 * height_m / LIGHT_SPEED_M_PER_NS
    stretch = time_scale_matrix(samples, kept, sample_interval_ns, scale=scale, about_ns=about_ns)
    # On the host: every scale has a length of its own, and each would be a shape to compile.
    return jnp.asarray(np.asarray(recorded(samples), np.float64) @ stretch, dtype=jnp.float32)


def trace_operators(
    samples: int,
    sample_interval_ns: float,
    time_zero_ns: float,
    settings: ChainSettings,
    kept: int,
    *,
    height_m: float,
) -> Callable[[float], Float[Array, "recorded sample"]]:
    """Time scale to the matrix of live traces for a map, each made once.

    Args:
        samples, sample_interval_ns, time_zero_ns: of the traces.
        settings: of the map's chain.
        kept: samples of its profiles.
        height_m: of the array above the surface.
    """

    def recorded(number: int) -> Float[Array, "recorded sample"]:
        return profile_operator(samples, sample_interval_ns, time_zero_ns, settings, kept=number)

    @cache
    def operator(time_scale: float) -> Float[Array, "recorded sample"]:
        return stretched_operator(recorded, kept, settings.sample_interval_ns, scale=time_scale, height_m=height_m)

    return operator
