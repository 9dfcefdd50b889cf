"""Pictures of a registered drive, and the page of drives registered together."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lgprjax.batch import FixExample, RegisteredDrive, example_scan, fix_example, settings_of
from lgprjax.batch.assumptions import UNSTATED
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile, assumed_in_words, read_fixes
from lgprjax.frames import LocalFrame
from lgprjax.registration import FEW_CHANNELS, LADDER_M, OFF_MAP_SCORE, PIECE_M, WRONG_M, RegisterOptions
from lgprjax.report.drive import draw_confidence, draw_trajectory, stated_errors
from lgprjax.report.html import PAGE, ReportFigure, Section, declines_table, drive_section, overview_table, write_report
from lgprjax.report.match import SwarmPicture, draw_match, draw_surface, draw_swarm
from lgprjax.report.results import CorrelationSurface, DriveResult, MatchExample
from lgprjax.report.summary import CodedDrive, DriveSummary, draw_codes, summarise, summary_of
from lgprjax.report.zoom_page import write_drive_page

_OWN = "the map was made from this drive: its fixes do not show the accuracy"
_LONE = (
    "one channel on a map of one channel: fixes locate the drive along the line. Ground next to the line resembles "
    "ground on the line. Across the line, fixes show only that the drive is near; the cross-track sigma is a bound"
)
_WRONG_SIGMAS = 2.0  # between ground and log
_ANGLES = ("yaw", "roll")
_USUAL_SCALE = 0.01
"""A time scale farther from 1 is remarked on."""
_PICTURES = {
    "-trajectory.png": ("Trajectory and errors along the drive.", "plan view above error curves"),
    "-confidence.png": (
        "Reliability of the fixes' sigmas, and the cost of a smaller risk.",
        "true error over stated sigma, error distributions by evidence, declined share over evidence",
    ),
    "-match.png": ("The ground of one scan, live and in the map.", "radargram strips"),
    "-map.png": ("Correlation of the same scan over the search region.", "correlation map"),
    "-swarm.png": (
        "The particle swarm of the same scan, run again.",
        "clouds of particles over the score; height, heading, roll and score over the iterations",
    ),
}
"""A drive's pictures by the ends of their names, with caption and alternative text; not every drive has them all."""
ENDS = tuple(_PICTURES)
_FIXES = ".fixes.h5"
_SUMMARY = "summary.json"


def draw_drive(
    result: DriveResult,
    drive: RegisteredDrive,
    source: MapFile,
    log: DriveLog,
    options: RegisterOptions,
    folder: Path,
    force: bool,
) -> list[ReportFigure]:
    """Write a drive's pictures, and its page of scans, to a folder; returns the pictures written.

    The confidence is drawn if the truth is known, match and map if a scan was tried, the swarm if there is one.

    Raises:
        InputError: one of them exists (without ``force``) or cannot be written.
    """
    trajectory, confidence, match, surface, swarm = pictures = [folder / f"{drive.name}{end}" for end in ENDS]
    if force:
        # Not all are drawn of every drive: one of an earlier run would pass for a picture of these fixes.
        for picture in pictures:
            picture.unlink(missing_ok=True)
    draw_trajectory(result, trajectory, force=force)
    write_drive_page(result, folder / f"{drive.name}{PAGE}", force=force)
    figures = [ReportFigure(trajectory, *_PICTURES["-trajectory.png"])]
    stated = stated_errors([result])
    if len(stated.ok):
        draw_confidence(stated, confidence, force=force)
        figures.append(ReportFigure(confidence, *_PICTURES["-confidence.png"]))
    scan = example_scan(drive)
    example = None if scan is None else fix_example(source, log, drive, options, scan)
    if example is None:
        return figures
    draw_match(_match(example, drive), match, force=force)
    search_m = options.search_half_m(drive.track.sigma_m)
    correlation = float(drive.table["correlation"].iloc[example.scan])
    draw_surface(_surface(example, source.description.frame, search_m, correlation), surface, force=force)
    code = drive.table["code"].iloc[example.scan]
    figures.append(
        ReportFigure(match, f"Scan {example.scan}, {code}: the ground, live and in the map.", "radargram strips")
    )
    figures.append(
        ReportFigure(surface, f"Scan {example.scan}, {code}: match over the search region.", "correlation map")
    )
    searched = _swarm(example, drive, source.description.frame)
    if searched is not None:
        draw_swarm(searched, swarm, force=force)
        figures.append(
            ReportFigure(
                swarm,
                f"Scan {example.scan}, {code}: the swarm around its best place, run again.",
                "clouds of particles over the score, score over the iterations",
            )
        )
    return figures


