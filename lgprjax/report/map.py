"""Pictures of a verified map: plan, strips along the route, agreement of its baselines."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.image import AxesImage

from lgprjax.report.style import (
    BLUE,
    CORRELATION_MAP,
    FAINT,
    GAP,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    VERMILLION,
    outer_edges,
    picture,
    runs_of,
    write_caption,
)

_BASELINES = (BLUE, ORANGE, GREEN, PURPLE)


@dataclass(frozen=True)
class BaselineStrip:
    """One baseline against the ground of the others.

    Attributes:
        at_m: places along the route.
        along_m, cross_m: match minus label; NaN if the match is not ok.
        correlation: correlation of the match.
    """

    at_m: Float[np.ndarray, " place"]
    along_m: Float[np.ndarray, " place"]
    cross_m: Float[np.ndarray, " place"]
    correlation: Float[np.ndarray, " place"]


@dataclass(frozen=True)
class MapStrips:
    """Contents of the picture, one value for each place of the route unless stated otherwise.

    Attributes:
        at_m: distance along the route.
        track_m: east and north of the route.
        width_m: width of the ground across.
        array_m: width of the array.
        overlap, passes, repeats, likeness: see the tables of a verified map.
        ambiguous: whether a rival is as good as the place itself.
        baselines: baselines against the others; empty for a map of one.
        least_overlap, least_repeats, widest_offset_m: limits.
        marked: stretches of every finding that is not good: kind, start and stop in metres.
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
        figure.suptitle(f"Map {strips.name} along its route", x=0.01, ha="left")
        write_caption(
            figure,
            "Dashed: limits. Shaded: stretches below the limit. Repeats: correlation of the stations with those an "
            "eighth of a wavelength farther. Rival: strongest other position within the search region, over the "
            "match of the position with itself. Offsets: matched position of a baseline on the other baselines, minus "
            "its label.",
        )


