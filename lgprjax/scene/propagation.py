"""Conversion of echoes in time bins to a radar's recording in its band: traces, or sweeps.

Loss that grows with frequency depends on an echo's time in the ground. In homogeneous soil that is a function of the
arrival time alone, so propagation, band and wavelet together are one matrix from time bins to samples (or to
frequencies), computed once on the host.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from lgprjax.scene.day import Conditions, usual_conditions
from lgprjax.scene.ground import Ground, Layers, SineField, Utilities, field_about, value_at

# Refracted rays through the flat surface: travel time, angles and spreading, in closed form except for one root.
#
# An antenna is h above the surface; a target is a aside and d below. The ray meets the surface at the distance u before
# the target where Snell's law holds:
#
#     (a - u) / sqrt((a - u)**2 + h**2) = n u / sqrt(u**2 + d**2)
#
# Travel time is stationary in u (Fermat), so that the remaining error of the root enters squared.

LIGHT_M_PER_NS = 0.299792458
_NEWTON_STEPS = 3  # leaves at most 2e-6 ns over all angles, heights of 0.1 m and more, n of 1.5 to 5


class Ray(NamedTuple):
    """A one-way ray from the antenna to the target.

    Attributes:
        air_m, ground_m: lengths of the parts in air and in the ground.
        cos_air, cos_ground: cosines of the angles to the vertical.
        spread_m: (out of plane, in plane) spreading of the ray tube: the field falls with the root of their product,
            one way. For a ray straight down both are h + d/n.
    """

    air_m: Float[Array, "*#ray"]
    ground_m: Float[Array, "*#ray"]
    cos_air: Float[Array, "*#ray"]
    cos_ground: Float[Array, "*#ray"]
    spread_m: tuple[Float[Array, "*#ray"], Float[Array, "*#ray"]]


def refract(
    aside_m: Float[Array, "*#ray"],
    height_m: Float[Array, "*#ray"],
    depth_m: Float[Array, "*#ray"],
    index: Float[Array, ""],
) -> Ray:
    """The ray over ``aside_m`` between ``height_m`` above and ``depth_m`` (> 0) below the surface.

    Args:
        index: refractive index of the ground, > 1.
    """
    # The root is between 0 and the lesser of the straight line's u and the critical angle's. The start is the lesser of
    # the paraxial ray and that limit, from which Newton's steps are monotonic.
    paraxial = aside_m * depth_m / (depth_m + index * height_m)
    critical = depth_m / jnp.sqrt(index**2 - 1.0)
    u = jnp.minimum(paraxial, 0.98 * jnp.minimum(critical, aside_m))
    for _ in range(_NEWTON_STEPS):
        air2 = (aside_m - u) ** 2 + height_m**2
        ground2 = u**2 + depth_m**2
        air_sine = (aside_m - u) / jnp.sqrt(air2)
        ground_sine = u / jnp.sqrt(ground2)
        slope = index * depth_m**2 / (ground2 * jnp.sqrt(ground2)) + height_m**2 / (air2 * jnp.sqrt(air2))
        u = jnp.clip(u - (index * ground_sine - air_sine) / slope, 0.0, jnp.minimum(critical, aside_m))
    air_m = jnp.sqrt((aside_m - u) ** 2 + height_m**2)
    ground_m = jnp.sqrt(u**2 + depth_m**2)
    cos_air, cos_ground = height_m / air_m, depth_m / ground_m
    out_of_plane = air_m + ground_m / index
    in_plane = (height_m / cos_air**2 + depth_m * cos_air / (index * cos_ground**3)) * cos_ground
    return Ray(air_m, ground_m, cos_air, cos_ground, (out_of_plane, in_plane))


def passage(ray: Ray, index: Float[Array, ""]) -> Float[Array, "*#ray"]:
    """Into the ground and out again, (1 + G)(1 - G), with Fresnel's G for a field across the plane of incidence."""
    reflection = (ray.cos_air - index * ray.cos_ground) / (ray.cos_air + index * ray.cos_ground)
    return 1.0 - reflection**2


MIDDLE_MHZ = 250.0
"""The frequency at which a ground's attenuation and velocity are given."""


