"""``lgprjax export``: drives and their fixes for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError
from lgprjax.cli.progress import console, working

_SUFFIX = ".mcap"


@dataclass(frozen=True)
class Export:
    """Write a drive, and its fixes, as ROS 2 messages in an MCAP file (needs: pip install lgprjax[log]).

    ROS 2 tools and Foxglove read it: scans as recorded, GNSS/INS as NavSatFix and Imu, travel as Odometry, fixes that
    are ok as PoseWithCovarianceStamped in the map's frame and NavSatFix. lgprjax import mcap makes a drive log of it.
    """

    drive: Annotated[Positional[Path], arg(metavar="DRIVE", help="drive log, X.drive.h5")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.mcap", help="recording to write")]
    fixes: Annotated[Path | None, arg(metavar="X.fixes.h5")] = None
    """fixes of the drive, as lgprjax register wrote them"""
    force: bool = False
    """replace an output that exists"""

    def run(self) -> None:
        """Export."""
        if not self.output.name.endswith(_SUFFIX):
            raise UsageError(f"--output: expected a file name that ends in {_SUFFIX}, found {self.output.name!r}")
        from lgprjax.formats import export_mcap

        with working(f"writing {self.output}"):
            exported = export_mcap(self.drive, self.output, fixes=self.fixes, force=self.force)
        poses = "" if self.fixes is None else f", {exported.poses} fixes that are ok"
        self._say(f"wrote {self.output}: {exported.scans} scans{poses}")
        if exported.left_out:
            self._say(f"not in it, there are no messages for them: {', '.join(exported.left_out)}")

    def _say(self, line: str) -> None:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
