"""Brings the echoes of gprMax and of the scene into one form: the scene's band and axis, zero phase.

Every echo is divided by that of a metal plate at a known distance, computed with the same pulse on the same grid,
and multiplied by the spectrum of the scene's wavelet. What is left is the ground's own response: a mirror of
reflection coefficient +1 would give the wavelet, upright, its peak at the time of the path.

In two dimensions a path of cylindrical spreading costs a factor exp(-i pi/4)/sqrt(f) (time factor exp(i w t)). A
mirror's echo runs along one such path, like the plate's: nothing to correct. The echo of a small object runs along
two, to it and back, and is multiplied by sqrt(i f) for the second. A small object in any number of dimensions
scatters in proportion to f**2 (Rayleigh: the displacement current in it, (permittivity ratio - 1) k**2 E, is the
source); the scene's scattering length does not depend on frequency, so the echo is divided by f**2. That is real
and positive and moves neither time nor polarity.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import hankel2

from lgprjax.scene import RadarConfig, make_wavelet
from validation.full_wave.fdtd import Recording
from validation.full_wave.fdtd_model import SEPARATION_M

LIGHT_M_PER_NS = 0.299792458
RADAR = RadarConfig()
MIDDLE_GHZ = 0.25
_FINE = 8  # picks are read from an axis eight times finer


class Pick(NamedTuple):
    """Where a trace is strongest, and how strong it is there, with its sign."""

    time_ns: float
    value: float


def scene_axis_ns(radar: RadarConfig = RADAR) -> Float[np.ndarray, " sample"]:
    """Times of the scene's samples after transmission."""
    return np.arange(radar.samples) * radar.sample_step_ns - radar.time_zero_ns


def plate_response(
    frequency_ghz: Float[np.ndarray, " bin"], distance_m: float, *, cross: bool
) -> Complex[np.ndarray, " bin"]:
    """The plate's echo: far away exp(-ikr)/sqrt(r), with ``cross`` (three dimensions) exp(-ikr)/r, times -1.

    The mirror image of the source stands at r. Exact fields: H0(kr) of a line, and 1 + 1/(ikr) - 1/(kr)**2 beside
    a dipole.
    """
    path_m = 2 * np.hypot(distance_m, SEPARATION_M / 2)
    k = 2 * np.pi * frequency_ghz / LIGHT_M_PER_NS
    turn = k * path_m
    if cross:
        return np.asarray(-np.exp(-1j * turn) / path_m * (1 + 1 / (1j * turn) - 1 / turn**2))
    return np.asarray(-hankel2(0, turn) * np.sqrt(0.5 * np.pi * k) * np.exp(-0.25j * np.pi))


def to_scene(
    echo: Recording, plate: Recording, plate_m: float, *, small: bool, cross: bool = False, radar: RadarConfig = RADAR
) -> Float[np.ndarray, "trace sample"]:
    """Echoes as zero-phase traces on the scene's axis; ``small``: of small objects, else of mirrors."""
    assert echo.step_ns == plate.step_ns
    step = echo.step_ns
    length = 1 << int(np.ceil(np.log2(4 * echo.field.shape[1])))  # no wrapping around
    frequency = np.fft.rfftfreq(length, step)
    band = np.abs(frequency - MIDDLE_GHZ) < 0.16
    wavelet = make_wavelet(radar)
    tap_ns = (np.arange(wavelet.size) - wavelet.size // 2) * radar.sample_step_ns
    spectrum = np.exp(-2j * np.pi * frequency[band, None] * tap_ns) @ wavelet * radar.sample_step_ns
    ratio = np.fft.rfft(echo.field, length)[:, band] / np.fft.rfft(plate.field, length)[:, band]
    ratio = ratio * plate_response(frequency[band], plate_m, cross=cross)
    if small:
        relative = frequency[band] / MIDDLE_GHZ
        ratio = ratio * relative**-2.0 * (1.0 if cross else np.sqrt(1j * relative))
    at_ns = scene_axis_ns(radar)
    back = np.exp(2j * np.pi * frequency[band, None] * at_ns)
    return np.asarray(2 * np.real((ratio * spectrum) @ back) / (length * step))


def pick(trace: Float[np.ndarray, " sample"], radar: RadarConfig = RADAR) -> Pick:
    """The strongest extreme, between the samples: band-limited to eight times as many, then a parabola."""
    spectrum = np.fft.rfft(np.asarray(trace, np.float64))
    fine = np.fft.irfft(spectrum, _FINE * trace.size) * _FINE
    at = int(np.argmax(np.abs(fine[: _FINE * (trace.size - 1)])))
    left, top, right = fine[at - 1 : at + 2]
    place = (at + 0.5 * (left - right) / (left - 2 * top + right)) / _FINE
    return Pick(place * radar.sample_step_ns - radar.time_zero_ns, float(top))


def similarity(one: Float[np.ndarray, "*axes"], other: Float[np.ndarray, "*axes"]) -> float:
    """Normalized correlation of whole traces."""
    return float(np.sum(one * other) / np.sqrt(np.sum(one**2) * np.sum(other**2)))
