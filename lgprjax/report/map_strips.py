"""The picture of a verified map: its plan, and strips along the route of what was measured."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes

from lgprjax.report.style import BLUE, FAINT, GAP, GREEN, INK, MUTED, ORANGE, PURPLE, VERMILLION, picture, write_caption

_BASELINES = (BLUE, ORANGE, GREEN, PURPLE)


@dataclass(frozen=True)
class BaselineStrip:
    """One baseline against the ground of the others.

    Attributes:
        at_m: places along the route.
        along_m, cross_m: match less label; NaN where the match is not ok.
        correlation: of the match.
    """

    at_m: Float[np.ndarray, " place"]
    along_m: Float[np.ndarray, " place"]
    cross_m: Float[np.ndarray, " place"]
    correlation: Float[np.ndarray, " place"]


@dataclass(frozen=True)
class MapStrips:
    """What is drawn, one value a place of the route unless said otherwise.

    Attributes:
        at_m: metres along the route.
        track_m: east and north.
        width_m: ground across; ``array_m`` is the array's width.
        overlap, passes, repeats, likeness: see the tables of a verified map.
        ambiguous: a rival is as good as the place itself.
        baselines: against the others; empty for a map of one.
        least_overlap, least_repeats, widest_offset_m: limits.
        marked: stretches of every finding that is not good: kind, start and stop metres.
    """

    name: str
    at_m: Float[np.ndarray, " place"]
    track_m: Float[np.ndarray, "place 2"]
    width_m: Float[np.ndarray, " place"]
    array_m: float
    overlap: Float[np.ndarray, " place"]
    passes: Float[np.ndarray, " place"]
    repeats: Float[np.ndarray, " place"]
    likeness: Float[np.ndarray, " place"]
    ambiguous: Bool[np.ndarray, " place"]
    baselines: tuple[BaselineStrip, ...]
    least_overlap: float
    least_repeats: float
    widest_offset_m: float
    marked: tuple[tuple[str, float, float], ...]


def draw_map_strips(strips: MapStrips, path: str | Path, *, force: bool = False) -> None:
    """Draw a verified map. Raises ``InputError`` if the file exists (without ``force``) or cannot be written."""
    rows = 6 if strips.baselines else 4
    with picture(path, 11.0, 2.4 + 1.7 * rows, force) as figure:
        heights = [1.5] + [1.0] * (rows - 1)
        plan, *axes = figure.subplots(rows, 1, height_ratios=heights)
        _plan(plan, strips)
        _width(axes[0], strips)
        short = strips.repeats < strips.least_repeats
        _line(axes[1], strips, strips.repeats, short, "weak", "signal that\nrepeats")
        axes[1].axhline(strips.least_repeats, color=VERMILLION, linewidth=0.9, linestyle="--")
        _line(axes[2], strips, strips.likeness, strips.ambiguous, "ambiguous", "best rival /\nown match")
        if strips.baselines:
            _offsets(axes[3], strips)
            _correlations(axes[4], strips)
        for each in axes:
            each.set_xlim(strips.at_m[0] - 0.5, strips.at_m[-1] + 0.5)
            each.grid(color=GAP, linewidth=0.6)
            each.set_axisbelow(True)
            each.label_outer()
        axes[-1].set_xlabel("along the route (m)")
        figure.suptitle(f"Map {strips.name}: what lies along its route", x=0.01, ha="left")
        write_caption(
            figure,
            "Dashed: limits. Shaded: stretches that fall short. Repeats: correlation of the stations with those an "
            "eighth of a wavelength farther. Rival: strongest other place within the search region, over the match of "
            "the place with itself. Offsets: where the ground of the other baselines puts a baseline, less its label.",
        )


def _plan(axes: Axes, strips: MapStrips) -> None:
    east, north = strips.track_m[:, 0], strips.track_m[:, 1]
    # Legs of the route that do not follow on each other are not joined.
    steps = np.hypot(np.diff(east), np.diff(north))
    breaks = np.flatnonzero(steps > 4.0 * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    for part in np.split(np.arange(len(east)), breaks):
        axes.plot(east[part], north[part], color=FAINT, linewidth=5.0, solid_capstyle="round", zorder=1)
    kinds = list(dict.fromkeys(kind for kind, _, _ in strips.marked))
    for kind, start_m, stop_m in strips.marked:
        inside = (strips.at_m >= start_m) & (strips.at_m <= stop_m)
        # A place may fall short in several ways: later kinds are smaller, so that all of them show.
        size = 13.0 - 1.7 * kinds.index(kind)
        axes.plot(east[inside], north[inside], "o", color=_COLOURS[kind], markersize=size, zorder=2 + kinds.index(kind))
    for kind in kinds:
        axes.plot([], [], "o", color=_COLOURS[kind], label=kind)
    if strips.marked:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=6, edgecolor="none")
    axes.annotate("start", (east[0], north[0]), xytext=(0, 7), textcoords="offset points", color=MUTED, fontsize=9)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")


_COLOURS = {
    "coverage": ORANGE,
    "holes": VERMILLION,
    "weak": MUTED,
    "ambiguous": PURPLE,
    "offset": BLUE,
    "disagreement": GREEN,
    "channels": INK,
}


def _shade(axes: Axes, strips: MapStrips, kinds: tuple[str, ...]) -> None:
    for kind, start_m, stop_m in strips.marked:
        if kind in kinds:
            axes.axvspan(start_m, stop_m, color=_COLOURS[kind], alpha=0.18, linewidth=0)


def _width(axes: Axes, strips: MapStrips) -> None:
    axes.step(strips.at_m, strips.width_m, where="mid", color=INK, linewidth=1.2, label="ground across")
    axes.step(strips.at_m, strips.overlap * strips.array_m, where="mid", color=BLUE, linewidth=1.0, label="array on it")
    axes.axhline(strips.least_overlap * strips.array_m, color=VERMILLION, linewidth=0.9, linestyle="--")
    _shade(axes, strips, ("coverage", "holes"))
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("width (m)")
    twin = axes.twinx()
    twin.step(strips.at_m, strips.passes, where="mid", color=MUTED, linewidth=1.0, linestyle=":")
    twin.set_ylim(0.0, max(2.0, float(strips.passes.max()) + 1.0))
    twin.set_ylabel("passes (dotted)", color=MUTED)
    axes.legend(loc="lower right", ncols=2)


def _line(
    axes: Axes,
    strips: MapStrips,
    value: Float[np.ndarray, " place"],
    short: Bool[np.ndarray, " place"],
    kind: str,
    label: str,
) -> None:
    axes.plot(strips.at_m, value, color=INK, linewidth=1.2)
    axes.plot(strips.at_m[short], value[short], ".", color=VERMILLION, markersize=6)
    _shade(axes, strips, (kind,))
    axes.set_ylim(0.0, 1.05)
    axes.set_ylabel(label)


def _offsets(axes: Axes, strips: MapStrips) -> None:
    for number, strip in enumerate(strips.baselines):
        colour = _BASELINES[number % len(_BASELINES)]
        axes.plot(
            strip.at_m,
            100.0 * strip.along_m,
            ".-",
            color=colour,
            linewidth=0.8,
            markersize=4,
            label=f"baseline {number} along",
        )
        axes.plot(
            strip.at_m, 100.0 * strip.cross_m, "x:", color=colour, linewidth=0.8, markersize=4, label=f"{number} across"
        )
    for sign in (-1.0, 1.0):
        axes.axhline(sign * 100.0 * strips.widest_offset_m, color=VERMILLION, linewidth=0.9, linestyle="--")
    _shade(axes, strips, ("offset",))
    axes.set_ylabel("offset (cm)")
    if len(strips.baselines) <= len(_BASELINES):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=8, edgecolor="none")


def _correlations(axes: Axes, strips: MapStrips) -> None:
    for number, strip in enumerate(strips.baselines):
        colour = _BASELINES[number % len(_BASELINES)]
        axes.plot(strip.at_m, strip.correlation, ".-", color=colour, linewidth=0.8, markersize=4)
    _shade(axes, strips, ("disagreement",))
    axes.set_ylim(0.0, 1.05)
    axes.set_ylabel("correlation of\nbaselines")
