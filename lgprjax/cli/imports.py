"""``lgprjax import FORMAT``: vendor files to drive logs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from tyro.conf import Positional, arg

from lgprjax.cli.terminal import UsageError, console, require_files, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import NavigationTrack, Survey, SurveyOrigin
    from lgprjax.radar.array import ArrayGeometry


# Common parts of the import verbs: the output, the site's origin, and the closing line.

Output = Annotated[Path, arg(aliases=["-o"], metavar="X.drive.h5", help="drive log to write")]
Force = Annotated[bool, arg(help="replace an output that exists")]


@dataclass(frozen=True)
class Origin:
    """Place of the recording on the earth."""

    latitude_deg: float = 0.0
    """latitude of the site's origin, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the site's origin, WGS-84"""
    heading_deg: float = 90.0
    """direction of the lines, clockwise from true north"""

    def place(self) -> "SurveyOrigin":
        """The origin for the importers."""
        from lgprjax.formats import SurveyOrigin

        return SurveyOrigin(self.latitude_deg, self.longitude_deg, self.heading_deg)


def print_survey(survey: "Survey") -> None:
    """Print a table of the findings on each line, in samples and metres."""
    head = (
        "line",
        "traces",
        "header",
        "break",
        "wave",
        "zero",
        "from",
        "sign",
        "direction",
        "from",
        "start",
        "from",
        "r",
    )
    rows = [
        (
            line.file,
            str(line.traces) if line.cut is None else line.cut,
            f"{line.time_zero_header:.2f}",
            _sample(line.first_break),
            _sample(line.direct_wave),
            f"{line.time_zero:.2f}",
            line.time_zero_from,
            {1: "+", -1: "-", 0: "?"}[line.sign] + (" inverted" if line.inverted else ""),
            "reversed" if line.reversed else "as stored",
            line.direction_from,
            f"{line.start_m:.2f} m",
            line.start_from,
            f"{line.correlation:.2f}",
        )
        for line in survey.lines
    ]
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    right = {1, 2, 3, 4, 5, 10, 12}
    for row in (head, *rows):
        cells = [
            text.rjust(width) if column in right else text.ljust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        ]
        _tell("  ".join(cells).rstrip())
    _tell(
        "header, break (the direct wave's first), wave (its strongest lobe) and zero (time zero) in samples; "
        f"r: correlation with the previous line; positions from: {survey.placed_by}"
    )
    for note in survey.notes:
        _tell(f"note: {note}")


def _tell(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def _sample(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def finished(output: Path) -> None:
    """Report what was written and where it is, and which quantities no instrument recorded."""
    from lgprjax.formats import DriveLog, assumed_in_words, assumed_of

    with DriveLog.open(output) as log:
        description = log.description
    assumed = assumed_of(description.provenance)
    if assumed:
        _tell(f"assumed, as no instrument recorded it: {assumed_in_words(assumed)}")
    if "time zero" in assumed:
        _tell("time zero was set to the first sample (see --time-zero-ns)")
    _tell(place_in_words(description.navigation, description.array, known="place on the earth" not in assumed))
    _tell(f"wrote {output}")
    if "place on the earth" in assumed:
        _tell("the site's origin was set to latitude 0, longitude 0 (see --latitude-deg)")


def place_in_words(navigation: "NavigationTrack", array: "ArrayGeometry | None", *, known: bool) -> str:
    """Where a drive begins, unless its place on the earth was made up, and how far it reaches with its array."""
    import numpy as np

    from lgprjax.frames import LocalFrame

    latitude, longitude = float(navigation.latitude_deg[0]), float(navigation.longitude_deg[0])
    frame = LocalFrame(latitude, longitude, 0.0)
    zeros = np.zeros(len(navigation.latitude_deg))
    east, north, _ = frame.to_local(navigation.latitude_deg, navigation.longitude_deg, zeros)
    yaw = frame.yaw_of_heading(navigation.heading_deg, navigation.longitude_deg)
    y_m = (0.0,) if array is None else (float(np.min(array.y_m)), float(np.max(array.y_m)))
    spans = (
        float(np.ptp([values + side * y for y in y_m])) for values, side in ((east, -np.sin(yaw)), (north, np.cos(yaw)))
    )
    across, up = (
        f"{span:.2f} m" if span < 10.0 else f"{span:.1f} m" if span < 1e4 else f"{span / 1e3:.1f} km" for span in spans
    )
    extent = f"{across} from west to east, {up} from south to north"
    if not known:
        return f"extent: {extent}"
    longitude = (longitude + 180.0) % 360.0 - 180.0
    letters = "N" if latitude >= 0.0 else "S", "E" if longitude >= 0.0 else "W"
    return f"place: {abs(latitude):.4f} {letters[0]}, {abs(longitude):.4f} {letters[1]}; extent: {extent}"


# ``lgprjax import grounded|cmu|gprmax``: published data sets and simulations to drive logs.


@dataclass(frozen=True)
class ImportGrounded:
    """A run in the layout of the GROUNDED data set: run.npy and run_UTM_point.npy."""

    run_dir: Annotated[
        Positional[Path],
        arg(
            metavar="RUN_DIR",
            help="folder with run.npy [scan, sample, channel] and run_UTM_point.npy [scan, channel, 2]",
        ),
    ]
    output: Output
    utm_zone: str
    """UTM zone of the points, such as 19N"""
    sample_interval_ns: float
    """two-way travel time between samples"""
    scan_rate_hz: float
    """scans per second"""
    time_zero_ns: float = 0.0
    """time from the first sample to time zero (not published with the data set)"""
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
                time_zero_ns=self.time_zero_ns,
                output=self.output,
                force=self.force,
            )
        finished(self.output)


@dataclass(frozen=True)
class ImportCmu:
    """A sequence of the CMU-GPR data set: gpr_meas.csv, we_odom.csv and, if available, ts_meas.csv.

    The sequences have no latitude and longitude: the total station's origin is placed at the site's origin, its x axis
    along the heading. A sequence without total station drives straight along the heading by its odometry.
    """

    sequence_dir: Annotated[Positional[Path], arg(metavar="SEQUENCE_DIR", help="folder with the CSV files")]
    output: Output
    time_window_ns: float
    """two-way travel time of a trace (not published with the data set)"""
    time_zero_ns: float = 0.0
    """time from the first sample to time zero"""
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
    file lacks positions: give --step-m. The simulation's picoseconds are resampled without aliasing.
    """

    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILE...", help="the traces, or one merged B-scan")]
    output: Output
    component: str | None = None
    """field component, such as Ez; default: Ez, or the only one in the files"""
    receiver: int = 1
    """number of the receiver"""
    sample_interval_ns: float | None = None
    """interval to resample to; default: the coarsest that keeps 99.99 % of the energy"""
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


