"""The report of a worked field: statements on the ground, their limits, and the signature."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, to_hex
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import NullFormatter

from lgprjax.report.html import ReportFigure, ReportTable, Section, write_report
from lgprjax.report.style import (
    BLUE,
    FAINT,
    GAP,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    SKY,
    VERMILLION,
    picture,
    runs_of,
    write_caption,
)

_LINE = "_" * 24
_WORKED = "It states where the tool was switched on, turning and at its depth."
_PASSED = (
    "It states where the tool was. In at least one run it was not measured whether the tool was switched on, turning "
    "and at its depth."
)
_LIMITS = """This is the record of a machine, not a clearance certificate. {stated} It does not state that the ground
is free of hazards: this requires a search after processing and the decision of the authority in charge.

Probabilities follow from the position uncertainty that the onboard filter estimates, and from the common position error
that control points show. Without control points an assumed error is used (see The work). Probabilities hold if
receiver, reference station and the dimensions in the vehicle file are at least that accurate. A cell has the
probability of its best pass; probabilities of passes are not combined, because their errors are correlated.

Depth is the tool depth below ground as the machine measured it. Ground with stones, roots, slopes or soil for which
the tool is not proven needs an assessment by a person who knows the ground."""


@dataclass(frozen=True, kw_only=True)
class CoveragePage:
    """The texts and tables of a report; rows are formatted texts.

    Attributes:
        name, organisation, period: name of the field, organisation, and period of the work.
        sentences: one statement for each level.
        facts: quantity and value.
        layers: level, processed, uncertain, not processed, share.
        passes_header, passes: names of the columns, and the passes with their figures.
        stops: run, begin, duration, reasons.
        finds: kind, time, latitude, longitude, note.
        control_points: name, when, run, measured minus known east and north, cm.
        turning_points: point, latitude, longitude.
        hashes: file and SHA-256.
        figures: figures, the map first.
        measured: whether the operation of the tool was measured in all runs.
    """

    name: str
    organisation: str
    period: str
    sentences: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    layers: tuple[tuple[str, ...], ...]
    passes_header: tuple[str, ...]
    passes: tuple[tuple[str, ...], ...]
    stops: tuple[tuple[str, ...], ...]
    finds: tuple[tuple[str, ...], ...]
    control_points: tuple[tuple[str, ...], ...]
    turning_points: tuple[tuple[str, ...], ...]
    hashes: tuple[tuple[str, str], ...]
    figures: tuple[ReportFigure, ...]
    measured: bool = True


def write_coverage_page(path: str | Path, page: CoveragePage, *, force: bool = False) -> None:
    """Write the report as one self-contained page.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    layers = ReportTable(
        ("confidence", "processed", "uncertain", "not processed", "processed, of the field"),
        page.layers,
        "Areas of cells with their centre inside the perimeter.",
    )
    facts = ReportTable(("quantity", "value"), page.facts)
    stops = ReportTable(("run", "begin (UTC)", "lasted", "why"), page.stops)
    passes = ReportTable(page.passes_header, page.passes, "Depth and speed measured while cells were counted.")
    points = ReportTable(("point", "latitude deg", "longitude deg"), page.turning_points, "WGS 84.")
    hashes = ReportTable(("file", "SHA-256"), page.hashes, "Recompute these values from the files to verify them.")
    signatures = ReportTable(
        ("for", "name", "date", "signature"),
        tuple((role, _LINE, _LINE, _LINE) for role in ("operator", "team leader", "quality control")),
        "The signature accepts this page as the record of the machine's work only.",
    )
    finds = ReportTable(
        ("kind", "time (UTC)", "latitude deg", "longitude deg", "note"), page.finds, "As reported with the evidence."
    )
    control = ReportTable(
        ("mark", "when", "run", "east cm", "north cm"),
        page.control_points,
        "Measured minus known position. The mean is not corrected; it is added to sigma.",
    )
    unchecked = "No control point was measured: the base position is not verified."
    sections = (
        Section("What was processed", "\n\n".join(page.sentences), (layers,), page.figures[:1]),
        Section("What this record does not say", _LIMITS.format(stated=_WORKED if page.measured else _PASSED)),
        Section("The work", "", (facts,), page.figures[1:]),
        Section("Stops", "" if page.stops else "None.", (stops,) if page.stops else ()),
        Section("Finds and detonations", "" if page.finds else "None reported.", (finds,) if page.finds else ()),
        Section("Control points", "" if page.control_points else unchecked, (control,) if page.control_points else ()),
        Section("Perimeter", "", (points,)),
        Section("Passes", "" if page.passes else "None.", (passes,) if page.passes else ()),
        Section("Files", "", (hashes,)),
        Section("Signatures", "", (signatures,)),
    )
    intro = (
        f"Responsible organisation: {page.organisation}. Worked {page.period}.\n\n"
        "Status: processed by machine; not searched, not released."
    )
    write_report(path, f"{page.name}: record of machine processing", intro, sections, force)


