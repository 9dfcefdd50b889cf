"""``lgprjax import FORMAT``: vendor files to drive logs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, working
from lgprjax.errors import InputError

Output = Annotated[Path, arg(aliases=["-o"], help="drive log to write, X.drive.h5")]
Force = Annotated[bool, arg(help="replace an output that exists")]


@dataclass(frozen=True)
class ImportLine:
    """One vendor file as a drive log (each of its channels a line)."""

    suffix: ClassVar[str]

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording; its header file lies beside it")]
    output: Output
    latitude_deg: float = 0.0
    """latitude of the first trace, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the first trace, WGS-84"""
    heading_deg: float = 90.0
    """direction of the line, clockwise from true north"""
    length_m: float | None = None
    """length of the line, where it was measured by tape; without it the header's trace spacing counts"""
    force: Force = False

    def run(self) -> None:
        """Import."""
        if self.file.suffix.lower() != self.suffix:
            raise InputError(self.file, "file name", f"a name that ends in {self.suffix}", repr(self.file.name))
        _lines(
            (self.file,),
            spacing_m=0.2,
            first_m=0.0,
            length_m=self.length_m,
            backwards=(),
            place=(self.latitude_deg, self.longitude_deg, self.heading_deg),
            output=self.output,
            force=self.force,
        )


@dataclass(frozen=True)
class ImportDt1(ImportLine):
    """Sensors & Software .DT1, its .HD beside it."""

    suffix: ClassVar[str] = ".dt1"


@dataclass(frozen=True)
class ImportDzt(ImportLine):
    """GSSI .DZT."""

    suffix: ClassVar[str] = ".dzt"


@dataclass(frozen=True)
class ImportMala(ImportLine):
    """MALA .rd3, its .rad beside it."""

    suffix: ClassVar[str] = ".rd3"


@dataclass(frozen=True)
class ImportLines:
    """Parallel lines (DT1, DZT or rd3), from left to right, as one multi-channel survey."""

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
    latitude_deg: float = 0.0
    """latitude of the site's origin, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the site's origin, WGS-84"""
    heading_deg: float = 90.0
    """direction of the lines, clockwise from true north"""
    force: Force = False

    def run(self) -> None:
        """Import."""
        require_files(self.files, "lines")
        _lines(
            self.files,
            spacing_m=self.line_spacing_m,
            first_m=self.first_line_m,
            length_m=self.length_m,
            backwards=self.reversed_lines,
            place=(self.latitude_deg, self.longitude_deg, self.heading_deg),
            output=self.output,
            force=self.force,
        )


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
        console.print(f"wrote {self.output}", highlight=False, markup=False, soft_wrap=True)


def _lines(
    files: tuple[Path, ...],
    *,
    spacing_m: float,
    first_m: float,
    length_m: float | None,
    backwards: tuple[int, ...],
    place: tuple[float, float, float],
    output: Path,
    force: bool,
) -> None:
    from lgprjax.formats import import_lines

    latitude_deg, longitude_deg, heading_deg = place
    with working(f"importing {len(files)} file(s)"):
        import_lines(
            files,
            line_spacing_m=spacing_m,
            first_line_m=first_m,
            length_m=length_m,
            reversed_lines=backwards,
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            heading_deg=heading_deg,
            output=output,
            force=force,
        )
    console.print(f"wrote {output}", highlight=False, markup=False, soft_wrap=True)
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        console.print("the site's origin was put at latitude 0, longitude 0 (see --latitude-deg)", highlight=False)


ImportVerb = (
    Annotated[ImportDt1, tyro.conf.subcommand("dt1")]
    | Annotated[ImportDzt, tyro.conf.subcommand("dzt")]
    | Annotated[ImportMala, tyro.conf.subcommand("mala")]
    | Annotated[ImportLines, tyro.conf.subcommand("lines")]
    | Annotated[ImportGrounded, tyro.conf.subcommand("grounded")]
)
