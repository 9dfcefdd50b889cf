"""``lgprjax import grounded|cmu|gprmax``: published data sets and simulations to drive logs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.import_parts import Force, Origin, Output, finished
from lgprjax.cli.progress import working


@dataclass(frozen=True)
class ImportGrounded:
    """A run in the layout in which users of the GROUNDED data set work: run.npy and run_UTM_point.npy."""

    run_dir: Annotated[
        Positional[Path],
        arg(
            metavar="RUN_DIR",
            help="folder that holds run.npy [scan, sample, channel] and run_UTM_point.npy [scan, channel, 2]",
        ),
    ]
    output: Output
    utm_zone: str
    """UTM zone of the points, such as 19N"""
    sample_interval_ns: float
    """two-way travel time between samples"""
    scan_rate_hz: float
    """scans a second"""
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import import_grounded

        with working(f"importing {self.run_dir}"):
            import_grounded(
                self.run_dir,
                utm_zone=self.utm_zone,
                sample_interval_ns=self.sample_interval_ns,
                scan_rate_hz=self.scan_rate_hz,
                output=self.output,
                force=self.force,
            )
        finished(self.output)


@dataclass(frozen=True)
class ImportCmu:
    """A sequence of the CMU-GPR data set: gpr_meas.csv, we_odom.csv and, where there is one, ts_meas.csv.

    The sequences have no latitude and longitude: the total station's origin is put at the site's origin, its x axis
    along the heading. A sequence without total station drives straight along the heading by its odometry.
    """

    sequence_dir: Annotated[Positional[Path], arg(metavar="SEQUENCE_DIR", help="folder that holds the CSV files")]
    output: Output
    time_window_ns: float
    """two-way travel time that a trace spans (the data set does not publish it)"""
    time_zero_ns: float = 0.0
    """how long after the first sample time zero lies"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import import_cmu

        with working(f"importing {self.sequence_dir}"):
            import_cmu(
                self.sequence_dir,
                time_window_ns=self.time_window_ns,
                time_zero_ns=self.time_zero_ns,
                place=self.origin.place(),
                output=self.output,
                force=self.force,
            )
        finished(self.output)


@dataclass(frozen=True)
class ImportGprMax:
    """gprMax results: the .out (version 3) or .h5 (version 4) files of one B-scan, or one merged file.

    Single-trace files are taken in the order of their numbers, each midway between its source and receiver. A merged
    file has lost its positions: say --step-m. The simulation's picoseconds are resampled without aliases.
    """

    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILE...", help="the traces, or one merged B-scan")]
    output: Output
    component: str | None = None
    """field component, such as Ez; without it Ez, or the only one in the files"""
    receiver: int = 1
    """number of the receiver"""
    sample_interval_ns: float | None = None
    """interval to resample to; without it the coarsest that keeps 99.99 % of the energy"""
    time_zero_ns: float = 0.0
    """time of the simulation that counts as zero, such as the delay of the source's pulse"""
    start_m: float = 0.0
    """position of the first trace of a merged file, from the site's origin"""
    step_m: float | None = None
    """distance between the traces of a merged file"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        require_files(self.files, "traces")
        from lgprjax.formats import import_gprmax

        with working(f"importing {len(self.files)} file(s)"):
            import_gprmax(
                self.files,
                component=self.component,
                receiver=self.receiver,
                sample_interval_ns=self.sample_interval_ns,
                time_zero_ns=self.time_zero_ns,
                start_m=self.start_m,
                step_m=self.step_m,
                place=self.origin.place(),
                output=self.output,
                force=self.force,
            )
        finished(self.output)
