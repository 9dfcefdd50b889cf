"""The site file: a road, its ground, a radar, days and drives as TOML (docs/scene.md lists the keys)."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.scene import (
    NO_FAULTS,
    WEATHER,
    Day,
    DrivePlan,
    Faults,
    GroundConfig,
    NavigationErrors,
    RadarConfig,
    RoadConfig,
    SweepPlan,
)
from lgprjax.simulation.site_check import refuse_impossible
from lgprjax.simulation.site_limits import LIMITS
from lgprjax.simulation.site_plan import ArrayConfig, Site, SiteDrive, SiteHeader
from lgprjax.simulation.site_table import Place, as_table, fill_config, nearest, refuse_unknown

NAVIGATION = {
    "standard": NavigationErrors(),
    "survey": NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=float(np.radians(0.1))),
}
"""Navigation that needs no section: 5 cm and 0.3 deg; 1 cm and 0.1 deg, as for making maps."""
FAULTS = {"usual": Faults(), "none": NO_FAULTS}
"""Receiver faults that need no section."""

_HEADER = ("name", "seed", "latitude_deg", "longitude_deg", "height_m")
_SECTIONS = ("ground", "road", "radar", "array", "day", "navigation", "faults", "drive")
_DRIVE_KEYS = ("name", "day", "day_seed", "seed", "navigation", "faults", "other_ground")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")

Config = TypeVar("Config")


def read_site(path: str | Path) -> Site:
    """A site from its file; nothing is drawn or rendered.

    Raises:
        InputError: the file is missing or no TOML; a key is unknown, missing, of a wrong type or out of its range;
            a name is used twice or stands for nothing; a drive leaves the road or hears beyond the ground.
    """
    root = Place(Path(path))
    table = load_toml(root.file)
    refuse_unknown(root, table, [*_HEADER, *_SECTIONS])
    given = {key: table[key] for key in _HEADER if key in table}
    header = fill_config(SiteHeader, root, {"name": root.file.name.removesuffix(".toml"), **given})
    array = fill_config(ArrayConfig, root.at("array"), table.get("array", {}))
    ground = fill_config(GroundConfig, root.at("ground"), table.get("ground", {}))
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
    faults = _read_named(Faults, root.at("faults"), table.get("faults", {}), FAULTS)
    choices = _Choices(days, navigation, faults)
    entries = table.get("drive", [])
    if not isinstance(entries, list) or not entries:
        raise root.at("drive").refuse("one [[drive]] or more", "none" if "drive" not in table else "no such list")
    drives: list[SiteDrive] = []
    for number, entry in enumerate(entries, 1):
        place = Place(root.file, f"drive[{number}]")
        drive = _read_drive(place, entry, site, choices)
        if drive.name in [known.name for known in drives]:
            raise place.at("name").refuse("a name that no other drive has", repr(drive.name))
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
    faults: Mapping[str, Faults]


def _read_road(place: Place, table: object, ground: GroundConfig) -> RoadConfig:
    withheld = {name: f"{name} in [ground], which the road goes by" for name in ("length_m", "margin_m")}
    road = fill_config(RoadConfig, place, table, withheld=withheld)
    return replace(road, length_m=ground.length_m, margin_m=ground.margin_m)


def _read_radar(place: Place, table: object, array: ArrayConfig) -> tuple[RadarConfig, SweepPlan | None]:
    entries = as_table(place, table)
    withheld = {"height_m": "height_m in [array]"}
    radar = fill_config(RadarConfig, place, entries, elsewhere=("recording", "sweeps"), withheld=withheld)
    recording = entries.get("recording", "sweeps" if "sweeps" in entries else "traces")
    if recording not in ("traces", "sweeps"):
        raise place.at("recording").refuse('"traces" or "sweeps"', repr(recording))
    if recording == "traces" and "sweeps" in entries:
        raise place.at("recording").refuse('"sweeps", since there is [radar.sweeps]', '"traces"')
    sweeps = fill_config(SweepPlan, place.at("sweeps"), entries.get("sweeps", {}))
    return replace(radar, height_m=array.height_m), sweeps if recording == "sweeps" else None


def _read_days(place: Place, table: object, seed: int) -> dict[str, Day]:
    days: dict[str, Day] = {}
    for name, entry in as_table(place, table).items():
        where = place.at(name)
        if name in WEATHER:
            raise where.refuse("a name of its own (like = that name)", "a name of the built-in weather")
        entries = as_table(where, entry)
        like = entries.get("like", "clear")
        if not isinstance(like, str) or like not in WEATHER:
            raise where.at("like").refuse(nearest(str(like), WEATHER, "a kind of weather"), repr(like))
        base = WEATHER[like](derive_seed(seed, "day", name))
        plain = {key: value for key, value in entries.items() if key != "like"}
        days[name] = fill_config(Day, where, plain, base=base)
    return days


def _read_named(kind: type[Config], place: Place, table: object, known: Mapping[str, Config]) -> dict[str, Config]:
    named = dict(known)
    for name, entry in as_table(place, table).items():
        if name in known:
            raise place.at(name).refuse("a name of its own", "a built-in name")
        named[name] = fill_config(kind, place.at(name), entry)
    return named


def _read_drive(place: Place, entry: object, site: Site, choices: _Choices) -> SiteDrive:
    table, header = as_table(place, entry), site.header
    base = DrivePlan(0.0, site.ground.length_m, scan_rate_hz=site.array.scan_rate_hz)
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


def _word(place: Place, value: object, known: Mapping[str, object] | list[str], what: str) -> str:
    if not isinstance(value, str) or value not in known:
        raise place.refuse(nearest(str(value), known, what), repr(value))
    return value


def _seed(place: Place, value: object) -> int | None:
    if value is None:
        return None
    low, high = LIMITS[SiteHeader]["seed"]
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise InputError(place.file, place.path, f"a whole number from {low:.0f} to {high:.0f}", repr(value))
    return value
