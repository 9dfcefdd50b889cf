"""``lgprjax map``: build, describe, verify, refine and update maps of the ground."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import (
    Level,
    UsageError,
    console,
    counted,
    detail,
    progress_bar,
    require_files,
    say,
    verdict,
    working,
)
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import MapFile
    from lgprjax.mapping import MapHealth, RouteInterval, UpdatedMap
    from lgprjax.mapping.align import AgreedBaselines
    from lgprjax.registration import Chance


# ``lgprjax map info``: coverage, origin and size of a map.

_RISK = 1e-4


@dataclass(frozen=True)
class MapInfo:
    """Show coverage, origin and acceptance scores of a map; with -v also how the file is stored."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Print."""
        figures = print_info(self.file)
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)
        verdict(_size(self.file, figures), f"map verify {self.file}")


def _size(path: Path, figures: dict[str, Any]) -> str:
    """A map in one line."""
    return f"{path}: {counted(figures['baselines'], 'baseline')}, {figures['length_m']:.1f} m"


def _labels(sigma_m: tuple[float, ...]) -> str:
    """Position sigmas of the navigation of each baseline."""
    from lgprjax.batch.assumptions import UNSTATED

    if not any(sigma_m):
        return UNSTATED
    sigmas_text = ", ".join("not stated" if sigma == 0.0 else f"{100.0 * sigma:.1f} cm" for sigma in sigma_m)
    return f"sigma {sigmas_text}"


def _scatter(chance: "Chance | None") -> str:
    """Scatter of the labels that left-out baselines show."""
    known = chance is not None and chance.label_scatter_m > 0.0
    return f"; scatter of the baselines {100.0 * chance.label_scatter_m:.1f} cm" if known and chance else ""


def _chance(chance: "Chance | None", wavelength_m: float) -> dict[str, object]:
    """Scores of other ground on this map, and the scores that a match needs."""
    from lgprjax.registration import ladder_of, least_z

    if chance is None:
        later = "not in this file; measured at the first registration"
        return {"noise_floor": later, "least_score": None, "sigma_scale": later}
    pooled = "pooled over many sites; this map is too small for its own"
    least = [round(float(score), 2) for score in least_z(_RISK, chance)]
    return {
        "noise_floor": f"{'own' if chance.own else pooled}; {chance.pieces} independent pieces",
        "least_score": {
            f"{window_m:g} m": score for window_m, score in zip(ladder_of(wavelength_m), least, strict=True)
        },
        "sigma_scale": f"{chance.sigma_scale:.2f}; "
        + (
            f"{chance.left_out} sections of baselines, each left out and registered on the others"
            if chance.left_out
            else "pooled over many sites; baselines do not overlap"
        ),
    }


def print_info(path: Path) -> dict[str, Any]:
    """Print the table of a map. Returns all figures by name, unrounded."""
    import numpy as np

    from lgprjax.batch import map_assumed_in_words
    from lgprjax.formats import MapFile

    with MapFile.open(path) as source:
        description, pose = source.description, source.pose
        step = np.hypot(*np.diff(pose[:, :2], axis=0).T)
        along = float(step[np.diff(source.drive) == 0].sum())
        low, high = pose[:, :2].min(axis=0), pose[:, :2].max(axis=0)
        figures: dict[str, Any] = {
            "name": description.name,
            "anchor_latitude_deg": description.frame.latitude_deg,
            "anchor_longitude_deg": description.frame.longitude_deg,
            "baselines": int(source.drive.max()) + 1,
            "stations": len(pose),
            "length_m": round(along, 2),
            "east_m": [round(float(low[0]), 2), round(float(high[0]), 2)],
            "north_m": [round(float(low[1]), 2), round(float(high[1]), 2)],
            "channels": description.channels,
            "channel_pitch_m": round(description.channel_pitch_m, 4),
            "station_step_m": round(description.settings.step_m, 4),
            "band_mhz": [description.settings.band_low_hz / 1e6, description.settings.band_high_hz / 1e6],
            "travel_time_ns": round(len(description.gain) * description.settings.sample_interval_ns, 2),
            "track_filter_m": round(description.settings.track_filter_m, 2),
            "tiles": len(source.tile_frame),
            "labels": _labels(description.label_sigma_m) + _scatter(source.chance),
            **_chance(source.chance, description.settings.wavelength_m),
            "weight": [round(weight, 3) for weight in description.weight],
            "retired": int(np.count_nonzero(source.retired)),
            "precision": source.precision.name,
            "bytes_per_m": round(path.stat().st_size / max(along, 1e-9)),
            **{f"bytes_per_m_{part}": round(size / max(along, 1e-9)) for part, size in source.stored_bytes().items()},
            "steps": source.provenance.get("steps"),
        }
        assumed = map_assumed_in_words(source)
    table = Table("quantity", "value", title=f"{path.name}")
    for name, value in _rows(figures):
        table.add_row(name, value)
    console.print(table)
    if assumed is not None:
        say(f"assumed: {assumed}")
    return {**figures, "assumed": assumed}