def _match(example: FixExample, drive: RegisteredDrive) -> MatchExample:
    strips, row = example.strips, drive.table.iloc[example.scan]
    distance = strips.distance_m - drive.track.travel_m[0]
    # For a single scan the box is as wide as a trace.
    window_m = float(np.nan_to_num(np.asarray(drive.fix.window_m)[example.scan]))
    first = distance[-1] - (window_m or distance[-1] - distance[-2])
    return MatchExample(
        baseline=strips.baseline,
        live=strips.live,
        beside=strips.beside,
        beside_m=strips.beside_m,
        distance_m=distance,
        time_ns=strips.time_ns,
        channel=strips.channel,
        correlation=float(row["correlation"]),
        margin=float(row["margin"]),
        gain="depth gain of the map, limited to 2.5 RMS of the scan",
        lag_m=strips.lag_m,
        window_m=(float(first), float(distance[-1])),
    )


def _surface(example: FixExample, frame: LocalFrame, search_m: float, correlation: float) -> CorrelationSurface:
    prior, best = _pair(example.prior_m), _pair(example.best_m)
    assert prior is not None
    assert best is not None
    return CorrelationSurface(
        x_m=example.surface.along_m,
        y_m=example.surface.cross_m,
        correlation=example.surface.score,
        half_width_m=(search_m, search_m),
        prior=prior,
        prior_sigma_m=example.prior_sigma_m,
        # The prior's sigmas are in east and north.
        prior_tilt_rad=-float(example.frame[2]),
        best=best,
        at_best=correlation,
        second=_pair(example.second_m),
        truth=_pair(example.truth_m),
        origin=_origin(example, frame),
        axes=("along", "cross"),
    )


def _swarm(example: FixExample, drive: RegisteredDrive, frame: LocalFrame) -> SwarmPicture | None:
    if example.swarm is None:
        return None
    place, best, offset, best_offset, met, along, cross, score = (
        np.asarray(field, np.float64) for field in example.swarm
    )
    degrees = np.array([1.0, *np.degrees([1.0, 1.0])])
    return SwarmPicture(
        x_m=along,
        y_m=cross,
        # Off the map a score is below any correlation.
        score=np.where(score > 0.75 * OFF_MAP_SCORE, score, np.nan),
        particle_m=place,
        best_m=best,
        offset=offset * degrees,
        best_offset=best_offset * degrees,
        best_score=np.where(met > 0.75 * OFF_MAP_SCORE, met, -np.inf),
        milliseconds=drive.milliseconds_per_scan,
        origin=_origin(example, frame),
        truth=_pair(example.truth_m),
    )


def _origin(example: FixExample, frame: LocalFrame) -> str:
    # Adding 0 removes the sign of a rounded zero.
    east, north = np.round(example.frame[:2], 1) + 0.0
    bearing = np.degrees(np.pi / 2.0 - example.frame[2]) % 360.0
    return (
        f"a place of the route, east {east:.1f} m and north {north:.1f} m from latitude, longitude "
        f"{frame.latitude_deg:.6f}°, {frame.longitude_deg:.6f}°; along is towards {bearing:.0f}°"
    )


