"""Radargrams and depth slices in the conventional form."""

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.spatial import KDTree

from lgprjax.formats.profile import Profile
from lgprjax.radar import WAVE_SPEED_M_PER_NS, Radargram
from lgprjax.report.style import (
    AMPLITUDE_MAP,
    BLUE,
    CORRELATION_MAP,
    FAINT,
    GREEN,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    outer_edges,
    picture,
    speed_text,
    write_caption,
    write_stretch_caption,
)

LIMIT_PERCENTILE = 98.5
NO_TRACE = "#cfe3f4"
"""Colour for missing traces, which is not grey."""
_WIDTH_IN, _HIGH_IN, _LOW_IN, _WORDS_IN = 11.0, 4.9, 3.1, 0.9
_PLAN_LOW_IN, _PLAN_HIGH_IN = 1.7, 4.5
_MOST_COLUMNS = 6000


@dataclass(frozen=True, kw_only=True)
class LinePlan:
    """Plan of a line.

    Attributes:
        east_m, north_m: position of each channel's antenna, from the origin.
        distance_m: distance along the line, as on the axis of its radargrams.
        shown: channels that the radargrams show.
        origin: description of the origin of the metres.
    """

    east_m: Float[np.ndarray, "place channel"]
    north_m: Float[np.ndarray, "place channel"]
    distance_m: Float[np.ndarray, " place"]
    shown: tuple[int, ...]
    origin: str


@dataclass(frozen=True, kw_only=True)
class LineView:
    """The picture of a line.

    Attributes:
        title: title of the picture.
        radargrams: radargrams, one per channel, from left to right.
        plan: plan of the line; ``None`` if its position is unknown.
        wave_speed_m_per_ns: wave speed of the depth axis.
        speed_is: source of the wave speed.
        notes: sentences for the caption.
    """

    title: str
    radargrams: tuple[Radargram, ...]
    plan: LinePlan | None = None
    wave_speed_m_per_ns: float = WAVE_SPEED_M_PER_NS
    speed_is: Literal["assumed", "given"] = "assumed"
    notes: tuple[str, ...] = ()


def radargram_of(profile: Profile, channel: int = 0) -> Radargram:
    """One channel of a vendor's file as recorded; very many traces are decimated.

    Unevenly spaced traces are put on an even grid, each cell with the nearest trace.
    """
    traces = profile.channels[:, channel]
    count, samples = traces.shape
    start_m = 0.0 if profile.positions_m is None else float(profile.positions_m[0])
    way = -1.0 if profile.positions_m is not None and profile.positions_m[-1] < profile.positions_m[0] else 1.0
    chosen = counted_columns(count)
    along, in_metres = chosen.astype(np.float64), False
    if profile.spacing_m is not None:
        along, in_metres = start_m + way * profile.spacing_m * chosen, True
    elif profile.positions_m is not None:
        places, nearest = even_columns(way * profile.positions_m)
        # Traces that all have one position are counted, as those without any are.
        if len(places) > 1:
            along, chosen, in_metres = way * places, nearest, True
    held = traces[chosen].astype(np.float32)
    amplitude = np.where((chosen[:, None] >= 0) & np.isfinite(held), held, np.float32(np.nan))
    return Radargram(
        name=profile.path.name if profile.channels.shape[1] == 1 else f"channel {channel}",
        amplitude=amplitude,
        along=along,
        in_metres=in_metres,
        time_ns=np.arange(samples) * profile.sample_interval_ns - profile.time_zero_ns,
        centre_frequency_hz=profile.centre_frequency_hz,
    )


