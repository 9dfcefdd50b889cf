"""A map from above: where its stations stand, and how loud its ground is at a few travel times."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from scipy.spatial import KDTree

from lgprjax.radar import WAVE_SPEED_M_PER_NS
from lgprjax.report.style import (
    BLUE,
    CORRELATION_MAP,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    exaggeration,
    outer_edges,
    picture,
    speed_text,
    write_caption,
)

_MOST_CELLS = 500
_LONG = 5.0
"""A map longer than so many times its width is drawn along its own axis."""
_BASELINE_COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY)


@dataclass(frozen=True, kw_only=True)
class MapStations:
    """Antennas of a map's stations and how loud the ground is under them.

    Attributes:
        name: of the map.
        east_m, north_m: of each antenna, from the origin.
        baseline: number of the drive that each was recorded on.
        level: RMS of the amplitudes about each time, with the map's own depth gain.
        time_ns, window_ns: two-way travel times, and how long a stretch about each is summed over.
        step_m, pitch_m: usual distance of stations and of an array's channels, the latter 0 of one channel.
        origin: what the metres count from, in words.
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
        level: of the antenna next to each cell, NaN where none is near.
        antenna_m: x and y of each antenna.
        labels: of the axes.
        origin: what the axes count from, in words.
        equal: whether the axes are east and north, to be drawn alike; else along and across the map.
    """

    x_m: Float[np.ndarray, " column"]
    y_m: Float[np.ndarray, " row"]
    level: Float[np.ndarray, "time row column"]
    antenna_m: Float[np.ndarray, "antenna 2"]
    labels: tuple[str, str]
    origin: str
    equal: bool


def slice_map(stations: MapStations) -> MapSlices:
    """Lay the stations on an even grid; a long narrow map along its own axis."""
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
    east_m, north_m = np.round(place[0], 1) + 0.0  # adding 0 takes the sign off a rounded nothing
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
    """What the slices show, and what depths and metres rest on."""
    step_m = float(slices.x_m[1] - slices.x_m[0]) if len(slices.x_m) > 1 else stations.step_m
    return " ".join(
        [
            f"Slices: RMS over {stations.window_ns:.3g} ns with the map's depth gain; cells of {step_m:.2g} m show the "
            "antenna next to them, white where none is near.",
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
        write_caption(figure, text)
        if not slices.equal:
            write_caption(figure, f"{text} Across drawn ×{exaggeration(panels[0]):.2g}.")


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
