"""Interpolation pull: a noisy map must not draw matches to the middle between its traces (research/lgpr.md 4).

A line of one channel over a smooth random ground, noise 10 dB down in map and live alike. The ground's scale is
such that raw linear interpolation of traces 10 cm apart, matched with scans exactly on them, errs by the 3.2 cm RMS
of the study. The pull is the amplitude of the error's first harmonic over the place between two traces: positive
towards the middle, zero where the map treats all places alike.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar import default_chain
from lgprjax.subsurface import ScanBlock, StationBlock, TraceSet, grid_spec, grid_traces, stations_of_drive

LENGTH_M, COEFFICIENTS, SCALE_M = 30.0, 40, 0.22
NOISE = 10 ** (-10 / 20)
SITES, LIVE = 4, 120
OFFSETS_M = np.arange(-0.3, 0.3001, 0.005)

Sampler = Callable[[np.ndarray], np.ndarray]
Site = tuple[Callable[[np.ndarray], np.ndarray], np.random.Generator]


def make_site(seed: int) -> Site:
    """Ground of unit variance whose correlation falls as exp(-d²/2 SCALE²), independent in each coefficient."""
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(200, COEFFICIENTS)) / SCALE_M
    phase = rng.uniform(0, 2 * np.pi, (200, COEFFICIENTS))
    return lambda s: np.asarray(0.1 * np.sum(np.cos(s[:, None, None] * wave + phase), axis=1)), rng


def noisy(ground: Sampler, place_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return ground(place_m) + NOISE * rng.normal(size=(len(place_m), COEFFICIENTS))


def linear(rows: np.ndarray, step_m: float, first_m: float = 0.0) -> Sampler:
    def sample(place_m: np.ndarray) -> np.ndarray:
        at = (place_m - first_m) / step_m
        low = np.floor(at).astype(int)
        part = (at - low)[:, None]
        return np.asarray(rows[low] * (1 - part) + rows[low + 1] * part)

    return sample


def raw_map(site: Site, spacing_m: float) -> Sampler:
    ground, rng = site
    return linear(noisy(ground, np.arange(0.0, LENGTH_M, spacing_m), rng), spacing_m)


def our_map(site: Site, spacing_m: float) -> Sampler:
    """Scans to stations to a tile; the line's cells along the middle of the track, sampled as tiles are."""
    ground, rng = site
    travel = np.arange(0.0, LENGTH_M, spacing_m)
    traces = noisy(ground, travel, rng)
    n = len(travel)
    pose = np.zeros((n, 5))
    pose[:, 0] = travel
    drive = ScanBlock(
        profile=traces[:, None].astype(np.float32),
        valid=np.ones((n, 1), bool),
        travel_m=travel,
        pose=pose,
        ground_up_m=np.zeros(n),
        antenna_m=np.zeros((n, 1, 3)),
        time_s=travel,
    )
    # The ground has no surface return; a track filter would only take ground away that the live scans keep.
    settings = replace(default_chain(200e6, spacing_m), track_filter_m=1e3)
    parts = list(stations_of_drive([drive], settings, spacing_m))
    stations = StationBlock(*(np.concatenate(f) for f in zip(*parts, strict=True)))
    spec = grid_spec(LENGTH_M, 0.2, step_m=settings.step_m, pitch_m=0.127, wavelength_m=settings.wavelength_m)
    ahead, found = np.array([[1.0], [0.0]]), len(stations.pose)
    fields = (stations.profile[:, 0], stations.pose[:, :2].T, np.tile(ahead, found), np.ones(found))
    laid = TraceSet(*(field.astype(np.float32) for field in fields))
    tile = grid_traces(laid, np.array([0.0, -spec.cross_cell_m]), spec=spec)
    return linear(np.asarray(tile.coefficients[:, 1], dtype=np.float64), spec.along_cell_m)


def errors(
    make_map: Callable[[Site, float], Sampler], spacing_m: float, step_m: float, on_traces: bool = False
) -> tuple[float, float]:
    """RMS error, and pull towards the middle between places ``step_m`` apart; metres, over random places."""
    error, place = [], []
    for seed in range(SITES):
        site = make_site(seed)
        sample = make_map(site, spacing_m)
        ground, rng = site
        truth = rng.uniform(4.0, LENGTH_M - 4.0, LIVE)
        truth = np.round(truth / step_m) * step_m if on_traces else truth
        live = noisy(ground, truth, rng)
        rows = sample((truth[:, None] + OFFSETS_M).reshape(-1)).reshape(LIVE, len(OFFSETS_M), COEFFICIENTS)
        r = np.einsum("lok,lk->lo", rows, live) / np.linalg.norm(rows, axis=2)
        error.append(OFFSETS_M[r.argmax(axis=1)])
        place.append(truth)
    wrong, phase = np.concatenate(error), 2 * np.pi * np.concatenate(place) / step_m
    return float(np.sqrt(np.mean(wrong**2))), float(2 * np.mean(wrong * np.sin(phase)))


def test_raw_linear_interpolation_has_the_pull_of_the_study() -> None:
    """The yardstick: without it the tests below would show nothing."""
    on_traces_m, _ = errors(raw_map, 0.1, 0.1, on_traces=True)
    assert on_traces_m == pytest.approx(0.032, abs=0.004)
    _, pull_m = errors(raw_map, 0.1, 0.1)
    assert pull_m > 0.006


@pytest.mark.parametrize(
    ("spacing_m", "step_m", "on_traces"), [(0.035, 0.05, False), (0.1, 0.1, False), (0.1, 0.1, True)]
)
def test_our_map_does_not_pull(spacing_m: float, step_m: float, on_traces: bool) -> None:
    """Scans 3.5 cm apart (10 mph at 126 Hz) on stations of 5 cm; scans 10 cm apart, which are the stations themselves.

    The latter are the study's setting, where 1-2-1 smoothing reached 1.9 cm.
    """
    rms_m, pull_m = errors(our_map, spacing_m, step_m, on_traces)
    assert rms_m <= 0.019
    assert abs(pull_m) < 0.002
