"""``lgprjax demo``: the story so far on a generated site, with a report."""

from dataclasses import dataclass
from pathlib import Path

from lgprjax.cli.progress import console, progress_bar

_INTRO = """Two drives over a generated road, 0.3 m to the left and right of its middle, make a map of the ground.
A third drive, on another day and 0.2 m to the left, is located against it from radar alone; its GNSS is wrong by a
metre. A fourth drive follows the same line over other ground, as if the map were of another road: none of its scans
may be called ok.

The ground is synthetic: stones and rough layers from a seed, rendered as 11 channels of 369 samples of one byte,
126 scans a second. Positions are known exactly, so every error below is against the truth."""


@dataclass(frozen=True)
class Demo:
    """Generate a site, map it, locate a drive on it, refuse an impostor road; write a report."""

    output: Path = Path("out/demo")
    """folder for drive logs, map, fixes and report; replaced if it is there"""

    def run(self) -> None:
        """Run the story."""
        from lgprjax.archive import build_map
        from lgprjax.cli.register import register_all, write_page
        from lgprjax.registration import RegisterOptions
        from lgprjax.report import summary_table
        from lgprjax.simulation import demo_site, write_drives

        self.output.mkdir(parents=True, exist_ok=True)
        site = demo_site()
        scans = sum(len(drive.scan_time_s) for drive in site.values())
        with progress_bar("rendering drives", scans) as progress:
            logs = write_drives(site, self.output, force=True, progress=progress)
        baselines = [logs["baseline_left"], logs["baseline_right"]]
        database = self.output / "site.map.h5"
        scans = sum(len(site[name].scan_time_s) for name in ("baseline_left", "baseline_right"))
        with progress_bar("building map", scans) as progress:
            build_map(baselines, database, force=True, progress=progress, stage=progress.stage)
        options = RegisterOptions()
        drives = [logs["live"], logs["impostor"]]
        results = register_all(database, drives, self.output, options, force=True, impostors=("impostor",))
        page = write_page(
            results, self.output, "lgprjax: a drive located by the ground", force=True, options=options, intro=_INTRO
        )
        console.print(summary_table([summary for _, summary, _ in results]))
        console.print(f"report: {page.resolve()}", highlight=False, markup=False, soft_wrap=True)
