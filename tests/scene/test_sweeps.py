"""Stepped-frequency recordings against their formula in float64."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Complex

from lgprjax.scene import (
    NO_FAULTS,
    RadarConfig,
    SimulatedDrive,
    SweepPlan,
    iterate_sweeps,
    slice_ground,
    start_of_day,
)
from lgprjax.scene.drive import calibration_path, common_path
from lgprjax.scene.propagation import band_spectrum, sweep_matrix
from lgprjax.scene.render import Response, received_echoes
from scene.bare_ground import SPOTLESS
from scene.short_drives import GROUND, drive_over

PLAN = SweepPlan(adc_bits=20)
DRIFTING = replace(NO_FAULTS, gain_drift=0.3, phase_drift_rad=1.0)
Sweeps = tuple[Complex[np.ndarray, "scan channel frequency"], Complex[np.ndarray, "scan frequency"]]


def sweeps_of(drive: SimulatedDrive, plan: SweepPlan = PLAN) -> Sweeps:
    chunks = list(iterate_sweeps(drive, plan))
    return np.concatenate([s for s, _ in chunks]), np.concatenate([c for _, c in chunks])


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.abs(x) ** 2)))


@cache
def still(faults: bool) -> tuple[SimulatedDrive, Sweeps]:
    drive = drive_over(
        GROUND, replace(SPOTLESS, gain_spread=0.1, delay_spread_ns=0.3), faults=DRIFTING if faults else NO_FAULTS
    )
    return drive, sweeps_of(drive)


def test_what_is_measured_is_drift_common_path_and_the_echoes() -> None:
    """g A E with E from a float64 product; over the calibration channel nothing of g and A is left."""
    drive, (sweeps, calibration) = still(True)
    scans = slice(40, 44)
    antenna_m = drive.road_antenna_m[scans].reshape(-1, 3)
    piece = slice_ground(drive.ground, -3.0, 9.0, stones=2048, utilities=8, conditions=drive.conditions)
    echoes = jax.jit(partial(received_echoes, radar=drive.radar))(
        piece, jnp.asarray(antenna_m, jnp.float32), drive.response
    )
    halves = np.asarray(echoes, np.float64) @ sweep_matrix(
        drive.radar, PLAN.frequency_mhz, velocity_m_per_ns=0.1, attenuation_per_m=0.7, dispersive_share=0.5
    ).astype(np.float64)
    heard = (halves[:, :61] + 1j * halves[:, 61:]).reshape(4, 3, 61)
    gain = drive.errors.gain.astype(np.float64) * np.exp(1j * drive.errors.phase_rad.astype(np.float64))
    expected = gain[scans, None, None] * common_path(PLAN) * heard
    assert rms(sweeps[scans] - expected) < 1e-3 * rms(expected)
    cable = 1.5 * np.exp(-2e-3j * np.pi * PLAN.frequency_mhz * 6.0)
    np.testing.assert_allclose(calibration_path(PLAN), cable, atol=1e-12)
    assert rms(calibration - gain[:, None] * common_path(PLAN) * cable) < 1e-5 * rms(calibration)
    ground = sweeps[scans] / calibration[scans, None, :]
    assert rms(ground - heard / cable) < 1e-3 * rms(heard / cable)


def test_the_common_path_ripples_as_asked_and_belongs_to_the_hardware() -> None:
    many = SweepPlan(steps=601, step_mhz=0.5, ripple=0.1)
    path = common_path(many) * np.exp(2e-3j * np.pi * many.frequency_mhz * 11.0)
    assert 0.02 < np.std(np.log(np.abs(path))) < 0.2
    np.testing.assert_array_equal(common_path(many), common_path(many))
    flat = common_path(replace(many, ripple=0.0))
    np.testing.assert_allclose(np.abs(flat), 1.0, atol=1e-12)


def test_the_converter_has_its_step_and_its_full_scale() -> None:
    drive, (sweeps, _) = still(False)
    step = 2 * 3.0 / 2**20
    halves = np.concatenate([sweeps.real.ravel(), sweeps.imag.ravel()]).astype(np.float64) / step
    assert np.abs(halves - np.round(halves)).max() < 0.05  # float32
    assert np.abs(halves - np.round(halves / 4) * 4).max() > 1  # not a coarser one
    loud, calibration = sweeps_of(drive._replace(response=drive.response._replace(gain=4 * drive.response.gain)))
    assert loud.real.max() == pytest.approx(3.0 - step, abs=1e-6)
    assert loud.real.min() == -3.0
    inside = np.abs(4 * sweeps.real) < 2.99
    assert 0.2 < inside.mean() < 0.99
    assert np.abs((loud.real - 4 * sweeps.real)[inside]).max() < 3 * step
    assert np.all(np.abs(loud.real[np.abs(4 * sweeps.real) > 3.01]) > 2.99)
    np.testing.assert_array_equal(calibration, still(False)[1][1])


def test_noise_of_a_sweep_is_that_of_a_trace() -> None:
    """Transformed with the radar's own spectrum, it has the rms that the traces have."""
    noisy = replace(SPOTLESS, noise_field=3e-3)
    quiet, _ = sweeps_of(drive_over(GROUND))
    loud, _ = sweeps_of(drive_over(GROUND, noisy))
    noise = loud - quiet
    time_ns = np.linspace(0.0, 60.0, 61)
    weight = band_spectrum(RadarConfig(), PLAN.frequency_mhz)
    back = np.exp(2e-3j * np.pi * np.outer(PLAN.frequency_mhz, time_ns)) * (weight / weight.sum())[:, None]
    traces = np.real(noise @ back)
    assert rms(traces) == pytest.approx(3e-3, rel=0.05)
    assert abs(np.mean(noise[1:] * np.conj(noise[:-1]))) < 0.03 * rms(noise) ** 2
    assert abs(np.mean(noise[:, 1:] * np.conj(noise[:, :-1]))) < 0.03 * rms(noise) ** 2


