"""The direct score in Numba: bilinear map under eleven antennas, correlation over channels and depth.

Band-limited: the scan is delayed to ``STEPS`` heights once, so that a pose only looks its row up; a step is 1 mm of
height, a phase error of 0.3° at most. Full: the map's traces have 369 samples, and the scan is delayed by linear
interpolation in time at each pose.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

from benchmarks.registration import CHANNEL_LEFT_M, CHANNELS, LIGHT_SPEED_M_PER_NS, SAMPLE_INTERVAL_NS, HardSet

STEPS = 192
_ROW = 48
_MARGIN = 8
_PER_M = 2.0 / LIGHT_SPEED_M_PER_NS
_PER_M_SAMPLES = _PER_M / SAMPLE_INTERVAL_NS
_LEFT = CHANNEL_LEFT_M.astype(np.float64)


class Search(NamedTuple):
    """Everything about a hard set that the kernels need.

    Attributes:
        rows: of each map, node by node; rows padded to whole cache lines.
        frame: origin, one over cell, prior and half width, lowest delay, one over its step; see ``_score_*``.
        cross: nodes across.
        length: numbers of a row that count.
        ramp: of each delay step, cosines then sines.
        hear: int8 scans to what ``prepare`` takes.
        prepare: kernel (heard, ramp) to what the score compares with.
        score: kernel (rows, cross, frame, prepared, length, box position) to r.
    """

    rows: list[Float[np.ndarray, "node row"]]
    frame: Float[np.ndarray, " 16"]
    cross: int
    length: int
    ramp: Float[np.ndarray, "step row"]
    hear: Callable[[Float[np.ndarray, "*batch sample"]], Float[np.ndarray, "*batch number"]]
    prepare: Callable[..., Any]
    score: Callable[..., Any]


def make_search(hard_set: HardSet, full: bool) -> Search:
    """Rows and constants of the full or the band-limited score."""
    maps, along, cross, numbers = hard_set.ground.shape
    half_width, prior = hard_set.half_width, hard_set.prior[0]
    reach_ns = _PER_M * (half_width[2] + abs(_LEFT[0]) * np.sin(half_width[4]) + 1e-4)
    step_ns = 2.0 * reach_ns / (STEPS - 1)
    frame = np.concatenate(
        [hard_set.origin_m, 1.0 / hard_set.cell_m, prior, half_width, [-reach_ns, 1.0 / step_ns]]
    ).astype(np.float64)
    flat = hard_set.ground.reshape(maps, along * cross, numbers)
    phase = np.outer(step_ns * np.arange(STEPS) - reach_ns, hard_set.omega)
    ramp = np.zeros((STEPS, _ROW), np.float32)
    ramp[:, : numbers // 2], ramp[:, numbers // 2 : numbers] = np.cos(phase), np.sin(phase)
    if full:
        samples = len(hard_set.basis)
        rows = [_padded(part @ hard_set.basis.T.astype(np.float32), 384) for part in flat]
        return Search(rows, frame, cross, samples, ramp, _repeated_ends, _as_it_is, _score_full)
    rows = [_padded(part, _ROW) for part in flat]
    basis = hard_set.basis.astype(np.float32)
    return Search(rows, frame, cross, numbers, ramp, lambda scans: scans @ basis, _at_all_delays, _score_band)


def _repeated_ends(samples: Float[np.ndarray, "*batch sample"]) -> Float[np.ndarray, "*batch row"]:
    """The scan as it is, repeated a little at both ends: delays are circular, as the map's frequencies are."""
    return np.ascontiguousarray(
        np.concatenate([samples[..., -_MARGIN:], samples, samples[..., :_MARGIN]], axis=-1), np.float32
    )


def _padded(rows: Float[np.ndarray, "node number"], width: int) -> Float[np.ndarray, "node row"]:
    wide = np.zeros((len(rows), width), np.float32)
    wide[:, : rows.shape[1]] = rows
    return wide


@njit
def _as_it_is(heard, _ramp):
    return heard


