"""A site and its drives as configuration, and each drive made from it."""

import difflib
import math
import types
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

from lgprjax.errors import InputError
from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.scene import (
    Cover,
    Day,
    DrivePlan,
    Ground,
    GroundConfig,
    NavigationErrors,
    RadarConfig,
    ReceiverFaults,
    Road,
    RoadConfig,
    SimulatedDrive,
    Skin,
    SweepPlan,
    Trench,
    make_ground,
    make_road,
    simulate_drive,
)


@dataclass(frozen=True)
class SiteHeader:
    """What a site is called and where on the globe its road begins.

    Attributes:
        name: of the site.
        seed: of road and ground, and of everything that has no seed of its own.
        latitude_deg, longitude_deg, height_m: WGS-84 of the road's start.
    """

    name: str
    seed: int = 1
    latitude_deg: float = 42.0
    longitude_deg: float = -71.0
    height_m: float = 30.0


@dataclass(frozen=True)
class ArrayConfig:
    """An even array across the vehicle.

    Attributes:
        channels, pitch_m: how many antennas, and how far apart.
        x_m: ahead of the rear axle. height_m: above the ground at rest.
        scan_rate_hz: scans a second; the channels are switched one after another within a scan.
    """

    channels: int = 11
    pitch_m: float = 0.127
    x_m: float = 3.0
    height_m: float = 0.3
    scan_rate_hz: float = 126.0

    @property
    def geometry(self) -> ArrayGeometry:
        """Where the antennas are."""
        period_s = 1.0 / self.scan_rate_hz
        return uniform_array(self.channels, self.pitch_m, x_m=self.x_m, height_m=self.height_m, scan_period_s=period_s)


@dataclass(frozen=True)
class SiteDrive:
    """One drive of a site.

    Attributes:
        day_name: the site file's word for the day.
        seed: of driving, navigation errors and faults.
        other_ground: seed of the ground that lies under the road instead of the site's, or None.
    """

    name: str
    day_name: str
    day: Day
    seed: int
    plan: DrivePlan
    navigation: NavigationErrors
    faults: ReceiverFaults
    other_ground: int | None = None


@dataclass(frozen=True)
class Site:
    """A road, the ground below it, a radar, and drives.

    Attributes:
        sweeps: what a stepped-frequency radar measures; None for a radar that records traces.
    """

    header: SiteHeader
    ground: GroundConfig
    road: RoadConfig
    radar: RadarConfig
    sweeps: SweepPlan | None
    array: ArrayConfig
    drives: tuple[SiteDrive, ...]

    @property
    def frame(self) -> LocalFrame:
        """The road's start on the globe."""
        return LocalFrame(self.header.latitude_deg, self.header.longitude_deg, self.header.height_m)


class SiteScene(NamedTuple):
    """What all drives of a site share."""

    site: Site
    road: Road
    ground: Ground


def prepare_site(site: Site) -> SiteScene:
    """Draws road and ground.

    Raises:
        ValueError: a road that cannot be.
    """
    return SiteScene(site, make_road(site.header.seed, site.road), make_ground(site.header.seed, site.ground))


def plan_drive(scene: SiteScene, drive: SiteDrive) -> SimulatedDrive:
    """Everything of a drive but its recording.

    Raises:
        ValueError: a plan that cannot be driven there, or that hears beyond the corridor's edge.
    """
    site, other = scene.site, drive.other_ground
    return simulate_drive(
        scene.ground if other is None else make_ground(other, site.ground),
        drive.plan,
        drive.day,
        drive.seed,
        road=scene.road,
        array=site.array.geometry,
        errors=drive.navigation,
        faults=drive.faults,
        radar=site.radar,
    )


# What a site file may say: closed ranges of every number, in the units of the dataclasses' fields.
#
# The ranges are those in which the models hold (refraction is solved for indices of 1.5 to 5), or else what no radar,
# road or vehicle exceeds.

Limits = dict[str, tuple[float, float]]

ASCENDING = frozenset(
    {
        *("stone_depth_m", "wavelength_m", "arc_length_m", "grade_wavelength_m", "bank_wavelength_m"),
        *("roughness_wavelength_m", "band_mhz", "clutter_depth_m", "along_m", "cross_m"),
        *("wander_wavelength_m", "bounce_wavelength_m", "outages_s", "slips_s"),
    }
)
"""Fields that are, or are lists of, [from, to]."""