def test_interference_meets_its_own_step_in_every_live_channel() -> None:
    faults = replace(NO_FAULTS, interference_share=0.3, interference_field=0.002, dead_channels=(2,))
    drive = drive_over(GROUND, faults=faults)
    quiet, quiet_calibration = sweeps_of(drive_over(GROUND, faults=replace(faults, interference_share=0.0)))
    sweeps, calibration = sweeps_of(drive)
    hit = drive.errors.interference > 0
    added = np.abs(sweeps - quiet)
    assert added[~hit].max() < 1e-5
    assert added[:, 2].max() < 1e-5
    np.testing.assert_allclose(calibration, quiet_calibration, atol=1e-6)
    strongest = PLAN.frequency_mhz[np.argmax(added[hit][:, 0], axis=-1)]
    assert np.abs(strongest - drive.errors.interference_mhz[hit]).max() <= 2.5
    assert np.all(np.sum(added[hit][:, 0] > 1e-4, axis=-1) <= 2)


def test_the_plate_is_a_mirror_half_a_metre_down() -> None:
    flat = Response(*(np.array(a, np.float32) for a in ([1.0], [0.0], [1.0], [[0.5, -0.2, 0.1]])))
    start = start_of_day(PLAN, drive_over(GROUND).radar, flat, 0.0, 1)
    reference = (start.plate / start.plate_calibration - start.empty / start.empty_calibration)[0]
    echo = reference * calibration_path(PLAN)
    expected = -1 / (2 * 0.5) * np.exp(-2j * np.pi * PLAN.frequency_mhz * 1e-3 * 2 * 0.5 / 0.299792458)
    np.testing.assert_allclose(echo, expected, atol=1e-4)


def test_chunks_never_change_a_sweep() -> None:
    drive, (sweeps, calibration) = still(False)
    chunks = list(iterate_sweeps(drive, PLAN, 50))
    assert [len(s) for s, _ in chunks] == [50, 50, len(drive.scan_time_s) - 100]
    np.testing.assert_array_equal(np.concatenate([s for s, _ in chunks]), sweeps)
    np.testing.assert_array_equal(np.concatenate([c for _, c in chunks]), calibration)
