"""``lgprjax import FORMAT``: vendor files to drive logs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.import_mcap import ImportMcap
from lgprjax.cli.import_parts import Force, Origin, Output, finished
from lgprjax.cli.import_sets import ImportCmu, ImportGprMax, ImportGrounded
from lgprjax.cli.progress import working
from lgprjax.errors import InputError


@dataclass(frozen=True)
class ImportLine:
    """One vendor file as a drive log (each of its channels a line)."""

    suffixes: ClassVar[tuple[str, ...]]

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording; its header file lies beside it")]
    output: Output
    length_m: float | None = None
    """length of the line, where it was measured by tape; without it the header's trace spacing counts"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        if self.file.suffix.lower() not in self.suffixes:
            expected = "a name that ends in " + " or ".join(self.suffixes)
            raise InputError(self.file, "file name", expected, repr(self.file.name))
        from lgprjax.formats import import_lines

        with working(f"importing {self.file}"):
            import_lines(
                (self.file,),
                line_spacing_m=0.2,
                length_m=self.length_m,
                latitude_deg=self.origin.latitude_deg,
                longitude_deg=self.origin.longitude_deg,
                heading_deg=self.origin.heading_deg,
                output=self.output,
                force=self.force,
            )
        finished(self.output, self.origin)


@dataclass(frozen=True)
class ImportDt1(ImportLine):
    """Sensors & Software .DT1, its .HD beside it."""

    suffixes: ClassVar[tuple[str, ...]] = (".dt1",)


@dataclass(frozen=True)
class ImportDzt(ImportLine):
    """GSSI .DZT."""

    suffixes: ClassVar[tuple[str, ...]] = (".dzt",)


@dataclass(frozen=True)
class ImportMala(ImportLine):
    """MALA .rd3 (16 bit) or .rd7 (32 bit), its .rad beside it."""

    suffixes: ClassVar[tuple[str, ...]] = (".rd3", ".rd7")


@dataclass(frozen=True)
class ImportIprb:
    """ImpulseRadar .iprb, its .iprh beside it. An array writes one file a channel: name all files of the line.

    Several files (LINE_001_A01.iprb LINE_001_A02.iprb ..., in any order) become one multi-channel drive; their headers
    say where each channel is. One file becomes a single-channel drive.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="the channels of one line; the header file of each lies beside it"),
    ]
    output: Output
    length_m: float | None = None
    """length of the line, where it was measured by tape; without it the distance that the wheel measured counts"""
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
        finished(self.output, self.origin)


@dataclass(frozen=True)
class ImportSegy:
    """SEG-Y .sgy or .segy (needs: pip install lgprjax[segy]).

    Positions come from the trace headers. Coordinates in degrees, or in metres with --utm-zone, put every trace on the
    map; otherwise the line runs straight from the origin along the heading.
    """

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording")]
    output: Output
    sample_interval_ns: float | None = None
    """two-way travel time between samples; needed where the header holds no plausible one (picoseconds, 10 to 2000)"""
    time_zero_ns: float = 0.0
    """how long after the first sample time zero lies"""
    utm_zone: str | None = None
    """UTM zone of coordinates in metres, such as 19N"""
    length_m: float | None = None
    """length of the line, where it was measured by tape; the headers' coordinates then do not count"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        from lgprjax.formats import import_segy

        with working(f"importing {self.file}"):
            placed = import_segy(
                self.file,
                sample_interval_ns=self.sample_interval_ns,
                time_zero_ns=self.time_zero_ns,
                utm_zone=self.utm_zone,
                place=self.origin.place(),
                length_m=self.length_m,
                output=self.output,
                force=self.force,
            )
        finished(self.output, None if placed else self.origin)


@dataclass(frozen=True)
class ImportLines:
    """Parallel lines (DT1, DZT, rd3, rd7, iprb or SEG-Y), from left to right, as one multi-channel survey."""

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="the lines, leftmost first; their header files lie beside them"),
    ]
    output: Output
    line_spacing_m: float
    """distance between neighbouring lines"""
    first_line_m: float = 0.0
    """distance of the first line to the right of the site's origin"""
    length_m: float | None = None
    """spread every line evenly over this length (ends on the tape)"""
    reversed_lines: tuple[int, ...] = field(default=())
    """numbers (from 0) of the lines that were recorded backwards"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of SEG-Y lines whose headers do not say it"""
    origin: Origin = field(default_factory=Origin)
    force: Force = False

    def run(self) -> None:
        """Import."""
        require_files(self.files, "lines")
        from lgprjax.formats import import_lines

        with working(f"importing {len(self.files)} file(s)"):
            import_lines(
                self.files,
                line_spacing_m=self.line_spacing_m,
                first_line_m=self.first_line_m,
                length_m=self.length_m,
                reversed_lines=self.reversed_lines,
                sample_interval_ns=self.sample_interval_ns,
                latitude_deg=self.origin.latitude_deg,
                longitude_deg=self.origin.longitude_deg,
                heading_deg=self.origin.heading_deg,
                output=self.output,
                force=self.force,
            )
        finished(self.output, self.origin)


ImportVerb = (
    Annotated[ImportDt1, tyro.conf.subcommand("dt1")]
    | Annotated[ImportDzt, tyro.conf.subcommand("dzt")]
    | Annotated[ImportMala, tyro.conf.subcommand("mala")]
    | Annotated[ImportIprb, tyro.conf.subcommand("iprb")]
    | Annotated[ImportSegy, tyro.conf.subcommand("segy")]
    | Annotated[ImportLines, tyro.conf.subcommand("lines")]
    | Annotated[ImportGrounded, tyro.conf.subcommand("grounded")]
    | Annotated[ImportCmu, tyro.conf.subcommand("cmu")]
    | Annotated[ImportGprMax, tyro.conf.subcommand("gprmax")]
    | Annotated[ImportMcap, tyro.conf.subcommand("mcap")]
)
