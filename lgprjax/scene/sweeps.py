"""A stepped-frequency receiver: sweeps of every channel and the calibration channel, and start-of-day recordings.

What is measured at a frequency f is g A(f) R(f) E(f) + noise: E what the antennas hear, R the channel, A the common
path (synthesiser, amplifiers, cables), g the drift of the scan. The calibration channel sees g A(f) a exp(-2 pi i f
tau), through an attenuator a and a cable tau: dividing by it leaves E, R and a known delay.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int, PRNGKeyArray

from lgprjax.scene.hardware import COUPLING_NS, HARDWARE_SEED, Response, ScanErrors, heard_echoes
from lgprjax.scene.propagation import RadarConfig, band_spectrum
from lgprjax.scene.rays import LIGHT_M_PER_NS
from lgprjax.scene.render import convolve_echoes
from lgprjax.scene.slices import GroundSlice

_AVERAGED = 256  # scans that the start-of-day recordings are the mean of


@dataclass(frozen=True)
class SweepPlan:
    """What is measured in each scan.

    Attributes:
        first_mhz, step_mhz, steps: the frequencies. 1 / step is the unambiguous travel time.
        adc_bits, full_scale_field: of the quadrature receiver; what is louder is clipped.
        calibration_gain, calibration_delay_ns: of the path through the attenuator, set as loud as the converter
            allows: noise of the calibration channel is noise of every channel, in proportion to the coupling.
        ripple: rms of the common path's response over frequency, in nepers and radians.
    """

    first_mhz: float = 100.0
    step_mhz: float = 5.0
    steps: int = 61
    adc_bits: int = 14
    full_scale_field: float = 3.0
    calibration_gain: float = 1.5
    calibration_delay_ns: float = 6.0
    ripple: float = 0.15

    @property
    def frequency_mhz(self) -> Float[np.ndarray, " frequency"]:
        """The frequencies."""
        return np.asarray(self.first_mhz + self.step_mhz * np.arange(self.steps))


class StartOfDay(NamedTuple):
    """Recordings before the drive: empty space, and a metal plate under the array, each with its calibration sweep."""

    empty: Complex[np.ndarray, "channel frequency"]
    empty_calibration: Complex[np.ndarray, " frequency"]
    plate: Complex[np.ndarray, "channel frequency"]
    plate_calibration: Complex[np.ndarray, " frequency"]


def common_path(plan: SweepPlan) -> Complex[np.ndarray, " frequency"]:
    """The path that all channels and the calibration channel share; it belongs to the hardware."""
    rng = np.random.default_rng([HARDWARE_SEED, 1])
    turns = np.outer(np.linspace(0, 1, plan.steps), np.arange(1, 5))
    wave = np.cos(2 * np.pi * (turns + rng.uniform(size=(2, 1, 4)))) @ rng.normal(size=4) * plan.ripple / 2
    cable_ns = 11.0
    return np.asarray(np.exp(wave[0] + 1j * wave[1] - 2e-3j * np.pi * plan.frequency_mhz * cable_ns))


def calibration_path(plan: SweepPlan) -> Complex[np.ndarray, " frequency"]:
    """The calibration channel's own part."""
    delay = np.exp(-2e-3j * np.pi * plan.frequency_mhz * plan.calibration_delay_ns)
    return np.asarray(plan.calibration_gain * delay)


def start_of_day(
    plan: SweepPlan, radar: RadarConfig, response: Response, noise_field: float, seed: int, *, plate_m: float = 0.5
) -> StartOfDay:
    """The look-up in empty space and the plate ``plate_m`` under the array, each the mean of many scans."""
    rng = np.random.default_rng([seed, 10])
    f = plan.frequency_mhz * 1e-3
    own = response.gain[:, None] * np.exp(-2j * np.pi * np.outer(response.delay_ns, f))
    coupling = response.coupling @ np.exp(-2j * np.pi * np.outer(np.asarray(COUPLING_NS), f))
    mirror = -0.5 / plate_m * np.exp(-2j * np.pi * f * 2 * plate_m / LIGHT_M_PER_NS)
    common, calibration = common_path(plan), calibration_path(plan)
    sigma = _noise_per_step(plan, radar, noise_field) / np.sqrt(_AVERAGED)

    def noisy(sweep: Complex[np.ndarray, "..."]) -> Complex[np.ndarray, "..."]:
        drift = 1 + 0.02 * rng.normal()  # the receiver is not as warm as it will be
        noise = rng.normal(size=(2, *sweep.shape)) * sigma * np.sqrt(0.5)
        return np.asarray(drift * common * sweep + noise[0] + 1j * noise[1])

    def pair(heard: Complex[np.ndarray, "channel frequency"]) -> tuple[np.ndarray, np.ndarray]:
        together = noisy(np.concatenate([own * heard, calibration[None]]))
        return together[:-1].astype(np.complex64), together[-1].astype(np.complex64)

    return StartOfDay(*pair(coupling), *pair(coupling + mirror[None]))


