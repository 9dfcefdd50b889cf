"""How long the stages of a running system take: a histogram a stage, with the deadline that it has to keep."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from lgprjax.report.style import BLUE, INK, MUTED, VERMILLION, label_decades, picture, write_caption

_BINS = 120
_LEAST_MS = 1e-3
"""A stage that a clock cannot resolve still has a place on a logarithmic axis."""


@dataclass(frozen=True)
class StageTimes:
    """How long one stage took, each time.

    Attributes:
        name: of the stage.
        milliseconds: of each event; what is not finite is left out.
        deadline_ms: to keep; None where there is none.
    """

    name: str
    milliseconds: Float[np.ndarray, " event"]
    deadline_ms: float | None = None


@dataclass(frozen=True, kw_only=True)
class TimingPicture:
    """Stages of one system.

    Attributes:
        title: of the picture.
        stages: in the order of the way through the system, at least one.
        note: what was measured on what, for the caption.
    """

    title: str
    stages: tuple[StageTimes, ...]
    note: str


def draw_timing(timing: TimingPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw a histogram a stage over one logarithmic axis, with median, 99th percentile, largest and deadline.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    times = [_measured(stage) for stage in timing.stages]
    everything = np.concatenate([*times, [stage.deadline_ms for stage in timing.stages if stage.deadline_ms]])
    low, high = (everything.min(), everything.max()) if everything.size else (1.0, 1.0)
    bins = np.geomspace(0.8 * low, 1.25 * high, _BINS + 1)
    with picture(path, 9.0, 2.0 + 1.35 * len(times), force) as figure:
        rows = figure.subplots(len(times), 1, sharex=True, squeeze=False)[:, 0]
        for axes, stage, values in zip(rows, timing.stages, times, strict=True):
            _draw_stage(axes, stage, values, bins)
        rows[-1].set_xscale("log")
        rows[-1].set_xlim(bins[0], bins[-1])
        label_decades(rows[-1].xaxis)
        rows[-1].set_xlabel("time (ms)")
        figure.supylabel("events (the highest of each row as high as the row)", fontsize=9.0)
        figure.suptitle(timing.title)
        write_caption(
            figure,
            f"{timing.note} Dotted: median and 99th percentile. Dashed: deadline; hatched beyond it.",
        )


def _draw_stage(axes: Axes, stage: StageTimes, values: Float[np.ndarray, " event"], bins: np.ndarray) -> None:
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_yticks([])
    deadline = stage.deadline_ms
    if deadline is not None:
        axes.axvline(deadline, color=INK, linewidth=1.4, linestyle=(0, (4, 2)))
    if not values.size:
        axes.set_title(f"{stage.name}: no event", fontweight="bold", fontsize=9.5)
        return
    late = values > (np.inf if deadline is None else deadline)
    # A bin that the deadline cuts shows both parts, one on the other.
    kept, beyond = (np.histogram(values[part], bins)[0] for part in (~late, late))
    axes.stairs(kept, bins, fill=True, facecolor=BLUE)
    axes.stairs(
        kept + beyond,
        bins,
        baseline=kept,
        fill=True,
        facecolor=VERMILLION,
        hatch="////",
        edgecolor="white",
        linewidth=0.0,
    )
    middle, rare = np.percentile(values, [50.0, 99.0])
    for at in (middle, rare):
        axes.axvline(at, color=MUTED, linewidth=1.0, linestyle=":")
    text = f"{stage.name}: median {middle:.3g}, p99 {rare:.3g}, largest {values.max():.3g} ms of {len(values)}"
    if deadline is not None:
        text += f"; {int(late.sum())} over {deadline:g} ms"
    axes.set_title(text, fontweight="bold", fontsize=9.5)


def _measured(stage: StageTimes) -> Float[np.ndarray, " event"]:
    values = np.asarray(stage.milliseconds, np.float64)
    return np.maximum(values[np.isfinite(values)], _LEAST_MS)
