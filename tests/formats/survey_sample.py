"""A made survey of parallel lines over one ground, with all that goes wrong in real ones."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from formats.samples import write_dt1

STEP_M = 0.25
SAMPLES = 160
WAVE_SAMPLE = 40.0
"""Where the direct wave begins; headers that are right say so."""
_PERIOD = 12.5
"""Of 100 MHz in samples of 0.8 ns."""


def direct_wave(begin: float = WAVE_SAMPLE, samples: int = SAMPLES) -> np.ndarray:
    """Two periods that swell and die away, the first lobe positive."""
    at = (np.arange(samples) - begin) / (2.0 * _PERIOD)
    lobes = np.sin(np.pi * at) ** 2 * np.sin(4.0 * np.pi * at)
    return np.where((at > 0.0) & (at < 1.0), 20000.0 * lobes, 0.0)


class Ground:
    """Echoes of one ground, every 0.25 m along it, which each line sees with echoes of its own on top."""

    def __init__(self, seed: int, traces: int = 140) -> None:
        self.seed = seed
        self.echoes = self._echoes(seed, traces)

    def line(self, number: int, first: int, traces: int) -> np.ndarray:
        """Traces of a line from a place of the ground on, in the survey's direction and sign."""
        own = self._echoes(self.seed + 1000 + number, traces)
        return np.asarray(self.echoes[first : first + traces] + 0.5 * own + direct_wave())

    @staticmethod
    def _echoes(seed: int, traces: int) -> np.ndarray:
        white = np.random.default_rng(seed).normal(size=(traces, SAMPLES))
        echoes = gaussian_filter(white, (1.5, 2.0))
        echoes *= 1500.0 / echoes.std()
        # Nothing comes before the direct wave.
        echoes[:, : int(WAVE_SAMPLE + 2 * _PERIOD)] = 0.0
        return np.asarray(echoes)


def write_survey(
    folder: Path,
    *,
    firsts: Sequence[int],
    traces: Sequence[int] | None = None,
    reversed_lines: Sequence[int] = (),
    inverted: Sequence[int] = (),
    time_zeros: dict[int, float] | None = None,
    first_number: int = 0,
    seed: int = 1,
) -> tuple[list[Path], list[np.ndarray]]:
    """Lines as DT1, and their traces as they should be: in the survey's direction and sign.

    Args:
        folder: for the files.
        firsts: place of the ground, in traces, at which each line begins.
        traces: of each line; 100 each without it.
        reversed_lines, inverted: indices of lines that are stored the other way.
        time_zeros: samples of headers that are wrong, by index.
        first_number: in the first file's name.
        seed: of the ground.
    """
    ground = Ground(seed)
    paths, truth = [], []
    for i, first in enumerate(firsts):
        line = np.rint(ground.line(i, first, 100 if traces is None else traces[i])).astype(np.int16)
        truth.append(line)
        stored = line[::-1] if i in reversed_lines else line
        stored = -stored if i in inverted else stored
        zero = (time_zeros or {}).get(i, WAVE_SAMPLE)
        path = folder / f"LINE{first_number + i:02}.DT1"
        paths.append(write_dt1(path, stored, step=STEP_M, TIMEZERO_AT_POINT=zero))
    return paths, truth


def write_topography(line: Path, east: np.ndarray, north: np.ndarray) -> Path:
    """``topo_NAME.txt`` beside a line."""
    path = line.with_name(f"topo_{line.stem}.txt")
    rows = "".join(f"{n:.4f},{e:.4f},10.00\n" for e, n in zip(east, north, strict=True))
    path.write_text("N,E,Z\n" + rows)
    return path