def _pair(place: np.ndarray | None) -> tuple[float, float] | None:
    return None if place is None else (float(place[0]), float(place[1]))


# Drives registered together.

Registered = tuple[DriveResult, DriveSummary, Section]


def search_in_words(settings: Mapping[str, object]) -> str:
    """The search that drives were registered with, for a page: a line from the settings (``settings_of``)."""
    search_m, window_m, scale = settings["search_m"], settings["window_m"], settings["time_scale"]
    lengths = ", ".join(f"{length:g}" for length in LADDER_M[1:])
    region = "within the position uncertainty stated by the log (2.5 m if it states none)"
    windows = f"the shortest window that reaches the risk, for a single scan, {lengths} m"
    parts = [
        f"Search: {region if search_m is None else f'{search_m:g} m to each side of the prior'}",
        windows if window_m is None else f"windows of {window_m:g} m" if window_m else "single scans",
        "time scale found along the drive" if scale is None else f"time scale {scale:g}",
    ]
    # Records of an older version in the same folder have no risk.
    risk = settings.get("risk")
    judged = "fixed thresholds" if risk is None else f"risk {risk:g} in each {PIECE_M:g} m of travel"
    # Nor have they swarms.
    swarms = (("search_swarm", "positions searched by a particle swarm"), ("swarm", "refined by a particle swarm"))
    parts += [words for name, words in swarms if settings.get(name)]
    return "; ".join([*parts, "user thresholds" if settings["own_thresholds"] else judged]) + "."