_HOW_STORED = ("track_filter_m", "tiles", "precision", "steps")
"""Rows of the verbose table, besides the bytes of each part."""


def _rows(figures: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Quantities with rounded values and units."""
    (west, east), (south, north) = figures["east_m"], figures["north_m"]
    low, high = figures["band_mhz"]
    latitude, longitude = figures["anchor_latitude_deg"], figures["anchor_longitude_deg"]
    yield "name", str(figures["name"])
    yield "origin, latitude, longitude", f"{latitude:.7f}°, {longitude:.7f}°"
    yield "extent from the origin", f"{west:.1f} to {east:.1f} m east, {south:.1f} to {north:.1f} m north"
    yield "baselines", f"{figures['baselines']}, {figures['length_m']:.1f} m in total"
    step_cm = 100.0 * figures["station_step_m"]
    yield "stations", f"{figures['stations']}, {step_cm:.1f} cm apart" + _retired(figures["retired"])
    pitch = f", {100.0 * figures['channel_pitch_m']:.1f} cm apart" if figures["channels"] > 1 else ""
    yield "channels", f"{figures['channels']}{pitch}"
    yield "band", f"{low:.0f} to {high:.0f} MHz"
    yield (
        "travel time",
        f"{figures['travel_time_ns']:.1f} ns, {0.05 * figures['travel_time_ns']:.1f} m deep at 0.1 m/ns",
    )
    yield "position labels", str(figures["labels"])
    yield "noise floor", str(figures["noise_floor"])
    if figures["least_score"] is not None:
        yield "required score of a match", _scores(figures["least_score"])
    yield "factor on sigmas", str(figures["sigma_scale"])
    if figures["weight"]:
        yield "weights of the baselines", ", ".join(f"{weight:.2f}" for weight in figures["weight"])
    yield "file size", f"{figures['bytes_per_m'] / 1e3:.1f} kB per metre"
    for name, value in figures.items() if console.level is Level.VERBOSE else ():
        if name in _HOW_STORED or name.startswith("bytes_per_m_"):
            yield name, ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _retired(stations: int) -> str:
    return f"; {stations} retired" if stations else ""


def _scores(least: dict[str, float]) -> str:
    scores = ", ".join(f"{window} {score:.2f}" for window, score in least.items())
    return f"{scores} noise floors by window length (risk {_RISK:g}, one search)"


# ``lgprjax map refine``: align the baselines of a map with each other.


@dataclass(frozen=True)
class MapRefine:
    """Align the baselines of a map: register each on the others, correct its position labels, write a new map."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="NEW.map.h5", help="map to write")]
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Refine."""
        from lgprjax.formats import MapFile, locked_map
        from lgprjax.mapping.align import baseline_files, plan_matches, refine_map

        with MapFile.open(self.file):
            check_outputs(self.output, self.json, force=self.force)
        with locked_map(self.output), MapFile.open(self.file) as source:
            plan = plan_matches(source)
            with progress_bar("registering baselines", 2 * len(plan.pairs.station), "matches") as progress:
                agreed = refine_map(
                    source, plan, self.output, force=self.force, progress=progress, stage=progress.stage
                )
            files = baseline_files(source)
        _print(agreed, files)
        if self.json is not None:
            write_figures(self.json, _figures(agreed), force=self.force)
        before, after = agreed.before.rms_m, agreed.after.rms_m
        moved = f"residual {before:.3f} m RMS before, {after:.3f} m after" if agreed.kept else "labels unchanged"
        verdict(f"wrote {self.output}: {agreed.kept} matches kept, {moved}", f"map verify {self.output}")


def _print(agreed: "AgreedBaselines", files: list[str]) -> None:
    from lgprjax.mapping.align import agreement_in_words

    table = Table("baseline", "matches", "kept", "moved, RMS m", "moved, max m", "label sigma m", "new sigma m")
    for change in agreed.baselines:
        row = [str(change.drive), str(change.matches), str(change.kept)]
        row += [f"{change.moved_rms_m:.3f}", f"{change.moved_max_m:.3f}", f"{change.sigma_before_m:.3f}"]
        table.add_row(*row, f"{change.sigma_after_m:.3f}" if change.kept else "unchanged")
    console.print(table)
    for line in agreement_in_words(agreed, files):
        say(line)


def _figures(agreed: "AgreedBaselines") -> dict[str, object]:
    """Plain values, for JSON; NaN becomes null."""
    changes = [
        {**change._asdict(), "sigma_after_m": change.sigma_after_m if change.kept else None}
        for change in agreed.baselines
    ]
    return {
        "tried": agreed.tried,
        "matched": agreed.matched,
        "used": agreed.used,
        "believed": agreed.kept,
        "noise_scale": agreed.noise_scale,
        "before": agreed.before._asdict() if agreed.kept else None,
        "after": agreed.after._asdict() if agreed.kept else None,
        "baselines": changes,
    }


# ``lgprjax map update``: add new drives to a map.


@dataclass(frozen=True)
class MapUpdate:
    """Add drives to a map as baselines, weight all baselines, and retire ground that two newer drives find changed."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5; replaced unless -o is given")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs or run folders")]
    output: Annotated[Path | None, arg(aliases=["-o"], metavar="NEW.map.h5", help="map to write")] = None
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Update."""
        from lgprjax.formats import DriveLog
        from lgprjax.mapping import UPDATE_PASSES, update_map

        require_files(self.drives, "drives")
        drives = tuple(drive_of(path) for path in self.drives)
        scans = 0
        for path in drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        check_outputs(self.json, force=self.force)
        with progress_bar("updating map", UPDATE_PASSES * scans) as progress:
            update = update_map(
                self.file, drives, self.output, force=self.force, progress=progress, stage=progress.stage
            )
        _print_update(update)
        if self.json is not None:
            write_figures(self.json, update.as_json(), force=self.force)
        written = self.output or self.file
        retired = sum(drive.retired for drive in update.drives)
        added = counted(len(update.drives), "baseline")
        verdict(f"wrote {written}: {added} added, {counted(retired, 'station')} retired", f"map verify {written}")


def _print_update(update: "UpdatedMap") -> None:
    from lgprjax.mapping.weights import changes_in_words

    for drive in update.drives:
        say(
            f"{drive.name}: baseline {drive.baseline}, {drive.length_m:.0f} m, {drive.over_map_m:.0f} m over the map, "
            f"{100 * drive.ok_share:.0f} % of the scans there ok"
        )
        say(
            f"  labels corrected over {drive.corrected_m:.0f} m: {drive.moved_rms_m:.3f} m RMS, "
            f"max {drive.moved_max_m:.3f} m; {drive.length_m - drive.corrected_m:.0f} m unchanged"
        )
        if drive.held_back:
            say(
                f"  {drive.held_back} of {drive.stations} stations held back: not located, or in conflict with the "
                "map and not yet confirmed by a second drive"
            )
        for line in changes_in_words(drive, update.files):
            say(f"  {line}")
        if drive.retired or drive.released:
            say(f"  {drive.retired} stations retired, {drive.released} held-back stations released")
    table = Table("baseline", "weight", "reasons", title="weights of the baselines")
    for number, (file, weight) in enumerate(zip(update.files, update.weights, strict=True)):
        table.add_row(f"{number} {file}", f"{weight.weight:.2f}", weight.reasons)
    console.print(table)


# Picture of a verified map: number and age of passes, cell by cell.


def draw_map_passes(source: "MapFile", health: "MapHealth", path: Path, *, force: bool) -> None:
    """Draw number and age of the passes over a verified map.

    Raises:
        InputError: a part of the map is damaged; the file exists (without ``force``) or cannot be written.
    """
    from lgprjax.mapping.survey import ground_passes, half_like_m
    from lgprjax.report import MapPasses, draw_passes

    ground = ground_passes(source, health.survey.route)
    now = datetime.now(UTC)
    today = (now - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() / 86400.0
    draw_passes(
        MapPasses(
            name=health.name,
            at_m=ground.at_m,
            across_m=ground.across_m,
            passes=ground.passes,
            age_days=today - ground.newest_day,
            hole=ground.hole,
            half_like_m=half_like_m(health.survey, source.description.channel_pitch_m),
            today=f"{now:%Y-%m-%d}",
        ),
        path,
        force=force,
    )


_VERDICT_STYLE = {"good": "green", "look": "yellow", "bad": "bold red"}
_INTERVALS = 4  # listed in the table; all of them are in the JSON
_OUTPUTS = ("places.csv", "agreement.csv", "strips.png", "passes.png", "findings.json")


@dataclass(frozen=True)
class MapBuild:
    """Build a map (subsurface database) from drive logs over the same ground."""

    drives: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="DRIVE...", help="drive logs or run folders; the first defines origin and processing of the map"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="M.map.h5", help="map to write")]
    centre_frequency_mhz: float | None = None
    """centre frequency of the antennas, if the log does not contain it"""
    travel_time_ns: float | None = None
    """maximum two-way travel time of the profiles; default: the end of the recording, for sweeps 15 periods"""
    precision: Literal["full", "standard", "small"] = "standard"
    """precision of stored traces: full (16-bit samples), standard (about two bits per value), small (fewer bits)"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Build."""
        from lgprjax.formats import MAP_PRECISIONS, DriveLog, locked_map
        from lgprjax.mapping import build_map

        require_files(self.drives, "drives")
        if self.centre_frequency_mhz is not None and not 1.0 <= self.centre_frequency_mhz <= 1e4:
            raise UsageError(
                f"--centre-frequency-mhz: expected MHz, 1 to 10000 (1 GHz: 1000), found {self.centre_frequency_mhz:g}"
            )
        if self.travel_time_ns is not None and not 1.0 <= self.travel_time_ns <= 1e5:
            raise UsageError(f"--travel-time-ns: expected 1 to 100000, in ns, found {self.travel_time_ns:g}")
        drives = tuple(drive_of(path) for path in self.drives)
        scans = 0
        for path in drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        check_outputs(self.output, force=self.force)
        frequency = None if self.centre_frequency_mhz is None else 1e6 * self.centre_frequency_mhz
        with locked_map(self.output), progress_bar("building map", scans) as progress:
            build_map(
                drives,
                self.output,
                centre_frequency_hz=frequency,
                travel_time_ns=self.travel_time_ns,
                precision=MAP_PRECISIONS[self.precision],
                force=self.force,
                progress=progress,
                stage=progress.stage,
            )
        figures = print_info(self.output)
        verdict(f"wrote {_size(self.output, figures)}", f"map verify {self.output}")