@njit(fastmath=True)
def _at_all_delays(coefficients, ramp):
    """Every channel of a scan at every delay step, levelled to unit power over the channels together."""
    channels, half = coefficients.shape[0], coefficients.shape[1] // 2
    table = np.zeros((channels, ramp.shape[0], ramp.shape[1]), np.float32)
    power = np.float32(0.0)
    for channel in range(channels):
        for k in range(2 * half):
            power += coefficients[channel, k] ** 2
    level = np.float32(1.0) / np.sqrt(power + np.float32(1e-30))
    for channel in range(channels):
        for step in range(ramp.shape[0]):
            for k in range(half):
                cos, sin = ramp[step, k] * level, ramp[step, half + k] * level
                real, imaginary = coefficients[channel, k], coefficients[channel, half + k]
                table[channel, step, k] = real * cos - imaginary * sin
                table[channel, step, half + k] = imaginary * cos + real * sin
    return table


@njit(fastmath=True)
def _score_band(rows, cross, frame, live, _length, u):
    yaw, roll = u[3] * frame[12], u[4] * frame[13]
    cos, sin, lift = np.cos(frame[7] + yaw), np.sin(frame[7] + yaw), np.sin(frame[8] + roll)
    east, north = frame[4] + u[0] * frame[9], frame[5] + u[1] * frame[10]
    product, power = np.float32(0.0), np.float32(0.0)
    for channel in range(CHANNELS):
        left = _LEFT[channel]
        x = (east - sin * left - frame[0]) * frame[2]
        y = (north + cos * left - frame[1]) * frame[3]
        i, j = int(x), int(y)
        a, b = np.float32(x - i), np.float32(y - j)
        node = i * cross + j
        w00, w01 = (np.float32(1.0) - a) * (np.float32(1.0) - b), (np.float32(1.0) - a) * b
        w10, w11 = a * (np.float32(1.0) - b), a * b
        delay = _PER_M * (u[2] * frame[11] + left * lift)
        step = int((delay - frame[14]) * frame[15] + 0.5)
        g00, g01, g10, g11 = rows[node], rows[node + 1], rows[node + cross], rows[node + cross + 1]
        heard = live[channel, step]
        # The pad holds zeros: a fixed length is unrolled.
        for k in range(_ROW):
            g = w00 * g00[k] + w01 * g01[k] + w10 * g10[k] + w11 * g11[k]
            product += g * heard[k]
            power += g * g
    return product / np.sqrt(power + np.float32(1e-30))


@njit(fastmath=True)
def _score_full(rows, cross, frame, live, length, u):
    yaw, roll = u[3] * frame[12], u[4] * frame[13]
    cos, sin, lift = np.cos(frame[7] + yaw), np.sin(frame[7] + yaw), np.sin(frame[8] + roll)
    east, north = frame[4] + u[0] * frame[9], frame[5] + u[1] * frame[10]
    product, power, strength = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for channel in range(CHANNELS):
        left = _LEFT[channel]
        x = (east - sin * left - frame[0]) * frame[2]
        y = (north + cos * left - frame[1]) * frame[3]
        i, j = int(x), int(y)
        a, b = np.float32(x - i), np.float32(y - j)
        node = i * cross + j
        w00, w01 = (np.float32(1.0) - a) * (np.float32(1.0) - b), (np.float32(1.0) - a) * b
        w10, w11 = a * (np.float32(1.0) - b), a * b
        later = _PER_M_SAMPLES * (u[2] * frame[11] + left * lift) + _MARGIN
        first = int(later)
        c = np.float32(later - first)
        d = np.float32(1.0) - c
        g00, g01, g10, g11 = rows[node], rows[node + 1], rows[node + cross], rows[node + cross + 1]
        heard, next_heard = live[channel, first:], live[channel, first + 1 :]
        for k in range(length):
            g = w00 * g00[k] + w01 * g01[k] + w10 * g10[k] + w11 * g11[k]
            s = d * heard[k] + c * next_heard[k]
            product += g * s
            power += g * g
            strength += s * s
    return product / np.sqrt(power * strength + np.float32(1e-30))
