"""The site file: a road, its ground, a radar, days and drives as TOML (docs/scene.md lists the keys)."""

import hashlib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from lgprjax.config import TableKey, as_table, nearest, refuse_unknown
from lgprjax.errors import InputError
from lgprjax.files import examples_folder, load_toml
from lgprjax.radar import unambiguous_ns
from lgprjax.scene import (
    NO_FAULTS,
    WEATHER,
    Day,
    DrivePlan,
    GroundConfig,
    NavigationErrors,
    RadarConfig,
    ReceiverFaults,
    RoadConfig,
    SimulatedDrive,
    SweepPlan,
)
from lgprjax.scene.propagation import band_spectrum
from lgprjax.scene.render import NOISE_STEP_MHZ
from lgprjax.simulation.drives import write_drive
from lgprjax.simulation.site_tables import (
    LIMITS,
    ArrayConfig,
    Site,
    SiteDrive,
    SiteHeader,
    SiteScene,
    fill_config,
    plan_drive,
    prepare_site,
)

# Consistency of a site file's parts, checked before anything is rendered.

_WANDERS = 3.0  # multiples of the wander's rms that fit into a lane


def refuse_impossible(site: Site, root: TableKey) -> None:
    """Refuse contradictions between sections and drives of a site.

    Raises:
        InputError: the band exceeds the time axis, is too narrow, or is off the sweeps' frequencies; the ground has no
            interfaces; an arc is too tight; a drive leaves the road or its aperture exceeds the ground; a dead channel
            does not exist, or sweeps have dead channels only.
    """
    _check_radar(site, root.at("radar"))
    if not site.ground.layer_depth_m:
        raise root.at("ground").at("layer_depth_m").refuse("one depth or more", "none")
    tightest = 1.0 / site.road.min_radius_m
    for number, (length_m, curvature) in enumerate(site.road.arcs, 1):
        place = root.at("road").at(f"arcs[{number}]")
        if not length_m > 0.0:
            raise place.refuse("[length in metres above 0, curvature per metre]", f"a length of {length_m:g}")
        if abs(curvature) > tightest * (1 + 1e-12):
            limit = f"a curvature of -{tightest:.4g} to {tightest:.4g} per metre (min_radius_m)"
            raise place.refuse(limit, f"{curvature:g}")
    reach = max(abs(site.array.geometry.y_m)) + site.radar.aperture_m
    if reach > site.ground.half_width_m:
        expected = f"{reach:.2f} or more (lateral reach of array and antennas)"
        raise root.at("ground").at("half_width_m").refuse(expected, f"{site.ground.half_width_m:g}")
    for number, drive in enumerate(site.drives, 1):
        _check_drive(site, drive, TableKey(root.file, f"drive[{number}]"))


def _check_radar(site: Site, place: TableKey) -> None:
    radar, sweeps = site.radar, site.sweeps
    highest = 500.0 / radar.sample_step_ns
    if radar.band_mhz[1] > highest:
        raise place.at("band_mhz").refuse(f"at most {highest:.0f} MHz at this sample_step_ns", f"{radar.band_mhz[1]:g}")
    if radar.band_mhz[1] - radar.band_mhz[0] < NOISE_STEP_MHZ:
        expected = f"a band of {NOISE_STEP_MHZ:g} MHz or more (the step of the noise)"
        raise place.at("band_mhz").refuse(expected, f"{radar.band_mhz[1] - radar.band_mhz[0]:g} MHz")
    if 2 * radar.band_edge_mhz > radar.band_mhz[1] - radar.band_mhz[0]:
        expected = f"at most half the band, {0.5 * (radar.band_mhz[1] - radar.band_mhz[0]):g}"
        raise place.at("band_edge_mhz").refuse(expected, f"{radar.band_edge_mhz:g}")
    if sweeps is not None and sweeps.frequency_mhz[-1] > highest:
        last = f"a last frequency of {sweeps.frequency_mhz[-1]:g} MHz"
        raise place.at("sweeps").at("steps").refuse(f"at most {highest:.0f} MHz at this sample_step_ns", last)
    if sweeps is not None and not band_spectrum(radar, sweeps.frequency_mhz).any():
        expected = f"frequencies within band_mhz, {radar.band_mhz[0]:g} to {radar.band_mhz[1]:g}"
        raise place.at("sweeps").refuse(expected, f"{sweeps.first_mhz:g} to {sweeps.frequency_mhz[-1]:g}")
    if sweeps is not None:
        window_ns = radar.samples * radar.sample_step_ns - radar.time_zero_ns
        clear_ns = unambiguous_ns(sweeps.frequency_mhz * 1e6)
        if clear_ns < window_ns:
            widest = sweeps.step_mhz * clear_ns / window_ns
            window = f"unambiguous over the radar's window of {window_ns:.3g} ns"
            expected = f"at most {math.floor(10.0 * widest) / 10.0:g} MHz, {window}"
            found = f"{sweeps.step_mhz:g} MHz, unambiguous over {clear_ns:.3g} ns"
            raise place.at("sweeps").at("step_mhz").refuse(expected, found)


