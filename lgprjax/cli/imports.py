"""``lgprjax import FORMAT``: vendor files to drive logs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from tyro.conf import Positional, arg

from lgprjax.cli.terminal import UsageError, counted, require_files, say, verdict, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import NavigationTrack, Survey, SurveyOrigin
    from lgprjax.radar.array import ArrayGeometry


# Common parts of the import commands: output, origin of the site, closing lines.

Output = Annotated[Path, arg(aliases=["-o"], metavar="X.drive.h5", help="drive log to write")]
Force = Annotated[bool, arg(help="replace existing outputs")]


@dataclass(frozen=True)
class Origin:
    """Position of the recording on the earth."""

    latitude_deg: float = 0.0
    """latitude of the local origin, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the local origin, WGS-84"""
    heading_deg: float = 90.0
    """compass heading of the lines, clockwise from true north"""

    def place(self) -> "SurveyOrigin":
        """The origin as the importers need it."""
        from lgprjax.formats import SurveyOrigin

        return SurveyOrigin(self.latitude_deg, self.longitude_deg, self.heading_deg)


def print_survey(survey: "Survey") -> None:
    """Print a table of the properties of each line, in samples and metres."""
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
        say("  ".join(cells).rstrip())
    say(
        "header, break (first break of the direct wave), wave (strongest lobe) and zero (time zero) in samples; "
        f"r: correlation with the previous line; positions from: {survey.placed_by}"
    )
    for note in survey.notes:
        say(f"note: {note}")


def _sample(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def finished(verb: Any) -> None:
    """Print assumed quantities, with the options of the verb that set them, position and extent, and its output."""
    from lgprjax.formats import DriveLog, assumed_in_words, assumed_of

    output: Path = verb.output
    with DriveLog.open(output) as log:
        description = log.description
        size = f"{counted(log.scans, 'scan')}, {counted(log.channels, 'channel')}"
    assumed = assumed_of(description.provenance)
    if assumed:
        say(f"assumed, not recorded: {assumed_in_words(assumed)}")
    if "time zero" in assumed and hasattr(verb, "time_zero_ns"):
        say("time zero was set to the first sample (see --time-zero-ns)")
    if "place on the earth" in assumed and hasattr(verb, "origin"):
        say("the local origin was set to latitude 0, longitude 0 (see --latitude-deg)")
    say(place_in_words(description.navigation, description.array, known="place on the earth" not in assumed))
    verdict(f"wrote {output}: {size}", f"check {output} --health")


def place_in_words(navigation: "NavigationTrack", array: "ArrayGeometry | None", *, known: bool) -> str:
    """Start position of a drive, unless it was assumed, and the extent of drive and array."""
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
    extent = f"{across} west to east, {up} south to north"
    if not known:
        return f"extent: {extent}"
    longitude = (longitude + 180.0) % 360.0 - 180.0
    letters = "N" if latitude >= 0.0 else "S", "E" if longitude >= 0.0 else "W"
    return f"place: {abs(latitude):.4f} {letters[0]}, {abs(longitude):.4f} {letters[1]}; extent: {extent}"


# ``lgprjax import grounded|cmu|gprmax``: published data sets and simulations to drive logs.


@dataclass(frozen=True)
class ImportGrounded:
    """Import a run in the layout of the GROUNDED data set: run.npy and run_UTM_point.npy."""

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
        finished(self)


@dataclass(frozen=True)
class ImportCmu:
    """Import a sequence of the CMU-GPR data set: gpr_meas.csv, we_odom.csv and, if present, ts_meas.csv.

    The sequences have no latitude and longitude. The origin of the total station is placed at the local origin, its x
    axis along the heading. Without total station the drive is a straight line along the heading, by odometry.
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
        finished(self)


