"""The drives of a site, planned all before the first is rendered, written one after another."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from lgprjax.errors import InputError
from lgprjax.scene import SimulatedDrive
from lgprjax.simulation.drives import write_drive
from lgprjax.simulation.site_plan import Site, SiteDrive, SiteScene, plan_drive, prepare_site


class PlannedDrive(NamedTuple):
    """What a drive will be.

    Attributes:
        drive: as the site says. scans: as many will be recorded. duration_s: from the first to the last.
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
        raise InputError(file, "road", "a road and ground that can be drawn", str(error)) from None
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
    """Where each drive goes.

    Raises:
        InputError: one of them exists (without ``force``), or the folder is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    paths = {entry.drive.name: folder / f"{entry.drive.name}.drive.h5" for entry in planned.drives}
    for path in paths.values():
        if path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "the file exists")
    return paths


def _plan(scene: SiteScene, drive: SiteDrive, file: Path, number: int) -> SimulatedDrive:
    try:
        return plan_drive(scene, drive)
    except ValueError as error:
        raise InputError(file, f"drive[{number}]", "a drive that road and ground can carry", str(error)) from None
