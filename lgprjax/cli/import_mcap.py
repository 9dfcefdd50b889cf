"""``lgprjax import mcap``: a recording of ROS 2 messages to a drive log."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError
from lgprjax.cli.import_parts import Force, Output, finished
from lgprjax.cli.progress import console, working


@dataclass(frozen=True)
class ImportMcap:
    """A recording of ROS 2 messages, .mcap (needs: pip install lgprjax[log]).

    Scans come from messages RadarScan, positions from NavSatFix, headings from an Imu with orientation or a
    PoseWithCovarianceStamped, travel from Odometry; docs/transfer.md has their definitions. Topics are found by their
    types. A file that a killed recorder left is read as far as it is whole.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    radar_topic: str | None = None
    """topic of the scans, where there are several"""
    array_topic: str | None = None
    """topic of the message RadarArray, where there are several"""
    gnss_topic: str | None = None
    """topic of the positions, where there are several"""
    heading_topic: str | None = None
    """topic of the headings; one of Odometry only counts where it is named, and must count from east"""
    odometry_topic: str | None = None
    """topic of the odometer, where there are several"""
    channel_pitch_m: float | None = None
    """distance between neighbouring channels of an array that no message describes"""
    array_x_m: float | None = None
    """how far ahead of the rear axle that array is"""
    array_height_m: float | None = None
    """how high above the ground that array is"""
    gnss_m: Annotated[tuple[float, float, float], arg(metavar="X Y Z")] = (0.0, 0.0, 0.0)
    """place of the GNSS antenna: ahead and to the left of the rear axle, above the ground"""
    gnss_sigma_m: float | None = None
    """sigma of positions whose messages do not tell their covariance"""
    heading_sigma_deg: float | None = None
    """sigma of headings whose messages do not tell their covariance"""
    force: Force = False

    def run(self) -> None:
        """Import."""
        for name in ("channel_pitch_m", "gnss_sigma_m", "heading_sigma_deg"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < 1e3:
                raise UsageError(f"--{name.replace('_', '-')}: expected a number above zero, found {value:g}")
        from lgprjax.formats import McapAssumed, McapTopics, UniformArray, import_mcap

        told = (self.channel_pitch_m, self.array_x_m, self.array_height_m)
        array = UniformArray(self.channel_pitch_m, self.array_x_m or 0.0, self.array_height_m or 0.0)
        with working(f"importing {self.file}"):
            imported = import_mcap(
                self.file,
                topics=McapTopics(
                    self.radar_topic, self.array_topic, self.gnss_topic, self.heading_topic, self.odometry_topic
                ),
                array=None if told == (None, None, None) else array,
                assumed=McapAssumed(self.gnss_m, self.gnss_sigma_m, self.heading_sigma_deg),
                output=self.output,
                force=self.force,
            )
        finished(self.output)
        for note in imported.notes:
            console.print(note, highlight=False, markup=False, soft_wrap=True)