@dataclass(frozen=True)
class ImportGprMax:
    """Import gprMax results: the .out (version 3) or .h5 (version 4) files of one B-scan, or one merged file.

    Single-trace files are ordered by their numbers; each trace lies midway between source and receiver. A merged file
    has no positions: give --step-m. The traces are resampled without aliasing.
    """

    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILE...", help="traces, or one merged B-scan")]
    output: Output
    component: str | None = None
    """field component, such as Ez; default: Ez, or the only component in the files"""
    receiver: int = 1
    """number of the receiver"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of the drive log; default: the coarsest that keeps 99.99 % of the energy"""
    time_zero_ns: float = 0.0
    """time from the first sample to time zero, such as the delay of the source pulse"""
    first_trace_m: float = 0.0
    """position of the first trace of a merged file, from the local origin"""
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
                start_m=self.first_trace_m,
                step_m=self.step_m,
                place=self.origin.place(),
                output=self.output,
                force=self.force,
            )
        finished(self)


# ``lgprjax import mcap``: a recording of ROS 2 messages to a drive log.


@dataclass(frozen=True)
class ImportMcap:
    """Import a recording of ROS 2 messages, .mcap (needs: pip install lgprjax[log]).

    Scans: RadarScan; positions: NavSatFix; headings: Imu with orientation or PoseWithCovarianceStamped; travel:
    Odometry. docs/transfer.md has the definitions. The message types select the topics. Of a truncated file the intact
    part is imported.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    radar_topic: str | None = None
    """topic of the scans, if several match"""
    array_topic: str | None = None
    """topic of RadarArray, if several match"""
    gnss_topic: str | None = None
    """topic of the positions, if several match"""
    heading_topic: str | None = None
    """topic of the headings; an Odometry topic, with headings relative to east, must be given here"""
    odometry_topic: str | None = None
    """topic of the odometry, if several match"""
    channel_pitch_m: float | None = None
    """distance between neighbouring channels of an array without RadarArray message"""
    array_x_m: float | None = None
    """position of that array, forward of the rear axle"""
    array_height_m: float | None = None
    """height of that array above the ground"""
    gnss_m: Annotated[tuple[float, float, float], arg(metavar="X Y Z")] = (0.0, 0.0, 0.0)
    """position of the GNSS antenna: forward and left of the rear axle, above the ground"""
    gnss_sigma_m: float | None = None
    """sigma of positions without covariance"""
    heading_sigma_deg: float | None = None
    """sigma of headings without covariance"""
    calibration: Annotated[Path | None, arg(metavar="X.radar.h5")] = None
    """calibration of a stepped-frequency radar, from lgprjax radar; replaces the look-up in RadarArray"""
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
                calibration=self.calibration,
                output=self.output,
                force=self.force,
            )
        for note in imported.notes:
            say(note)
        finished(self)


@dataclass(frozen=True)
class ImportRosbag(ImportMcap):
    """Import a ROS bag: ROS 1 (.bag), or ROS 2 in SQLite (.db3 or its folder; needs: pip install lgprjax[rosbag]).

    Scans: RadarScan; positions: NavSatFix; headings: Imu with orientation or PoseWithCovarianceStamped; travel:
    Odometry. docs/transfer.md has the definitions. The message types select the topics. For ROS 2 bags in MCAP use
    lgprjax import mcap.
    """


# ``lgprjax import signals``: vehicle signals from a table or a recording.


@dataclass(frozen=True)
class ImportSignals:
    """Import vehicle signals from a table or a recording, .csv, .parquet or .mcap, for lgprjax tune.

    A TOML file, such as tuning/signals.toml, assigns columns to signals and units: time, speed or travel, latitude and
    longitude or east and north, heading, yaw rate, wheel angles, steering command, volts, pedals. The command converts
    units and rejects values outside the range of a signal.

    The columns of a .csv are separated by commas, semicolons or tabs; with semicolons or tabs the decimal sign may be a
    comma. Cells without a number are skipped and counted; a column with more than 5 % of them is rejected.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="table or recording: .csv, .parquet or .mcap")]
    output: Output
    columns: Annotated[Path, arg(metavar="COLUMNS.toml", help="TOML file that assigns columns to signals and units")]
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import VehicleLog
        from lgprjax.formats.signal_tables import import_signals

        with working(f"importing {self.file}"):
            imported = import_signals(self.file, self.columns, self.output, force=self.force)
        rows = ", ".join(f"{name} {count}" for name, count in imported.signals.items())
        say(f"values per signal: {rows}")
        for name, how in imported.left_out.items():
            say(f"skipped in {name}: {how}")
        for what, how in imported.assumed.items():
            say(f"assumed, not recorded: {what}: {how}")
        known = "place on the earth" not in imported.assumed
        say(place_in_words(VehicleLog.open(self.output).navigation, None, known=known))
        verdict(
            f"wrote {self.output}: {imported.seconds:.1f} s, {counted(len(imported.signals), 'signal')}",
            f"check {self.output} --health",
        )


