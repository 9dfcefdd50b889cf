"""``lgprjax import FORMAT``: vendor files to drive logs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.import_mcap import ImportMcap
from lgprjax.cli.import_parts import Force, Origin, Output, finished, print_survey
from lgprjax.cli.import_sets import ImportCmu, ImportGprMax, ImportGrounded
from lgprjax.cli.progress import working
from lgprjax.errors import InputError


@dataclass(frozen=True, kw_only=True)
class _FoundInTraces:
    """What is looked for in the traces of lines, and may be said instead."""

    output: Output
    length_m: float | None = None
    """length of the lines, where it was measured by tape; without it the headers' trace spacing counts"""
    time_zero: Literal["auto", "header"] | float = "auto"
    """auto: the header's where it agrees with the direct wave, else the wave's first break; header; or nanoseconds
    after the first sample"""
    reversed_lines: Literal["auto", "odd", "even"] | tuple[int, ...] = "auto"
    """lines recorded backwards: auto finds them; odd or even by the numbers in their names; or numbers from 0"""
    utm_zone: str | None = None
    """UTM zone of a topography file in metres of that grid, such as 33N"""
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

    file: Annotated[Positional[Path], arg(metavar="FILE", help="the recording; its header file lies beside it")]

    def run(self) -> None:
        """Import."""
        if self.file.suffix.lower() not in self.suffixes:
            expected = "a name that ends in " + " or ".join(self.suffixes)
            raise InputError(self.file, "file name", expected, repr(self.file.name))
        self._import((self.file,))


@dataclass(frozen=True, kw_only=True)
class ImportDt1(ImportLine):
    """Sensors & Software .DT1, its .HD beside it."""

    suffixes: ClassVar[tuple[str, ...]] = (".dt1",)


@dataclass(frozen=True, kw_only=True)
class ImportDzt(ImportLine):
    """GSSI .DZT."""

    suffixes: ClassVar[tuple[str, ...]] = (".dzt",)


@dataclass(frozen=True, kw_only=True)
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
        finished(self.output)


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
            import_segy(
                self.file,
                sample_interval_ns=self.sample_interval_ns,
                time_zero_ns=self.time_zero_ns,
                utm_zone=self.utm_zone,
                place=self.origin.place(),
                length_m=self.length_m,
                output=self.output,
                force=self.force,
            )
        finished(self.output)


@dataclass(frozen=True, kw_only=True)
class ImportLines(_FoundInTraces):
    """Lines of a survey (DT1, DZT, rd3, rd7, iprb or SEG-Y) as one drive log.

    Where they lie is said by a tape (--lines-at-m or --line-spacing-m), or by files beside them: a topography
    (topo_NAME.txt, NAME.xyz or NAME.csv: a row of N, E, Z a trace) or a receiver's (.GPS, .DZG, .cor). Time zero,
    sign, direction and start of each line are looked for in its traces and listed.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help="the lines, leftmost first; their header files lie beside them"),
    ]
    line_spacing_m: float | None = None
    """distance between neighbouring lines"""
    lines_at_m: tuple[float, ...] | None = None
    """place of each line to the right of the site's origin, such as 0 0.25 0.5 1.0"""
    first_line_m: float = 0.0
    """with --line-spacing-m: distance of the first line to the right of the site's origin"""
    polarity: Literal["auto", "keep"] = "auto"
    """auto: lines of the opposite sign to most are inverted; keep: as recorded"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of SEG-Y lines whose headers do not say it"""

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


_BY_SUFFIX = {
    **dict.fromkeys((".dt1", ".dzt", ".rd3", ".rd7", ".sgy", ".segy", ".iprb"), "lines"),
    ".mcap": "mcap",
    ".out": "gprmax",
}
_BY_CONTENT = {"run.npy": "grounded", "gpr_meas.csv": "cmu"}
"""A file that tells a folder's format."""
_TAPE = ("--line-spacing-m", "--lines-at-m", "--first-line-m")
"""Options that only lines have, and not the formats of a single file."""


def recognised(arguments: Sequence[str]) -> list[str]:
    """Arguments of ``import`` with the format put in, where files are named without one.

    A single SEG-Y file and the channels of one ImpulseRadar line have formats of their own, unless a tape makes lines
    of them. What is not recognised is left as it is.
    """
    words = [str(word) for word in arguments]
    formats = ("dt1", "dzt", "mala", "iprb", "segy", "lines", "grounded", "cmu", "gprmax", "mcap")
    if not words or words[0] in formats:
        return words
    outputs = {i + 1 for i, word in enumerate(words) if word in ("-o", "--output")}
    found = [Path(word) for i, word in enumerate(words) if not word.startswith("-") and i not in outputs]
    taped = any(word.partition("=")[0].replace("_", "-") in _TAPE for word in words)
    for path in found:
        known = next((name for part, name in _BY_CONTENT.items() if (path / part).is_file()), None)
        known = known or _BY_SUFFIX.get(path.suffix.lower())
        if known is None and path.suffix.lower() == ".h5" and not path.name.endswith((".drive.h5", ".map.h5")):
            known = "gprmax"
        if known is None:
            continue
        files = [other for other in found if other.suffix.lower() == path.suffix.lower()]
        if taped:
            return [known, *words]
        if known == "lines" and path.suffix.lower() in (".sgy", ".segy") and len(files) == 1:
            known = "segy"
        if known == "lines" and path.suffix.lower() == ".iprb":
            lines = {re.sub(r"_A\d+$", "", file.stem, flags=re.IGNORECASE) for file in files}
            known = "iprb" if len(lines) == 1 else "lines"
        return [known, *words]
    return words