# ``lgprjax import mcap``: a recording of ROS 2 messages to a drive log.


@dataclass(frozen=True)
class ImportMcap:
    """A recording of ROS 2 messages, .mcap (needs: pip install lgprjax[log]).

    Scans come from messages RadarScan, positions from NavSatFix, headings from an Imu with orientation or a
    PoseWithCovarianceStamped, travel from Odometry; docs/transfer.md has their definitions. Topics are found by their
    types. A truncated file is read as far as it is intact.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    radar_topic: str | None = None
    """topic of the scans, if there are several"""
    array_topic: str | None = None
    """topic of the message RadarArray, if there are several"""
    gnss_topic: str | None = None
    """topic of the positions, if there are several"""
    heading_topic: str | None = None
    """topic of the headings; one of type Odometry must be given explicitly, with headings relative to east"""
    odometry_topic: str | None = None
    """topic of the odometer, if there are several"""
    channel_pitch_m: float | None = None
    """distance between neighbouring channels of an array that no message describes"""
    array_x_m: float | None = None
    """how far ahead of the rear axle that array is"""
    array_height_m: float | None = None
    """how high above the ground that array is"""
    gnss_m: Annotated[tuple[float, float, float], arg(metavar="X Y Z")] = (0.0, 0.0, 0.0)
    """place of the GNSS antenna: forward and left of the rear axle, above the ground"""
    gnss_sigma_m: float | None = None
    """sigma of positions whose messages state no covariance"""
    heading_sigma_deg: float | None = None
    """sigma of headings whose messages state no covariance"""
    force: Force = False

    def run(self) -> None:
        """Import."""
        for name in ("channel_pitch_m", "gnss_sigma_m", "heading_sigma_deg"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < 1e3:
                raise UsageError(f"--{name.replace('_', '-')}: expected a number above zero, found {value:g}")
        from lgprjax.formats import McapAssumed, McapTopics, UniformArray, import_mcap

        given = (self.channel_pitch_m, self.array_x_m, self.array_height_m)
        array = UniformArray(self.channel_pitch_m, self.array_x_m or 0.0, self.array_height_m or 0.0)
        with working(f"importing {self.file}"):
            imported = import_mcap(
                self.file,
                topics=McapTopics(
                    self.radar_topic, self.array_topic, self.gnss_topic, self.heading_topic, self.odometry_topic
                ),
                array=None if given == (None, None, None) else array,
                assumed=McapAssumed(self.gnss_m, self.gnss_sigma_m, self.heading_sigma_deg),
                output=self.output,
                force=self.force,
            )
        finished(self.output)
        for note in imported.notes:
            console.print(note, highlight=False, markup=False, soft_wrap=True)


@dataclass(frozen=True)
class ImportRosbag(ImportMcap):
    """A ROS bag: ROS 1 (.bag), or ROS 2 in SQLite (.db3 or its folder; needs: pip install lgprjax[rosbag]).

    Scans come from messages RadarScan, positions from NavSatFix, headings from an Imu with orientation or a
    PoseWithCovarianceStamped, travel from Odometry; docs/transfer.md has their definitions. Topics are found by their
    types. ROS 2 bags in MCAP are read by lgprjax import mcap.
    """


# ``lgprjax import signals``: a vehicle's signals out of a table or a recording.


@dataclass(frozen=True)
class ImportSignals:
    """A vehicle's signals from a table or a recording: .csv, .parquet or .mcap, for the studies of lgprjax tune.

    The columns of a .csv are separated by commas, semicolons or tabs; with the latter two a comma may be the decimal
    sign. Cells that are no numbers are left out and counted; a column with more than 5 % of them is refused.

    A TOML file says which column is which signal and in which unit: time, speed or travel, latitude and longitude or
    east and north, heading, yaw rate, wheel angles, steering command, volts, pedals. Units are converted; values out of
    a signal's range are refused. tuning/signals.toml is an example.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the table or recording: .csv, .parquet or .mcap")]
    output: Output
    map: Annotated[Path, arg(metavar="COLUMNS.toml", help="which column is which signal, and its unit")]
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import VehicleLog
        from lgprjax.formats.signal_tables import import_signals

        with working(f"importing {self.file}"):
            imported = import_signals(self.file, self.map, self.output, force=self.force)
        rows = ", ".join(f"{name} {count}" for name, count in imported.signals.items())
        _tell(f"{imported.seconds:.1f} s; numbers of each signal: {rows}")
        for name, how in imported.left_out.items():
            _tell(f"left out of {name}: {how}")
        for what, how in imported.assumed.items():
            _tell(f"assumed, as nothing says it: {what}: {how}")
        known = "place on the earth" not in imported.assumed
        _tell(place_in_words(VehicleLog.open(self.output).navigation, None, known=known))
        _tell(f"wrote {self.output}")