_SEED = (0.0, 2.0**31 - 1)
_SHARE = (0.0, 1.0)
_ANGLE_RAD = (0.0, math.radians(20))
_TIME_S = (0.0, 1e6)
_PER_HOUR = (0.0, 1e5)

LIMITS: dict[type, Limits] = {
    SiteHeader: {
        "seed": _SEED,
        "latitude_deg": (-85.0, 85.0),
        "longitude_deg": (-180.0, 180.0),
        "height_m": (-500.0, 9000.0),
    },
    ArrayConfig: {
        "channels": (1, 64),
        "pitch_m": (0.01, 2.0),
        "x_m": (-10.0, 10.0),
        "height_m": (0.1, 2.0),
        "scan_rate_hz": (1.0, 1e4),
    },
    GroundConfig: {
        "length_m": (1.0, 1e5),
        "margin_m": (0.0, 1e3),
        "half_width_m": (2.1, 20.0),
        "stones_per_m2": (0.0, 200.0),
        "stone_depth_m": (0.01, 10.0),
        "stone_depth_scale_m": (0.05, 1e3),
        "stone_strength_m": (0.0, 1.0),
        "stone_strength_spread": (0.0, 3.0),
        "layer_depth_m": (0.05, 10.0),
        "layer_relief_m": (0.0, 1.0),
        "layer_reflectivity": (0.0, 0.5),
        "wavelength_m": (0.05, 1e3),
        "waves": (1, 200),
        "trees_per_100m": (0.0, 100.0),
        "utilities_per_100m": (0.0, 100.0),
        "utilities_along": (0, 20),
        "moisture_rms": (0.0, 0.2),
        "velocity_m_per_ns": (0.06, 0.2),
        "attenuation_per_m": (0.0, 10.0),
        "dispersive_share": _SHARE,
        "repeat_m": (0.1, 1e3),
    },
    RoadConfig: {
        "heading_deg": (0.0, 360.0),
        "arcs": (-1.0, 1e5),
        "curvature_rms_per_m": (0.0, 0.1),
        "arc_length_m": (1.0, 1e4),
        "min_radius_m": (10.0, 1e6),
        "transition_m": (0.5, 1e3),
        "grade_rms": (0.0, 0.2),
        "grade_wavelength_m": (10.0, 1e5),
        "bank_rms_rad": (0.0, 0.2),
        "bank_wavelength_m": (10.0, 1e5),
        "roughness_rms_m": (0.0, 0.05),
        "roughness_wavelength_m": (0.05, 100.0),
    },
    RadarConfig: {
        "samples": (32, 4096),
        "sample_step_ns": (0.01, 2.0),
        "time_zero_ns": (0.0, 50.0),
        "band_mhz": (10.0, 5e3),
        "band_edge_mhz": (1.0, 2e3),
        "tail_ns": (0.0, 100.0),
        "aperture_m": (0.5, 5.0),
    },
    SweepPlan: {
        "first_mhz": (10.0, 5e3),
        "step_mhz": (0.1, 100.0),
        "steps": (8, 2001),
        "adc_bits": (6, 24),
        "full_scale_field": (1e-3, 1e3),
        "calibration_gain": (1e-3, 10.0),
        "calibration_delay_ns": (0.0, 100.0),
        "ripple": (0.0, 1.0),
    },
    Day: {
        "seed": _SEED,
        "noise_field": (0.0, 1.0),
        "gain_spread": (0.0, 0.3),
        "delay_spread_ns": (0.0, 2.0),
        "coupling_spread": (0.0, 0.5),
        "velocity_factor": (0.8, 1.25),
        "velocity_spread": (0.0, 0.05),
        "attenuation_factor": (0.0, 20.0),
        "moisture_rms": (0.0, 0.1),
        "clutter_per_m2": (0.0, 200.0),
        "clutter_depth_m": (0.01, 10.0),
        "clutter_strength_m": (0.0, 1.0),
        "moved_share": _SHARE,
        "moved_depth_m": (0.0, 10.0),
    },
    Cover: {
        "thickness_m": (0.0, 1.0),
        "relief_m": (0.0, 0.3),
        "index": (1.0, 2.5),
        "attenuation_per_m": (0.0, 20.0),
        "lift": _SHARE,
        "reflectivity": (-0.9, 0.9),
    },
    Skin: {
        "thickness_m": (0.05, 2.0),
        "relief_m": (0.0, 0.3),
        "slowness": (-0.4, 0.5),
        "reflectivity": (-0.5, 0.5),
    },
    Trench: {"along_m": (-1e3, 1e5), "cross_m": (-20.0, 20.0), "depth_m": (0.1, 10.0)},
    DrivePlan: {
        "start_m": (-1e3, 1e5),
        "stop_m": (-1e3, 1e5),
        "direction": (-1, 1),
        "speed_mps": (0.05, 60.0),
        "lane_m": (-20.0, 20.0),
        "wander_m": (0.0, 1.0),
        "wander_wavelength_m": (1.0, 1e4),
        "height_sigma_m": (0.0, 0.05),
        "roll_sigma_rad": (0.0, math.radians(5)),
        "bounce_wavelength_m": (0.5, 1e4),
    },
    NavigationErrors: {
        "rate_hz": (0.5, 1e4),
        "position_sigma_m": (0.0, 100.0),
        "position_bias_m": (-100.0, 100.0),
        "height_sigma_m": (0.0, 100.0),
        "heading_sigma_rad": _ANGLE_RAD,
        "roll_sigma_rad": _ANGLE_RAD,
        "correlation_s": (0.01, 1e5),
        "odometer_scale_error": (-0.5, 0.5),
        "odometer_noise_m": (0.0, 1.0),
        "odometer_rate_hz": (0.5, 1e4),
        "jump_start_s": _TIME_S,
        "jumps_per_hour": _PER_HOUR,
        "jump_held_s": _TIME_S,
        "jump_sigma_m": (0.0, 100.0),
        "jump_sigma_factor": (0.0, 100.0),
        "outages_s": _TIME_S,
        "outages_per_hour": _PER_HOUR,
        "outage_held_s": _TIME_S,
        "velocity_walk": (0.0, 1.0),
        "heading_walk": (0.0, 0.1),
        "odometer_drift": (0.0, 0.5),
        "odometer_drift_s": (0.1, 1e5),
        "slips_s": _TIME_S,
        "slips_per_hour": _PER_HOUR,
        "slip_held_s": _TIME_S,
        "slip_fraction": (-1.0, 5.0),
        "odometer_step_m": (0.0, 1.0),
    },
    ReceiverFaults: {
        "gain_drift": (-0.9, 10.0),
        "phase_drift_rad": (-2 * math.pi, 2 * math.pi),
        "dropped_share": (0.0, 0.5),
        "clipped_share": _SHARE,
        "interference_share": _SHARE,
        "interference_field": (0.0, 10.0),
        "dead_channels": (0, 63),
    },
}


