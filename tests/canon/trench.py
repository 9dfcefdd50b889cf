"""A generated road that is dug up and filled again between a map's drives and later ones."""

from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from canon.map import of_many_grounds
from lgprjax.formats import DriveLog, DriveWriter
from lgprjax.formats.store import write_attribute
from lgprjax.mapping import build_map
from lgprjax.scene import (
    Day,
    DrivePlan,
    Ground,
    GroundConfig,
    NavigationErrors,
    SimulatedDrive,
    Trench,
    ground_on,
    make_ground,
    simulate_drive,
)
from lgprjax.simulation.drives import write_drive

_RTK = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=float(np.radians(0.1)))
_USUAL = NavigationErrors(position_bias_m=(0.5, -0.4))


class TrenchSite(NamedTuple):
    """Files of the site.

    Attributes:
        map: of two drives before the works, dated 2025-06.
        newer: drives after them, dated 2026-03, -04 and so on, GNSS wrong by 0.64 m.
        elsewhere: a drive like those over other ground.
        live: after the works, to be located.
        trench_m: along the road (east of the map's origin, which is the start of the road).
    """

    map: Path
    newer: tuple[Path, ...]
    elsewhere: Path
    live: Path
    trench_m: tuple[float, float]


def parts(site: TrenchSite, east_m: np.ndarray, room_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """What lies well inside the trench, and well outside: near its rims a scan hears both."""
    low, high = site.trench_m
    inside = (east_m > low + room_m) & (east_m < high - room_m)
    return inside, (east_m < low - room_m) | (east_m > high + room_m)


def dated(path: Path, day: str) -> Path:
    """The drive, recorded on another day."""
    with h5py.File(path, "r+") as store:
        del store.attrs["t0_utc"]
        write_attribute(store, "t0_utc", f"{day}T09:00:00+00:00")
    return path


def make_trench_site(
    folder: Path, seed: int, length_m: float, trench_m: tuple[float, float], *, depth_m: float = 2.0, newer: int = 2
) -> TrenchSite:
    """Render the drives and build the map.

    Args:
        folder: for the files.
        seed: of everything.
        length_m: of the drives.
        trench_m: from and to along the road, across its whole width.
        depth_m: of the works; deeper ground stays.
        newer: drives after the works, three at most.
    """
    config = GroundConfig(length_m=length_m + 4.0)
    ground = make_ground(seed, config)
    dug = _dug(ground, trench_m, depth_m, seed)
    elsewhere = make_ground(seed + 1000, config)

    def drive(name: str, on: Ground, date: str, number: int, lane_m: float, errors: NavigationErrors) -> Path:
        plan = DrivePlan(0.0, length_m, lane_m=lane_m)
        simulated = simulate_drive(on, plan, Day(seed=100 * seed + number), number, errors=errors)
        if on is dug:
            simulated = _without_layers(simulated, trench_m, depth_m)
        path = folder / f"{name}.drive.h5"
        write_drive(path, simulated)
        return dated(path, date)

    old = [
        drive("left", ground, "2025-06-01", 1, 0.3, _RTK),
        drive("right", ground, "2025-06-01", 2, -0.3, _RTK),
    ]
    build_map(old, folder / "road.map.h5", measure=of_many_grounds)
    for number, lane_m in ((1, 0.1), (2, -0.1), (3, 0.0))[:newer]:
        drive(f"newer{number}", dug, f"2026-0{number + 2}-01", 2 + number, lane_m, _USUAL)
    drive("elsewhere", elsewhere, "2026-04-20", 8, 0.0, _USUAL)
    drive("live", dug, "2026-06-01", 9, 0.05, NavigationErrors(position_bias_m=(0.8, 0.6)))
    return trench_site_in(folder, trench_m)


def trench_site_in(folder: Path, trench_m: tuple[float, float]) -> TrenchSite:
    """Site that ``make_trench_site`` wrote."""
    return TrenchSite(
        map=folder / "road.map.h5",
        newer=tuple(sorted(folder.glob("newer?.drive.h5"))),
        elsewhere=folder / "elsewhere.drive.h5",
        live=folder / "live.drive.h5",
        trench_m=trench_m,
    )


def first_scans(path: Path, target: Path, scans: int) -> Path:
    """The first scans of a drive as a drive of its own."""
    with DriveLog.open(path) as log:
        traces, _ = log.read_traces(0, scans)
        with DriveWriter.create(target, log.description, channels=log.channels, dtype=np.uint8) as writer:
            writer.append(log.scan_time_s[:scans], (traces + 128).astype(np.uint8))
    return target


def _dug(ground: Ground, trench_m: tuple[float, float], depth_m: float, seed: int) -> Ground:
    """The ground with other stones in the trench, the same on every later day."""
    works = Day(seed=seed, trenches=(Trench(trench_m, depth_m=depth_m),), clutter_per_m2=0.0)
    return ground_on(ground, works)[0]


def _without_layers(drive: SimulatedDrive, trench_m: tuple[float, float], depth_m: float) -> SimulatedDrive:
    """No layers of old in the trench; a day's own trench would be filled by that day's seed."""
    row = np.array([[*trench_m, -5.0, 5.0, depth_m]])
    return drive._replace(conditions=drive.conditions._replace(trenches=row))