def _plan(axes: Axes, strips: MapStrips) -> None:
    east, north = strips.track_m[:, 0], strips.track_m[:, 1]
    # Legs of the route that are not consecutive are not joined.
    steps = np.hypot(np.diff(east), np.diff(north))
    breaks = np.flatnonzero(steps > 4.0 * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    for part in np.split(np.arange(len(east)), breaks):
        axes.plot(east[part], north[part], color=FAINT, linewidth=5.0, solid_capstyle="round", zorder=1)
    kinds = list(dict.fromkeys(kind for kind, _, _ in strips.marked))
    for kind, start_m, stop_m in strips.marked:
        inside = (strips.at_m >= start_m) & (strips.at_m <= stop_m)
        # A place may fall short in several ways: later kinds are smaller, so that all of them are visible.
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


# The ground of a map from above, straightened along its route: number of passes, age, holes.

PASSES = tuple(colormaps[CORRELATION_MAP](share) for share in (0.95, 0.75, 0.55, 0.35, 0.1))
"""One pass, two, and so on; the last one is for more: darker with more passes."""
_MARGIN = 0.06
"""Share of the route's length on its left, for the scale bar."""


@dataclass(frozen=True, kw_only=True)
class MapPasses:
    """Cells of a map's ground, along its route and across it.

    Attributes:
        name: name of the map.
        at_m, across_m: middles of the evenly spaced cells, along the route and to its left.
        passes: number of baselines that cover the whole of a cell; 0 without ground.
        age_days: time since the newest of them; NaN without ground or its date.
        hole: mask of cells under the route's array that no baseline covers.
        half_like_m: distance across at which the correlation of the ground's signal has halved; ``None`` if unknown.
        today: reference date of ages.
    """

    name: str
    at_m: Float[np.ndarray, " place"]
    across_m: Float[np.ndarray, " cell"]
    passes: Int[np.ndarray, "place cell"]
    age_days: Float[np.ndarray, "place cell"]
    hole: Bool[np.ndarray, "place cell"]
    half_like_m: float | None
    today: str


def draw_passes(ground: MapPasses, path: str | Path, *, force: bool = False) -> None:
    """Draw passes above and age below, holes hatched, the correlation distance as a bar across.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 11.0, 5.6, force) as figure:
        above, below = figure.subplots(2, 1, sharex=True, sharey=True)
        norm = BoundaryNorm(np.arange(0.5, len(PASSES) + 1.0), len(PASSES))
        counted = np.minimum(ground.passes, len(PASSES)).astype(np.float64)
        levels = _draw_cells(above, ground, np.where(ground.passes > 0, counted, np.nan), ListedColormap(PASSES), norm)
        ticks = [*map(str, range(1, len(PASSES))), f"≥ {len(PASSES)}"]
        bar = figure.colorbar(levels, ax=above, label="passes", pad=0.01, aspect=12)
        bar.set_ticks(list(range(1, len(PASSES) + 1)), labels=ticks)

        oldest = float(np.nanmax(ground.age_days)) if np.isfinite(ground.age_days).any() else 0.0
        span = Normalize(0.0, max(oldest, 1.0))
        newest = np.where(ground.passes > 0, ground.age_days, np.nan)
        ages = _draw_cells(below, ground, newest, colormaps[CORRELATION_MAP].reversed(), span)
        figure.colorbar(ages, ax=below, label="days since the newest pass", pad=0.01, aspect=12)

        for axes in (above, below):
            _hatch_holes(axes, ground)
            axes.set_ylabel("across (m)\nleft positive")
        _draw_scale(above, ground)
        low, high = outer_edges(ground.at_m)
        below.set_xlim(low - _MARGIN * (high - low), high)
        below.set_ylim(*_rows_in_sight(ground))
        below.set_xlabel("along the route (m)")
        holes = f"{int(ground.hole.any(axis=1).sum())} of {len(ground.at_m)} positions with a hole"
        figure.suptitle(f"Map {ground.name}: {holes}")
        write_caption(figure, " ".join([*_notes(ground), f"Ages to {ground.today}."]))


def _rows_in_sight(ground: MapPasses) -> tuple[float, float]:
    """Rows across, with a margin of one cell next to the outermost ground, or hole, on both sides."""
    low, high = outer_edges(ground.across_m)
    held = np.flatnonzero(((ground.passes > 0) | ground.hole).any(axis=0))
    if not len(held):
        return low, high
    cell_m = (high - low) / len(ground.across_m)
    return max(low + (held[0] - 1) * cell_m, low), min(low + (held[-1] + 2) * cell_m, high)


def _notes(ground: MapPasses) -> list[str]:
    low, high = outer_edges(ground.at_m)
    step_m = (high - low) / len(ground.at_m)
    notes = [f"Cells of {step_m:g} m along the route, straightened; a pass counts if it covers the whole cell."]
    if ground.hole.any():
        notes.append("Hatched, and marked above: holes under the route's array.")
    if ground.half_like_m is not None:
        notes.append("Bar: cross-track distance at which the correlation of the ground signal is half.")
    if not np.isfinite(ground.age_days[ground.passes > 0]).all():
        notes.append("Grey: no date in the map.")
    return notes


def _draw_cells(
    axes: Axes, ground: MapPasses, value: Float[np.ndarray, "place cell"], cmap: Colormap, norm: Normalize
) -> AxesImage:
    along, across = outer_edges(ground.at_m), outer_edges(ground.across_m)
    # Ground with an unknown value is grey; cells without ground are white.
    known = np.where(ground.passes > 0, 1.0, np.nan)
    layers = ((known, ListedColormap([FAINT]), Normalize(0.0, 1.0)), (value, cmap, norm))
    for values, colours, scale in layers:
        image = axes.imshow(
            values.T,
            cmap=colours,
            norm=scale,
            origin="lower",
            aspect="auto",
            interpolation="nearest",
            extent=(*along, *across),
        )
    return image


def _hatch_holes(axes: Axes, ground: MapPasses) -> None:
    along, across = outer_edges(ground.at_m), outer_edges(ground.across_m)
    step_m, row_m = (along[1] - along[0]) / len(ground.at_m), (across[1] - across[0]) / len(ground.across_m)
    for row, held in enumerate(ground.hole.T):
        runs = [(along[0] + first * step_m, (last - first) * step_m) for first, last in runs_of(held)]
        if runs:
            rows = (across[0] + row * row_m, row_m)
            axes.broken_barh(runs, rows, facecolor="none", hatch="////", edgecolor=VERMILLION, linewidth=0.0)
    # A hole of a metre is narrower than a dot on a long route.
    for first, last in runs_of(np.asarray(ground.hole.any(axis=1))):
        middle = along[0] + 0.5 * (first + last) * step_m
        axes.plot(middle, 1.0, "v", color=VERMILLION, ms=6, transform=axes.get_xaxis_transform(), clip_on=False)


def _draw_scale(axes: Axes, ground: MapPasses) -> None:
    if ground.half_like_m is None:
        return
    low, high = outer_edges(ground.at_m)
    x, half = low - 0.6 * _MARGIN * (high - low), 0.5 * ground.half_like_m
    axes.errorbar([x], [0.0], yerr=[half], color=INK, elinewidth=2.0, capsize=4.0, fmt="none")
    axes.annotate(
        f"{ground.half_like_m:.2f} m",
        (x, half),
        xytext=(0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=9.0,
        color=MUTED,
    )
