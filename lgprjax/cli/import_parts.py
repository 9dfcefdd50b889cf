"""What the import verbs share: the output, the site's origin, and the closing line."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from lgprjax.cli.progress import console

if TYPE_CHECKING:
    from lgprjax.formats import Place, Survey

Output = Annotated[Path, arg(aliases=["-o"], help="drive log to write, X.drive.h5")]
Force = Annotated[bool, arg(help="replace an output that exists")]


@dataclass(frozen=True)
class Origin:
    """Where on the earth the recording is put."""

    latitude_deg: float = 0.0
    """latitude of the site's origin, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the site's origin, WGS-84"""
    heading_deg: float = 90.0
    """direction of the lines, clockwise from true north"""

    def place(self) -> "Place":
        """The origin as the importers take it."""
        from lgprjax.formats import Place

        return Place(self.latitude_deg, self.longitude_deg, self.heading_deg)


def print_survey(survey: "Survey") -> None:
    """One table of what was found in each line, in samples and metres."""
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
        f"r: correlation with the line before; positions from: {survey.placed_by}"
    )


def _tell(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def _sample(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def finished(output: Path) -> None:
    """Say what was written, and what of it no instrument recorded."""
    from lgprjax.formats import DriveLog, assumed_in_words, assumed_of

    with DriveLog.open(output) as log:
        assumed = assumed_of(log.description.provenance)
    if assumed:
        _tell(f"assumed, as no instrument recorded it: {assumed_in_words(assumed)}")
    _tell(f"wrote {output}")
    if "place on the earth" in assumed:
        _tell("the site's origin was put at latitude 0, longitude 0 (see --latitude-deg)")