def _check_drive(site: Site, drive: SiteDrive, place: TableKey) -> None:
    plan, ground, array, aperture = drive.plan, site.ground, site.array, site.radar.aperture_m
    if plan.direction == 0:
        raise place.at("direction").refuse("1 or -1", "0")
    if not plan.start_m < plan.stop_m:
        raise place.at("stop_m").refuse(f"more than start_m, {plan.start_m:g}", f"{plan.stop_m:g}")
    # The body must be on the road, and the array, ahead of it in either direction, must be over ground.
    ahead_m = plan.direction * array.x_m
    least_m = -ground.margin_m + max(0.0, aperture - ahead_m)
    most_m = ground.length_m + ground.margin_m - max(0.0, aperture + ahead_m)
    for key, value in (("start_m", plan.start_m), ("stop_m", plan.stop_m)):
        if not least_m <= value <= most_m:
            why = f"{least_m:g} to {most_m:g}, where road and ground cover the reach of the array"
            raise place.at(key).refuse(why, f"{value:g}")
    half_array_m = float(max(abs(array.geometry.y_m)))
    room_m = ground.half_width_m - half_array_m - aperture - _WANDERS * plan.wander_m
    if room_m < 0:
        expected = (
            f"less, so that the ground covers the lateral reach of array and antennas, {half_array_m + aperture:.2f} m"
        )
        raise place.at("wander_m").refuse(expected, f"{plan.wander_m:g}")
    if abs(plan.lane_m) > room_m:
        why = f"-{room_m:.2f} to {room_m:.2f}, where the ground covers the lateral reach of array and antennas"
        raise place.at("lane_m").refuse(why, f"{plan.lane_m:g}")
    duration_s = (plan.stop_m - plan.start_m) / plan.speed_mps
    if duration_s * array.scan_rate_hz < 2.0:
        raise place.at("stop_m").refuse("two scans or more", f"{duration_s:.3g} s at {array.scan_rate_hz:g} scans a s")
    low, high = LIMITS[GroundConfig]["velocity_m_per_ns"]
    velocity = ground.velocity_m_per_ns * drive.day.velocity_factor
    if not low <= velocity <= high:
        why = f"a velocity in the ground of {low:g} to {high:g} m/ns on that day"
        raise place.at("day").refuse(why, f"{velocity:.3g} m/ns")
    for channel in drive.faults.dead_channels:
        if channel >= array.channels:
            expected = f"dead_channels from 0 to {array.channels - 1}"
            raise place.at("faults").refuse(expected, str(channel))
    if site.sweeps is not None and len(set(drive.faults.dead_channels)) == array.channels:
        raise place.at("faults").refuse("a live channel (needed to calibrate sweeps)", "all channels dead")


NAVIGATION = {
    "standard": NavigationErrors(),
    "survey": NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=float(np.radians(0.1))),
}
"""Navigation that needs no section: 5 cm and 0.3 deg; 1 cm and 0.1 deg, as for making maps."""
FAULTS = {"usual": ReceiverFaults(), "none": NO_FAULTS}
"""Receiver faults that need no section."""