def earlier_summaries(folder: Path, names: Sequence[str]) -> list[DriveSummary]:
    """Summaries of drives registered into a folder earlier whose fixes still exist.

    Args:
        folder: folder of the results.
        names: drives that are registered now, which are left out.

    Raises:
        InputError: ``summary.json`` is not the summary of a registration.
    """
    path = folder / _SUMMARY
    if not path.exists():
        return []
    try:
        told = [summary_of(entry) for entry in json.loads(path.read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError, KeyError):
        expected = "the summary of an earlier registration, or another folder"
        raise InputError(path, "content", expected, "another file") from None
    return [each for each in told if each.name not in names and (folder / f"{each.name}{_FIXES}").is_file()]


def _earlier(folder: Path, summary: DriveSummary) -> tuple[CodedDrive, Section]:
    """A drive registered before, from its files: its codes, and its section of the page."""
    table = read_fixes(folder / f"{summary.name}{_FIXES}")
    margin = table["margin"].to_numpy()
    coded = CodedDrive(
        summary.name,
        summary.impostor,
        table["code"].to_numpy().astype(str),
        np.where(margin <= 1.0, margin, np.nan),
        table["p_false"].to_numpy() if "p_false" in table.columns else np.full(len(table), np.nan),
    )
    figures = [
        ReportFigure(folder / f"{summary.name}{end}", *words)
        for end, words in _PICTURES.items()
        if (folder / f"{summary.name}{end}").is_file()
    ]
    section = drive_section(summary, figures)
    # Of a folder of an older version there is no page of scans.
    return coded, section if (folder / f"{summary.name}{PAGE}").is_file() else replace(section, beside=None)


def summarise_search(result: DriveResult, options: RegisterOptions) -> DriveSummary:
    """``summarise``, and how the drive was searched: a later page over its folder has drives searched otherwise."""
    return replace(summarise(result), search=search_in_words(settings_of(options)), risk=options.risk)


def write_page(results: Sequence[Registered], folder: Path, title: str, *, intro: str = "") -> Path:
    """Write ``report.html``: overview, codes of all drives, a section each; drives registered before are kept.

    Raises:
        InputError: ``summary.json`` is not one of a registration, or a file cannot be written.
    """
    codes = folder / "codes.png"
    before = earlier_summaries(folder, [result.name for result, _, _ in results])
    summaries = [*before, *(summary for _, summary, _ in results)]
    earlier = [_earlier(folder, summary) for summary in before]
    draw_codes(
        [*(coded for coded, _ in earlier), *(result for result, _, _ in results)],
        codes,
        risks=[summary.risk for summary in summaries],
        force=True,
    )
    figure = ReportFigure(
        codes,
        "Evidence, accepted risk, margin over the runner-up, and codes of all tried scans. One decade of evidence is "
        "a tenfold smaller probability that foreign ground matches as well.",
        "histograms of evidence and margin, bar of codes, one row per drive",
    )
    tables = [table for table in (overview_table(summaries), declines_table(summaries)) if table is not None]
    overview = Section("All drives", "", tuple(tables), (figure,))
    page = folder / "report.html"
    drawn = [*(section for _, section in earlier), *(section for _, _, section in results)]
    searched = [_with_search(section, summary) for section, summary in zip(drawn, summaries, strict=True)]
    write_report(page, title, intro, [overview, *searched], force=True)
    return page


def _with_search(section: Section, summary: DriveSummary) -> Section:
    return replace(section, text=f"{section.text}\n\n{summary.search}")


def drive_result(
    drive: RegisteredDrive, source: MapFile, *, impostor: bool, gnss_gap: np.ndarray | None = None
) -> DriveResult:
    """The registered drive as the record that pictures are made from; ``gnss_gap`` marks scans without GNSS."""
    pose, prior, truth = np.asarray(drive.fix.pose), drive.track.pose, drive.truth
    table, frame = drive.table, source.description.frame
    numbers = range(int(source.drive.max()) + 1)
    return DriveResult(
        name=drive.name,
        map_name=source.description.name,
        origin=(frame.latitude_deg, frame.longitude_deg),
        milliseconds_per_scan=drive.milliseconds_per_scan,
        time_s=table["time_s"].to_numpy(),
        distance_m=np.cumsum(np.abs(np.diff(drive.track.travel_m, prepend=drive.track.travel_m[0]))),
        east_m=pose[:, 0],
        north_m=pose[:, 1],
        prior_east_m=prior[:, 0],
        prior_north_m=prior[:, 1],
        heading_rad=prior[:, 3],
        sigma_along_m=table["sigma_along_m"].to_numpy(),
        sigma_cross_m=table["sigma_cross_m"].to_numpy(),
        correlation=table["correlation"].to_numpy(),
        # Without a runner-up the margin is over the least possible score, and means nothing.
        margin=np.where(np.asarray(drive.fix.runner_up) > -1.0, table["margin"].to_numpy(), np.nan),
        p_false=np.asarray(drive.fix.p_false),
        code=table["code"].to_numpy().astype(str),
        yaw_rad=pose[:, 3],
        sigma_yaw_rad=np.sqrt(np.asarray(drive.fix.covariance)[:, 3, 3]),
        gnss_gap=gnss_gap,
        truth_east_m=None if truth is None else truth[:, 0],
        truth_north_m=None if truth is None else truth[:, 1],
        truth_yaw_rad=None if truth is None else truth[:, 3],
        correlation_at_truth=None if truth is None else drive.correlation_at_truth,
        baseline_tracks=tuple(source.pose[source.drive == number, :2] for number in numbers),
        impostor=impostor,
        remarks=_remarks(drive, source),
        place_assumed=drive.place_assumed,
    )


def _remarks(drive: RegisteredDrive, source: MapFile) -> tuple[str, ...]:
    """Remarks on the fixes."""
    labels = None if any(source.description.label_sigma_m) else f"labels: {UNSTATED}"
    lines = (
        _OWN if drive.is_baseline else None,
        labels,
        drive.alignment.told,
        drive.travel_changed,
        None if drive.agreement is None else drive.agreement.told,
        _windows(drive),
        _time_scales(drive),
        _attitude(drive),
        _along(drive),
        *_unknowns(drive, source),
    )
    return tuple(line for line in lines if line is not None)


def _unknowns(drive: RegisteredDrive, source: MapFile) -> tuple[str | None, ...]:
    """Limitations: assumptions at import, a map that is elsewhere, ground next to a line."""
    assumed = f"assumed in this drive: {assumed_in_words(drive.assumed)}" if drive.assumed else None
    lone = drive.channels == 1 and source.description.channels == 1 and drive.away is None
    return assumed, drive.away, _LONE if lone else None


_SELDOM = 0.05


def _windows(drive: RegisteredDrive) -> str | None:
    """Window lengths of the ok fixes; one that hardly occurs, as at a drive's start, counts with the next longer."""
    window_m = np.asarray(drive.fix.window_m)[drive.table["code"].to_numpy() == "ok"]
    if not len(window_m):
        return None
    every, counts = np.unique(window_m, return_counts=True)
    often = counts >= _SELDOM * len(window_m)
    often[-1] = True
    lengths = every[often]
    counts = np.bincount(np.searchsorted(lengths, window_m), minlength=len(lengths))
    named = ["single scans" if length == 0.0 else f"{length:.2g} m" for length in lengths]
    shares = [f"{name} {100.0 * count / len(window_m):.0f} %" for name, count in zip(named, counts, strict=True)]
    back = f"; {np.sum(drive.carried_back)} carried back from the ground ahead" if drive.carried_back.any() else ""
    return f"windows of the ok fixes: {', '.join(shares)}{back}"


def _attitude(drive: RegisteredDrive) -> str | None:
    """Height, heading and roll by the matches, if they differ from the log; or a note that they are not observable."""
    ok = drive.table["code"].to_numpy() == "ok"
    if drive.channels <= FEW_CHANNELS:
        few = f"an array of {drive.channels} channels" if drive.channels > 1 else "a single channel"
        return f"heading and roll come from the log: {few} cannot check them"
    if not ok.any():
        return None
    off = np.asarray(drive.fix.pose)[ok, 2:] - drive.track.pose[ok, 2:]
    off[:, 1] = np.mod(off[:, 1] + np.pi, 2.0 * np.pi) - np.pi
    sigma = np.sqrt(np.einsum("sii->si", np.asarray(drive.fix.covariance)[ok, 2:, 2:]))
    middle, wrong = np.median(off, axis=0), np.abs(np.median(off / sigma, axis=0)) > _WRONG_SIGMAS
    named = (
        f"height {middle[0]:+.2f} m",
        *(f"{n} {np.degrees(v):+.1f} deg" for n, v in zip(_ANGLES, middle[1:], strict=True)),
    )
    said = [text for text, apart in zip(named, wrong, strict=True) if apart]
    return f"the fixes contradict the log (median of fix minus log): {', '.join(said)}" if said else None


def _along(drive: RegisteredDrive) -> str | None:
    """Note on scans whose ground does not determine the position along the path."""
    # The part due to map and odometer is independent of the ground.
    matched = np.asarray(drive.fix.covariance)[:, :2, :2] - drive.map_odometry_covariance
    yaw = np.asarray(drive.fix.pose)[:, 3]
    facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    along_m2 = np.einsum("si,sij,sj->s", facing, matched, facing)
    flat = (drive.table["code"].to_numpy() == "ambiguous") & (along_m2 > WRONG_M**2)
    if not flat.any():
        return None
    return (
        f"{flat.sum()} scans declined where the ground hardly changes along the path (flat layers): the match does not "
        f"determine their position along it (sigma above {WRONG_M:g} m)"
    )


def _time_scales(drive: RegisteredDrive) -> str | None:
    """The time scales of the drive, if they differ from the map's day."""
    scale = drive.time_scale[drive.table["code"].to_numpy() == "ok"]
    if not len(scale) or np.max(np.abs(scale - 1.0)) < _USUAL_SCALE:
        return None
    return f"time scale of the ok fixes: {scale.min():.3f} to {scale.max():.3f}, median {np.median(scale):.3f}"
