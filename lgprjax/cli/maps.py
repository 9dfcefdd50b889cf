"""``lgprjax map``: build, describe, verify, refine and update subsurface databases."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, progress_bar, require_files
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import MapFile
    from lgprjax.mapping import MapHealth, RouteInterval, UpdatedMap
    from lgprjax.mapping.align import AgreedBaselines
    from lgprjax.registration import Chance


# ``lgprjax map info``: coverage, origin and size of a subsurface database.

_RISK = 1e-4


@dataclass(frozen=True)
class MapInfo:
    """Show the coverage and the origin of a subsurface database."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    verbose: bool = False
    """also show how the file is stored: bytes of each part, tiles, precision, steps of processing"""
    force: bool = False
    """replace that file if it exists"""

    def run(self) -> None:
        """Print."""
        figures = print_info(self.file, verbose=self.verbose)
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)


def _labels(sigma_m: tuple[float, ...]) -> str:
    """Position sigmas stated by the navigation of each baseline."""
    from lgprjax.batch.assumptions import UNSTATED

    if not any(sigma_m):
        return UNSTATED
    sigmas_text = ", ".join("not stated" if sigma == 0.0 else f"{100.0 * sigma:.1f} cm" for sigma in sigma_m)
    return f"sigma {sigmas_text}"


def _chance(chance: "Chance | None", wavelength_m: float) -> dict[str, object]:
    """Scores of foreign ground on this map, and those required of a match."""
    from lgprjax.registration import ladder_of, least_z

    if chance is None:
        later = "not in this file: measured at the first registration"
        return {"noise_floor": later, "least_score": None, "sigma_scale": later}
    pooled = "pooled over many grounds: this map is too small for its own"
    least = [round(float(score), 2) for score in least_z(_RISK, chance)]
    return {
        "noise_floor": f"{'own' if chance.own else pooled}; {chance.pieces} independent pieces",
        "least_score": {
            f"{window_m:g} m": score for window_m, score in zip(ladder_of(wavelength_m), least, strict=True)
        },
        "sigma_scale": f"{chance.sigma_scale:.2f}; "
        + (
            f"{chance.left_out} pieces of baselines left out and registered on the others"
            if chance.left_out
            else "pooled over many grounds: baselines do not overlap"
        ),
    }