@dataclass(frozen=True, kw_only=True)
class _FoundInTraces:
    """Options of lines whose properties are estimated from the traces."""

    output: Output
    length_m: float | None = None
    """length of the lines, if measured by tape; default: from the trace spacing of the headers"""
    time_zero: Literal["auto", "header"] = "auto"
    """source of time zero: auto (the header if it agrees with the direct wave, else the first break of the wave), or
    header"""
    time_zero_ns: float | None = None
    """time from the first sample to time zero; replaces --time-zero"""
    reversed_lines: Literal["auto", "odd", "even"] | tuple[int, ...] = "auto"
    """lines recorded backward: auto detects them; odd or even line numbers in the file names; or numbers from 0"""
    utm_zone: str | None = None
    """UTM zone of topography or SEG-Y coordinates in metres, such as 33N"""
    partial: bool = False
    """import the complete traces of a truncated file"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def _import(self, files: tuple[Path, ...], *, polarity: Literal["auto", "keep"] = "keep", **own: Any) -> None:
        """Import, with the options that only one command has, by their names in ``import_lines``."""
        from lgprjax.formats import import_lines

        with working(f"importing {len(files)} file(s)"):
            survey = import_lines(
                files,
                output=self.output,
                length_m=self.length_m,
                time_zero=self.time_zero if self.time_zero_ns is None else self.time_zero_ns,
                polarity=polarity,
                reversed_lines=self.reversed_lines,
                utm_zone=self.utm_zone,
                partial=self.partial,
                latitude_deg=self.origin.latitude_deg,
                longitude_deg=self.origin.longitude_deg,
                heading_deg=self.origin.heading_deg,
                force=self.force,
                **own,
            )
        print_survey(survey)
        finished(self)


@dataclass(frozen=True, kw_only=True)
class ImportLine(_FoundInTraces):
    """Import one vendor file; each channel becomes a line."""

    suffixes: ClassVar[tuple[str, ...]]

    file: Annotated[Positional[Path], arg(metavar="FILE", help="recording, with its header file in the same folder")]

    def run(self) -> None:
        """Import."""
        if self.file.is_dir():
            raise InputError(self.file, "file", "a recording", "a folder")
        if self.file.suffix.lower() not in self.suffixes:
            expected = f"a name that ends in {' or '.join(self.suffixes)} (lgprjax import FILE recognises the format)"
            raise InputError(self.file, "file name", expected, repr(self.file.name))
        self._import((self.file,), channel=getattr(self, "channel", None))


@dataclass(frozen=True, kw_only=True)
class ImportDt1(ImportLine):
    """Import a Sensors & Software file, .DT1 with its .HD."""

    suffixes: ClassVar[tuple[str, ...]] = (".dt1",)


@dataclass(frozen=True, kw_only=True)
class ImportDzt(ImportLine):
    """Import a GSSI file, .DZT."""

    suffixes: ClassVar[tuple[str, ...]] = (".dzt",)
    channel: int | None = None
    """channel to import of two antennas in one place, counted from 0"""


@dataclass(frozen=True, kw_only=True)
class ImportMala(ImportLine):
    """Import a MALA file, .rd3 (16 bit) or .rd7 (32 bit), with its .rad."""

    suffixes: ClassVar[tuple[str, ...]] = (".rd3", ".rd7")


@dataclass(frozen=True)
class ImportIprb:
    """Import ImpulseRadar files, .iprb with .iprh. An array writes one file per channel: give all files of the line.

    Several files (LINE_001_A01.iprb LINE_001_A02.iprb ..., in any order) become one multi-channel drive; the headers
    contain the position of each channel. One file becomes a single-channel drive.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="channels of one line, each with its header file"),
    ]
    output: Output
    length_m: float | None = None
    """length of the line, if measured by tape; default: from the measuring wheel"""
    partial: bool = False
    """import the complete traces of truncated files"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        require_files(self.files, "channels")
        from lgprjax.formats import import_iprb

        with working(f"importing {len(self.files)} file(s)"):
            cut = import_iprb(
                self.files,
                place=self.origin.place(),
                length_m=self.length_m,
                partial=self.partial,
                output=self.output,
                force=self.force,
            )
        if cut is not None:
            say(f"note: read {cut}")
        finished(self)


@dataclass(frozen=True)
class ImportSegy:
    """Import a SEG-Y file, .sgy or .segy.

    Coordinates in the trace headers, in degrees, or in metres with --utm-zone, give the position of every trace.
    Without them the line is straight, from the local origin along the heading.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    sample_interval_ns: float | None = None
    """two-way travel time between samples; needed if the header has no plausible value (10 to 2000 ps)"""
    time_zero_ns: float = 0.0
    """time from the first sample to time zero"""
    utm_zone: str | None = None
    """UTM zone of coordinates in metres, such as 19N"""
    length_m: float | None = None
    """length of the line, if measured by tape; replaces the coordinates of the headers"""
    sample_format: Literal["ibm", "ieee"] | None = None
    """coding of float samples; default: that of the header, unless the samples contradict it"""
    partial: bool = False
    """import the complete traces of a truncated file"""
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
                sample_format=self.sample_format,
                utm_zone=self.utm_zone,
                place=self.origin.place(),
                length_m=self.length_m,
                partial=self.partial,
                output=self.output,
                force=self.force,
            )
        for note in notes:
            say(f"note: {note}")
        finished(self)