@dataclass(frozen=True)
class RadarConfig:
    """The radar's time axis, band and field of view (defaults: the array of RA-L 2020).

    Attributes:
        samples, sample_step_ns, time_zero_ns: sample k is taken k * step - time_zero after transmission.
        band_mhz, band_edge_mhz: the spectrum is flat inside and falls to zero at the band's ends as a cosine.
        tail_ns: time past the trace's end for which echoes are computed, because their wavelets reach into it.
        aperture_m: largest horizontal distance of stones that return an echo (faded out over the last quarter).
        height_m: height of the array at rest, where the time gain and the loss in the ground begin.
    """

    samples: int = 369
    sample_step_ns: float = 0.16
    time_zero_ns: float = 4.0
    band_mhz: tuple[float, float] = (100.0, 400.0)
    band_edge_mhz: float = 100.0
    tail_ns: float = 16.0
    aperture_m: float = 2.0
    height_m: float = 0.3

    @property
    def bins(self) -> int:
        """Number of time bins of the echoes; bin k has the time of sample k."""
        return self.samples + round(self.tail_ns / self.sample_step_ns)

    @property
    def bin_ns(self) -> Float[np.ndarray, " bin"]:
        """Time of each bin after transmission, ns."""
        return np.asarray(np.arange(self.bins) * self.sample_step_ns - self.time_zero_ns)


def band_spectrum(
    radar: RadarConfig, frequency_mhz: Float[np.ndarray, " frequency"]
) -> Float[np.ndarray, " frequency"]:
    """The radar's spectrum: 1 inside the band, cosine edges."""
    low, high = radar.band_mhz
    inside = np.minimum(frequency_mhz - low, high - frequency_mhz)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(inside / radar.band_edge_mhz, 0.0, 1.0)))


def propagation(
    radar: RadarConfig,
    frequency_mhz: Float[np.ndarray, " frequency"],
    *,
    velocity_m_per_ns: float,
    attenuation_per_m: float,
    dispersive_share: float,
) -> Complex[np.ndarray, "bin frequency"]:
    """Response at each frequency to an echo of 1 in each time bin: delay, and effects of the ground beyond its mean
    loss.

    The dispersive share of the attenuation grows in proportion to the frequency (constant Q) and the velocity
    with it, as causality demands: k(f) = 2 pi f / v * (1 - ln(f / f0) / (pi Q)), 1/Q = share * a * v / (pi f0).
    """
    time_ns = radar.bin_ns
    in_ground_ns = np.maximum(time_ns - 2 * radar.height_m / LIGHT_M_PER_NS, 0.0)
    f0 = MIDDLE_MHZ * 1e-3
    f = frequency_mhz * 1e-3
    inverse_q = dispersive_share * attenuation_per_m * velocity_m_per_ns / (np.pi * f0)
    loss = np.exp(-np.pi * inverse_q * np.outer(in_ground_ns, f - f0))
    late = in_ground_ns[:, None] * (inverse_q / np.pi * np.log(np.maximum(f, 1e-6) / f0))[None, :]
    return np.asarray(loss * np.exp(-2j * np.pi * f[None, :] * (time_ns[:, None] - late)))


@lru_cache(maxsize=16)
def trace_matrix(
    radar: RadarConfig, *, velocity_m_per_ns: float, attenuation_per_m: float, dispersive_share: float
) -> Float[np.ndarray, "bin sample"]:
    """Echoes in time bins to traces: the zero-phase wavelet of the band, its peak 1, dulled by the way.

    On two cores the product takes 2.2 ms for 704 traces, a pair of FFTs 3.0 ms; and it cannot wrap around.
    """
    low, high = radar.band_mhz
    frequency_mhz = np.arange(low, high, 0.5) + 0.25
    spectrum = band_spectrum(radar, frequency_mhz)
    echo = propagation(
        radar,
        frequency_mhz,
        velocity_m_per_ns=velocity_m_per_ns,
        attenuation_per_m=attenuation_per_m,
        dispersive_share=dispersive_share,
    )
    sample_ns = radar.bin_ns[: radar.samples]
    back = np.exp(2e-3j * np.pi * np.outer(frequency_mhz, sample_ns)) * (spectrum / spectrum.sum())[:, None]
    return np.asarray((echo @ back).real, np.float32)


def make_wavelet(radar: RadarConfig) -> Float[np.ndarray, " tap"]:
    """The band's zero-phase wavelet over +- the tail, its peak of 1 in the middle."""
    low, high = radar.band_mhz
    frequency_mhz = np.arange(low, high, 0.5) + 0.25
    spectrum = band_spectrum(radar, frequency_mhz)
    tail = radar.bins - radar.samples
    time_ns = np.arange(-tail, tail + 1) * radar.sample_step_ns
    return np.asarray(np.cos(2e-3 * np.pi * np.outer(time_ns, frequency_mhz)) @ (spectrum / spectrum.sum()))