# Tables of a site file as frozen dataclasses: every key, type and range is checked, each error is one line.

Config = TypeVar("Config")


@dataclass(frozen=True)
class TableKey:
    """Where in which file a value stands: ``drive[2].lane_m``."""

    file: Path
    path: str = ""

    def at(self, key: str) -> "TableKey":
        """A key of the table here."""
        return TableKey(self.file, f"{self.path}.{key}" if self.path else key)

    def refuse(self, expected: str, found: str) -> InputError:
        """The error to raise."""
        return InputError(self.file, self.path or "file", expected, found)


def fill_config(
    kind: type[Config],
    place: TableKey,
    table: object,
    *,
    base: Config | None = None,
    elsewhere: Iterable[str] = (),
    withheld: Mapping[str, str] | None = None,
) -> Config:
    """A dataclass from a table.

    Args:
        table: as TOML gives it. An angle whose field ends in ``_rad`` may be given in degrees, ending in ``_deg``.
        base: what the keys that are not there keep; None: the dataclass's defaults.
        elsewhere: keys of this table that are not the dataclass's and are read by the caller.
        withheld: fields that a site file does not set here, and where they come from.

    Raises:
        InputError: no table, a key that is unknown or missing, a type or a range that is wrong.
    """
    entries, withheld = as_table(place, table), withheld or {}
    hints = get_type_hints(kind)
    known = [f.name for f in fields(kind) if f.name not in withheld]  # type: ignore[arg-type]
    refuse_unknown(place, entries, [*known, *elsewhere, *(_degrees(name) for name in known)], withheld)
    values: dict[str, Any] = {}
    for name in known:
        given = [key for key in dict.fromkeys((name, _degrees(name))) if key in entries and key not in elsewhere]
        if len(given) > 1:
            raise place.at(given[1]).refuse(f"{given[0]} or {given[1]}", "both")
        for key in given:
            inner = None if base is None else getattr(base, name)
            scale = 1.0 if key == name else math.pi / 180
            values[name] = _convert(hints[name], place.at(key), entries[key], kind, name, inner, scale)
    if base is not None:
        return replace(base, **values)  # type: ignore[type-var]
    for f in fields(kind):  # type: ignore[arg-type]
        if f.name in known and f.name not in values and f.default is MISSING:
            raise place.at(f.name).refuse("a value", "none")
    return kind(**values)


