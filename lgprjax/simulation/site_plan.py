"""A site and its drives as configuration, and each drive made from it."""

from dataclasses import dataclass
from typing import NamedTuple

from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.scene import (
    Day,
    DrivePlan,
    Faults,
    Ground,
    GroundConfig,
    NavigationErrors,
    RadarConfig,
    Road,
    RoadConfig,
    SimulatedDrive,
    SweepPlan,
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
    faults: Faults
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
