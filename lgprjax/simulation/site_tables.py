"""A site and its drives as configuration, and each drive made from it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from lgprjax.config import DataclassTables, Limits
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
    """Name of a site, and the start of its road on the globe.

    Attributes:
        name: name of the site.
        seed: seed of road and ground, and of everything without its own seed.
        latitude_deg, longitude_deg, height_m: WGS-84 position of the road's start.
    """

    name: str
    seed: int = 1
    latitude_deg: float = 42.0
    longitude_deg: float = -71.0
    height_m: float = 30.0


@dataclass(frozen=True)
class ArrayConfig:
    """A uniform array across the vehicle.

    Attributes:
        channels, pitch_m: number and spacing of the antennas.
        x_m: distance ahead of the rear axle.
        height_m: height above the ground at rest.
        scan_rate_hz: scans per second; the channels are switched one after another within a scan.
    """

    channels: int = 11
    pitch_m: float = 0.127
    x_m: float = 3.0
    height_m: float = 0.3
    scan_rate_hz: float = 126.0

    @property
    def geometry(self) -> ArrayGeometry:
        """Positions and time offsets of the antennas."""
        period_s = 1.0 / self.scan_rate_hz
        return uniform_array(self.channels, self.pitch_m, x_m=self.x_m, height_m=self.height_m, scan_period_s=period_s)


@dataclass(frozen=True)
class SiteDrive:
    """One drive of a site.

    Attributes:
        day_name: name of the day in the site file.
        seed: seed of driving, navigation errors and faults.
        other_ground: seed of a ground under the road other than the site's; ``None``: the site's.
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
        sweeps: sweep plan of a stepped-frequency radar; ``None`` for a radar that records traces.
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
        """Local frame at the start of the road."""
        return LocalFrame(self.header.latitude_deg, self.header.longitude_deg, self.header.height_m)


class SiteScene(NamedTuple):
    """Common parts of all drives of a site."""

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
    """Simulate a drive without its recording.

    Raises:
        ValueError: the plan cannot be driven there, or an aperture extends beyond the corridor's edge.
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


# Valid contents of a site file: closed ranges of every number, in the units of the dataclasses' fields.
#
# The ranges are those in which the models hold (refraction is solved for indices of 1.5 to 5), or else what no radar,
# road or vehicle exceeds.

ASCENDING = frozenset(
    {
        *("stone_depth_m", "wavelength_m", "arc_length_m", "grade_wavelength_m", "bank_wavelength_m"),
        *("roughness_wavelength_m", "band_mhz", "clutter_depth_m", "moisture_wavelength_m", "along_m", "cross_m"),
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
        "moisture_wavelength_m": (0.05, 1e4),
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


fill_config = DataclassTables(LIMITS, rising=ASCENDING).fill
"""A dataclass from a table of a site file."""
