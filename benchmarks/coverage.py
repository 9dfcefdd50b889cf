"""``python -m benchmarks coverage``: the live worked area, the source's cached shapes, brute force; records."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.process import AS_THE_PEER, ProgramError, run_program
from benchmarks.records import Record, machine_line
from lgprjax.coverage.field import LEVELS

_PERIOD_MS = 100.0
_SPARE = 10.0
"""Times that a step must fit into the period of ten moments a second."""


@dataclass(frozen=True)
class CoveragePlan:
    """How much is measured.

    Attributes:
        moments: of the drive.
        draws: of the brute force, at each cell of one moment's patch.
        limit_s: of the process.
    """

    moments: int = 20_000
    draws: int = 100_000
    limit_s: float = 1800.0


FULL_COVERAGE = CoveragePlan()
QUICK_COVERAGE = CoveragePlan(moments=2000, draws=10_000, limit_s=400.0)


class CoverageOutcome(NamedTuple):
    """What a run found.

    Attributes:
        machine: what it ran on.
        records: figures, those with goals among them.
        not_measured: what did not run, and why.
        figures: as the program left them.
    """

    machine: str
    records: list[Record]
    not_measured: list[str]
    figures: dict[str, float]


def run_coverage(plan: CoveragePlan, say: Callable[[str], None]) -> CoverageOutcome:
    """Run a plan.

    Args:
        plan: what to run.
        say: told what runs now.
    """
    machine = machine_line()
    say("worked area, one core")
    arguments = ["--moments", str(plan.moments), "--draws", str(plan.draws)]
    try:
        figures = run_program(
            "benchmarks.worked_area", arguments, threads=1, limit_s=plan.limit_s, environment=AS_THE_PEER
        )
    except ProgramError as error:
        return CoverageOutcome(machine, [], [str(error)], {})
    return CoverageOutcome(machine, coverage_records(figures), [], figures)


def coverage_records(figures: Mapping[str, float]) -> list[Record]:
    """Records of what the program found."""
    goal = _PERIOD_MS / _SPARE
    step = figures["p50_ms"]
    told = f"{figures['moments']:.0f} moments, {figures['cells'] / 1e6:.0f} million cells; period {_PERIOD_MS:.0f} ms"
    worst = f"a full step's whole wait; {_PERIOD_MS / figures['max_ms']:.1f} fit into a period"
    brute = f"{figures['brute_force_ms']:.0f} ms with {figures['draws']:.0f} draws a moment, NumPy"
    records = [
        Record("step, median", step, "ms", "lower", goal, told),
        Record("step, p99", figures["p99_ms"], "ms", "lower", goal, told),
        Record("step, longest", figures["max_ms"], "ms", "lower", None, worst),
        Record("steps in a period", _PERIOD_MS / step, "×", "higher", _SPARE, "of 0.1 s, one core"),
        Record("memory, map", figures["map_mb"], "MB", "lower", None, "probabilities of all cells"),
        Record("memory, process", figures["peak_rss_mb"], "MB", "lower", None, "peak, with JAX and its compiler"),
        Record("brute force / step", figures["brute_force_ms"] / step, "×", "higher", None, brute),
    ]
    for level in LEVELS:
        cached, made_s = figures[f"cached_ms_{level:g}"], figures[f"cached_made_s_{level:g}"]
        ours, theirs = figures[f"ours_m2_{level:g}"], figures[f"cached_m2_{level:g}"]
        told = f"{cached:.3g} ms a moment and {made_s:.3g} s beforehand, one level; a step serves all levels"
        area = f"{ours:.1f} m² to {theirs:.1f} m² of the same drive"
        beyond = figures[f"cached_beyond_ours_cells_{level:g}"]
        records += [
            Record(f"cached shapes / step, {level:g}", cached / step, "×", "higher", None, told),
            Record(f"area / cached shapes, {level:g}", ours / theirs, "×", "higher", 1.0, area),
            Record(f"cells of cached shapes alone, {level:g}", beyond, "", "lower", 0.0, "the cache is a lower bound"),
        ]
    return records


# Smooth random ground on a grid, and its value between the nodes.

_PAD = 32
"""Cells beyond the grid: the field is drawn on a torus, and its opposite edges must not know each other."""
_TAPS = 10
"""Nodes to each side that a value between nodes is made of."""


@dataclass(frozen=True)
class Texture:
    """What the ground looks like in plan.

    Attributes:
        correlation_m: l of the autocorrelation exp(-d²/(2 l²)).
        decoy_share: of the power that repeats every ``decoy_pitch_m`` along the track.
    """

    correlation_m: float = 0.12
    decoy_share: float = 0.35
    decoy_pitch_m: float = 0.61


def draw_ground(
    rng: np.random.Generator,
    size: tuple[int, int],
    cell_m: Float[np.ndarray, " 2"],
    shaping: Float[np.ndarray, "coefficient coefficient"],
    texture: Texture,
) -> Float[np.ndarray, "along cross coefficient"]:
    """A Gaussian field plus a part that repeats along the track, of unit power together before shaping.

    Args:
        size: nodes along and cross.
        cell_m: between them.
        shaping: independent unit coefficients times this are the ground's.
        texture: correlation length and decoy.
    """
    length, numbers = texture.correlation_m, len(shaping)
    torus = (size[0] + _PAD, size[1] + _PAD)
    field = _smooth(rng.standard_normal((*torus, numbers)), cell_m, length)[: size[0], : size[1]]
    along = np.arange(size[0]) * cell_m[0]
    # The harmonic that does not change along the track is left out: a track filter takes such ground away.
    wave = 2.0 * np.pi * np.arange(1, 6) / texture.decoy_pitch_m
    weight = np.exp(-0.25 * (wave * length) ** 2)
    weight /= np.sqrt(np.sum(weight**2))
    phase = np.outer(along, wave)
    waves = np.concatenate([weight * np.cos(phase), weight * np.sin(phase)], axis=1)
    across = _smooth(rng.standard_normal((waves.shape[1], torus[1], numbers)), cell_m, length, axes=(1,))
    decoy = np.tensordot(waves, across[:, : size[1]], axes=1)
    share = texture.decoy_share
    return np.asarray((np.sqrt(1.0 - share) * field + np.sqrt(share) * decoy) @ shaping)


def sample_ground(
    ground: Float[np.ndarray, "along cross coefficient"], cells: Float[np.ndarray, "place 2"]
) -> Float[np.ndarray, "place coefficient"]:
    """Value between nodes by a Gaussian-windowed sinc: the field is band-limited well below the grid's own limit.

    Args:
        ground: the field at its nodes.
        cells: places in cells from node (0, 0), at least ``_TAPS`` cells from the rim.
    """
    low = np.floor(cells).astype(int)
    reach = np.arange(1 - _TAPS, _TAPS + 1)
    distance = (cells - low)[:, :, None] - reach
    kernel = np.sinc(distance) * np.exp(-0.5 * (distance / (0.3 * _TAPS)) ** 2)
    kernel /= np.sum(kernel, axis=-1, keepdims=True)
    patch = ground[(low[:, 0, None] + reach)[:, :, None], (low[:, 1, None] + reach)[:, None, :]].astype(np.float64)
    return np.asarray(np.einsum("pa,pc,pack->pk", kernel[:, 0], kernel[:, 1], patch, optimize=True))


def _smooth(
    white: Float[np.ndarray, "..."],
    cell_m: Float[np.ndarray, " 2"],
    correlation_m: float,
    axes: tuple[int, ...] = (0, 1),
) -> Float[np.ndarray, "..."]:
    """Unit white noise to unit power with autocorrelation exp(-d²/(2 l²)) over the given axes (0 along, 1 cross)."""
    spectrum = np.fft.fftn(white, axes=axes)
    for axis in axes:
        wave = 2.0 * np.pi * np.fft.fftfreq(white.shape[axis], cell_m[axis])
        root = np.exp(-0.25 * (wave * correlation_m) ** 2)
        shape = [1] * white.ndim
        shape[axis] = -1
        spectrum *= (root / np.sqrt(np.mean(root**2))).reshape(shape)
    return np.asarray(np.fft.ifftn(spectrum, axes=axes).real)
