"""Hard registration problems from a seed: what every search in the comparison is given.

Grounds are smooth Gaussian fields in plan, independent from one coefficient to the next up to a depth envelope,
with autocorrelation exp(-d²/(2 l²)); a share of the power repeats exactly every 0.61 m along the track, so that
false places look right. Scans are heard from the field itself between its nodes (``field``), not by the bilinear
sampling that the searches use, and carry as much noise as makes r at the truth the drawn value.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.bench.field import Texture, draw_ground, sample_ground
from lgprjax.errors import InputError

LIGHT_SPEED_M_PER_NS = 0.299792458
SAMPLES = 369
SAMPLE_INTERVAL_NS = 0.16
HARMONICS = np.arange(5, 27)
"""On the grid of the discrete Fourier transform, where Parseval is exact. 100-400 MHz holds 18 of its
frequencies; two more at either end make 22, 85 to 440 MHz."""
CHANNELS = 11
CHANNEL_LEFT_M = 0.127 * (CHANNELS // 2 - np.arange(CHANNELS))
"""Of each channel from the array's centre; channel 0 is the leftmost."""
HEIGHT_REFERENCE_M = 0.3
CELL_M = np.array([0.04, 0.0635])
HALF_CELLS = (92, 68)
"""3.68 m by 4.32 m either way: the box and the array at 5°, no search leaves the map."""
SUCCESS_M = 0.10
_OUT_OF_BAND_SHARE = 0.05
_FULL_SCALE_RMS = 5.0


@dataclass(frozen=True)
class HardSetConfig(Texture):
    """Size and difficulty; the ground's look in plan is inherited.

    Attributes:
        maps, scans: grounds, and scans on each; 114 scans are a tile of 4 m driven at 3.5 cm.
        half_width: of the search box: along_m, cross_m, height_m, heading_rad, roll_rad.
        correlation_low, correlation_high: r at the truth is drawn between them, one a scan.
    """

    maps: int = 8
    scans: int = 114
    half_width: tuple[float, float, float, float, float] = (
        3.5,
        3.5,
        0.08,
        float(np.deg2rad(4)),
        float(np.deg2rad(1.5)),
    )
    correlation_low: float = 0.45
    correlation_high: float = 0.65


class HardSet(NamedTuple):
    """The problems.

    Attributes:
        ground: coefficients (real parts, then imaginary parts) at each node, at ``HEIGHT_REFERENCE_M``.
        origin_m, cell_m: along and cross of node (0, 0), and between nodes.
        omega: angular frequency of each complex coefficient, rad/ns.
        basis: orthonormal; ``samples @ basis`` are the band-limited numbers of a trace.
        scans: int8 values; scaled each by itself.
        map_index: ground of each problem.
        truth: along_m, cross_m, height_m above ground, heading_rad, roll_rad.
        prior: centre of each box, in the same units; its height is ``HEIGHT_REFERENCE_M``.
        half_width: of every box.
        correlation: r at the truth, in band, before quantisation.
    """

    ground: Float[np.ndarray, "map along cross coefficient"]
    origin_m: Float[np.ndarray, " 2"]
    cell_m: Float[np.ndarray, " 2"]
    omega: Float[np.ndarray, " half"]
    basis: Float[np.ndarray, "sample coefficient"]
    scans: Float[np.ndarray, "problem channel sample"]
    map_index: Int[np.ndarray, " problem"]
    truth: Float[np.ndarray, "problem 5"]
    prior: Float[np.ndarray, "problem 5"]
    half_width: Float[np.ndarray, " 5"]
    correlation: Float[np.ndarray, " problem"]


def make_hard_set(seed: int, config: HardSetConfig | None = None) -> HardSet:
    """The same problems for the same seed and settings."""
    config = config or HardSetConfig()
    rng = np.random.default_rng(seed)
    basis, omega = band_basis()
    size = (2 * HALF_CELLS[0] + 1, 2 * HALF_CELLS[1] + 1)
    shaping = _depth_shaping(basis)
    ground = np.stack([draw_ground(rng, size, CELL_M, shaping, config) for _ in range(config.maps)]).astype(np.float32)
    origin = -CELL_M * np.array(HALF_CELLS)
    index = np.repeat(np.arange(config.maps), config.scans)
    half_width = np.array(config.half_width)
    prior = np.tile(np.array([0.0, 0.0, HEIGHT_REFERENCE_M, 0.0, 0.0]), (len(index), 1))
    truth = prior + 0.8 * half_width * rng.uniform(-1.0, 1.0, prior.shape)
    drawn = rng.uniform(config.correlation_low, config.correlation_high, len(index))
    scans = np.empty((len(index), CHANNELS, SAMPLES), np.float32)
    for problem, place in enumerate(index):
        heard = hear(ground[place], origin, omega, truth[problem])
        scans[problem] = _noisy_samples(rng, heard, basis, drawn[problem])
    return HardSet(ground, origin, CELL_M, omega, basis, scans, index, truth, prior, half_width, drawn)


