"""Success against the coarse stage's step and against the ground's correlation length, as a picture."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes

from benchmarks.process import PeerResult, run_peer
from benchmarks.records import wilson
from benchmarks.registration import CELL_M, HardSetConfig, make_hard_set, save_hard_set
from lgprjax.report.style import BLUE, GAP, INK, MUTED, picture, write_caption

_SEED = 1
_GOAL = 0.99
_ROOM = 1.03
"""Beyond the last mark, so that none is cut."""


@dataclass(frozen=True)
class Sweep:
    """What the figure is measured on.

    Attributes:
        hard_set: size and difficulty of each point's set.
        strides: cells from coarse place to coarse place, along and across.
        correlations_m: of the ground.
        threads: of each process.
    """

    hard_set: HardSetConfig
    strides: tuple[tuple[int, int], ...] = ((2, 1), (3, 2), (5, 3), (6, 4), (8, 5), (10, 6), (12, 8))
    correlations_m: tuple[float, ...] = (0.05, 0.07, 0.09, 0.12, 0.16, 0.22, 0.30)
    threads: int = 2


SWEEP = Sweep(HardSetConfig(maps=2))
QUICK_SWEEP = Sweep(HardSetConfig(maps=1, scans=57), ((3, 2), (6, 4), (10, 6)), (0.06, 0.12, 0.24))
USUAL_STRIDE = (3, 2)


class Point(NamedTuple):
    """A setting in metres and what was found there."""

    setting_m: float
    result: PeerResult


def measure_sweeps(sweep: Sweep, folder: Path, say: Callable[[str], None]) -> tuple[list[Point], list[Point]]:
    """This project's result at every stride, then on ground of every correlation length.

    Args:
        sweep: the settings.
        folder: for the sets' files, removed by the caller.
        say: told what runs now.
    """

    def at(stride: tuple[int, int], config: HardSetConfig) -> PeerResult:
        say(f"figure: stride {stride[0]}x{stride[1]}, correlation length {100 * config.correlation_m:g} cm")
        file = folder / "sweep.npz"
        save_hard_set(file, make_hard_set(_SEED, config))
        options = ("--stride", *(str(cells) for cells in stride))
        count = config.maps * config.scans
        return run_peer("this_project", file, count=count, threads=(sweep.threads,), options=options)

    usual = sweep.hard_set
    strides = [Point(max(stride * CELL_M), at(stride, usual)) for stride in sweep.strides]
    grounds = []
    for length_m in sweep.correlations_m:
        config = HardSetConfig(
            correlation_m=length_m,
            decoy_share=usual.decoy_share,
            decoy_pitch_m=usual.decoy_pitch_m,
            maps=usual.maps,
            scans=usual.scans,
        )
        grounds.append(Point(length_m, at(USUAL_STRIDE, config)))
    return strides, grounds


def draw_sweeps(
    strides: Sequence[Point], grounds: Sequence[Point], path: str | Path, *, usual_m: float, force: bool = False
) -> None:
    """Draw both as success with its 95 % interval.

    Args:
        strides: settings are the coarse step in metres.
        grounds: settings are the correlation length in metres.
        path: the PNG.
        usual_m: correlation length of the ground under the first.
        force: replace a file that exists.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    problems = max(point.result.problems for point in (*strides, *grounds))
    with picture(path, 10.0, 4.4, force) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, strides, "coarse step (cm)", f"correlation length {100 * usual_m:g} cm")
        step_m = max(USUAL_STRIDE * CELL_M)
        _draw(right, grounds, "correlation length of the ground (cm)", f"coarse step {100 * step_m:.3g} cm")
        left.set_ylabel("scans found within 10 cm (%)")
        figure.suptitle("Success of the pose search")
        write_caption(
            figure,
            f"Bars: 95 % intervals of up to {problems} problems a point. Dashed: {100 * _GOAL:g} %. The coarse step is "
            "the larger of those along and across the track; box and noise are those of the hard set.",
        )


def _draw(axes: Axes, points: Sequence[Point], label: str, title: str) -> None:
    ran = [point for point in points if point.result.problems]
    x = [100 * point.setting_m for point in ran]
    shares = [100 * point.result.success_share for point in ran]
    bounds = [wilson(point.result.successes, point.result.problems) for point in ran]
    below = [share - 100 * bound.low for share, bound in zip(shares, bounds, strict=True)]
    above = [100 * bound.high - share for share, bound in zip(shares, bounds, strict=True)]
    axes.grid(axis="y", color=GAP)
    axes.axhline(100 * _GOAL, color=MUTED, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.errorbar(x, shares, yerr=[below, above], color=BLUE, ecolor=INK, elinewidth=1.0, marker="o", capsize=3.0)
    axes.set_ylim(0.0, 100.0 * _ROOM)
    axes.set_xlim(0.0, _ROOM * max(x, default=1.0))
    axes.set_xlabel(label)
    axes.set_title(title)