def as_table(place: TableKey, value: object) -> dict[str, Any]:
    """The value, which must be a table.

    Raises:
        InputError: it is not.
    """
    if not isinstance(value, dict):
        raise place.refuse("a table", _say(value))
    return value


def refuse_unknown(
    place: TableKey, table: Mapping[str, object], known: Iterable[str], withheld: Mapping[str, str] | None = None
) -> None:
    """Raises ``InputError`` for the first key that is not known; names the nearest one that is."""
    names = list(dict.fromkeys(known))
    for key in table:
        if key in names:
            continue
        if withheld and key in withheld:
            raise place.at(key).refuse(withheld[key], "this key")
        raise place.at(key).refuse(nearest(key, names, "a key"), "an unknown key")


def nearest(name: str, known: Iterable[str], what: str) -> str:
    """What was expected instead of an unknown name: the close one, or all there are."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, 1, 0.6)
    return f"{what}, perhaps {close[0]}" if close else f"{what} among {', '.join(names) or 'none'}"


def _degrees(name: str) -> str:
    return name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name


def _convert(hint: Any, place: TableKey, value: object, kind: type, name: str, base: object, scale: float) -> Any:
    """A value of the type that the hint says; a pair or list of numbers is held to its limits number by number."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (types.UnionType, Union):  # X | None: TOML has no None
        return _convert(next(i for i in inner if i is not types.NoneType), place, value, kind, name, base, scale)
    if is_dataclass(hint):
        return fill_config(hint, place, value, base=base)  # type: ignore[arg-type]
    if origin is tuple:
        return _convert_tuple(inner, place, value, kind, name, scale)
    if hint is str:
        if not isinstance(value, str) or not value:
            raise place.refuse("a text", _say(value))
        return value
    whole = hint is int
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise place.refuse("a whole number" if whole else "a number", _say(value))
    low, high = LIMITS.get(kind, {}).get(name, (-math.inf, math.inf))
    number = value if whole else float(value) * scale
    if not (math.isfinite(number) and low <= number <= high):
        raise place.refuse(_between(low / scale, high / scale), _say(value))
    return number


def _convert_tuple(
    inner: tuple[Any, ...], place: TableKey, value: object, kind: type, name: str, scale: float
) -> tuple[Any, ...]:
    many = inner[-1] is Ellipsis
    due = "a list" if many else f"a list of {len(inner)}"
    if not isinstance(value, list) or (not many and len(value) != len(inner)):
        raise place.refuse(due, _say(value))
    items = tuple(
        _convert(inner[0], TableKey(place.file, f"{place.path}[{number}]"), item, kind, name, None, scale)
        for number, item in enumerate(value, 1)
    )
    if name in ASCENDING and not many and not items[0] < items[1]:
        raise place.refuse("[from, to] with from before to", _say(value))
    return items


def _between(low: float, high: float) -> str:
    if math.isinf(high):
        return "a finite number" if math.isinf(low) else f"{low:.6g} or more"
    return f"{low:.6g} to {high:.6g}"


def _say(value: object) -> str:
    text = repr(value) if not isinstance(value, dict) else "a table"
    return text if len(text) <= 60 else f"{text[:57]}..."
