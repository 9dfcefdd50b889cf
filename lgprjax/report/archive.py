"""The page of an archive: all drives together, the worst places of the map, the worst drives, failures."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lgprjax.report.html import ReportFigure, ReportTable, Section, write_report
from lgprjax.report.results import CODES
from lgprjax.report.style import (
    BLUE,
    CODE_COLOURS,
    CORRELATION_MAP,
    GAP,
    INK,
    MUTED,
    ORANGE,
    VERMILLION,
    picture,
    write_caption,
)

_PLACES = ("place", "east, north (m)", "latitude, longitude", "scans", "ok", "largest error", "worst drive", "at (s)")
_DRIVES = ("drive", "scans searched", "ok", "ok but wrong", "RMS across", "RMS along", "largest error", "ms a scan")
_WORKERS = ("worker", "drives", "programs compiled", "drives that compiled later", "peak memory", "busy")


@dataclass(frozen=True, kw_only=True)
class ArchivePage:
    """Texts and tables of an archive's page; rows are formatted texts.

    Attributes:
        title, intro: title and introduction of the page.
        facts: quantity and value over all drives.
        places: number, place, latitude and longitude, scans, ok, largest error, drive, time.
        drives: worst drives: name, scans searched, ok, wrong, RMS across and along, largest error, time per scan.
        failed: drive and reason, also of drives that have a result of an earlier run.
        workers: worker, drives, programs compiled, drives after the first that compiled, peak memory, busy.
        spread, plan: pictures of all drives and of all places; ``None`` without searched scans.
    """

    title: str
    intro: str
    facts: tuple[tuple[str, str], ...]
    places: tuple[tuple[str, ...], ...]
    drives: tuple[tuple[str, ...], ...]
    failed: tuple[tuple[str, str], ...]
    workers: tuple[tuple[str, ...], ...]
    spread: ReportFigure | None
    plan: ReportFigure | None


def write_archive_page(path: str | Path, page: ArchivePage, *, force: bool = False) -> None:
    """Write it as one self-contained page.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    places = ReportTable(
        _PLACES, page.places, "The drive with the worst result in this cell, at this time_s of its fixes."
    )
    drives = ReportTable(_DRIVES, page.drives, "Wrong: error above 0.3 m. All drives are in archive.csv.")
    workers = ReportTable(_WORKERS, page.workers, "Processes that made these results.")
    failed = ReportTable(("drive", "why"), page.failed)
    none = "No scan was searched." if page.plan is None else "No cell with a scan without a correct fix."
    sections = [
        Section("All drives", "", (ReportTable(("quantity", "value"), page.facts),), _figures(page.spread)),
        Section("Worst places", "" if page.places else none, (places,) if page.places else (), _figures(page.plan)),
        Section("Worst drives", "", (drives,)),
    ]
    if page.failed:
        sections.insert(0, Section("Drives that failed", "A later run tries them again.", (failed,)))
    sections.append(Section("Workers", "", (workers,)))
    write_report(path, page.title, page.intro, sections, force)


def _figures(figure: ReportFigure | None) -> tuple[ReportFigure, ...]:
    return () if figure is None else (figure,)


# Distribution over many drives: availability, errors, times, and codes.

_BINS = 40


@dataclass(frozen=True, kw_only=True)
class ArchiveDrives:
    """Drives of an archive, one value per drive; NaN if missing.

    Attributes:
        name: name of the map.
        ok_share: share of ok fixes among the searched scans, 0 to 1.
        rms_cross_m, rms_along_m: errors of the ok fixes.
        milliseconds_per_scan: wall time of the search per scan.
        counts: number of scans by code, over all drives.
    """

    name: str
    ok_share: Float[np.ndarray, " drive"]
    rms_cross_m: Float[np.ndarray, " drive"]
    rms_along_m: Float[np.ndarray, " drive"]
    milliseconds_per_scan: Float[np.ndarray, " drive"]
    counts: dict[str, int]


