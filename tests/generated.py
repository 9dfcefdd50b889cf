"""The generated site of the tests: drives, map and registrations, made once a session in float32 as shipped."""

from pathlib import Path
from typing import NamedTuple

from lgprjax.archive import RegisteredDrive, build_map, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.registration import RegisterOptions
from lgprjax.simulation import demo_site, write_drives


class Site(NamedTuple):
    """Files of one generated site."""

    folder: Path
    logs: dict[str, Path]
    map: Path


def make_site(folder: Path, seed: int, length_m: float) -> Site:
    """Render the drives of a site and build its map."""
    logs = write_drives(demo_site(seed, length_m), folder)
    database = folder / "site.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database)
    return Site(folder, logs, database)


def register_site(site: Site, name: str) -> RegisteredDrive:
    """Register one of the site's drives with the default thresholds, prior wrong by a metre."""
    with MapFile.open(site.map) as source, DriveLog.open(site.logs[name]) as log:
        return register_log(source, log, RegisterOptions(search_m=1.5))