def print_info(path: Path, *, verbose: bool = False) -> dict[str, object]:
    """Print the table of a database; the same figures by name, with all their digits and how the file is stored."""
    import numpy as np

    from lgprjax.batch import map_assumed_in_words
    from lgprjax.formats import MapFile

    with MapFile.open(path) as source:
        description, pose = source.description, source.pose
        step = np.hypot(*np.diff(pose[:, :2], axis=0).T)
        along = float(step[np.diff(source.drive) == 0].sum())
        low, high = pose[:, :2].min(axis=0), pose[:, :2].max(axis=0)
        figures: dict[str, object] = {
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
            "labels": _labels(description.label_sigma_m),
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
    for name, value in _for_people(figures, verbose=verbose):
        table.add_row(name, value)
    console.print(table)
    if assumed is not None:
        console.print(f"assumed: {assumed}", highlight=False, markup=False, soft_wrap=True)
    return {**figures, "assumed": assumed}


_HOW_STORED = ("track_filter_m", "tiles", "precision", "steps")
"""Rows that few readers want; those of bytes are others."""


def _for_people(figures: dict[str, Any], *, verbose: bool) -> Iterator[tuple[str, str]]:
    """Quantities in words, with their units and no more digits than they are good for."""
    (west, east), (south, north) = figures["east_m"], figures["north_m"]
    low, high = figures["band_mhz"]
    latitude, longitude = figures["anchor_latitude_deg"], figures["anchor_longitude_deg"]
    yield "name", str(figures["name"])
    yield "origin, latitude and longitude", f"{latitude:.7f}°, {longitude:.7f}°"
    yield "extent from there", f"{west:.1f} to {east:.1f} m east, {south:.1f} to {north:.1f} m north"
    yield "baselines", f"{figures['baselines']}, {figures['length_m']:.1f} m in all"
    step_cm = 100.0 * figures["station_step_m"]
    yield "stations", f"{figures['stations']}, {step_cm:.1f} cm apart" + _retired(figures["retired"])
    pitch = f", {100.0 * figures['channel_pitch_m']:.1f} cm apart" if figures["channels"] > 1 else ""
    yield "channels", f"{figures['channels']}{pitch}"
    yield "band", f"{low:.0f} to {high:.0f} MHz"
    yield (
        "travel time",
        f"{figures['travel_time_ns']:.1f} ns, {0.05 * figures['travel_time_ns']:.1f} m deep at 0.1 m/ns",
    )
    yield "labels", str(figures["labels"])
    yield "noise floor", str(figures["noise_floor"])
    if figures["least_score"] is not None:
        yield "least score of a match", _scores(figures["least_score"])
    yield "scale of sigmas", str(figures["sigma_scale"])
    if figures["weight"]:
        yield "weights of the baselines", ", ".join(f"{weight:.2f}" for weight in figures["weight"])
    yield "size", f"{figures['bytes_per_m'] / 1e3:.1f} kB a metre"
    for name, value in figures.items() if verbose else ():
        if name in _HOW_STORED or name.startswith("bytes_per_m_"):
            yield name, ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _retired(stations: int) -> str:
    return f"; {stations} retired" if stations else ""


def _scores(least: dict[str, float]) -> str:
    scores = ", ".join(f"{window} {score:.2f}" for window, score in least.items())
    return f"{scores} noise floors by window (risk {_RISK:g}, one search)"


# ``lgprjax map refine``: make the baselines of a map consistent.


@dataclass(frozen=True)
class MapRefine:
    """Make the baselines of a map consistent: register each on the others, correct its labels, write a new map."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="NEW.map.h5", help="database to write")]
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Refine."""
        from lgprjax.formats import MapFile, locked_map
        from lgprjax.mapping.align import baseline_files, plan_matches, refine_map

        with MapFile.open(self.file):
            check_outputs(self.output, self.json, force=self.force)
        with locked_map(self.output), MapFile.open(self.file) as source:
            plan = plan_matches(source)
            with progress_bar("matching baselines", 2 * len(plan.pairs.station), "matches") as progress:
                agreed = refine_map(
                    source, plan, self.output, force=self.force, progress=progress, stage=progress.stage
                )
            files = baseline_files(source)
        _print(self.output, agreed, files)
        if self.json is not None:
            write_figures(self.json, _figures(agreed), force=self.force)


def _print(path: Path, agreed: "AgreedBaselines", files: list[str]) -> None:
    from lgprjax.mapping.align import agreement_in_words

    table = Table("baseline", "matches", "believed", "moved RMS m", "largest m", "label sigma m", "after m")
    for change in agreed.baselines:
        row = [str(change.drive), str(change.matches), str(change.kept)]
        row += [f"{change.moved_rms_m:.3f}", f"{change.moved_max_m:.3f}", f"{change.sigma_before_m:.3f}"]
        table.add_row(*row, f"{change.sigma_after_m:.3f}" if change.kept else "as it was")
    console.print(table)
    for line in [*agreement_in_words(agreed, files), f"wrote {path}"]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


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


# ``lgprjax map update``: update a map by new drives.


@dataclass(frozen=True)
class MapUpdate:
    """Add drives to a map as baselines, weight all of them, and retire ground that two newer drives find changed."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5; without -o it is replaced")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs over its ground")]
    output: Annotated[Path | None, arg(aliases=["-o"], metavar="NEW.map.h5", help="write a new database")] = None
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Update."""
        from lgprjax.formats import DriveLog
        from lgprjax.mapping import UPDATE_PASSES, update_map

        require_files(self.drives, "drives")
        scans = 0
        for path in self.drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        check_outputs(self.json, force=self.force)
        with progress_bar("updating map", UPDATE_PASSES * scans) as progress:
            update = update_map(
                self.file, self.drives, self.output, force=self.force, progress=progress, stage=progress.stage
            )
        _print_update(update)
        _say(f"wrote {self.output or self.file}")
        if self.json is not None:
            write_figures(self.json, update.as_json(), force=self.force)


def _print_update(update: "UpdatedMap") -> None:
    from lgprjax.mapping.weights import changes_in_words

    for drive in update.drives:
        _say(
            f"{drive.name}: baseline {drive.baseline}, {drive.length_m:.0f} m, {drive.over_map_m:.0f} m of them over "
            f"the map's ground, {100 * drive.ok_share:.0f} % of the scans there ok"
        )
        _say(
            f"  labels moved by {drive.moved_rms_m:.3f} m RMS, {drive.moved_max_m:.3f} m at most, over "
            f"{drive.corrected_m:.0f} m; {drive.length_m - drive.corrected_m:.0f} m stay as given"
        )
        if drive.held_back:
            _say(
                f"  {drive.held_back} of {drive.stations} stations are held back: not located, or in conflict "
                "with the map until a second drive agrees"
            )
        for line in changes_in_words(drive, update.files):
            _say(f"  {line}")
        if drive.retired or drive.released:
            _say(f"  {drive.retired} stations retired, {drive.released} that were held back are in force")
    table = Table("baseline", "weight", "reasons", title="weights of the baselines")
    for number, (file, weight) in enumerate(zip(update.files, update.weights, strict=True)):
        table.add_row(f"{number} {file}", f"{weight.weight:.2f}", weight.reasons)
    console.print(table)


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)