@dataclass(frozen=True, kw_only=True)
class ImportLines(_FoundInTraces):
    """Import parallel lines of a survey (DT1, DZT, rd3, rd7, iprb or SEG-Y) as one drive log.

    Line positions come from tape measurements (--lines-at-m or --line-spacing-m), from files in the same folder, or
    from SEG-Y headers. Such files are topography (topo_NAME.txt, NAME.xyz or NAME.csv: N, E, Z of each trace) and GNSS
    (.GPS, .DZG, .cor). Time zero, sign, direction and start of each line are estimated from the traces and listed.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="lines, leftmost first, with header files in the same folder"),
    ]
    line_spacing_m: float | None = None
    """distance between neighbouring lines"""
    lines_at_m: tuple[float, ...] | None = None
    """position of each line, to the right of the local origin, such as 0 0.25 0.5 1.0"""
    first_line_m: float = 0.0
    """with --line-spacing-m: position of the first line, to the right of the local origin"""
    polarity: Literal["auto", "keep"] = "auto"
    """auto: invert lines with a sign opposite to the majority; keep: as recorded"""
    channel: int | None = None
    """channel to import of DZT files with several, counted from 0"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of SEG-Y lines, if the headers do not contain it"""
    sample_format: Literal["ibm", "ieee"] | None = None
    """coding of float samples of SEG-Y lines; default: that of the header, unless the samples contradict it"""

    def run(self) -> None:
        """Import."""
        require_files(self.files, "lines")
        self._import(
            self.files,
            polarity=self.polarity,
            line_spacing_m=self.line_spacing_m,
            lines_at_m=self.lines_at_m,
            first_line_m=self.first_line_m,
            channel=self.channel,
            sample_interval_ns=self.sample_interval_ns,
            sample_format=self.sample_format,
        )
