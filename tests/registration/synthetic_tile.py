"""A random smooth ground, a tile cut from it, and live templates taken anywhere on it; NumPy float64.

The ground is a sum of plane waves in each coefficient, so that its exact value is known between the cells.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from lgprjax.radar import coefficient_basis, default_chain
from lgprjax.registration import SearchProblem, SearchSpec, Template, Thresholds
from lgprjax.subsurface import Tile

SETTINGS = default_chain(200e6, 0.035)
SAMPLES = 40
INTERVAL_NS = SETTINGS.sample_interval_ns
BASIS = coefficient_basis(np.ones(SAMPLES), INTERVAL_NS, SETTINGS)
OMEGA = np.asarray(BASIS.angular_frequency_rad_per_ns, dtype=np.float64)
HALF = len(OMEGA)

CELLS = (56, 40)
CELL_M = np.array([0.05, 0.06])
ORIGIN_M = np.array([-1.4, -1.2])
REFERENCE_M = 0.3
NS_PER_M = 2 / 0.299792458

CHANNELS, SCANS = 6, 3
LEFT_M = np.tile((2.5 - np.arange(CHANNELS)) * 0.127, SCANS)
FORWARD_M = np.repeat([0.0, -0.1, -0.2], CHANNELS)
OFFSET_M = np.stack([FORWARD_M, LEFT_M], axis=-1)
TRACES = CHANNELS * SCANS

SEARCH = SearchSpec(lattice=(23, 19), margin=(22, 18))
HALF_WIDTH = np.array([0.5, 0.5, 0.08, np.radians(3.0), np.radians(1.5)])
THRESHOLDS = Thresholds(*(jnp.float32(value) for value in (6.0, 1.5, 0.6, 1.0)))

Ground = Callable[[np.ndarray], np.ndarray]
"""Places [..., 2] to complex waves [..., half] of unit power."""


def random_ground(seed: int, scale_m: float = 0.13) -> Ground:
    """Correlation falls as exp(-d²/2 scale²)."""
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(60, 2, HALF)) / scale_m
    factor = (rng.normal(size=(60, HALF)) + 1j * rng.normal(size=(60, HALF))) / np.sqrt(120)
    return lambda place: np.asarray(
        np.sum(factor * np.exp(1j * np.einsum("...d,dkh->...kh", place, wave.swapaxes(0, 1))), axis=-2)
    )


def along_ground(seed: int) -> Ground:
    """Furrows: varies along only."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(30, HALF)) + 1j * rng.normal(size=(30, HALF))
    wave = rng.normal(size=(30, HALF)) / 0.13
    return lambda place: np.asarray(np.sum(factor * np.exp(1j * place[..., :1, None] * wave), axis=-2) / np.sqrt(60))


def periodic_ground(seed: int, period_m: float) -> Ground:
    """Comes again along after each period; random across."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(30, HALF)) + 1j * rng.normal(size=(30, HALF))
    along = 2 * np.pi / period_m * rng.integers(1, 4, size=(30, HALF))
    cross = rng.normal(size=(30, HALF)) / 0.13

    def ground(place: np.ndarray) -> np.ndarray:
        phase = place[..., :1, None] * along + place[..., 1:, None] * cross
        return np.asarray(np.sum(factor * np.exp(1j * phase), axis=-2) / np.sqrt(60))

    return ground


def stacked(wave: np.ndarray) -> np.ndarray:
    """All real parts, then all imaginary parts."""
    return np.concatenate([wave.real, wave.imag], axis=-1)


def make_tile(ground: Ground, valid: np.ndarray | None = None) -> Tile:
    along, cross = (ORIGIN_M[axis] + np.arange(CELLS[axis]) * CELL_M[axis] for axis in range(2))
    covered = np.ones(CELLS, bool) if valid is None else valid
    value = stacked(ground(np.stack(np.meshgrid(along, cross, indexing="ij"), axis=-1)))
    value = np.where(covered[..., None], value, 0.0)
    return Tile(
        coefficients=jnp.asarray(value, dtype=jnp.float32),
        power=jnp.asarray(np.sum(value**2, axis=-1), dtype=jnp.float32),
        valid=jnp.asarray(covered),
        origin_m=jnp.asarray(ORIGIN_M, dtype=jnp.float32),
        cell_m=jnp.asarray(CELL_M, dtype=jnp.float32),
    )


def places(pose: np.ndarray, offset_m: np.ndarray = OFFSET_M) -> np.ndarray:
    """Where a pose puts the antennas."""
    turn = np.array([[np.cos(pose[3]), -np.sin(pose[3])], [np.sin(pose[3]), np.cos(pose[3])]])
    return np.asarray(pose[:2] + offset_m @ turn.T)


def live(ground: Ground, pose: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Coefficients as recorded at a pose: an antenna higher above the ground hears it later."""
    above_m = pose[2] + LEFT_M * np.sin(pose[4]) - REFERENCE_M
    wave = ground(places(pose)) * np.exp(-1j * above_m[:, None] * NS_PER_M * OMEGA)
    return np.asarray(stacked(wave) + noise * np.sqrt(0.5) * rng.normal(size=(TRACES, 2 * HALF)))


def make_problem(
    ground: Ground,
    truth: np.ndarray,
    prior: np.ndarray,
    *,
    noise: float = 0.4,
    seed: int = 0,
    half_width: np.ndarray = HALF_WIDTH,
) -> SearchProblem:
    """A batch: truth and prior [batch, 5]."""
    rng = np.random.default_rng(seed)
    batch = len(truth)
    coefficients = np.stack([live(ground, pose, noise, rng) for pose in truth])
    return SearchProblem(
        template=Template(
            coefficients=jnp.asarray(coefficients, dtype=jnp.float32),
            offset_m=jnp.asarray(np.tile(OFFSET_M, (batch, 1, 1)), dtype=jnp.float32),
            valid=jnp.ones((batch, TRACES), bool),
            scan=jnp.asarray(np.tile(np.arange(TRACES) // CHANNELS, (batch, 1)), dtype=jnp.int32),
        ),
        prior=jnp.asarray(prior, dtype=jnp.float32),
        half_width=jnp.asarray(np.tile(half_width, (batch, 1)), dtype=jnp.float32),
        finite=jnp.ones(batch, bool),
    )
