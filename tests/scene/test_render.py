"""Echoes against hand formulae: times, polarity, spreading, band, and the same answer far down the road."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene import (
    Ground,
    GroundConfig,
    Layers,
    RadarConfig,
    make_ground,
    make_wavelet,
    render_traces,
    slice_ground,
)

RADAR = RadarConfig()
LIGHT_M_PER_NS = 0.299792458
VELOCITY_M_PER_NS = 0.1


def ground_of(
    stones: list[tuple[float, float, float]],
    strengths: list[float],
    layer: tuple[float, float] | None = None,
    slope: float = 0.0,
) -> Ground:
    """Stones (along, cross, depth) and one interface (depth, reflectivity); it tilts by ``slope``."""
    depth, reflectivity = (1.0, 0.0) if layer is None else layer
    one = np.ones((1, 1))
    wave_rad_per_m = 1e-3
    layers = Layers(
        depth_m=np.array([depth]),
        wave_rad_per_m=np.array([[[wave_rad_per_m, 0.0]]]),
        relief_m=slope / wave_rad_per_m * one,
        relief_phase_rad=0.0 * one,
        reflectivity_mean=np.array([reflectivity]),
        reflectivity=0.0 * one,
        reflectivity_phase_rad=0.0 * one,
    )
    return Ground(GroundConfig(), np.array(stones).reshape(-1, 3), np.array(strengths), layers)


def render(ground: Ground, antenna_m: list[tuple[float, float, float]]) -> Float[np.ndarray, "trace sample"]:
    piece = slice_ground(ground, -10.0, 10.0, stones=16)
    return np.asarray(render_traces(piece, jnp.asarray(antenna_m, jnp.float32), radar=RADAR))


def peak_of(trace: Float[np.ndarray, " sample"]) -> tuple[float, float]:
    """Place (in samples, through a parabola) and value of the strongest sample."""
    at = int(np.argmax(np.abs(trace)))
    left, top, right = trace[at - 1 : at + 2]
    return at + 0.5 * (left - right) / (left - 2 * top + right), float(top)


def sample_of(time_ns: float) -> float:
    return (time_ns + RADAR.time_zero_ns) / RADAR.sample_step_ns


@pytest.mark.parametrize("strength", [0.02, -0.02])
@pytest.mark.parametrize(
    ("antenna", "stone"),
    [
        ((0.0, 0.0, 0.3), (0.0, 0.0, 1.0)),
        ((0.7, -0.4, 0.32), (0.1, 0.2, 0.6)),
        ((-0.5, 1.0, 0.15), (0.0, 0.0, 2.0)),
    ],
)
def test_stone_arrives_in_time_with_its_polarity_and_loss(
    antenna: tuple[float, float, float], stone: tuple[float, float, float], strength: float
) -> None:
    trace = render(ground_of([stone], [strength]), [antenna])[0].astype(np.float64)
    aside = np.hypot(antenna[0] - stone[0], antenna[1] - stone[1])
    range_m = float(np.hypot(aside, stone[2]))
    expected_ns = 2 * antenna[2] / LIGHT_M_PER_NS + 2 * range_m / VELOCITY_M_PER_NS
    passage = 1 - 0.5**2
    expected = strength * passage * (stone[2] / range_m) ** 2 * np.exp(-1.4 * range_m) / (antenna[2] + range_m) ** 2
    place, value = peak_of(trace)
    assert abs(place - sample_of(expected_ns)) < 0.1
    assert value == pytest.approx(expected, rel=0.02)


def test_flat_interface_arrives_in_time_with_its_polarity() -> None:
    traces = render(ground_of([], [], layer=(0.8, -0.05)), [(0.0, 0.0, 0.3), (0.0, 0.5, 0.4)])
    for trace, height in zip(traces.astype(np.float64), (0.3, 0.4), strict=True):
        place, value = peak_of(trace)
        assert abs(place - sample_of(2 * height / LIGHT_M_PER_NS + 1.6 / VELOCITY_M_PER_NS)) < 0.1
        assert value == pytest.approx(-0.05 * 0.75 * np.exp(-1.4 * 0.8) / (2 * (height + 0.8)), rel=0.02)


def test_tilted_interface_is_heard_along_its_normal() -> None:
    slope = 0.5
    trace = render(ground_of([], [], layer=(1.0, 0.05), slope=slope), [(0.2, 0.0, 0.3)])[0]
    normal_m = (1.0 + slope * 0.2) * np.cos(np.arctan(slope))
    expected = sample_of(2 * 0.3 / LIGHT_M_PER_NS + 2 * normal_m / VELOCITY_M_PER_NS)
    assert abs(peak_of(trace.astype(np.float64))[0] - expected) < 0.1


def test_stones_add_up_as_exact_wavelets() -> None:
    """Oracle: float64 sum of wavelets, each read at its echo's exact time from an eight times finer axis."""
    rng = np.random.default_rng(5)
    stones = np.column_stack([np.sort(rng.uniform(-1, 1, 12)), rng.uniform(-1, 1, 12), rng.uniform(0.3, 2, 12)])
    strengths = rng.normal(size=12) * 0.01
    trace = render(ground_of([tuple(s) for s in stones], list(strengths)), [(0.0, 0.0, 0.3)])[0]
    fine = RadarConfig(sample_step_ns=RADAR.sample_step_ns / 8)
    taps = make_wavelet(fine)
    tap_ns = (np.arange(taps.size) - fine.tail_samples) * fine.sample_step_ns
    sample_ns = np.arange(RADAR.samples) * RADAR.sample_step_ns - RADAR.time_zero_ns
    expected = np.zeros(RADAR.samples)
    for (along, cross, depth), strength in zip(stones, strengths, strict=True):
        aside = np.hypot(along, cross)
        range_m = np.hypot(aside, depth)
        edge = np.clip(4 * (1 - aside / RADAR.aperture_m), 0, 1)
        field = strength * 0.75 * (depth / range_m) ** 2 * edge**2 * (3 - 2 * edge)
        field *= np.exp(-1.4 * range_m) / (0.3 + range_m) ** 2
        arrival_ns = 2 * 0.3 / LIGHT_M_PER_NS + 2 * range_m / VELOCITY_M_PER_NS
        expected += field * np.interp(sample_ns - arrival_ns, tap_ns, taps, left=0.0, right=0.0)
    assert np.abs(trace - expected).max() < 0.02 * np.abs(expected).max()


