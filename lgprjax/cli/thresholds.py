"""``lgprjax thresholds``: what a fix must reach, found on one's own drives."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, progress_bar
from lgprjax.cli.search_options import check_region, check_search
from lgprjax.errors import InputError


@dataclass(frozen=True)
class ThresholdsVerb:
    """Calibrate the thresholds of fixes on drives whose places are known.

    Every drive is matched at its own place, and led to other places of the same map, where no match can be right. The
    thresholds let a match of the second kind pass with the probability asked for; the scale of the sigmas makes the
    errors of the first kind what their covariances say. Use them on other drives than these: register --thresholds.
    """

    map: Annotated[Positional[Path], arg(metavar="MAP", help="subsurface database, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs over its ground")]
    output: Annotated[Path, arg(aliases=["-o"], help="X.thresholds.toml")]
    window_m: float
    """length of the windows in metres, 0 for single scans; thresholds hold for one length, which register then needs"""
    search_m: float = 2.5
    """search this far to each side of the position in the log, in metres"""
    time_scale: float | Literal["auto"] = "auto"
    """as for register"""
    risk: float = 1e-4
    """probability that a match with ground that is not there passes"""
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Calibrate."""
        from lgprjax.archive import thresholds_from, try_drives
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import DriveLog, MapFile, write_thresholds
        from lgprjax.registration import RegisterOptions, squared_errors

        require_files(self.drives, "drives")
        check_search(self.search_m, self.window_m, self.time_scale, self.risk)
        for output in (self.output, self.json):
            if output is not None and output.exists() and not self.force:
                raise InputError(output, "output", "a new file, or --force", "the file exists")
        options = RegisterOptions(
            search_m=self.search_m,
            window_m=self.window_m,
            time_scale=None if self.time_scale == "auto" else float(self.time_scale),
        )
        with ExitStack() as opened:
            source = opened.enter_context(MapFile.open(self.map))
            check_region(self.search_m, source)
            logs = [opened.enter_context(DriveLog.open(path)) for path in self.drives]
            scans = sum(log.scans for log in logs)
            with progress_bar("matching, at true places and at false ones", 2 * scans) as told:
                trials = try_drives(source, logs, options, told)
        try:
            found = thresholds_from(trials, self.risk)
        except ValueError as error:
            raise InputError(self.map, "drives", "drives that tell enough", str(error)) from None
        right = trials.true.right
        strength, lead = (values / trials.true.scatter for values in (trials.true.strength, trials.true.margin))
        passed = right & (strength >= found.strength_by_chance) & (lead >= found.margin_by_chance)
        nees = squared_errors(trials.true, float(found.sigma_scale))[right]
        figures = {
            "matches": len(right),
            "right": int(right.sum()),
            "pass": float(np.sum(passed) / max(int(right.sum()), 1)),
            "false": len(trials.false.strength),
            "highest_false_strength": float(np.max(trials.false.strength / trials.false.scatter)),
            "highest_false_lead": float(np.max(trials.false.margin / trials.false.scatter)),
            "errors_within_95": float(np.mean(nees <= 5.991)),
        }
        thresholds = {name: float(value) for name, value in found._asdict().items()}
        names = ", ".join(path.name for path in self.drives)
        write_thresholds(
            self.output,
            thresholds,
            window_m=self.window_m,
            search_m=self.search_m,
            found_on={"map": self.map.name, "drives": names, "risk": self.risk, **figures},
            force=self.force,
        )
        if self.json is not None:
            write_figures(self.json, {"thresholds": thresholds, **figures}, force=self.force)
        console.print(
            f"score >= {found.strength_by_chance:.2f} and lead >= {found.margin_by_chance:.2f} noise floors; sigmas "
            f"times {found.sigma_scale:.2f}\n"
            f"right matches that pass: {figures['pass']:.1%} of {figures['right']}; highest of {figures['false']} "
            f"false ones: score {figures['highest_false_strength']:.2f}, lead {figures['highest_false_lead']:.2f}\n"
            f"thresholds: {self.output}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