def even_columns(
    place_m: Float[np.ndarray, " trace"],
) -> tuple[Float[np.ndarray, " column"], Int[np.ndarray, " column"]]:
    """An even grid along a line and the nearest trace of each place; -1 without a near one.

    Traces taken standing or in reverse are skipped. The grid has the usual step of the rest, with at most 6000 places.
    """
    reach = np.maximum.accumulate(np.where(np.isfinite(place_m), place_m, -np.inf))
    onward = np.flatnonzero(np.diff(reach, prepend=-np.inf) > 0)
    if len(onward) < 2:
        return np.zeros(1), np.zeros(1, np.int64)
    held_m = place_m[onward]
    usual_m = float(np.median(np.diff(held_m)))
    span_m = float(held_m[-1] - held_m[0])
    columns = int(np.clip(round(span_m / usual_m) + 1, 2, _MOST_COLUMNS))
    grid_m = np.linspace(held_m[0], held_m[-1], columns)
    after = np.clip(np.searchsorted(held_m, grid_m), 1, len(held_m) - 1)
    nearest = np.where(grid_m - held_m[after - 1] <= held_m[after] - grid_m, after - 1, after)
    near = np.abs(held_m[nearest] - grid_m) <= 5.0 * max(usual_m, span_m / (columns - 1))
    return grid_m, np.where(near, onward[nearest], -1)


