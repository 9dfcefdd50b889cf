"""``lgprjax view``: draw recordings and maps."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from lgprjax.cli.terminal import UsageError, require_files, verdict, working
from lgprjax.errors import InputError


@dataclass(frozen=True)
class View:
    """Draw a vendor file, a drive log or a map, as a PNG or as an HTML page with zoom.

    Vendor files and drive logs: a radargram, dewowed, background removed, with the gain in the caption; drive logs also
    show a plan of the drive. Maps: time slices at five travel times.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="FILE...",
            help=".dt1, .dzt, .rd3, .rd7, .iprb, .sgy or .segy (with their header files), X.drive.h5, M.map.h5",
        ),
    ]
    output: Annotated[
        Path | None,
        arg(
            aliases=["-o"],
            metavar="PNG|DIR",
            help="picture (with --html: page) to write; for several files, the folder; default: FILE.png here",
        ),
    ] = None
    channel: int | None = None
    """channel to draw, counted from 0; default: all channels up to four, else the middle one"""
    raw: bool = False
    """amplitudes as recorded: no processing, no gain"""
    velocity_m_per_ns: float | None = None
    """wave speed for the depth axis; default: 0.1"""
    sample_interval_ns: float | None = None
    """two-way travel time between samples of a SEG-Y file, if the header does not contain it"""
    html: bool = False
    """write an HTML page with zoom, FILE.html, instead of a PNG"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Draw."""
        from lgprjax.report.views import MAP, check_speed

        require_files(self.files, "files")
        check_speed(self.velocity_m_per_ns)
        outputs = self._outputs()
        for file, output in zip(self.files, outputs, strict=True):
            if file.name.lower().endswith(MAP) and (self.raw or self.channel is not None):
                raise UsageError(f"--raw, --channel: expected files that become radargrams, found the map {file.name}")
            if file.is_dir():
                raise InputError(file, "file", "a recording or a map", "a folder")
            if not file.exists():
                raise InputError(file, "file", "a readable file", "No such file or directory")
            # Checked before drawing starts: the last output may exist.
            if output.exists() and not self.force:
                raise InputError(output, "output", "a new file, or --force", "an existing file")
        for file, output in zip(self.files, outputs, strict=True):
            with working(f"drawing {file}"):
                output.parent.mkdir(parents=True, exist_ok=True)
                self._draw(file, output)
            verdict(f"wrote {output}")

    def _outputs(self) -> list[Path]:
        suffix = ".html" if self.html else ".png"
        if self.output is not None and len(self.files) == 1 and not self.output.is_dir():
            if self.output.suffix.lower() != suffix:
                with_html = "with" if self.html else "without"
                expected = f"a file name that ends in {suffix} {with_html} --html"
                raise UsageError(f"--output: expected {expected}, found {self.output.name!r}")
            return [self.output]
        folder = Path() if self.output is None else self.output
        if folder.exists() and not folder.is_dir():
            raise InputError(folder, "output", "a folder for several files", "a file")
        outputs = [folder / (file.stem + suffix) for file in self.files]
        name, count = Counter(outputs).most_common(1)[0]
        if count > 1:
            raise UsageError(f"files: expected different names, found {count} that become {name.name}")
        return outputs

    def _draw(self, file: Path, output: Path) -> None:
        from lgprjax.radar import WAVE_SPEED_M_PER_NS
        from lgprjax.report import draw_line, draw_map_slices, write_line_page, write_map_page
        from lgprjax.report.views import DRIVE, MAP, stations_of_map, view_of_drive, view_of_profile

        name, speed = file.name.lower(), self.velocity_m_per_ns
        if name.endswith(MAP):
            (write_map_page if self.html else draw_map_slices)(
                stations_of_map(file),
                output,
                wave_speed_m_per_ns=WAVE_SPEED_M_PER_NS if speed is None else speed,
                speed_is="assumed" if speed is None else "given",
                force=self.force,
            )
            return
        if name.endswith(DRIVE):
            view = view_of_drive(file, channel=self.channel, raw=self.raw, speed_m_per_ns=speed)
        else:
            view = view_of_profile(
                file,
                channel=self.channel,
                raw=self.raw,
                speed_m_per_ns=speed,
                sample_interval_ns=self.sample_interval_ns,
            )
        (write_line_page if self.html else draw_line)(view, output, force=self.force)
