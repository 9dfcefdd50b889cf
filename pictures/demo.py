"""Data of the demonstration's site, made once for all pictures that show them."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.batch import FixExample, RegisteredDrive, fix_example, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.recordings.drives import gnss_gaps
from lgprjax.registration import RegisterOptions
from lgprjax.report import DriveResult
from lgprjax.report.registered import drive_result
from lgprjax.simulation import plan_site, read_site, site_file, write_site

SITE = "village"
_WET = """
[day.wet]
like = "rain"
noise_field = 1.5e-3

[[drive]]
name = "wet"
seed = 5
day = "wet"
navigation = "town"
start_m = 20
stop_m = 34
lane_m = 0.2
"""


@dataclass(frozen=True)
class Located:
    """A drive of the site, located on its map.

    Attributes:
        log: path of the drive log.
        drive: the fixes.
        options: of the search.
        result: for the pictures of ``lgprjax.report``.
    """

    log: Path
    drive: RegisteredDrive
    options: RegisterOptions
    result: DriveResult


class DemoSite:
    """The site of ``lgprjax demo``: drives, map, fixes.

    Args:
        folder: for its files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._wet: dict[tuple[float, float | None], Located] = {}

    @cached_property
    def logs(self) -> dict[str, Path]:
        """The drive logs by name."""
        file = site_file(SITE)
        return dict(write_site(plan_site(read_site(file), file), self.folder, force=True))

    @cached_property
    def map(self) -> Path:
        """The map of both baselines."""
        path = self.folder / "site.map.h5"
        build_map([self.logs["baseline_left"], self.logs["baseline_right"]], path, force=True)
        return path

    @cached_property
    def live(self) -> Located:
        """The live drive."""
        return self._locate(self.logs["live"], RegisterOptions())

    @cached_property
    def impostor(self) -> Located:
        """The drive on other ground."""
        return self._locate(self.logs["impostor"], RegisterOptions())

    @cached_property
    def _wet_log(self) -> Path:
        """A short drive over the same ground on a wet day, with a noisy receiver."""
        text = site_file(SITE).read_text(encoding="utf-8")
        file = self.folder / "wet.toml"
        file.write_text(text[: text.index("[[drive]]")] + _WET, encoding="utf-8")
        return dict(write_site(plan_site(read_site(file), file), self.folder / "wet", force=True))["wet"]

    def wet(self, *, window_m: float, time_scale: float | None = None) -> Located:
        """The wet drive, with windows of one length."""
        if (window_m, time_scale) not in self._wet:
            options = RegisterOptions(window_m=window_m, time_scale=time_scale)
            self._wet[window_m, time_scale] = self._locate(self._wet_log, options)
        return self._wet[window_m, time_scale]

    def example(self, located: Located, scan: int, options: RegisterOptions | None = None) -> FixExample:
        """Strips of ground and score surface of one scan."""
        with MapFile.open(self.map) as source, DriveLog.open(located.log) as log:
            found = fix_example(source, log, located.drive, options or located.options, scan)
        assert found is not None
        return found

    def _locate(self, path: Path, options: RegisterOptions) -> Located:
        with MapFile.open(self.map) as source, DriveLog.open(path) as log:
            drive = register_log(source, log, options)
            impostor = drive.name == "impostor"
            result = drive_result(drive, source, impostor=impostor, gnss_gap=gnss_gaps(log))
        # Times vary from run to run.
        drive = replace(drive, milliseconds_per_scan=np.nan)
        return Located(path, drive, options, replace(result, milliseconds_per_scan=np.nan))


def errors_m(located: Located) -> Float[np.ndarray, " scan"]:
    """Distance of each fix from the true place."""
    result = located.result
    assert result.truth_east_m is not None
    assert result.truth_north_m is not None
    return np.asarray(np.hypot(result.east_m - result.truth_east_m, result.north_m - result.truth_north_m))