def sweep_matrix(
    radar: RadarConfig,
    frequency_mhz: Float[np.ndarray, " frequency"],
    *,
    velocity_m_per_ns: float,
    attenuation_per_m: float,
    dispersive_share: float,
) -> Float[np.ndarray, "bin recorded"]:
    """Echoes in time bins to sweeps: all real parts, then all imaginary parts."""
    echo = propagation(
        radar,
        frequency_mhz,
        velocity_m_per_ns=velocity_m_per_ns,
        attenuation_per_m=attenuation_per_m,
        dispersive_share=dispersive_share,
    )
    return np.concatenate([echo.real, echo.imag], axis=1).astype(np.float32)


# The part of the ground that a block of scans can see, in float32 about the block's own origin.

TRENCHES = 2


class GroundSlice(NamedTuple):
    """Ground within reach of a block of scans; rows of strength 0 are padding.

    The arrays are NumPy's on the host and JAX's inside a compiled function.

    Attributes:
        stone_m, stone_strength_m: (along, cross, depth) and scattering length of stones and roots.
        stone_slowness: slowness of the ground between the surface and the stone, relative to the day's mean.
        utilities, layers: utilities and layers of the ground.
        moisture: relative slowness as fields over place: permanent, and of the day.
        skin_m, skin_slowness: see ``Conditions``.
        cover_m: thickness of the snow.
        cover: (index, attenuation_per_m, lift, reflectivity) of the snow.
        trenches: (from along, to along, from cross, to cross, depth), one row per trench.
        velocity_m_per_ns, attenuation_per_m: velocity and attenuation of the day.
        dispersive_share: see ``GroundConfig``.
    """

    stone_m: Float[np.ndarray, "stone 3"]
    stone_strength_m: Float[np.ndarray, " stone"]
    stone_slowness: Float[np.ndarray, " stone"]
    utilities: Utilities
    layers: Layers
    moisture: tuple[SineField, SineField]
    skin_m: SineField
    skin_slowness: Float[np.ndarray, ""]
    cover_m: SineField
    cover: Float[np.ndarray, "4"]
    trenches: Float[np.ndarray, "trench 5"]
    velocity_m_per_ns: Float[np.ndarray, ""]
    attenuation_per_m: Float[np.ndarray, ""]
    dispersive_share: Float[np.ndarray, ""]


def count_stones(ground: Ground, from_m: Float[np.ndarray, " block"], to_m: Float[np.ndarray, " block"]) -> int:
    """Most stones found in any of the windows [from, to] along the track."""
    along = ground.scatterers.place_m[:, 0]
    return int(np.max(np.searchsorted(along, to_m) - np.searchsorted(along, from_m)))


def count_utilities(ground: Ground, from_m: Float[np.ndarray, " block"], to_m: Float[np.ndarray, " block"]) -> int:
    """Most pipes and cables that reach into any of the windows [from, to] along the track."""
    low, high = _extent(ground.utilities)
    return int(np.max(np.sum((high[None] >= from_m[:, None]) & (low[None] <= to_m[:, None]), axis=1), initial=0))