_HEADER = ("name", "seed", "latitude_deg", "longitude_deg", "height_m")
_SECTIONS = ("ground", "road", "radar", "array", "day", "navigation", "faults", "drive")
_DRIVE_KEYS = ("name", "day", "day_seed", "seed", "navigation", "faults", "other_ground")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")

Config = TypeVar("Config")


def site_file(given: str | Path) -> Path:
    """A site file: the path itself, or the file of the example site of that name (``lgprjax examples`` copies them).

    Raises:
        InputError: there is no example site of the name.
    """
    path = Path(given)
    if path.is_file() or path.suffix == ".toml":  # a missing file is reported by the reader
        return path
    known = {each.stem: each for each in sorted(examples_folder("sites").glob("*.toml"))}
    if str(given) not in known:
        found = "a folder" if path.is_dir() else "no such file"
        raise InputError(path, "site", f"a site file, or an example site among {', '.join(known)}", found)
    return known[str(given)]


def read_site(path: str | Path) -> Site:
    """Read a site from its file, without drawing or rendering.

    Raises:
        InputError: the file is missing or not TOML; a key is unknown, missing, of a wrong type or out of its range;
            a name is used twice or refers to nothing; a drive leaves the road or its aperture exceeds the ground.
    """
    root = TableKey(Path(path))
    table = load_toml(root.file)
    if "kind" in table and "vehicle" in table:
        raise root.at("kind").refuse(
            'a site, or drives of a vehicle (kind = "vehicle_drives")', "a study (lgprjax tune)"
        )
    refuse_unknown(root, table, [*_HEADER, *_SECTIONS])
    given = {key: table[key] for key in _HEADER if key in table}
    header = fill_config(SiteHeader, root, {"name": root.file.name.removesuffix(".toml"), **given})
    array = fill_config(ArrayConfig, root.at("array"), table.get("array", {}))
    ground = _read_ground(root.at("ground"), table.get("ground", {}))
    radar, sweeps = _read_radar(root.at("radar"), table.get("radar", {}), array)
    site = Site(
        header=header,
        ground=ground,
        road=_read_road(root.at("road"), table.get("road", {}), ground),
        radar=radar,
        sweeps=sweeps,
        array=array,
        drives=(),
    )
    days = _read_days(root.at("day"), table.get("day", {}), header.seed)
    navigation = _read_named(NavigationErrors, root.at("navigation"), table.get("navigation", {}), NAVIGATION)
    faults = _read_named(ReceiverFaults, root.at("faults"), table.get("faults", {}), FAULTS)
    choices = _Choices(days, navigation, faults)
    entries = table.get("drive", [])
    if not isinstance(entries, list) or not entries:
        raise root.at("drive").refuse(
            "one [[drive]] or more", "none" if "drive" not in table else "not a list of tables"
        )
    drives: list[SiteDrive] = []
    for number, entry in enumerate(entries, 1):
        place = TableKey(root.file, f"drive[{number}]")
        drive = _read_drive(place, entry, site, choices)
        if drive.name in [known.name for known in drives]:
            raise place.at("name").refuse("a unique drive name", repr(drive.name))
        drives.append(drive)
    site = replace(site, drives=tuple(drives))
    refuse_impossible(site, root)
    return site