def test_echoes_outside_the_trace_and_padding_are_silent() -> None:
    late = render(ground_of([(0.0, 0.0, 4.5)], [1.0]), [(0.0, 0.0, 0.3)])
    aside = render(ground_of([(0.0, 2.1, 1.0)], [1.0]), [(0.0, 0.0, 0.3)])
    assert not late.any()
    assert not aside.any()


def test_wavelet_keeps_to_its_band() -> None:
    taps = make_wavelet(RADAR)
    power = np.abs(np.fft.rfft(taps, 8192)) ** 2
    frequency_mhz = np.fft.rfftfreq(8192, RADAR.sample_step_ns * 1e-3)
    inside = (frequency_mhz >= 100) & (frequency_mhz <= 400)
    assert power[~inside].sum() < 1e-3 * power.sum()
    assert taps[RADAR.tail_samples] == pytest.approx(1.0)
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-12)


def test_far_down_the_road_is_as_sharp_as_at_the_start() -> None:
    near = make_ground(3, GroundConfig(length_m=10.0))
    far_m = 7_000.0
    turn = near.layers.wave_rad_per_m[..., 0] * far_m
    far = near._replace(
        stone_m=near.stone_m + np.array([far_m, 0.0, 0.0]),
        layers=near.layers._replace(
            relief_phase_rad=near.layers.relief_phase_rad - turn,
            reflectivity_phase_rad=near.layers.reflectivity_phase_rad - turn,
        ),
    )
    antenna_m = jnp.asarray([(5.0, 0.0, 0.3), (5.3, 0.5, 0.31)], jnp.float32)
    here = slice_ground(near, 2.0, 8.0, stones=1024)
    there = slice_ground(far, far_m + 2.0, far_m + 8.0, stones=1024, origin_m=(far_m, 0.0))
    traces = render_traces(here, antenna_m, radar=RADAR)
    np.testing.assert_allclose(
        render_traces(there, antenna_m, radar=RADAR), traces, atol=1e-4 * float(jnp.abs(traces).max())
    )
