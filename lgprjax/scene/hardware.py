"""The radar's own errors: antennas and cables of the array, the day's spread, and what goes wrong during a drive."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.scene.day import Day
from lgprjax.scene.fields import device_value_at
from lgprjax.scene.propagation import RadarConfig
from lgprjax.scene.rays import LIGHT_M_PER_NS
from lgprjax.scene.render import place_echoes, place_ground_echoes, snow_over
from lgprjax.scene.slices import GroundSlice

# Direct coupling between neighbours, then two reflections of the vehicle: time after transmission and field.
COUPLING_NS = (0.42, 1.6, 3.1)
COUPLING_FIELD = (0.5, -0.2, 0.1)
HARDWARE_SEED = 20  # the same array on every day


@dataclass(frozen=True)
class Faults:
    """What goes wrong in the receiver during a drive.

    Attributes:
        gain_drift: relative change of the receiver's gain from the drive's start to its end (it warms up).
        phase_drift_rad: change of its phase (heard in sweeps only).
        dropped_share: of the scans, lost between radar and recorder.
        clipped_share: of the scans, received four times too loud.
        interference_share, interference_field: of the scans hit by a transmitter in the band, and how loudly.
        dead_channels: channels whose antenna is not connected.
    """

    gain_drift: float = 0.05
    phase_drift_rad: float = 0.1
    dropped_share: float = 0.001
    clipped_share: float = 0.001
    interference_share: float = 0.002
    interference_field: float = 0.01
    dead_channels: tuple[int, ...] = ()


NO_FAULTS = Faults(0.0, 0.0, 0.0, 0.0, 0.0)


class Response(NamedTuple):
    """Errors of each channel on one day."""

    gain: Float[np.ndarray, " channel"]
    delay_ns: Float[np.ndarray, " channel"]
    surface: Float[np.ndarray, " channel"]
    coupling: Float[np.ndarray, "channel path"]


class ScanErrors(NamedTuple):
    """Errors of each scan.

    Attributes:
        gain, phase_rad: of the receiver.
        interference: its field, 0 for most scans; its frequency.
    """

    gain: Float[np.ndarray, " scan"]
    phase_rad: Float[np.ndarray, " scan"]
    interference: Float[np.ndarray, " scan"]
    interference_mhz: Float[np.ndarray, " scan"]


def draw_response(day: Day, channels: int, faults: Faults) -> Response:
    """The array's errors on a day: a part that belongs to the hardware (coupling) and a part of the day."""
    hardware = np.random.default_rng(HARDWARE_SEED)
    rng = np.random.default_rng([day.seed, 1])
    coupling = np.asarray(COUPLING_FIELD) * (1 + 0.1 * hardware.normal(size=(channels, len(COUPLING_FIELD))))
    gain = 1 + day.gain_spread * rng.normal(size=channels)
    response = Response(
        gain=np.where(np.isin(np.arange(channels), faults.dead_channels), 0.0, gain),
        delay_ns=day.delay_spread_ns * rng.normal(size=channels),
        surface=1 + day.coupling_spread * rng.normal(size=channels),
        coupling=coupling * (1 + day.coupling_spread * rng.normal(size=coupling.shape)),
    )
    return Response(*(a.astype(np.float32) for a in response))


def draw_scan_errors(faults: Faults, scans: int, band_mhz: tuple[float, float], seed: int) -> ScanErrors:
    """Drift over the drive, loud scans, interference."""
    rng = np.random.default_rng([seed, 8])
    course = np.linspace(0.0, 1.0, scans)
    # Warming up is quick at first.
    warm = (1 - np.exp(-3 * course)) / (1 - np.exp(-3))
    loud = np.where(rng.uniform(size=scans) < faults.clipped_share, 4.0, 1.0)
    hit = rng.uniform(size=scans) < faults.interference_share
    errors = ScanErrors(
        gain=(1 + faults.gain_drift * warm) * loud,
        phase_rad=faults.phase_drift_rad * warm,
        interference=np.where(hit, faults.interference_field * rng.exponential(size=scans), 0.0),
        interference_mhz=rng.uniform(*band_mhz, scans),
    )
    return ScanErrors(*(a.astype(np.float32) for a in errors))


def kept_scans(faults: Faults, scans: int, seed: int) -> np.ndarray:
    """Numbers of the scans that reach the recorder; the first and the last always do."""
    lost = np.random.default_rng([seed, 9]).uniform(size=scans) < faults.dropped_share
    lost[[0, -1]] = False
    return np.flatnonzero(~lost)


def heard_echoes(
    ground: GroundSlice,
    place_m: Float[Array, "trace 3"],
    response: Response,
    *,
    radar: RadarConfig,
) -> Float[Array, "trace bin"]:
    """All that a channel hears, in time bins: ground, surface, snow, coupling; its gain and delay included.

    Args:
        place_m: (along, cross, height above the ground) of every trace, scan after scan.
    """
    scans = place_m.shape[0] // response.gain.shape[0]
    delay_ns = jnp.tile(jnp.asarray(response.delay_ns), scans)
    echoes = place_ground_echoes(ground, place_m, delay_ns, radar=radar)

    index, _, _, snow_reflectivity = jnp.asarray(ground.cover)
    snow_ns, snow_loss, lift_m = snow_over(ground, place_m)
    height_m = place_m[:, 2] + lift_m
    thickness_m = snow_ns * LIGHT_M_PER_NS / (2.0 * jnp.maximum(index - 1.0, 1e-6))
    moisture = sum(device_value_at(m, place_m[:, :2]) for m in ground.moisture)
    soil = LIGHT_M_PER_NS / ground.velocity_m_per_ns * (1.0 + jnp.asarray(moisture))
    strength = jnp.tile(jnp.asarray(response.surface), scans)
    surface = strength * (index - soil) / (index + soil) * snow_loss / (2.0 * height_m)
    top_m = jnp.maximum(height_m - thickness_m, 0.02)
    snow = strength * snow_reflectivity / (2.0 * top_m)

    coupling = jnp.tile(jnp.asarray(response.coupling), (scans, 1))
    coupling_ns = jnp.broadcast_to(jnp.asarray(COUPLING_NS, jnp.float32)[None], coupling.shape)
    above_ns = jnp.stack([2.0 * height_m / LIGHT_M_PER_NS + snow_ns, 2.0 * top_m / LIGHT_M_PER_NS], axis=1)
    time_ns = jnp.concatenate([above_ns, coupling_ns], axis=1)
    field = jnp.concatenate([jnp.stack([surface, snow], axis=1), coupling], axis=1)
    echoes += place_echoes(time_ns + delay_ns[:, None], field, radar=radar)
    return echoes * jnp.tile(jnp.asarray(response.gain), scans)[:, None]