def counted_columns(traces: int) -> Int[np.ndarray, " column"]:
    """All traces, decimated to at most 6000."""
    return np.arange(0, traces, -(-traces // _MOST_COLUMNS))


def amplitude_limit(radargram: Radargram) -> float:
    """The 98.5th percentile of the absolute amplitudes: the grey scale is symmetric."""
    finite = np.abs(radargram.amplitude[np.isfinite(radargram.amplitude)])
    # A silent radargram still needs different limits.
    return float(np.percentile(finite, LIMIT_PERCENTILE)) or 1.0 if finite.size else 1.0


def draw_radargram(
    radargram: Radargram, axes: Axes, *, wave_speed_m_per_ns: float = WAVE_SPEED_M_PER_NS, limit: float | None = None
) -> Axes:
    """Draw a radargram: travel time down at the left, depth at the right, distance or trace number along the bottom.

    Args:
        radargram: recorded radargram, or one from ``clear_view``.
        axes: axes to draw on, in a script, a notebook or another figure.
        wave_speed_m_per_ns: wave speed of the depth axis, which states it.
        limit: amplitude of white, and negative amplitude of black; by default the 98.5th percentile.

    Returns:
        the axes.
    """
    top = limit if limit is not None else amplitude_limit(radargram)
    along, time = outer_edges(radargram.along), outer_edges(radargram.time_ns)
    axes.imshow(
        radargram.amplitude.T,
        cmap=colormaps[AMPLITUDE_MAP].with_extremes(bad=NO_TRACE),
        vmin=-top,
        vmax=top,
        aspect="auto",
        interpolation="antialiased",
        extent=(along[0], along[1], time[1], time[0]),
    )
    axes.set_xlabel("distance along the line (m)" if radargram.in_metres else "trace number")
    axes.set_ylabel("two-way travel time (ns)")
    if radargram.time_ns[0] < 0.0 < radargram.time_ns[-1]:
        axes.axhline(0.0, color=VERMILLION, linewidth=0.8)
    axis = axes.secondary_yaxis(
        "right",
        functions=(
            lambda time_ns: np.multiply(time_ns, wave_speed_m_per_ns / 2.0),
            lambda depth_m: np.divide(depth_m, wave_speed_m_per_ns / 2.0),
        ),
    )
    axis.yaxis.set_major_locator(_Depths(nbins=8, steps=[1, 2, 2.5, 5, 10]))
    axis.set_ylabel(depth_label(wave_speed_m_per_ns))
    return axes


def depth_label(wave_speed_m_per_ns: float) -> str:
    """Label of a depth axis, with its wave speed."""
    return f"depth (m), v = {speed_text(wave_speed_m_per_ns)} m/ns"


def draw_line(view: LineView, path: str | Path, *, force: bool = False) -> None:
    """Draw the radargrams of a line one below the other, and their plan.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    several = len(view.radargrams) > 1
    each_in = _LOW_IN if several else _HIGH_IN
    heights = [each_in] * len(view.radargrams) + ([_plan_height_in(view.plan)] if view.plan else [])
    with picture(path, _WIDTH_IN, sum(heights) + _WORDS_IN, force) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        panels = [figure.add_subplot(grid[row]) for row in range(len(heights))]
        for radargram, axes in zip(view.radargrams, panels, strict=False):
            draw_radargram(radargram, axes, wave_speed_m_per_ns=view.wave_speed_m_per_ns)
            if several:
                axes.set_title(radargram.name)
        if view.plan is not None:
            _draw_plan(panels[-1], view.plan)
        figure.suptitle(view.title)
        _caption(figure, panels[0], view)


def caption_of(view: LineView) -> str:
    """Processing, limits of the colours, and assumptions of the depths."""
    first = view.radargrams[0]
    # Each channel has its own gain; common steps are listed once.
    of_all = zip_longest(*(each.steps for each in view.radargrams), fillvalue="nothing")
    steps = "; ".join(" / ".join(dict.fromkeys(each)) for each in of_all)
    done = f"Processing: {steps}." if steps else "As recorded: no processing, no gain."
    limits = f"Grey: 0 ± the {LIMIT_PERCENTILE:g}th percentile of the amplitudes, white positive."
    speed_m_per_ns = speed_text(view.wave_speed_m_per_ns)
    speed = f"Depth: v = {speed_m_per_ns} m/ns is {view.speed_is}; antenna separation is not corrected for."
    zero = ["Red line: time zero."] if first.time_ns[0] < 0.0 < first.time_ns[-1] else []
    gaps = any(np.isnan(each.amplitude).any() for each in view.radargrams)
    missing = ["Pale blue: no trace."] if gaps else []
    return " ".join([done, limits, *zero, *missing, speed, *view.notes])


def _caption(figure: Figure, axes: Axes, view: LineView) -> None:
    text = caption_of(view)
    if view.plan is not None:
        text += f" Plan: metres from {view.plan.origin}."
    if view.radargrams[0].in_metres:
        write_stretch_caption(axes, text, "Depth", view.wave_speed_m_per_ns / 2.0)
    else:
        write_caption(figure, text)


def _draw_plan(axes: Axes, plan: LinePlan) -> None:
    for channel in range(plan.east_m.shape[1]):
        if channel not in plan.shown:
            axes.plot(plan.east_m[:, channel], plan.north_m[:, channel], color=FAINT, linewidth=0.8)
    for channel in plan.shown:
        axes.plot(plan.east_m[:, channel], plan.north_m[:, channel], color=BLUE, linewidth=1.4)
    middle = plan.shown[len(plan.shown) // 2]
    east, north = plan.east_m[:, middle], plan.north_m[:, middle]
    for place, mark, colour, word in ((0, "o", GREEN, "start"), (-1, "s", VERMILLION, "end")):
        axes.plot(east[place], north[place], mark, color=colour, markersize=7, label=word)
    marks_m = MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(plan.distance_m[0], plan.distance_m[-1])
    for mark_m in marks_m[(marks_m > plan.distance_m[0]) & (marks_m < plan.distance_m[-1])]:
        at = int(np.argmin(np.abs(plan.distance_m - mark_m)))
        axes.plot(east[at], north[at], ".", color=BLUE, markersize=5)
        axes.annotate(
            f"{mark_m:g} m",
            (east[at], north[at]),
            xytext=(0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=8.0,
            color=MUTED,
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.05)
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.set_title(f"plan of {_channels(plan)}")
    axes.legend(loc="best")


def _channels(plan: LinePlan) -> str:
    count = plan.east_m.shape[1]
    if count == 1:
        return "the line"
    return f"{count} channels" + (
        f", channel {', '.join(map(str, plan.shown))} blue" if len(plan.shown) < count else ""
    )


def _plan_height_in(plan: LinePlan) -> float:
    east_m, north_m = (float(np.ptp(each)) for each in (plan.east_m, plan.north_m))
    return float(np.clip(0.8 * _WIDTH_IN * north_m / max(east_m, 1e-9) + 0.9, _PLAN_LOW_IN, _PLAN_HIGH_IN))


class _Depths(MaxNLocator):
    """Above the ground there is no depth."""

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        return [float(tick) for tick in super().tick_values(vmin, vmax) if tick >= -1e-9]


# A map from above: its stations, and the level of its ground at a few travel times.

_MOST_CELLS = 500
_LONG = 5.0
"""A map longer than this multiple of its width is drawn along its own axis."""
_BASELINE_COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY)


@dataclass(frozen=True, kw_only=True)
class MapStations:
    """Antennas of a map's stations and the level of the ground under them.

    Attributes:
        name: name of the map.
        east_m, north_m: position of each antenna, from the origin.
        baseline: number of each antenna's drive.
        level: RMS of the amplitudes around each time, with the map's own depth gain.
        time_ns, window_ns: two-way travel times, and the length of the window around each.
        step_m, pitch_m: usual distance of stations and of an array's channels, the latter 0 for a single channel.
        origin: description of the origin of the metres.
        notes: sentences for the caption.
    """

    name: str
    east_m: Float[np.ndarray, " antenna"]
    north_m: Float[np.ndarray, " antenna"]
    baseline: Int[np.ndarray, " antenna"]
    level: Float[np.ndarray, "antenna time"]
    time_ns: Float[np.ndarray, " time"]
    window_ns: float
    step_m: float
    pitch_m: float
    origin: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MapSlices:
    """Stations on a grid.

    Attributes:
        x_m, y_m: middles of the cells.
        level: level of the antenna nearest to each cell, NaN without a near one.
        antenna_m: x and y of each antenna.
        labels: labels of the axes.
        origin: description of the origin of the axes.
        equal: whether the axes are east and north, drawn with equal scale; else along and across the map.
    """

    x_m: Float[np.ndarray, " column"]
    y_m: Float[np.ndarray, " row"]
    level: Float[np.ndarray, "time row column"]
    antenna_m: Float[np.ndarray, "antenna 2"]
    labels: tuple[str, str]
    origin: str
    equal: bool


def slice_map(stations: MapStations) -> MapSlices:
    """Put the stations on an even grid; a long narrow map along its own axis."""
    place = np.stack([stations.east_m, stations.north_m], axis=1)
    middle = place.mean(axis=0)
    axis = np.linalg.svd(place - middle, full_matrices=False)[2][0] if len(place) > 1 else np.array([1.0, 0.0])
    if (place[-1] - place[0]) @ axis < 0:
        axis = -axis
    turned = (place - place[0]) @ np.stack([axis, [-axis[1], axis[0]]], axis=1)
    equal = bool(np.ptp(turned[:, 0]) < _LONG * np.ptp(turned[:, 1]))
    antenna_m = place if equal else turned
    bearing = np.degrees(np.arctan2(axis[0], axis[1])) % 360.0
    labels = ("east (m)", "north (m)") if equal else (f"along the map, towards {bearing:.0f}° (m)", "across (m)")
    east_m, north_m = np.round(place[0], 1) + 0.0  # adding 0 removes the sign of a rounded zero
    start = f"the first antenna, east {east_m:.1f} m and north {north_m:.1f} m of "
    cell_m = max(stations.step_m, float(np.ptp(antenna_m, axis=0).max()) / _MOST_CELLS)
    near_m = max(cell_m, 0.6 * stations.pitch_m)
    x_m, y_m = (_middles(antenna_m[:, each], cell_m, near_m) for each in (0, 1))
    grid = np.stack(np.meshgrid(x_m, y_m), axis=-1)
    away_m, nearest = KDTree(antenna_m).query(grid, distance_upper_bound=near_m)
    held = np.isfinite(away_m)
    level = np.where(held, stations.level.T[:, np.where(held, nearest, 0)], np.nan)
    return MapSlices(
        x_m=x_m,
        y_m=y_m,
        level=level,
        antenna_m=antenna_m,
        labels=labels,
        origin=stations.origin if equal else start + stations.origin,
        equal=equal,
    )


def _middles(place_m: Float[np.ndarray, " antenna"], cell_m: float, beyond_m: float) -> Float[np.ndarray, " cell"]:
    low, high = float(place_m.min()) - 0.5 * beyond_m, float(place_m.max()) + 0.5 * beyond_m
    cells = max(2, round((high - low) / cell_m))
    return np.asarray(low + (np.arange(cells) + 0.5) * (high - low) / cells)


def level_limits(level: Float[np.ndarray, "time row column"]) -> tuple[float, float]:
    """The 1st and the 99th percentile."""
    finite = level[np.isfinite(level)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (1.0, 99.0))
    return float(low), float(max(high, low + 1e-12))


def slice_title(stations: MapStations, number: int, wave_speed_m_per_ns: float) -> str:
    """Time and depth of a slice."""
    time_ns = float(stations.time_ns[number])
    return f"{time_ns:.1f} ns, depth {time_ns * wave_speed_m_per_ns / 2.0:.2f} m"


def caption_of_slices(stations: MapStations, slices: MapSlices, wave_speed_m_per_ns: float, speed_is: str) -> str:
    """Contents of the slices, and assumptions of depths and metres."""
    step_m = float(slices.x_m[1] - slices.x_m[0]) if len(slices.x_m) > 1 else stations.step_m
    return " ".join(
        [
            f"Slices: RMS over {stations.window_ns:.3g} ns with the map's depth gain; cells of {step_m:.2g} m "
            "show the nearest antenna, white where none is near.",
            f"Depth: v = {speed_text(wave_speed_m_per_ns)} m/ns is {speed_is}.",
            f"Metres from {slices.origin}.",
            *stations.notes,
        ]
    )


def draw_map_slices(
    stations: MapStations,
    path: str | Path,
    *,
    wave_speed_m_per_ns: float = WAVE_SPEED_M_PER_NS,
    speed_is: str = "assumed",
    force: bool = False,
) -> None:
    """Draw the plan of a map's stations, then its slices from shallow to deep.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    slices = slice_map(stations)
    count = len(stations.time_ns) + 1
    rows, columns = ((count + 2) // 3, 3) if slices.equal else (count, 1)
    height_in = _height_in(slices) * rows + 1.3
    low, high = level_limits(slices.level)
    x, y = outer_edges(slices.x_m), outer_edges(slices.y_m)
    with picture(path, 11.0, height_in, force) as figure:
        panels = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel())
        _draw_stations(panels[0], stations, slices)
        for number, axes in enumerate(panels[1:count]):
            image = axes.imshow(
                slices.level[number],
                cmap=colormaps[CORRELATION_MAP],
                vmin=low,
                vmax=high,
                origin="lower",
                aspect="equal" if slices.equal else "auto",
                interpolation="nearest",
                extent=(*x, *y),
            )
            axes.set_title(slice_title(stations, number, wave_speed_m_per_ns))
        for axes in panels[count:]:
            axes.set_axis_off()
        for axes in panels[:count]:
            axes.label_outer()
        for number in range(count):
            if number + columns >= count:
                panels[number].set_xlabel(slices.labels[0])
                panels[number].tick_params(labelbottom=True)
            if number % columns == 0:
                panels[number].set_ylabel(slices.labels[1])
        figure.colorbar(image, ax=panels, shrink=0.6, pad=0.01, label="RMS amplitude")
        figure.suptitle(f"Map {stations.name}: {_counted(len(np.unique(stations.baseline)))}")
        text = caption_of_slices(stations, slices, wave_speed_m_per_ns, speed_is)
        if slices.equal:
            write_caption(figure, text)
        else:
            write_stretch_caption(panels[0], text, "Across")


def _height_in(slices: MapSlices) -> float:
    if not slices.equal:
        return 1.5
    x, y = outer_edges(slices.x_m), outer_edges(slices.y_m)
    return float(np.clip(3.0 * (y[1] - y[0]) / (x[1] - x[0]), 1.2, 5.0)) + 0.6


def _draw_stations(axes: Axes, stations: MapStations, slices: MapSlices) -> None:
    numbers = np.unique(stations.baseline)
    for order, number in enumerate(numbers):
        own = slices.antenna_m[stations.baseline == number]
        colour = _BASELINE_COLOURS[order % len(_BASELINE_COLOURS)]
        axes.plot(own[:, 0], own[:, 1], ".", color=colour, markersize=1.5)
    if slices.equal:
        axes.set_aspect("equal")
    axes.set_title(f"antennas of {_counted(len(numbers))}")


def _counted(baselines: int) -> str:
    return "1 baseline" if baselines == 1 else f"{baselines} baselines"