# Map of a worked field: processed ground by confidence, uncertain and unprocessed ground, and every stop.

# Distinguishable with every common colour blindness, and of four different lightnesses in print: the palette's own blue
# is as dark as its vermillion.
_YELLOW, _DEEP_BLUE = "#F0E442", "#00456B"
COLOURS = (VERMILLION, _YELLOW, SKY, _DEEP_BLUE)
"""Colours of cells: not processed, uncertain, processed at the lower level only, processed at the higher level."""
_WIDTH_IN = 9.0


def level_colours(count: int) -> tuple[str, ...]:
    """Colours of ground processed at rising levels: the surest is the darkest."""
    shades = LinearSegmentedColormap.from_list("levels", COLOURS[2:])
    between = [to_hex(shades(share)) for share in np.linspace(0.0, 1.0, count)[1:-1]]
    return (SKY, *between, _DEEP_BLUE)[-count:]


@dataclass(frozen=True, kw_only=True)
class CoverPicture:
    """Contents of the map of a field, metres east and north of its anchor.

    Attributes:
        name: name of the field.
        perimeter_m: corners of the field.
        east_m, north_m, cell_m: south-west corner and side of the cells.
        inside: mask of cells whose centre is inside the perimeter.
        levels: levels of confidence, rising.
        states: state of the cells at each level: 0 not processed, 1 uncertain, 2 processed.
        swaths_m: tracks of the tool.
        stops_m: places with a reason to stop.
    """

    name: str
    perimeter_m: Float[np.ndarray, "corner 2"]
    east_m: float
    north_m: float
    cell_m: float
    inside: Bool[np.ndarray, "north east"]
    levels: tuple[float, ...]
    states: UInt8[np.ndarray, "level north east"]
    swaths_m: tuple[Float[np.ndarray, "_ 2"], ...]
    stops_m: Float[np.ndarray, "stop 2"]