@dataclass(frozen=True, kw_only=True)
class _FoundInTraces:
    """Properties estimated from the traces of lines, which may be given instead."""

    output: Output
    length_m: float | None = None
    """length of the lines, if measured by tape; default: the headers' trace spacing"""
    time_zero: Literal["auto", "header"] | float = "auto"
    """auto: the header's if it agrees with the direct wave, else the wave's first break; header; or nanoseconds
    after the first sample"""
    reversed_lines: Literal["auto", "odd", "even"] | tuple[int, ...] = "auto"
    """lines recorded backward: auto detects them; odd or even by the numbers in their names; or numbers from 0"""
    utm_zone: str | None = None
    """UTM zone of a topography, or of SEG-Y coordinates, in metres of that grid, such as 33N"""
    partial: bool = False
    """read the whole traces of a file that is cut short"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def _import(
        self,
        files: tuple[Path, ...],
        *,
        polarity: Literal["auto", "keep"] = "keep",
        line_spacing_m: float | None = None,
        lines_at_m: tuple[float, ...] | None = None,
        first_line_m: float = 0.0,
        sample_interval_ns: float | None = None,
    ) -> None:
        from lgprjax.formats import import_lines

        with working(f"importing {len(files)} file(s)"):
            survey = import_lines(
                files,
                output=self.output,
                line_spacing_m=line_spacing_m,
                lines_at_m=lines_at_m,
                first_line_m=first_line_m,
                length_m=self.length_m,
                time_zero=self.time_zero,
                polarity=polarity,
                reversed_lines=self.reversed_lines,
                sample_interval_ns=sample_interval_ns,
                utm_zone=self.utm_zone,
                partial=self.partial,
                latitude_deg=self.origin.latitude_deg,
                longitude_deg=self.origin.longitude_deg,
                heading_deg=self.origin.heading_deg,
                force=self.force,
            )
        print_survey(survey)
        finished(self.output)


@dataclass(frozen=True, kw_only=True)
class ImportLine(_FoundInTraces):
    """One vendor file as a drive log (each of its channels a line)."""

    suffixes: ClassVar[tuple[str, ...]]

    file: Annotated[
        Positional[Path], arg(metavar="FILE", help="the recording; its header file, if it has one, next to it")
    ]

    def run(self) -> None:
        """Import."""
        if self.file.is_dir():
            raise InputError(self.file, "file", "a recording", "a folder")
        if self.file.suffix.lower() not in self.suffixes:
            expected = f"a name that ends in {' or '.join(self.suffixes)} (lgprjax import FILE recognises the format)"
            raise InputError(self.file, "file name", expected, repr(self.file.name))
        self._import((self.file,))


@dataclass(frozen=True, kw_only=True)
class ImportDt1(ImportLine):
    """Sensors & Software .DT1, with its .HD."""

    suffixes: ClassVar[tuple[str, ...]] = (".dt1",)


@dataclass(frozen=True, kw_only=True)
class ImportDzt(ImportLine):
    """GSSI .DZT."""

    suffixes: ClassVar[tuple[str, ...]] = (".dzt",)


@dataclass(frozen=True, kw_only=True)
class ImportMala(ImportLine):
    """MALA .rd3 (16 bit) or .rd7 (32 bit), with its .rad."""

    suffixes: ClassVar[tuple[str, ...]] = (".rd3", ".rd7")


@dataclass(frozen=True)
class ImportIprb:
    """ImpulseRadar .iprb, with its .iprh. An array writes one file per channel: give all files of the line.

    Several files (LINE_001_A01.iprb LINE_001_A02.iprb ..., in any order) become one multi-channel drive; the headers
    give the place of each channel. One file becomes a single-channel drive.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="the channels of one line, each with its header file"),
    ]
    output: Output
    length_m: float | None = None
    """length of the line, if measured by tape; default: the distance measured by the wheel"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        require_files(self.files, "channels")
        from lgprjax.formats import import_iprb

        with working(f"importing {len(self.files)} file(s)"):
            import_iprb(
                self.files, place=self.origin.place(), length_m=self.length_m, output=self.output, force=self.force
            )
        finished(self.output)


@dataclass(frozen=True)
class ImportSegy:
    """SEG-Y .sgy or .segy (needs: pip install lgprjax[segy]).

    Positions come from the trace headers. Coordinates in degrees, or in metres with --utm-zone, place every trace on
    the earth; otherwise the line runs straight from the origin along the heading.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    sample_interval_ns: float | None = None
    """two-way travel time between samples; needed if the header has no plausible one (picoseconds, 10 to 2000)"""
    time_zero_ns: float = 0.0
    """time from the first sample to time zero"""
    utm_zone: str | None = None
    """UTM zone of coordinates in metres, such as 19N"""
    length_m: float | None = None
    """length of the line, if measured by tape; the headers' coordinates are then ignored"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import import_segy

        with working(f"importing {self.file}"):
            notes = import_segy(
                self.file,
                sample_interval_ns=self.sample_interval_ns,
                time_zero_ns=self.time_zero_ns,
                utm_zone=self.utm_zone,
                place=self.origin.place(),
                length_m=self.length_m,
                output=self.output,
                force=self.force,
            )
        for note in notes:
            _tell(f"note: {note}")
        finished(self.output)


@dataclass(frozen=True, kw_only=True)
class ImportLines(_FoundInTraces):
    """Lines of a survey (DT1, DZT, rd3, rd7, iprb or SEG-Y) as one drive log.

    Their places come from a tape (--lines-at-m or --line-spacing-m), or from files next to them: a topography
    (topo_NAME.txt, NAME.xyz or NAME.csv: a row of N, E, Z for each trace) or a receiver's (.GPS, .DZG, .cor); those of
    SEG-Y lines also from the coordinates of their headers. Time zero, sign, direction and start of each line are
    estimated from its traces and listed.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="the lines, leftmost first, with their header files next to them"),
    ]
    line_spacing_m: float | None = None
    """distance between neighbouring lines"""
    lines_at_m: tuple[float, ...] | None = None
    """place of each line to the right of the site's origin, such as 0 0.25 0.5 1.0"""
    first_line_m: float = 0.0
    """with --line-spacing-m: distance of the first line to the right of the site's origin"""
    polarity: Literal["auto", "keep"] = "auto"
    """auto: lines with a sign opposite to the majority are inverted; keep: as recorded"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of SEG-Y lines, if missing in their headers"""

    def run(self) -> None:
        """Import."""
        require_files(self.files, "lines")
        self._import(
            self.files,
            polarity=self.polarity,
            line_spacing_m=self.line_spacing_m,
            lines_at_m=self.lines_at_m,
            first_line_m=self.first_line_m,
            sample_interval_ns=self.sample_interval_ns,
        )
