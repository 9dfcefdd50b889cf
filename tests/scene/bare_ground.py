"""Ground with nothing in it but what a test asks for, and how its traces are read."""

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.scene import (
    Conditions,
    Day,
    Ground,
    GroundConfig,
    Layers,
    RadarConfig,
    Scatterers,
    Utilities,
    make_wavelet,
    render_traces,
    slice_ground,
)
from lgprjax.scene.ground import constant_field

RADAR = RadarConfig()
LIGHT_M_PER_NS = 0.299792458
CONFIG = GroundConfig(length_m=30.0, stones_per_m2=0.0, waves=1, velocity_m_per_ns=0.1, dispersive_share=0.0)
INDEX = LIGHT_M_PER_NS / 0.1
SPOTLESS = Day(
    seed=1,
    noise_field=0.0,
    gain_spread=0.0,
    delay_spread_ns=0.0,
    coupling_spread=0.0,
    velocity_spread=0.0,
    moisture_rms=0.0,
    clutter_per_m2=0.0,
)
_TRACES = 16
Point = tuple[float, float, float]


def one_layer(depth_m: float = 1.0, reflectivity: float = 0.0, slope: float = 0.0) -> Layers:
    """An interface that falls by ``slope`` along the track within some metres of the origin."""
    one = np.ones((1, 1))
    wave_rad_per_m = 1e-3
    return Layers(
        depth_m=np.array([depth_m]),
        wave_rad_per_m=np.array([[[wave_rad_per_m, 0.0]]]),
        relief_m=slope / wave_rad_per_m * one,
        relief_phase_rad=0.0 * one,
        reflectivity_mean=np.array([reflectivity]),
        reflectivity=0.0 * one,
        reflectivity_phase_rad=0.0 * one,
    )


def pipes(*rows: tuple[float, float, float, float, float, float]) -> Utilities:
    """Long cylinders: (along, cross, angle_rad, depth, radius, reflectivity)."""
    along, cross, angle, depth, radius, reflectivity = np.array(rows, np.float64).reshape(-1, 6).T
    return Utilities(
        centre_m=np.column_stack([along, cross]),
        direction=np.column_stack([np.cos(angle), np.sin(angle)]),
        half_length_m=np.full(len(along), 10.0),
        depth_m=depth,
        radius_m=radius,
        reflectivity=reflectivity,
    )


def ground_of(
    stones: Sequence[Point] = (),
    strengths: Sequence[float] = (),
    *,
    layer: Layers | None = None,
    utilities: Utilities | None = None,
    attenuation_per_m: float = 0.7,
    dispersive_share: float = 0.0,
) -> Ground:
    """Stones (along, cross, depth), sorted along; one interface; pipes; moist all alike."""
    return Ground(
        replace(CONFIG, attenuation_per_m=attenuation_per_m, dispersive_share=dispersive_share),
        Scatterers(np.array(stones, np.float64).reshape(-1, 3), np.array(strengths, np.float64)),
        pipes() if utilities is None else utilities,
        one_layer() if layer is None else layer,
        constant_field(0.0, 2),
    )


def render(
    ground: Ground, antenna_m: Sequence[Point], *, conditions: Conditions | None = None, origin_m: float = 0.0
) -> Float[np.ndarray, "trace sample"]:
    """Traces at places about the origin, in float64; all calls share one compiled program."""
    window = (origin_m - 10.0, origin_m + 10.0)
    piece = slice_ground(ground, *window, stones=16, utilities=4, origin_m=(origin_m, 0.0), conditions=conditions)
    places = np.array(list(antenna_m) + [antenna_m[-1]] * (_TRACES - len(antenna_m)), np.float32)
    return np.asarray(render_traces(piece, jnp.asarray(places), radar=RADAR), np.float64)[: len(antenna_m)]


def peak_of(trace: Float[np.ndarray, " sample"]) -> tuple[float, float]:
    """Time in ns and value of the strongest peak, through a parabola."""
    at = int(np.argmax(np.abs(trace)))
    left, top, right = trace[at - 1 : at + 2]
    beside = 0.5 * (left - right) / (left - 2 * top + right)
    time_ns = (at + beside) * RADAR.sample_step_ns - RADAR.time_zero_ns
    return float(time_ns), float(top - 0.25 * (left - right) * beside)


def wavelets_at(time_ns: Float[np.ndarray, " echo"], field: Float[np.ndarray, " echo"]) -> Float[np.ndarray, " sample"]:
    """Float64 sum of wavelets, each read at its echo's exact time from an eight times finer axis."""
    fine = replace(RADAR, sample_step_ns=RADAR.sample_step_ns / 8)
    taps = make_wavelet(fine)
    tap_ns = (np.arange(taps.size) - taps.size // 2) * fine.sample_step_ns
    sample_ns = np.arange(RADAR.samples) * RADAR.sample_step_ns - RADAR.time_zero_ns
    waves = np.interp(sample_ns[None, :] - time_ns[:, None], tap_ns, taps, left=0.0, right=0.0)
    return np.asarray(field @ waves)


def fermat(aside_m: float, height_m: float, depth_m: float, index: float = INDEX) -> tuple[float, float, float]:
    """The quickest one-way path by search, in float64: time in ns, metres in air, metres in the ground."""
    low, high = 0.0, aside_m
    for _ in range(9):
        entry = np.linspace(low, high, 201)
        path = np.hypot(entry, height_m) + index * np.hypot(aside_m - entry, depth_m)
        best = int(np.argmin(path))
        low, high = entry[max(best - 2, 0)], entry[min(best + 2, 200)]
    air, ground = np.hypot(entry[best], height_m), np.hypot(aside_m - entry[best], depth_m)
    return float(path[best]) / LIGHT_M_PER_NS, float(air), float(ground)
