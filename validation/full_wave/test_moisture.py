"""Wetter soil: the wave slows, the trace stretches, and correlation falls as much in the scene as in gprMax.

gprMax has 13 m of fractal soil after Peplinski (sand 0.9, clay 0.05), the same structure at both moistures; every
reflection, multiple path, loss and dispersion is in it. The scene has its own ground, slowed by the factor by which
gprMax's traces are stretched. Both pass the same steps: mean over the track taken off, traces levelled over time,
5 to 25 ns after transmission compared at the true place.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar
from scipy.signal import fftconvolve

from lgprjax.scene import make_wavelet
from validation.full_wave.echoes import LIGHT_M_PER_NS, RADAR, scene_axis_ns, to_scene
from validation.full_wave.fdtd import Fdtd, Recording, subtract
from validation.full_wave.fdtd_model import HEIGHT_M, PLATE_M, Model, Plate
from validation.full_wave.scenes import render_road

CELL_M = 0.02  # 13 cells in the shortest wavelength of the band; what the grid slows is alike at both moistures
LENGTH_M = 13.0
PLACE_M = [round(0.6 + 0.2 * number, 3) for number in range(60)]
DRY, WET = (0.04, 0.12), (0.05, 0.13)  # volumetric water, least and most
SURFACE_NS = 2 * HEIGHT_M / LIGHT_M_PER_NS
WINDOW_NS = (5.0, 25.0)
NOISE = 0.3  # rms over the rms of the levelled echoes: 10 dB below them
# "The same order": within a factor of two. The loss depends on how reflections lie over depth, which differs
# between the grounds; by the stretch alone a sample t after the surface correlates as the wavelet's
# autocorrelation at (stretch - 1) t, which is common to both.
FACTOR = 2.0

Traces = Float[np.ndarray, "trace sample"]


class Correlations(NamedTuple):
    """Means over the places, against the dry ground without noise."""

    dry: float
    wet: float
    wet_rescaled: float


def fractal_soil(water: tuple[float, float]) -> Model:
    return Model(
        (0.0, LENGTH_M),
        below_m=1.6,
        above_m=0.5,
        cell_m=CELL_M,
        window_ns=34.0,
        lines=(
            f"#soil_peplinski: 0.9 0.05 1.7 2.66 {water[0]} {water[1]} mixture",
            f"#fractal_box: 0 0 0 {LENGTH_M:g} 1.6 inf 1.5 1 1 1 20 mixture soil 7",
        ),
    )


def rescale(traces: Traces, stretch: float) -> Traces:
    """The traces as they would be at ``stretch`` times the velocity: time compressed towards the surface's echo."""
    time_ns = scene_axis_ns()
    return np.stack([np.interp(SURFACE_NS + stretch * (time_ns - SURFACE_NS), time_ns, trace) for trace in traces])


def correlate(one: Traces, other: Traces) -> float:
    """Normalized correlation of each pair of traces in the window, on average."""
    time_ns = scene_axis_ns()
    window = (time_ns > WINDOW_NS[0]) & (time_ns < WINDOW_NS[1])
    a, b = one[:, window], other[:, window]
    return float(np.mean(np.sum(a * b, axis=1) / np.sqrt(np.sum(a**2, axis=1) * np.sum(b**2, axis=1))))


def level(dry: Traces, wet: Traces) -> tuple[Traces, Traces]:
    """Without what all traces share, and with the dry ground's rms at each time brought to 1."""
    dry, wet = (traces - traces.mean(axis=0) for traces in (dry, wet))
    rms = np.sqrt(np.mean(dry**2, axis=0))
    return dry / rms, wet / rms


def compare(dry: Traces, wet: Traces, stretch: float) -> Correlations:
    """Correlations at the true place, the live traces with noise of the radar's band."""
    taps = make_wavelet(RADAR)
    white = np.random.default_rng(4).normal(size=(2, *dry.shape))
    noise = NOISE * fftconvolve(white, taps[None, None] / np.linalg.norm(taps), mode="same", axes=-1)
    live_dry, live_wet = dry + noise[0], wet + noise[1]
    return Correlations(correlate(dry, live_dry), correlate(dry, live_wet), correlate(dry, rescale(live_wet, stretch)))


def test_wetting_costs_as_much_correlation_as_in_the_scene(fdtd: Fdtd) -> None:
    air = Model((-0.8, 0.8), below_m=0.4, above_m=0.5, cell_m=CELL_M, window_ns=24.0)
    metal = fdtd("coarse_plate", air.with_parts(Plate(PLATE_M - HEIGHT_M)), [0.0])
    plate = subtract(metal, fdtd("coarse_air", air, [0.0]))

    def in_band(recording: Recording) -> Traces:
        # The mean over the track holds the direct wave, a thousand times the ground's echoes: off before the division.
        return to_scene(
            recording._replace(field=recording.field - recording.field.mean(axis=0)), plate, PLATE_M, small=False
        )

    soil = level(in_band(fdtd("dry", fractal_soil(DRY), PLACE_M)), in_band(fdtd("wet", fractal_soil(WET), PLACE_M)))
    best = minimize_scalar(lambda s: -correlate(soil[0], rescale(soil[1], s)), bounds=(0.98, 1.1), method="bounded")
    stretch = float(best.x)
    assert 1.02 < stretch < 1.08  # wetter is slower, by a few per cent
    scene = level(render_road(PLACE_M), render_road(PLACE_M, velocity_factor=1 / stretch))

    outside, ours = compare(*soil, stretch), compare(*scene, stretch)
    print(f"\nwetting that stretches travel times by {stretch:.4f}\n{'correlation':28}  gprMax   scene")
    for name in Correlations._fields:
        print(f"{name:28}{getattr(outside, name):8.3f}{getattr(ours, name):8.3f}")
    loss, ours_loss = outside.dry - outside.wet, ours.dry - ours.wet
    print(f"{'lost by wetting':28}{loss:8.3f}{ours_loss:8.3f}")
    assert loss > 0.05
    assert 1 / FACTOR < ours_loss / loss < FACTOR
    # In both most of it comes back with the right time scale.
    for result in (outside, ours):
        assert result.wet_rescaled - result.wet > 0.5 * (result.dry - result.wet)