@partial(jax.jit, static_argnames=("radar", "plan"))
def record_sweeps(
    key: PRNGKeyArray,
    first_scan: Int[Array, ""],
    ground: GroundSlice,
    antenna_m: Float[Array, "scan channel 3"],
    response: Response,
    errors: ScanErrors,
    noise_field: Float[Array, ""],
    matrix: Float[Array, "bin recorded"],
    *,
    radar: RadarConfig,
    plan: SweepPlan,
) -> tuple[Complex[Array, "scan channel frequency"], Complex[Array, "scan frequency"]]:
    """Records a block of scans; arguments as of ``record_scans``, the matrix from ``sweep_matrix``."""
    scans, channels, _ = antenna_m.shape
    echoes = heard_echoes(ground, antenna_m.reshape(-1, 3), response, radar=radar)
    halves = convolve_echoes(echoes, matrix).reshape(scans, channels, 2, plan.steps)
    calibration = calibration_path(plan)
    through = np.broadcast_to(np.stack([calibration.real, calibration.imag])[None, None], (scans, 1, 2, plan.steps))
    halves = jnp.concatenate([halves, jnp.asarray(through, jnp.float32)], axis=1)
    heard = jax.lax.complex(halves[:, :, 0], halves[:, :, 1])
    drift = jax.lax.complex(errors.gain * jnp.cos(errors.phase_rad), errors.gain * jnp.sin(errors.phase_rad))
    sweep = heard * drift[:, None, None] * jnp.asarray(common_path(plan), jnp.complex64)[None, None]

    keys = jax.vmap(jax.random.fold_in, (None, 0))(key, first_scan + jnp.arange(scans, dtype=jnp.int32))
    white = jax.vmap(lambda k: jax.random.normal(k, (2, channels + 1, plan.steps), jnp.float32))(keys)
    sigma = noise_field * _noise_per_step(plan, radar, 1.0) * np.sqrt(0.5)
    sweep += jax.lax.complex(white[:, 0] * sigma, white[:, 1] * sigma)

    # A transmitter in the band is heard in the step that meets it; where no antenna is, it is not.
    phase = jax.vmap(lambda k: jax.random.uniform(jax.random.fold_in(k, 1), (channels + 1,)))(keys)
    away = jnp.abs(jnp.asarray(plan.frequency_mhz, jnp.float32)[None, :] - errors.interference_mhz[:, None])
    share = jnp.clip(1.0 - away / plan.step_mhz, 0.0, 1.0) * errors.interference[:, None] * plan.steps
    connected = jnp.append(jnp.asarray(response.gain) != 0, False).astype(jnp.complex64)
    turn = jax.lax.complex(jnp.cos(2 * jnp.pi * phase), jnp.sin(2 * jnp.pi * phase)) * connected[None, :]
    sweep += share.astype(jnp.complex64)[:, None, :] * turn[..., None]

    step = 2.0 * plan.full_scale_field / 2**plan.adc_bits

    def digitise(x: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.clip(jnp.round(x / step) * step, -plan.full_scale_field, plan.full_scale_field - step)

    sweep = jax.lax.complex(digitise(sweep.real), digitise(sweep.imag))
    return sweep[:, :-1], sweep[:, -1]


def _noise_per_step(plan: SweepPlan, radar: RadarConfig, noise_field: float) -> float:
    """Rms of the complex noise of a step that makes ``noise_field`` in a time trace with the radar's spectrum."""
    spectrum = band_spectrum(radar, plan.frequency_mhz)
    return float(noise_field * np.sqrt(2.0) * spectrum.sum() / np.linalg.norm(spectrum))
