"""The array's own errors: their sizes, what stays from day to day, and what each channel hears above the ground."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene import NO_FAULTS, Conditions, Cover, Day, ReceiverFaults, ground_on, slice_ground
from lgprjax.scene.propagation import trace_matrix
from lgprjax.scene.render import (
    COUPLING_FIELD,
    COUPLING_NS,
    Response,
    draw_response,
    draw_scan_errors,
    kept_scans,
    received_echoes,
)
from scene.bare_ground import INDEX, LIGHT_M_PER_NS, RADAR, SPOTLESS, ground_of, wavelets_at

BAND_MHZ = (100.0, 400.0)
MATRIX = trace_matrix(RADAR, velocity_m_per_ns=0.1, attenuation_per_m=0.7, dispersive_share=0.0)
QUIET = Response(*(np.array(a, np.float32) for a in ([1.0, 0.9], [0.0, 0.2], [1.0, 1.1], np.zeros((2, 3)))))
HEIGHTS_M = [0.3, 0.35, 0.28, 0.31]  # two scans of two channels
heard = jax.jit(partial(received_echoes, radar=RADAR))


def traces(response: Response, conditions: Conditions | None = None) -> Float[np.ndarray, "trace sample"]:
    piece = slice_ground(ground_of(), -5.0, 5.0, stones=16, utilities=4, conditions=conditions)
    antenna_m = jnp.asarray([(0.0, 0.0, h) for h in HEIGHTS_M], jnp.float32)
    return np.asarray(np.asarray(heard(piece, antenna_m, response), np.float64) @ MATRIX)


def test_the_surface_is_heard_from_where_it_lies_with_fresnels_strength() -> None:
    for trace, height, channel in zip(traces(QUIET), HEIGHTS_M, (0, 1, 0, 1), strict=True):
        gain, delay_ns, surface, _ = (float(part[channel].ravel()[0]) for part in QUIET)
        field = gain * surface * (1 - INDEX) / (1 + INDEX) / (2 * height)
        expected = wavelets_at(np.array([2 * height / LIGHT_M_PER_NS + delay_ns]), np.array([field]))
        assert np.abs(trace - expected).max() < 0.02 * abs(field)
        assert field < 0  # denser below: turned over


def test_snow_has_a_surface_of_its_own_and_softens_the_roads() -> None:
    snow = Cover(0.1, 0.0, index=1.4, attenuation_per_m=0.5, lift=0.3, reflectivity=-0.15)
    _, conditions = ground_on(ground_of(), replace(SPOTLESS, cover=snow))
    alike = QUIET._replace(
        gain=np.ones(2, np.float32), delay_ns=np.zeros(2, np.float32), surface=np.ones(2, np.float32)
    )
    for trace, height in zip(traces(alike, conditions), HEIGHTS_M, strict=True):
        raised = height + 0.03
        road = (1.4 - INDEX) / (1.4 + INDEX) * np.exp(-2 * 0.5 * 0.1) / (2 * raised)
        top = -0.15 / (2 * (raised - 0.1))
        air_ns = 2 * (raised - 0.1) / LIGHT_M_PER_NS
        expected = wavelets_at(np.array([air_ns + 2 * 0.1 * 1.4 / LIGHT_M_PER_NS, air_ns]), np.array([road, top]))
        assert np.abs(trace - expected).max() < 0.02 * abs(road)


def test_coupling_comes_at_its_times_whatever_the_height() -> None:
    coupling = np.array([COUPLING_FIELD, np.array(COUPLING_FIELD) * 1.2], np.float32)
    with_it = traces(QUIET._replace(coupling=coupling)) - traces(QUIET)
    for trace, channel in zip(with_it, (0, 1, 0, 1), strict=True):
        field = coupling[channel] * QUIET.gain[channel]
        expected = wavelets_at(np.asarray(COUPLING_NS) + QUIET.delay_ns[channel], field.astype(np.float64))
        assert np.abs(trace - expected).max() < 0.02


def test_a_days_errors_have_their_spread_and_the_hardware_stays() -> None:
    days = [draw_response(Day(seed=s, gain_spread=0.03, delay_spread_ns=0.04), 11, NO_FAULTS) for s in range(60)]
    assert np.std([d.gain for d in days]) == pytest.approx(0.03, rel=0.1)
    assert np.mean([d.gain for d in days]) == pytest.approx(1.0, abs=0.005)
    assert np.std([d.delay_ns for d in days]) == pytest.approx(0.04, rel=0.1)
    assert np.std([d.surface for d in days]) == pytest.approx(0.02, rel=0.1)
    coupling = np.array([d.coupling for d in days])
    per_day = np.std(coupling, axis=0) / np.abs(coupling.mean(axis=0))
    assert per_day.mean() == pytest.approx(0.02, rel=0.15)
    own = coupling.mean(axis=0) / np.asarray(COUPLING_FIELD) - 1
    assert 0.05 < own.std() < 0.2  # each antenna has its own, the same on every day


def test_the_receiver_warms_up_quickly_at_first_and_dead_channels_hear_nothing() -> None:
    response = draw_response(Day(), 5, replace(NO_FAULTS, dead_channels=(1, 4)))
    np.testing.assert_array_equal(response.gain == 0, [False, True, False, False, True])
    errors = draw_scan_errors(replace(NO_FAULTS, gain_drift=-0.08, phase_drift_rad=0.2), 1000, BAND_MHZ, 3)
    assert (errors.gain[0], errors.phase_rad[0]) == (1.0, 0.0)
    assert errors.gain[-1] == pytest.approx(0.92, abs=1e-6)
    assert errors.phase_rad[-1] == pytest.approx(0.2, abs=1e-6)
    assert np.all(np.diff(errors.gain) < 0)
    assert errors.phase_rad[500] > 0.75 * errors.phase_rad[-1]


def test_loud_and_hit_scans_have_their_share() -> None:
    scans = 40_000
    errors = draw_scan_errors(replace(NO_FAULTS, clipped_share=0.01, interference_share=0.02), scans, BAND_MHZ, 3)
    assert np.mean(errors.gain == 4.0) == pytest.approx(0.01, abs=4 * np.sqrt(0.01 / scans))
    assert np.all((errors.gain == 4.0) | (errors.gain == 1.0))
    hit = draw_scan_errors(
        ReceiverFaults(interference_share=0.02, interference_field=0.05), scans, BAND_MHZ, 4
    ).interference
    assert np.mean(hit > 0) == pytest.approx(0.02, abs=4 * np.sqrt(0.02 / scans))
    assert hit[hit > 0].mean() == pytest.approx(0.05, rel=0.15)
    frequency_mhz = errors.interference_mhz
    assert 100.0 <= frequency_mhz.min() < 101.0
    assert 399.0 < frequency_mhz.max() <= 400.0


def test_dropped_scans_have_their_share_and_the_ends_are_kept() -> None:
    kept = kept_scans(replace(NO_FAULTS, dropped_share=0.05), 20_000, 5)
    assert 1 - len(kept) / 20_000 == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 20_000))
    assert np.all(np.diff(kept) >= 1)
    for seed in range(30):
        few = kept_scans(replace(NO_FAULTS, dropped_share=0.9), 10, seed)
        assert (few[0], few[-1]) == (0, 9)
    np.testing.assert_array_equal(kept_scans(NO_FAULTS, 50, 5), np.arange(50))