def drive_of(path: Path) -> Path:
    """A drive log; of a run folder the one that the run wrote, or that is written now from its records."""
    if not (path / "run.json").is_file():
        return path
    from lgprjax.cli.data import config_of_run
    from lgprjax.formats import read_run
    from lgprjax.runtime.drive_log import drive_of_run

    config = config_of_run(path)
    if config.coverage is not None:
        raise InputError(path, "run", "a run with radar", "a run of a field plan, without radar")
    output, reading = path / f"{config.name}.drive.h5", read_run(path)
    written_s = max((segment.stat().st_mtime for segment in path.glob("*.lgprun")), default=0.0)
    if reading.summary.end is None and time.time() - written_s < _STILL_S:
        raise InputError(path, "run", "a run that has ended", "a run that is still recording")
    if not output.exists() or output.stat().st_mtime < written_s:
        with working(f"writing {output}"):
            drive = drive_of_run(reading, config, output, force=True)
        say(f"wrote {output}: {drive.seconds:.1f} s, {drive.scans} scans")
    return output


_STILL_S = 5.0
"""A recorder writes more often."""


@dataclass(frozen=True)
class MapVerify:
    """Verify a map: coverage, holes, weak or ambiguous ground, inconsistent baselines."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    output: Annotated[
        Path | None,
        arg(aliases=["-o"], metavar="DIR", help="folder for strips.png, passes.png, two tables and findings.json"),
    ] = None
    json: Path | None = None
    """JSON file for the findings; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Verify. Findings do not change the exit status."""
        from lgprjax.formats import MapFile
        from lgprjax.mapping import places_of, verify_map

        with MapFile.open(self.file) as source:
            self._check_outputs()
            with progress_bar("verifying map", places_of(source), "places") as progress:
                health = verify_map(source, progress)
            _print_health(self.file, health)
            if self.output is not None:
                self.output.mkdir(parents=True, exist_ok=True)
                _write_health(self.output, source, health, self.force)
                say(f"pictures and tables: {self.output}")
        if self.json is not None:
            write_figures(self.json, health.as_json(), force=self.force)
        bad = {finding.kind for finding in health.findings if finding.verdict != "good"}
        following = f"register {self.file} DRIVE... -o DIR"
        if bad & {"offset", "disagreement"} and health.baselines > 1:
            following = f"map refine {self.file} -o NEW.map.h5"
        verdict(f"{self.file}: map {health.verdict}" + (f" ({', '.join(sorted(bad))})" if bad else ""), following)

    def _check_outputs(self) -> None:
        check_outputs(self.json, force=self.force)
        if self.output is not None and self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        for path in () if self.output is None else (self.output / name for name in _OUTPUTS):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "an existing file")


def _print_health(path: Path, health: "MapHealth") -> None:
    title = f"{path.name}: {health.length_m:.0f} m of route, {health.baselines} baselines"
    table = Table("finding", "value", "look / bad at", "verdict", "metres along the route", title=title)
    for finding in health.findings:
        verdict = Text(finding.verdict, _VERDICT_STYLE[finding.verdict])
        limits = f"{finding.look:g} / {finding.bad:g}"
        value = f"{finding.value:.3g} {finding.unit}".strip()
        table.add_row(finding.kind, value, limits, verdict, _where(finding.where))
    console.print(table)
    for finding in health.findings:
        console.print(f"{finding.verdict}: {finding.kind}: {finding.text}", highlight=False, markup=False)
    per_km = 1e3 * health.seconds / health.length_m / 60.0
    detail(f"{health.seconds:.0f} s, {per_km:.1f} min per kilometre of route")


def _where(intervals: "tuple[RouteInterval, ...]") -> str:
    """The longest intervals, in metres along the route."""
    longest = sorted(intervals, key=lambda each: each.start_m - each.stop_m)[:_INTERVALS]
    parts = []
    for each in sorted(longest, key=lambda each: each.start_m):
        named = [f"{what} {number}" for what, number in (("baseline", each.drive), ("channel", each.channel))]
        known = [name for name, number in zip(named, (each.drive, each.channel), strict=True) if number is not None]
        parts.append(f"{each.start_m:.0f}-{each.stop_m:.0f} m" + (f" ({', '.join(known)})" if known else ""))
    more = len(intervals) - len(longest)
    return ", ".join(parts) + (f", {more} more" if more > 0 else "")


def _write_health(folder: Path, source: "MapFile", health: "MapHealth", force: bool) -> None:
    import numpy as np

    from lgprjax.formats import atomic_output
    from lgprjax.mapping.verify import WEAK_REPEATS, WIDE_OFFSET_M
    from lgprjax.registration import MIN_OVERLAP
    from lgprjax.report import BaselineStrip, MapStrips, draw_map_strips

    for name, values in (("places.csv", health.places), ("agreement.csv", health.agreement)):
        with atomic_output(folder / name, force) as temporary:
            values.to_csv(temporary, index=False, float_format="%.12g")
    write_figures(folder / "findings.json", health.as_json(), force=force)
    draw_map_passes(source, health, folder / "passes.png", force=force)
    survey, agreement = health.survey, health.agreement
    strips = []
    for drive in sorted(set(agreement["baseline"])):
        mine = agreement[agreement["baseline"] == drive].sort_values("route_m")
        ok = mine["code"].to_numpy() == "ok"
        strips.append(
            BaselineStrip(
                at_m=mine["route_m"].to_numpy(),
                along_m=np.where(ok, mine["along_m"].to_numpy(), np.nan),
                cross_m=np.where(ok, mine["cross_m"].to_numpy(), np.nan),
                correlation=mine["correlation"].to_numpy(),
            )
        )
    draw_map_strips(
        MapStrips(
            name=health.name,
            at_m=survey.route.at_m,
            track_m=survey.route.pose[:, :2],
            width_m=survey.ground.width_m,
            array_m=source.description.array_width_m,
            overlap=survey.ground.overlap,
            passes=survey.ground.passes.astype(np.float64),
            repeats=survey.signal.repeats,
            likeness=survey.signal.likeness,
            ambiguous=survey.signal.ambiguous,
            baselines=tuple(strips),
            least_overlap=MIN_OVERLAP,
            least_repeats=WEAK_REPEATS,
            widest_offset_m=WIDE_OFFSET_M,
            marked=tuple((f.kind, each.start_m, each.stop_m) for f in health.findings for each in f.where),
        ),
        folder / "strips.png",
        force=force,
    )