def slice_ground(
    ground: Ground,
    from_m: float,
    to_m: float,
    *,
    stones: int,
    utilities: int = 8,
    origin_m: tuple[float, float] = (0.0, 0.0),
    conditions: Conditions | None = None,
) -> GroundSlice:
    """Cuts the window [from, to] along the track out of the ground, relative to ``origin_m`` (along, cross).

    Args:
        stones, utilities: numbers of rows of the result, the same for all blocks of a drive to avoid recompilation.
        conditions: conditions of the day; ``None``: the ground of its config.

    Raises:
        ValueError: the window holds more stones or utilities than rows, or more than ``TRENCHES`` trenches.
    """
    conditions = usual_conditions() if conditions is None else conditions
    place_m, strength_m = ground.scatterers
    first, last = (int(i) for i in np.searchsorted(place_m[:, 0], [from_m, to_m]))
    if last - first > stones:
        raise ValueError(f"window [{from_m}, {to_m}] holds {last - first} stones, more than {stones}")
    origin = np.asarray(origin_m, np.float64)
    seen = place_m[first:last]
    place = np.zeros((stones, 3), np.float32)
    place[:, 2] = 1.0  # padding at a harmless depth avoids division by zero
    place[: len(seen)] = seen - np.append(origin, 0.0)
    strength = np.zeros(stones, np.float32)
    strength[: len(seen)] = strength_m[first:last]
    slowness = np.ones(stones, np.float32)
    moisture = value_at(ground.moisture, seen[:, :2]) + value_at(conditions.moisture, seen[:, :2])
    in_skin = np.clip(value_at(conditions.skin_m, seen[:, :2]), 0.0, seen[:, 2]) / seen[:, 2]
    slowness[: len(seen)] = 1.0 + moisture + conditions.skin_slowness * in_skin
    turn = ground.layers.wave_rad_per_m @ origin
    layers = ground.layers._replace(
        relief_phase_rad=np.mod(ground.layers.relief_phase_rad + turn, 2 * np.pi),
        reflectivity_phase_rad=np.mod(ground.layers.reflectivity_phase_rad + turn, 2 * np.pi),
    )
    cover = conditions.cover
    return GroundSlice(
        stone_m=place,
        stone_strength_m=strength,
        stone_slowness=slowness,
        utilities=_near(ground.utilities, from_m, to_m, origin, utilities),
        layers=Layers(*(a.astype(np.float32) for a in layers)),
        moisture=(field_about(ground.moisture, origin), field_about(conditions.moisture, origin)),
        skin_m=field_about(conditions.skin_m, origin),
        skin_slowness=np.asarray(conditions.skin_slowness, np.float32),
        cover_m=field_about(conditions.cover_m, origin),
        cover=np.array([cover.index, cover.attenuation_per_m, cover.lift, cover.reflectivity], np.float32),
        trenches=_trenches_within(conditions.trenches, from_m, to_m, origin),
        velocity_m_per_ns=np.asarray(ground.config.velocity_m_per_ns * conditions.velocity_factor, np.float32),
        attenuation_per_m=np.asarray(ground.config.attenuation_per_m * conditions.attenuation_factor, np.float32),
        dispersive_share=np.asarray(ground.config.dispersive_share, np.float32),
    )


def _extent(utilities: Utilities) -> tuple[Float[np.ndarray, " utility"], Float[np.ndarray, " utility"]]:
    reach = np.abs(utilities.direction[:, 0]) * utilities.half_length_m
    return utilities.centre_m[:, 0] - reach, utilities.centre_m[:, 0] + reach


def _near(utilities: Utilities, from_m: float, to_m: float, origin_m: Float[np.ndarray, "2"], rows: int) -> Utilities:
    """The utilities that reach into the window, relative to the origin."""
    low, high = _extent(utilities)
    inside = (high >= from_m) & (low <= to_m)
    if inside.sum() > rows:
        raise ValueError(f"window [{from_m}, {to_m}] holds {inside.sum()} utilities, more than {rows}")
    out = Utilities(
        centre_m=np.zeros((rows, 2), np.float32),
        direction=np.tile(np.array([1.0, 0.0], np.float32), (rows, 1)),
        half_length_m=np.zeros(rows, np.float32),
        depth_m=np.ones(rows, np.float32),
        radius_m=np.ones(rows, np.float32),
        reflectivity=np.zeros(rows, np.float32),
    )
    near = Utilities(*(a[inside] for a in utilities))
    near = near._replace(centre_m=near.centre_m - origin_m)
    for padded, kept in zip(out, near, strict=True):
        padded[: len(kept)] = kept
    return out


def _trenches_within(
    trenches: Float[np.ndarray, "trench 5"], from_m: float, to_m: float, origin_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "kept 5"]:
    """The trenches that reach into the window, relative to the origin; padding rows are far away."""
    inside = trenches[(trenches[:, 1] >= from_m) & (trenches[:, 0] <= to_m)]
    if len(inside) > TRENCHES:
        raise ValueError(f"window [{from_m}, {to_m}] holds {len(inside)} trenches, more than {TRENCHES}")
    out = np.full((TRENCHES, 5), 1e6)
    out[:, 4] = 0.0
    out[: len(inside)] = inside
    out[:, :2] -= origin_m[0]
    out[:, 2:4] -= origin_m[1]
    return out.astype(np.float32)
