"""More drives over the ground of the canonical site, on days of every kind; the same road with ground that repeats."""

from dataclasses import replace
from pathlib import Path

from canon.map import of_many_grounds
from canon.site import Site
from lgprjax.mapping import build_map
from lgprjax.scene import WEATHER, Day, DrivePlan, NavigationErrors, simulate_drive
from lgprjax.simulation import read_site, site_file, write_drive
from lgprjax.simulation.site_tables import SiteScene, prepare_site

LENGTH_M = 40.0


def village(repeat_m: float | None = None) -> SiteScene:
    """Ground and road of the canonical site; the ground repeats itself after ``repeat_m``."""
    site = read_site(site_file("village"))
    ground = replace(site.ground, length_m=LENGTH_M, repeat_m=repeat_m)
    return prepare_site(replace(site, ground=ground, road=replace(site.road, length_m=LENGTH_M), drives=()))


def drive_over(
    scene: SiteScene,
    path: Path,
    day: Day,
    *,
    lane_m: float = 0.2,
    direction: int = 1,
    errors: NavigationErrors | None = None,
) -> Path:
    """Render a drive of 25 m, its GNSS wrong by a metre unless told otherwise."""
    plan = DrivePlan(5.0, LENGTH_M - 10.0, lane_m=lane_m, direction=direction)
    errors = NavigationErrors(position_bias_m=(0.8, 0.6)) if errors is None else errors
    geometry = scene.site.array.geometry
    drive = simulate_drive(scene.ground, plan, day, 3, road=scene.road, array=geometry, errors=errors)
    write_drive(path, drive)
    return path


def repeating_site(folder: Path, repeat_m: float) -> Site:
    """Map and live drive on ground that repeats itself."""
    scene, clear = village(repeat_m), WEATHER["clear"]
    survey = NavigationErrors(position_sigma_m=0.01)
    logs = {
        name: drive_over(scene, folder / f"{name}.drive.h5", clear(number), lane_m=lane_m, errors=survey)
        for number, (name, lane_m) in enumerate((("left", 0.3), ("right", -0.3)))
    }
    build_map(list(logs.values()), folder / "site.map.h5", measure=of_many_grounds)
    logs["live"] = drive_over(scene, folder / "live.drive.h5", clear(9))
    return Site(folder, logs, folder / "site.map.h5")