# The picture of a verified map's ground: passes and age, cell by cell.


def draw_map_passes(source: "MapFile", health: "MapHealth", path: Path, *, force: bool) -> None:
    """Draw number and age of the passes over a verified map's ground.

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
    """Build a subsurface database from drive logs over the same ground."""

    drives: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="DRIVE...", help="drive logs; the first defines the map's origin and processing"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="M.map.h5", help="database to write")]
    centre_frequency_mhz: float | None = None
    """centre frequency of the antennas, if missing in the log"""
    travel_time_ns: float | None = None
    """largest travel time of the profiles; default: the recording's end, for sweeps fifteen periods"""
    precision: Literal["full", "standard", "small"] = "standard"
    """precision of stored traces: full as 16-bit samples, standard in about two bits per number, small in fewer"""
    force: bool = False
    """replace an output that exists"""

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
        scans = 0
        for path in self.drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        check_outputs(self.output, force=self.force)
        frequency = None if self.centre_frequency_mhz is None else 1e6 * self.centre_frequency_mhz
        with locked_map(self.output), progress_bar("building map", scans) as progress:
            build_map(
                self.drives,
                self.output,
                centre_frequency_hz=frequency,
                travel_time_ns=self.travel_time_ns,
                precision=MAP_PRECISIONS[self.precision],
                force=self.force,
                progress=progress,
                stage=progress.stage,
            )
        console.print(f"wrote {self.output}", highlight=False, markup=False, soft_wrap=True)
        print_info(self.output)


@dataclass(frozen=True)
class MapVerify:
    """Verify a map: coverage, holes, weak or ambiguous ground, baselines that disagree."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    output: Annotated[
        Path | None,
        arg(aliases=["-o"], metavar="DIR", help="folder for strips.png, passes.png, two tables and findings.json"),
    ] = None
    json: Path | None = None
    """also write the findings to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Measure and judge; findings do not change the exit status."""
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
                console.print(f"pictures and tables: {self.output}", highlight=False, markup=False, soft_wrap=True)
        if self.json is not None:
            write_figures(self.json, health.as_json(), force=self.force)

    def _check_outputs(self) -> None:
        check_outputs(self.json, force=self.force)
        if self.output is not None and self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        for path in () if self.output is None else (self.output / name for name in _OUTPUTS):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "one that exists")


def _print_health(path: Path, health: "MapHealth") -> None:
    title = f"{path.name}: {health.length_m:.0f} m of route, {health.baselines} baselines"
    table = Table("finding", "value", "look / bad at", "verdict", "where along the route", title=title)
    for finding in health.findings:
        verdict = Text(finding.verdict, _VERDICT_STYLE[finding.verdict])
        limits = f"{finding.look:g} / {finding.bad:g}"
        value = f"{finding.value:.3g} {finding.unit}".strip()
        table.add_row(finding.kind, value, limits, verdict, _where(finding.where))
    console.print(table)
    for finding in health.findings:
        console.print(f"{finding.verdict}: {finding.kind}: {finding.text}", highlight=False, markup=False)
    per_km = 1e3 * health.seconds / health.length_m / 60.0
    took = f"took {health.seconds:.0f} s, {per_km:.1f} min a kilometre of route"
    console.print(f"{path}: map {health.verdict} ({took})", highlight=False, markup=False, soft_wrap=True)


def _where(intervals: "tuple[RouteInterval, ...]") -> str:
    """The longest intervals in metres along the route, in order."""
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