def draw_coverage(cover: CoverPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the map at equal scale, north up.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    north, east = cover.inside.shape
    height_in = 1.9 + float(np.clip(_WIDTH_IN * north / east, 2.5, 11.0))
    with picture(path, _WIDTH_IN, height_in, force) as figure:
        axes = figure.subplots()
        draw_coverage_on(axes, cover)
        figure.suptitle(f"{cover.name}: ground processed by the machine")
        write_caption(
            figure,
            "North is up. Each cell has the probability of its best pass. White lines: tracks of the tool's centre; "
            f"grey: beyond the perimeter. Cells of {100.0 * cover.cell_m:g} cm. A machine pass is not clearance.",
        )


def draw_coverage_on(axes: Axes, cover: CoverPicture) -> None:
    """Draw the map on axes, with its legend above them."""
    # Cells processed at a level are also processed at each lower level.
    kinds = cover.states[0] + np.sum(cover.states[1:] == 2, axis=0, dtype=np.uint8)
    colours = (*COLOURS[:2], *level_colours(len(cover.levels)))
    north, east = kinds.shape
    extent = (
        cover.east_m,
        cover.east_m + east * cover.cell_m,
        cover.north_m,
        cover.north_m + north * cover.cell_m,
    )
    axes.imshow(
        np.ma.masked_array(kinds, ~cover.inside),
        cmap=ListedColormap(colours).with_extremes(bad=GAP),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        origin="lower",
        extent=extent,
        interpolation="nearest",
        aspect="equal",
    )
    for way in cover.swaths_m:
        axes.plot(*way.T, color="white", linewidth=0.5, alpha=0.7)
    axes.add_patch(Polygon(cover.perimeter_m, fill=False, edgecolor=INK, linewidth=1.4))
    if len(cover.stops_m):
        axes.plot(*cover.stops_m.T, "X", color=INK, markeredgecolor="white", markersize=9, label="stop")
    axes.set_xlim(*extent[:2])
    axes.set_ylim(*extent[2:])
    axes.set_xlabel("east of the anchor (m)")
    axes.set_ylabel("north of the anchor (m)")
    _legend(axes, cover, kinds, colours)


def _legend(axes: Axes, cover: CoverPicture, kinds: UInt8[np.ndarray, "north east"], colours: tuple[str, ...]) -> None:
    *lower, highest = (f"{100.0 * level:g} %" for level in cover.levels)
    uncertain = f"uncertain at {100.0 * cover.levels[0]:g} %"
    words = ("not processed", uncertain, *(f"processed at {each} only" for each in lower), f"processed at {highest}")
    inside = kinds[cover.inside]
    patches = [
        Patch(facecolor=colour, edgecolor=MUTED, label=f"{word}: {_share(inside == kind)}")
        for kind, (colour, word) in enumerate(zip(colours, words, strict=True))
    ]
    handles, _ = axes.get_legend_handles_labels()
    axes.legend(
        handles=[*patches[::-1], *handles], loc="lower center", bbox_to_anchor=(0.5, 1.01), ncols=3, frameon=False
    )


def _share(held: Bool[np.ndarray, " cell"]) -> str:
    """Rounded down: nearly all is not all."""
    return f"{np.floor(1000.0 * np.mean(held)) / 10.0:.1f} %"


# A plan before it is driven: ground, keep-outs, swaths in their order, and the turns between them.


@dataclass(frozen=True, kw_only=True)
class CoverPlanPicture:
    """A plan in metres east and north of its anchor.

    Attributes:
        title, caption: title above the picture, and caption below it.
        perimeter_m: corners of the field.
        ground_m: rings of the ground that must be safe to drive on.
        keep_outs_m: rings of the keep-outs, including their buffers.
        swaths_m: start and end of each swath, in driving order.
        forward_m, reverse_m: points along the ways between swaths.
        width_m: width of the tool.
        computed_m: corner computed from three driven corners; ``None`` without one.
    """

    title: str
    caption: str
    perimeter_m: Float[np.ndarray, "_ 2"]
    ground_m: tuple[Float[np.ndarray, "_ 2"], ...]
    keep_outs_m: tuple[Float[np.ndarray, "_ 2"], ...]
    swaths_m: tuple[Float[np.ndarray, "2 2"], ...]
    forward_m: tuple[Float[np.ndarray, "_ 2"], ...]
    reverse_m: tuple[Float[np.ndarray, "_ 2"], ...]
    width_m: float
    computed_m: Float[np.ndarray, "2"] | None = None


def draw_cover_plan(plan: CoverPlanPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw a plan: the earlier a swath, the darker it is.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 8.0, 8.0, force) as figure:
        axes = figure.subplots()
        for ring in plan.ground_m:
            axes.add_patch(Polygon(ring, fill=False, edgecolor=VERMILLION, linewidth=1.6, linestyle="--"))
        for ring in plan.keep_outs_m:
            axes.add_patch(Polygon(ring, facecolor=GAP, edgecolor=VERMILLION, linewidth=1.2, hatch="xx"))
        order = colormaps["viridis"](np.linspace(0.0, 0.9, len(plan.swaths_m)))
        for swath, colour in zip(plan.swaths_m, order, strict=True):
            axes.add_patch(Polygon(_tool_strip(swath, plan.width_m), facecolor=colour, alpha=0.25, linewidth=0.0))
            axes.annotate("", swath[1], swath[0], arrowprops={"arrowstyle": "->", "color": colour, "linewidth": 1.2})
        for way in plan.forward_m:
            axes.plot(*way.T, color=MUTED, linewidth=0.9)
        for way in plan.reverse_m:
            axes.plot(*way.T, color=ORANGE, linewidth=1.1, linestyle=":")
        axes.add_patch(Polygon(plan.perimeter_m, fill=False, edgecolor=INK, linewidth=1.6))
        axes.plot(*plan.swaths_m[0][0], "o", color=INK)
        axes.plot(*plan.swaths_m[-1][1], "s", color=INK)
        handles = [
            Line2D([], [], color=INK, linewidth=1.6, label="perimeter"),
            Line2D([], [], color=VERMILLION, linestyle="--", label="fence: safe ground ends"),
            Line2D([], [], color=MUTED, label="turn"),
            Line2D([], [], color=ORANGE, linestyle=":", label="in reverse"),
            Line2D([], [], color=INK, marker="o", linestyle="none", label="begin"),
            Line2D([], [], color=INK, marker="s", linestyle="none", label="end"),
        ]
        if plan.computed_m is not None:
            east, north = plan.computed_m.tolist()
            mark = Line2D([east], [north], color=VERMILLION, marker="o", markersize=14, linestyle="none")
            mark.set(markerfacecolor="none", markeredgewidth=2.5, label="fourth corner: computed, visit it")
            axes.add_line(mark)
            axes.annotate("visit", (east, north), (10, 10), textcoords="offset points", color=VERMILLION)
            handles.append(mark)
        axes.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.01), ncols=3, frameon=False)
        axes.set_aspect("equal", adjustable="datalim")
        axes.autoscale_view()
        axes.set_xlabel("east of the anchor (m)")
        axes.set_ylabel("north of the anchor (m)")
        figure.suptitle(plan.title)
        write_caption(figure, plan.caption)