def draw_archive_drives(drives: ArchiveDrives, path: str | Path, *, force: bool = False) -> None:
    """Draw three histograms over the drives, and the codes of all scans.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 11.0, 5.6, force) as figure:
        (share, errors), (times, codes) = figure.subplots(2, 2)
        share.hist(100.0 * _finite(drives.ok_share), bins=_BINS, range=(0.0, 100.0), color=BLUE)
        share.set_xlabel("scans with an ok fix (%)")
        _draw_errors(errors, drives)
        took_ms = _finite(drives.milliseconds_per_scan)
        top_ms = 2.0 * float(np.percentile(took_ms, 90.0)) if len(took_ms) else 1.0
        times.hist(np.minimum(took_ms, top_ms), bins=_BINS, range=(0.0, top_ms), color=MUTED)
        times.set_xlabel("time per scan (ms)")
        for axes in (share, errors, times):
            axes.set_ylabel("drives")
            axes.yaxis.get_major_locator().set_params(integer=True)
        _draw_codes(codes, drives.counts)
        figure.suptitle(f"{len(drives.ok_share)} drives on {drives.name}")
        write_caption(
            figure,
            "Errors: root mean square of the ok fixes of a drive in the map's frame, where true poses are known. "
            "The last bar of an axis includes all larger values.",
        )


def _draw_errors(axes: Axes, drives: ArchiveDrives) -> None:
    cross, along = _finite(drives.rms_cross_m), _finite(drives.rms_along_m)
    axes.set_xlabel("RMS error (m)")
    if not len(cross):
        axes.text(0.5, 0.5, "true poses unknown", transform=axes.transAxes, ha="center", color=MUTED)
        return
    top = max(float(np.percentile(np.concatenate([cross, along]), 99.0)), 0.02) * 1.2
    for values, colour, label in ((cross, BLUE, "across"), (along, ORANGE, "along")):
        axes.hist(np.minimum(values, top), bins=_BINS, range=(0.0, top), color=colour, histtype="step", label=label)
    axes.legend(frameon=False)


def _finite(values: Float[np.ndarray, " drive"]) -> Float[np.ndarray, " known"]:
    return np.asarray(values[np.isfinite(values)])


def _draw_codes(axes: Axes, counts: dict[str, int]) -> None:
    shown = [code for code in CODES[:-1] if counts.get(code, 0)][::-1]
    total = max(sum(counts[code] for code in shown), 1)
    shares = [100.0 * counts[code] / total for code in shown]
    bars = axes.barh(shown, shares, color=[CODE_COLOURS[code] for code in shown])
    axes.bar_label(bars, [f"{share:.3g} %" for share in shares], padding=3, color=INK, fontsize=8.5)
    axes.set_xlim(0.0, 115.0)
    axes.set_xlabel("of the scans searched (%)")


# Where on a map drives are located and where not: the plan of all drives in cells, the worst marked.

_MOST_CELLS = 240  # along the longer side: finer ones could not be seen
_WIDTH_IN = 11.0
_LEAST_SHAPE = 0.12  # height of a plan by its width
_ERROR_MAP = "magma_r"
_LIMIT_M = 0.3


@dataclass(frozen=True, kw_only=True)
class ArchivePlaces:
    """Scans of all drives in square cells of the map's plane.

    Attributes:
        name: name of the map.
        cell_m: side of a cell.
        cell: index of each cell: its south-west corner east and north of the anchor in cells.
        tried, ok, judged: number of scans searched, with an ok fix, and with an ok fix and a known truth.
        square_m2: sum of the squared errors of the judged scans.
        worst_m: middles of the worst places, in order.
        chords_m: start and end of each stretch of the map's baselines.
    """

    name: str
    cell_m: float
    cell: Int[np.ndarray, "cell 2"]
    tried: Int[np.ndarray, " cell"]
    ok: Int[np.ndarray, " cell"]
    judged: Int[np.ndarray, " cell"]
    square_m2: Float[np.ndarray, " cell"]
    worst_m: Float[np.ndarray, "place 2"]
    chords_m: Float[np.ndarray, "chord 2 2"]


def draw_archive_places(places: ArchivePlaces, path: str | Path, *, force: bool = False) -> None:
    """Draw the share of scans with an ok fix and, where truth is known, the errors; equal scale, north up.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    low, high = places.cell.min(axis=0), places.cell.max(axis=0) + 1
    together = 1 << max(0, int(np.ceil(np.log2(np.max(high - low) / _MOST_CELLS))))
    cell_m = places.cell_m * together
    cell = np.floor_divide(places.cell, together)
    first = cell.min(axis=0)
    shape = tuple(int(n) for n in cell.max(axis=0) - first + 1)
    tried, ok, judged, square = (
        _gridded(cell - first, values, shape) for values in (places.tried, places.ok, places.judged, places.square_m2)
    )
    known = bool(judged.any())
    size_m = cell_m * np.array(shape)
    flat = float(np.clip(size_m[1] / size_m[0], _LEAST_SHAPE, 1.1))
    with picture(path, _WIDTH_IN, 1.4 + (1 + known) * (0.8 + 0.82 * _WIDTH_IN * flat), force) as figure:
        panels = figure.subplots(1 + known, 1, sharex=True, squeeze=False)[:, 0]
        edges = (cell_m * first[0], cell_m * first[1], *(cell_m * first + size_m))
        share = 100.0 * ok / np.where(tried > 0, tried, np.nan)
        _draw(figure, panels[0], share, edges, "scans with an ok fix (%)", CORRELATION_MAP, 100.0)
        if known:
            rms_m = np.sqrt(square / np.where(judged > 0, judged, np.nan))
            _draw(figure, panels[1], rms_m, edges, "RMS error of ok fixes (m)", _ERROR_MAP, _LIMIT_M)
        for axes in panels:
            _mark(axes, places)
            axes.set_ylabel("north of the anchor (m)")
            _set_limits(axes, edges)
        panels[-1].set_xlabel("east of the anchor (m)")
        figure.suptitle(f"Where drives on {places.name} are located")
        write_caption(
            figure,
            f"Cells of {cell_m:g} m; grey: no drive. Thin lines: the map's baselines. Numbered: the worst, "
            "as in the table. A scan counts at its true position, else at its ok fix, else at its prior.",
        )