def band_basis() -> tuple[Float[np.ndarray, "sample coefficient"], Float[np.ndarray, " half"]]:
    """Orthonormal in-band columns of the discrete Fourier transform, and their frequencies in rad/ns."""
    omega = 2.0 * np.pi * HARMONICS / (SAMPLES * SAMPLE_INTERVAL_NS)
    phase = np.outer(np.arange(SAMPLES) * SAMPLE_INTERVAL_NS, omega)
    return np.concatenate([np.cos(phase), -np.sin(phase)], axis=1) * np.sqrt(2.0 / SAMPLES), omega


def hear(
    ground: Float[np.ndarray, "along cross coefficient"],
    origin_m: Float[np.ndarray, " 2"],
    omega: Float[np.ndarray, " half"],
    pose: Float[np.ndarray, " 5"],
) -> Float[np.ndarray, "channel coefficient"]:
    """Coefficients that the array hears at a pose, without noise: an antenna higher up hears its trace later."""
    left = CHANNEL_LEFT_M
    place = np.stack([pose[0] - np.sin(pose[3]) * left, pose[1] + np.cos(pose[3]) * left], axis=-1)
    still = sample_ground(ground, (place - origin_m) / CELL_M)
    delay_ns = (pose[2] + left * np.sin(pose[4]) - HEIGHT_REFERENCE_M) * 2.0 / LIGHT_SPEED_M_PER_NS
    half = len(omega)
    later = (still[:, :half] + 1j * still[:, half:]) * np.exp(-1j * delay_ns[:, None] * omega)
    return np.concatenate([later.real, later.imag], axis=1)


def success(pose: Float[np.ndarray, "*batch 5"], truth: Float[np.ndarray, "*batch 5"]) -> Bool[np.ndarray, "*batch"]:
    """Within 0.10 m of the truth horizontally."""
    return np.asarray(error_m(pose, truth) <= SUCCESS_M)


def error_m(pose: Float[np.ndarray, "*batch 5"], truth: Float[np.ndarray, "*batch 5"]) -> Float[np.ndarray, "*batch"]:
    """Horizontal distance from the truth."""
    return np.asarray(np.hypot(pose[..., 0] - truth[..., 0], pose[..., 1] - truth[..., 1]))


def save_hard_set(path: str | Path, hard_set: HardSet) -> None:
    """As an npz file for other processes."""
    with Path(path).open("wb") as file:
        np.savez(file, **hard_set._asdict())


def load_hard_set(path: str | Path) -> HardSet:
    """Read what ``save_hard_set`` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    try:
        with np.load(path) as file:
            return HardSet(**{name: file[name] for name in HardSet._fields})
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, "hard set", "an npz file of a hard set", str(error)) from None


def _depth_shaping(basis: Float[np.ndarray, "sample coefficient"]) -> Float[np.ndarray, "coefficient coefficient"]:
    """Spectrum about 220 MHz, then a depth envelope that falls by e in 40 ns, in band."""
    frequency_mhz = HARMONICS / (SAMPLES * SAMPLE_INTERVAL_NS) * 1e3
    amplitude = np.tile(np.exp(-(((frequency_mhz - 220.0) / 130.0) ** 2)), 2)
    envelope = np.exp(-np.arange(SAMPLES) * SAMPLE_INTERVAL_NS / 40.0)
    return np.asarray(amplitude[:, None] * (basis.T @ (envelope[:, None] * basis)))


def _noisy_samples(
    rng: np.random.Generator,
    heard: Float[np.ndarray, "channel coefficient"],
    basis: Float[np.ndarray, "sample coefficient"],
    correlation: float,
) -> Float[np.ndarray, "channel sample"]:
    """Int8 samples whose in-band part has exactly this correlation with what was heard, but for rounding."""
    noise = rng.standard_normal(heard.shape)
    noise -= heard * np.sum(noise * heard) / np.sum(heard**2)
    noise *= np.sqrt(np.sum(heard**2) * (correlation**-2 - 1.0) / np.sum(noise**2))
    inside = (heard + noise) @ basis.T
    outside = rng.standard_normal(inside.shape)
    outside -= outside @ basis @ basis.T
    outside *= np.sqrt(_OUT_OF_BAND_SHARE * np.sum(inside**2) / np.sum(outside**2))
    samples = inside + outside
    scale = 127.0 / (_FULL_SCALE_RMS * np.sqrt(np.mean(samples**2)))
    return np.asarray(np.clip(np.round(samples * scale), -127, 127), np.float32)
