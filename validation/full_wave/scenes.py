"""The scene's side of the comparison: ground with nothing in it but what a test asks for."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.scene import (
    GroundConfig,
    Layers,
    RadarConfig,
    Scatterers,
    make_ground,
    render_traces,
    slice_ground,
    usual_conditions,
)
from validation.full_wave.echoes import LIGHT_M_PER_NS, RADAR
from validation.full_wave.fdtd_model import HEIGHT_M, PERMITTIVITY

# Scattering lengths of small objects: a denser one returns the pulse as it was sent, a void turns it over.
DENSE_STONE_M, VOID_STONE_M = 0.01, -0.01
VELOCITY_M_PER_NS = LIGHT_M_PER_NS / np.sqrt(PERMITTIVITY)


def render(
    antenna_m: Sequence[float],
    *,
    stones: Sequence[tuple[float, float, float]] = (),
    depth_m: float = 1.0,
    reflectivity: float = 0.0,
    relief_m: float = 0.0,
    wave_rad_per_m: float = 1.0,
    radar: RadarConfig = RADAR,
) -> Float[np.ndarray, "trace sample"]:
    """Traces of stones (along, depth, scattering length) and one interface, over soil without loss.

    The interface lies at depth + relief * sin(wave * along). The antenna stands over cross = 0, as the stones do.
    """
    config = GroundConfig(
        length_m=20.0,
        stones_per_m2=0.0,
        trees_per_100m=0.0,
        utilities_per_100m=0.0,
        utilities_along=0,
        moisture_rms=0.0,
        velocity_m_per_ns=VELOCITY_M_PER_NS,
        attenuation_per_m=0.0,
    )
    one = np.ones((1, 1))
    interface = Layers(
        depth_m=np.array([depth_m]),
        wave_rad_per_m=np.array([[[wave_rad_per_m, 0.0]]]),
        relief_m=relief_m * one,
        relief_phase_rad=0.0 * one,
        reflectivity_mean=np.array([reflectivity]),
        reflectivity=0.0 * one,
        reflectivity_phase_rad=0.0 * one,
    )
    along, depth, strength = np.array(sorted(stones), np.float64).reshape(-1, 3).T
    scatterers = Scatterers(np.column_stack([along, 0.0 * along, depth]), strength)
    ground = make_ground(0, config)._replace(scatterers=scatterers, layers=interface)
    piece = slice_ground(ground, -10.0, 10.0, stones=8, utilities=1)
    places = [(x, 0.0, HEIGHT_M) for x in antenna_m]
    return np.asarray(render_traces(piece, jnp.asarray(places, jnp.float32), radar=radar), np.float64)


def render_road(antenna_m: Sequence[float], *, velocity_factor: float = 1.0) -> Float[np.ndarray, "trace sample"]:
    """Traces of the usual ground with everything that it holds, the wave so many times as fast."""
    ground = make_ground(3, GroundConfig(length_m=max(antenna_m)))
    piece = slice_ground(ground, -3.0, max(antenna_m) + 3.0, stones=4096, conditions=usual_conditions(velocity_factor))
    places = [(x, 0.0, HEIGHT_M) for x in antenna_m]
    return np.asarray(render_traces(piece, jnp.asarray(places, jnp.float32), radar=RADAR), np.float64)