def derive_seed(seed: int, *words: str) -> int:
    """A seed of the site's seed and a name: other drives may come and go, it stays."""
    digest = hashlib.sha256("/".join([str(seed), *words]).encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


@dataclass(frozen=True)
class _Choices:
    days: Mapping[str, Day]
    navigation: Mapping[str, NavigationErrors]
    faults: Mapping[str, ReceiverFaults]


def _read_ground(place: TableKey, table: object) -> GroundConfig:
    ground = fill_config(GroundConfig, place, table)
    if ground.repeat_m is not None:
        for key in ("trees_per_100m", "utilities_per_100m"):
            if number := as_table(place, table).get(key):
                raise place.at(key).refuse("0 or no key (ground with repeat_m has no such objects)", f"{number:g}")
    return ground


def _read_road(place: TableKey, table: object, ground: GroundConfig) -> RoadConfig:
    withheld = {name: f"{name} in [ground] (the road uses it)" for name in ("length_m", "margin_m")}
    road = fill_config(RoadConfig, place, table, withheld=withheld)
    return replace(road, length_m=ground.length_m, margin_m=ground.margin_m)


def _read_radar(place: TableKey, table: object, array: ArrayConfig) -> tuple[RadarConfig, SweepPlan | None]:
    entries = as_table(place, table)
    withheld = {"height_m": "height_m in [array]"}
    radar = fill_config(RadarConfig, place, entries, elsewhere=("recording", "sweeps"), withheld=withheld)
    recording = entries.get("recording", "sweeps" if "sweeps" in entries else "traces")
    if recording not in ("traces", "sweeps"):
        raise place.at("recording").refuse('"traces" or "sweeps"', repr(recording))
    if recording == "traces" and "sweeps" in entries:
        raise place.at("recording").refuse('"sweeps", as the section [radar.sweeps] exists', '"traces"')
    sweeps = fill_config(SweepPlan, place.at("sweeps"), entries.get("sweeps", {}))
    return replace(radar, height_m=array.height_m), sweeps if recording == "sweeps" else None


def _read_days(place: TableKey, table: object, seed: int) -> dict[str, Day]:
    days: dict[str, Day] = {}
    for name, entry in as_table(place, table).items():
        where = place.at(name)
        if name in WEATHER:
            raise where.refuse("a new name (use like = for the built-in weather)", "a name of the built-in weather")
        entries = as_table(where, entry)
        like = entries.get("like", "clear")
        if not isinstance(like, str) or like not in WEATHER:
            raise where.at("like").refuse(nearest(str(like), WEATHER, "a kind of weather"), repr(like))
        base = WEATHER[like](derive_seed(seed, "day", name))
        plain = {key: value for key, value in entries.items() if key != "like"}
        days[name] = fill_config(Day, where, plain, base=base)
    return days


def _read_named(kind: type[Config], place: TableKey, table: object, known: Mapping[str, Config]) -> dict[str, Config]:
    named = dict(known)
    for name, entry in as_table(place, table).items():
        if name in known:
            raise place.at(name).refuse("a new name", "a built-in name")
        named[name] = fill_config(kind, place.at(name), entry)
    return named


def _read_drive(place: TableKey, entry: object, site: Site, choices: _Choices) -> SiteDrive:
    table, header = as_table(place, entry), site.header
    base = DrivePlan(start_m=0.0, stop_m=site.ground.length_m, scan_rate_hz=site.array.scan_rate_hz)
    withheld = {"scan_rate_hz": "scan_rate_hz in [array]"}
    plan = fill_config(DrivePlan, place, table, base=base, elsewhere=_DRIVE_KEYS, withheld=withheld)
    name = table.get("name")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        found = "none" if name is None else repr(name)
        raise place.at("name").refuse("a name of letters, digits, '.', '_' and '-', fit for a file", found)
    day_name = _word(place.at("day"), table.get("day", "clear"), [*WEATHER, *choices.days], "a day")
    day_seed = _seed(place.at("day_seed"), table.get("day_seed"))
    if day_name in WEATHER:
        day = WEATHER[day_name](derive_seed(header.seed, "drive", name, "day") if day_seed is None else day_seed)
    else:
        day = choices.days[day_name]
        day = day if day_seed is None else replace(day, seed=day_seed)
    seed = _seed(place.at("seed"), table.get("seed"))
    track = _word(place.at("navigation"), table.get("navigation", "standard"), choices.navigation, "navigation")
    fault = _word(place.at("faults"), table.get("faults", "usual"), choices.faults, "faults")
    return SiteDrive(
        name=name,
        day_name=day_name,
        day=day,
        seed=derive_seed(header.seed, "drive", name) if seed is None else seed,
        plan=plan,
        navigation=choices.navigation[track],
        faults=choices.faults[fault],
        other_ground=_seed(place.at("other_ground"), table.get("other_ground")),
    )


def _word(place: TableKey, value: object, known: Mapping[str, object] | list[str], what: str) -> str:
    if not isinstance(value, str) or value not in known:
        raise place.refuse(nearest(str(value), known, what), repr(value))
    return value


def _seed(place: TableKey, value: object) -> int | None:
    if value is None:
        return None
    low, high = LIMITS[SiteHeader]["seed"]
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise InputError(place.file, place.path, f"a whole number from {low:.0f} to {high:.0f}", repr(value))
    return value


# The drives of a site, planned all before the first is rendered, written one after another.


class PlannedDrive(NamedTuple):
    """Plan of a drive.

    Attributes:
        drive: drive of the site.
        scans: number of scans to record.
        duration_s: time from the first to the last scan.
    """

    drive: SiteDrive
    scans: int
    duration_s: float

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return self.duration_s * self.drive.plan.speed_mps


class PlannedSite(NamedTuple):
    """Road and ground of a site, and its drives in order; ``file`` is where errors point."""

    file: Path
    scene: SiteScene
    drives: tuple[PlannedDrive, ...]


def plan_site(site: Site, file: Path, only: Sequence[str] = ()) -> PlannedSite:
    """Drive every drive without recording it, so that what cannot be driven is refused now.

    Drives are made again when they are written (2 s a kilometre): memory holds one at a time.

    Args:
        only: names of the drives wanted; none for all.

    Raises:
        InputError: a road that cannot be, a drive that it cannot carry, a name that is none of the site's.
    """
    known = [drive.name for drive in site.drives]
    for name in only:
        if name not in known:
            raise InputError(file, "--only", f"drives among {', '.join(known)}", name)
    try:
        scene = prepare_site(site)
    except ValueError as error:
        raise InputError(file, "road", "a feasible road and ground", str(error)) from None
    planned = []
    for number, drive in enumerate(site.drives, 1):
        if only and drive.name not in only:
            continue
        simulated = _plan(scene, drive, file, number)
        planned.append(PlannedDrive(drive, len(simulated.scan_time_s), float(simulated.scan_time_s[-1])))
    return PlannedSite(file, scene, tuple(planned))


def write_site(
    planned: PlannedSite, folder: Path, *, force: bool = False, progress: Callable[[int], None] = lambda _: None
) -> dict[str, Path]:
    """Render the drives to ``NAME.drive.h5`` in a folder, which is made; returns the paths by name.

    A drive that fails leaves nothing half-written; those before it stay.

    Raises:
        InputError: an output exists (without ``force``; found before any work) or cannot be written.
    """
    site = planned.scene.site
    paths = output_paths(planned, folder, force=force)
    folder.mkdir(parents=True, exist_ok=True)
    for number, drive in enumerate(site.drives, 1):
        if drive.name not in paths:
            continue
        origin = {
            "name": site.header.name,
            "seed": site.header.seed,
            "day": drive.day_name,
            "ground_seed": site.header.seed if drive.other_ground is None else drive.other_ground,
        }
        write_drive(
            paths[drive.name],
            _plan(planned.scene, drive, planned.file, number),
            frame=site.frame,
            sweeps=site.sweeps,
            provenance={"site": origin},
            force=force,
            progress=progress,
        )
    return paths


def output_paths(planned: PlannedSite, folder: Path, *, force: bool) -> dict[str, Path]:
    """Output path of each drive.

    Raises:
        InputError: an output exists (without ``force``), or the folder is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    paths = {entry.drive.name: folder / f"{entry.drive.name}.drive.h5" for entry in planned.drives}
    for path in paths.values():
        if path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "an existing file")
    return paths


def _plan(scene: SiteScene, drive: SiteDrive, file: Path, number: int) -> SimulatedDrive:
    try:
        return plan_drive(scene, drive)
    except ValueError as error:
        raise InputError(file, f"drive[{number}]", "a drive within road and ground", str(error)) from None