def _tool_strip(swath: Float[np.ndarray, "2 2"], width_m: float) -> Float[np.ndarray, "4 2"]:
    along = swath[1] - swath[0]
    aside = 0.5 * width_m * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return np.array([swath[0] + aside, swath[1] + aside, swath[1] - aside, swath[0] - aside])


# Measurements while working a field: depth, speed and the position's uncertainty over time, with the stops.

# Hours between two recordings are drawn as one second.
_LONGEST_STEP_S = 1.0


@dataclass(frozen=True, kw_only=True)
class CoverChannelsPicture:
    """Channels over the moments of a record.

    Attributes:
        time_s: time of each moment.
        depth_m, speed_mps: measured depth and speed.
        sigma_m: standard deviation of the position along the worse axis.
        counts: whether cells counted.
        fixed: whether the GNSS position was fixed.
        stopped: whether there was a reason to stop.
    """

    time_s: Float[np.ndarray, " moment"]
    depth_m: Float[np.ndarray, " moment"]
    speed_mps: Float[np.ndarray, " moment"]
    sigma_m: Float[np.ndarray, " moment"]
    counts: Bool[np.ndarray, " moment"]
    fixed: Bool[np.ndarray, " moment"]
    stopped: Bool[np.ndarray, " moment"]


def draw_cover_channels(channels: CoverChannelsPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the channels over minutes of recording.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    step_s = np.clip(np.diff(channels.time_s, prepend=channels.time_s[:1]), 0.0, _LONGEST_STEP_S)
    minutes = np.cumsum(step_s) / 60.0
    with picture(path, 9.0, 6.6, force) as figure:
        depth, speed, sigma = figure.subplots(3, 1, sharex=True)
        rows = (
            (depth, 100.0 * channels.depth_m, "depth (cm)", BLUE),
            (speed, channels.speed_mps, "speed (m/s)", GREEN),
            (sigma, 100.0 * channels.sigma_m, "position sigma (cm)", INK),
        )
        for axes, values, label, colour in rows:
            _shade(axes, minutes, channels.stopped, ORANGE, 0.45)
            axes.plot(minutes, np.where(channels.counts, values, np.nan), color=colour, linewidth=1.2)
            axes.plot(minutes, np.where(channels.counts, np.nan, values), color=FAINT, linewidth=0.9)
            axes.set_ylabel(label)
            axes.spines[["top", "right"]].set_visible(False)
        depth.invert_yaxis()
        if np.nanmax(channels.sigma_m, initial=0.0) > 0.0:
            sigma.set_yscale("log")
            sigma.yaxis.set_major_formatter("{x:g}")
            sigma.yaxis.set_minor_formatter(NullFormatter())
        _shade(sigma, minutes, ~channels.fixed, MUTED, 0.25)
        sigma.set_xlabel("minutes of recording")
        figure.suptitle("Measured values during work")
        write_caption(
            figure,
            "Coloured: cells counted (tool switched on, turning, at its depth, heading known). Light grey: cells not "
            "counted. Orange: a reason to stop. Grey, below: no fixed GNSS position. Sigma: from the onboard filter, "
            "along the worse axis.",
        )


def _shade(
    axes: Axes, minutes: Float[np.ndarray, " moment"], held: Bool[np.ndarray, " moment"], colour: str, alpha: float
) -> None:
    for first, last in runs_of(held):
        axes.axvspan(minutes[first], minutes[min(last, len(minutes) - 1)], color=colour, alpha=alpha, linewidth=0)