def _gridded(
    cell: Int[np.ndarray, "cell 2"], values: np.ndarray, shape: tuple[int, ...]
) -> Float[np.ndarray, "east north"]:
    grid = np.zeros(shape)
    np.add.at(grid, (cell[:, 0], cell[:, 1]), values)
    return grid


def _draw(
    figure: Figure,
    axes: Axes,
    values: Float[np.ndarray, "east north"],
    edges: tuple[float, ...],
    label: str,
    colours: str,
    limit: float,
) -> None:
    west, south, east, north = edges
    axes.set_facecolor(GAP)
    image = axes.imshow(
        np.ma.masked_invalid(values.T),
        cmap=colours,
        vmin=0.0,
        vmax=limit,
        origin="lower",
        extent=(west, east, south, north),
        interpolation="nearest",
        aspect="equal",
    )
    extend = "max" if np.nanmax(values, initial=0.0) > limit else "neither"
    figure.colorbar(image, ax=axes, label=label, pad=0.01, aspect=12, extend=extend)


def _mark(axes: Axes, places: ArchivePlaces) -> None:
    axes.add_collection(LineCollection(list(places.chords_m), colors=MUTED, linewidths=0.6))
    for number, (east, north) in enumerate(places.worst_m, start=1):
        axes.plot(east, north, "o", markersize=11, markerfacecolor="white", markeredgecolor=VERMILLION, mew=1.4)
        axes.text(east, north, str(number), ha="center", va="center", fontsize=7.5, clip_on=True)


def _set_limits(axes: Axes, edges: tuple[float, ...]) -> None:
    """A road is thin: leave room next to it for labels."""
    west, south, east, north = edges
    half_m = 0.53 * np.array([east - west, north - south])
    half_m = np.maximum(half_m, 0.5 * _LEAST_SHAPE * 2.0 * half_m.max())
    axes.set_xlim(0.5 * (west + east) - half_m[0], 0.5 * (west + east) + half_m[0])
    axes.set_ylim(0.5 * (south + north) - half_m[1], 0.5 * (south + north) + half_m[1])
