"""The site of ``sites/village.toml`` with a road of any length and ground of any seed."""

from dataclasses import replace

from lgprjax.scene import SimulatedDrive
from lgprjax.simulation import read_site, site_file
from lgprjax.simulation.site_tables import SiteDrive, plan_drive, prepare_site


def village_drives(seed: int = 1, length_m: float = 70.0) -> dict[str, SimulatedDrive]:
    """Its drives by name, before they are rendered; they end as far before the road's end as those of the file.

    Args:
        seed: of ground and days; 1 for those of the file.
        length_m: of the road.
    """
    site = read_site(site_file("village"))
    longer_m, other = length_m - site.ground.length_m, seed - site.header.seed

    def changed(drive: SiteDrive) -> SiteDrive:
        return replace(
            drive,
            plan=replace(drive.plan, stop_m=drive.plan.stop_m + longer_m),
            day=replace(drive.day, seed=drive.day.seed + 10 * other),
            other_ground=None if drive.other_ground is None else drive.other_ground + other,
        )

    site = replace(
        site,
        header=replace(site.header, seed=seed),
        ground=replace(site.ground, length_m=length_m),
        road=replace(site.road, length_m=length_m),
        drives=tuple(changed(drive) for drive in site.drives),
    )
    scene = prepare_site(site)
    return {drive.name: plan_drive(scene, drive) for drive in site.drives}
