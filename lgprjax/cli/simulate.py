"""``lgprjax simulate`` and ``lgprjax demo``: drive logs of a synthetic site, and the demonstration."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.terminal import console, counted, progress_bar, say, verdict, working
from lgprjax.files import make_folder

if TYPE_CHECKING:
    from lgprjax.simulation import PlannedSite


@dataclass(frozen=True)
class Simulate:
    """Generate drive logs of a synthetic site: road, ground, days and drives.

    The log stores the true position of every scan as /truth. The same file gives the same drives. lgprjax examples
    copies example sites; docs/scene.md describes the keys and the model. A file of kind "vehicle_drives", such as
    tuning/drives.toml, gives drives of a vehicle: calibrations, and drives along a course with radar.
    """

    site: Annotated[
        Positional[Path],
        arg(metavar="SITE", help="site file, drives file, or the name of an example site: village"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for NAME.drive.h5 of each drive")]
    only: Annotated[tuple[str, ...], arg(metavar="NAME...", help="write only these drives")] = ()
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Plan all drives, then render them."""
        from lgprjax.simulation import is_vehicle_plan, output_paths, plan_site, read_site, site_file, write_site

        file = site_file(self.site)
        if is_vehicle_plan(file):
            self._drive_vehicle(file)
            return
        site = read_site(file)
        with working(f"planning {file}"):
            planned = plan_site(site, file, self.only)
        output_paths(planned, self.output, force=self.force)
        scans = sum(entry.scans for entry in planned.drives)
        with progress_bar("rendering drives", scans) as progress:
            paths = write_site(planned, self.output, force=self.force, progress=progress)
        _print_written(planned, paths)
        first = next(iter(paths.values()))
        verdict(f"{counted(len(paths), 'drive log')} in {self.output}", f"map build {first} -o M.map.h5")

    def _drive_vehicle(self, file: Path) -> None:
        from lgprjax.simulation import read_vehicle_plan, write_vehicle_logs

        plan = read_vehicle_plan(file)
        with progress_bar("driving", len(self.only or plan.drives), "drives") as progress:
            paths = write_vehicle_logs(plan, self.output, only=self.only, force=self.force, progress=progress)
        title = f"vehicle {plan.serial_number or 'without serial number'}"
        table = Table("drive", "duration", "file size", title=title)
        for drive in plan.drives:
            if drive.name in paths:
                size = f"{paths[drive.name].stat().st_size / 1e6:.2f} MB"
                table.add_row(drive.name, f"{drive.manoeuvre.time_s[-1]:.1f} s", size)
        console.print(table)
        verdict(f"{counted(len(paths), 'drive log')} in {self.output}", f"check {next(iter(paths.values()))} --health")


def _print_written(planned: "PlannedSite", paths: dict[str, Path]) -> None:
    site = planned.scene.site
    what = "traces" if site.sweeps is None else "sweeps"
    title = f"{site.header.name}: {site.array.channels} channels of {what}, seed {site.header.seed}"
    table = Table("drive", "day", "scans", "length", "duration", "ground", "file size", title=title)
    for column in (2, 3, 4, 6):
        table.columns[column].justify = "right"
    for entry in planned.drives:
        drive = entry.drive
        ground = "site" if drive.other_ground is None else f"other, {drive.other_ground}"
        length, took = f"{entry.length_m:.1f} m", f"{entry.duration_s:.1f} s"
        size = f"{paths[drive.name].stat().st_size / 1e6:.1f} MB"
        table.add_row(drive.name, drive.day_name, str(entry.scans), length, took, ground, size)
    console.print(table)


# ``lgprjax demo``: the workflow on a synthetic site, with a report.

_INTRO = """Two drives over a simulated road, 0.3 m left and right of the centre line, make a map of the ground. A third
drive, on another day and 0.2 m to the left, is located on the map by radar; its GNSS position is wrong by a metre. A
fourth drive, the impostor, follows the same line over other ground, as on another road. None of its scans may be ok.

The ground is synthetic: stones and rough layers from a seed, rendered as 11 channels of 369 samples of one byte,
126 scans per second. The true positions are known, so every error below is an error against the truth."""


@dataclass(frozen=True)
class Demo:
    """Simulate a road, map it, locate a drive on the map, reject a drive over other ground; write a report."""

    output: Annotated[Path, arg(aliases=("-o",), metavar="DIR")] = Path("out/demo")
    """folder for drive logs, map, fixes and report; replaced if it exists"""

    def run(self) -> None:
        """Run the demonstration."""
        from lgprjax.cli.register import register_all
        from lgprjax.mapping import build_map
        from lgprjax.registration import RegisterOptions
        from lgprjax.report import summary_table
        from lgprjax.report.registered import write_page
        from lgprjax.simulation import plan_site, read_site, site_file, write_site

        make_folder(self.output)
        file = site_file("village")
        planned = plan_site(read_site(file), file)
        scans = {entry.drive.name: entry.scans for entry in planned.drives}
        with progress_bar("rendering drives", sum(scans.values())) as progress:
            logs = write_site(planned, self.output, force=True, progress=progress)
        baselines = [logs["baseline_left"], logs["baseline_right"]]
        database = self.output / "site.map.h5"
        with progress_bar("building map", scans["baseline_left"] + scans["baseline_right"]) as progress:
            build_map(baselines, database, force=True, progress=progress, stage=progress.stage)
        options = RegisterOptions()
        drives = [logs["live"], logs["impostor"]]
        results = register_all(database, drives, self.output, options, force=True, impostors=("impostor",))
        page = write_page(results, self.output, "lgprjax: a drive located by radar scans of the ground", intro=_INTRO)
        console.print(summary_table([summary for _, summary, _ in results]))
        say(f"report: {page.resolve()}")
        shares = ", ".join(
            f"{summary.name} {100.0 * (summary.ok_fraction or 0.0):.1f} % ok" for _, summary, _ in results
        )
        verdict(f"{shares} (impostor: other ground)", f"map info {database}")
