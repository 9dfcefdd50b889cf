"""Refracted rays through the flat surface: travel time, angles and spreading, in closed form but for one root.

An antenna stands h above the surface; a target lies a aside and d below. The ray meets the surface at the
distance u before the target where Snell's law holds:

    (a - u) / sqrt((a - u)**2 + h**2) = n u / sqrt(u**2 + d**2)

Travel time is stationary in u (Fermat), so what is left of the root's error enters it squared.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

LIGHT_M_PER_NS = 0.299792458
_NEWTON_STEPS = 3  # leaves at most 2e-6 ns over all angles, heights of 0.1 m and more, n of 1.5 to 5


class Ray(NamedTuple):
    """A one-way ray from the antenna to the target.

    Attributes:
        air_m, ground_m: lengths of its two parts.
        cos_air, cos_ground: of the angles to the vertical.
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
        index: of refraction of the ground, > 1.
    """
    # The root lies between 0 and both the straight line's u and the critical angle's: start at the lesser of
    # the paraxial ray and that limit, from where Newton's steps are monotonic.
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
