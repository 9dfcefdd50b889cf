"""``lgprjax radar``: calibrate a stepped-frequency radar from sweeps of an array that stands still."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs
from lgprjax.cli.terminal import UsageError, console, progress_bar, require_files, say, verdict
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.recordings.radar_calibration import Calibrated, StandingSweeps, SweepSource

Sweeps = Annotated[
    Positional[tuple[Path, ...]],
    arg(metavar="SWEEPS...", help="run folders (mode record), drive logs or recordings of ROS messages with sweeps"),
]
Output = Annotated[
    Path, arg(aliases=["-o"], metavar="X.radar.h5", help="calibration to write; its picture, X.radar.png, beside it")
]


@dataclass(frozen=True)
class RadarLookup:
    """Make the look-up calibration from sweeps into empty space: the array stands still, nothing is in view.

    Each check is listed with its limits: a warning or a rejection. The configuration of a run ([radar] calibration) and
    lgprjax import use the file.
    """

    sweeps: Sweeps
    output: Output
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Calibrate."""
        from lgprjax.recordings.radar_calibration import lookup_of

        sources = _sources(self.sweeps)
        shown = _check_outputs(self.output, force=self.force)
        found = lookup_of(_averaged(sources))
        _finish(found, self.sweeps, self.output, shown, force=self.force)
        verdict(
            f"wrote {self.output} and {shown.name}: look-up of {found.standing.scans} scans",
            f"radar plate SWEEPS... --lookup {self.output} -o Y.radar.h5",
        )


@dataclass(frozen=True)
class RadarPlate:
    """Measure gain and delay of each channel over a metal plate that is equally far from all channels.

    The output has the look-up as well. Each check is listed with its limits: a warning or a rejection. Channels whose
    echo disagrees with that of the others are marked and not used.
    """

    sweeps: Sweeps
    lookup: Annotated[Path, arg(metavar="L.radar.h5", help="look-up of the same array, from lgprjax radar lookup")]
    output: Output
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Calibrate."""
        from lgprjax.formats import read_radar_calibration
        from lgprjax.recordings.radar_calibration import response_of

        sources = _sources(self.sweeps)
        lookup = read_radar_calibration(self.lookup, sources[0].layout)
        shown = _check_outputs(self.output, force=self.force)
        found = response_of(_averaged(sources), lookup, self.sweeps[0])
        _finish(found, (*self.sweeps, self.lookup), self.output, shown, force=self.force)
        gain, delay_ns, valid = found.known.channel_gain, found.known.channel_delay_ns, found.known.channel_valid
        assert gain is not None
        assert delay_ns is not None
        assert valid is not None
        table = Table("channel", "gain", "delay, ns", "used")
        for number, row in enumerate(zip(gain, delay_ns, valid, strict=True)):
            table.add_row(str(number), f"{row[0]:.3f}", f"{row[1]:+.3f}", "yes" if row[2] else "no")
        console.print(table)
        verdict(
            f"wrote {self.output} and {shown.name}: gain and delay of {valid.sum()} of {len(valid)} channels",
            f"check {self.output}",
        )


def _check_outputs(output: Path, *, force: bool) -> Path:
    """Place of the picture, after checks of both outputs."""
    if not output.name.endswith(".radar.h5"):
        raise UsageError(f"--output: expected a file name that ends in .radar.h5, found {output.name!r}")
    shown = output.with_suffix(".png")
    check_outputs(output, shown, force=force)
    return shown


def _sources(paths: tuple[Path, ...]) -> "list[SweepSource]":
    from lgprjax.recordings.radar_calibration import sweeps_of

    require_files(paths, "sweeps")
    if len(set(paths)) < len(paths):
        raise InputError(next(path for path in paths if paths.count(path) > 1), "sweeps", "each once", "twice")
    return [sweeps_of(path) for path in paths]


def _averaged(sources: "list[SweepSource]") -> "StandingSweeps":
    from lgprjax.recordings.radar_calibration import average_sweeps

    with progress_bar("averaging sweeps", sum(source.scans for source in sources)) as progress:
        return average_sweeps(sources, progress)


def _finish(found: "Calibrated", inputs: tuple[Path, ...], output: Path, shown: Path, *, force: bool) -> None:
    """Print the checks; write calibration and picture unless one of them rejects the recording."""
    import numpy as np

    from lgprjax.formats import write_radar_calibration
    from lgprjax.recordings.radar_calibration import refuse_bad
    from lgprjax.report.radar_calibration import RadarCalibrationPicture, draw_radar_calibration

    table = Table("check", "found", "expected", "rejected at", "verdict")
    styles = {"good": "green", "look": "yellow", "bad": "bold red"}
    words = {"good": "good", "look": "warning", "bad": "rejected"}
    for each in found.checks:
        side = "below" if each.bad > each.look else "above"
        limits = (f"{side} {each.look:g} {each.unit}", f"{each.bad:g} {each.unit}")
        judged = Text(words[each.verdict], styles[each.verdict])
        table.add_row(each.name, f"{each.value:.3g} {each.unit}", *limits, judged)
    console.print(table)
    refuse_bad(inputs[0], found.checks)
    for each in found.checks:
        if each.verdict == "look":
            say(f"warning: {each.name}: {each.meaning}")
    known = found.known
    valid = np.ones(len(known.lookup_sweeps), bool) if known.channel_valid is None else known.channel_valid
    provenance = {
        "inputs": [path.name for path in inputs],
        "scans": found.standing.scans,
        "checks": [each._asdict() for each in found.checks],
    }
    write_radar_calibration(output, known, provenance, force=force)
    gain, delay_ns = (
        None if values is None else np.where(valid, values, np.nan)
        for values in (known.channel_gain, known.channel_delay_ns)
    )
    picture = RadarCalibrationPicture(
        name=output.name.removesuffix(".radar.h5"),
        frequencies_hz=known.frequencies_hz,
        group_delay_ns=known.group_delay_ns,
        empty=known.lookup_sweeps[valid] / known.lookup_calibration_sweep,
        noise=found.standing.noise[valid],
        calibration=found.standing.calibration,
        echo=found.echo,
        gain=gain,
        delay_ns=delay_ns,
    )
    draw_radar_calibration(picture, shown, force=force)
