"""``lgprjax map``: build a subsurface database, tell what one covers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError, require_files
from lgprjax.cli.progress import console, progress_bar


@dataclass(frozen=True)
class MapBuild:
    """Build a subsurface database from drive logs over the same ground."""

    drives: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="DRIVE...", help="drive logs; the first gives the map its origin and its processing"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], help="database to write, M.map.h5")]
    centre_frequency_mhz: float | None = None
    """centre frequency of the antennas, where the log does not say"""
    force: bool = False
    """replace an output that exists"""

    def run(self) -> None:
        """Build."""
        from lgprjax.archive import build_map
        from lgprjax.formats import DriveLog

        require_files(self.drives, "drives")
        if self.centre_frequency_mhz is not None and not 1.0 <= self.centre_frequency_mhz <= 1e4:
            raise UsageError(f"--centre-frequency-mhz: expected 1 to 10000, found {self.centre_frequency_mhz:g}")
        scans = 0
        for path in self.drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        frequency = None if self.centre_frequency_mhz is None else 1e6 * self.centre_frequency_mhz
        with progress_bar("building map", scans) as progress:
            build_map(self.drives, self.output, centre_frequency_hz=frequency, force=self.force, progress=progress)
        console.print(f"wrote {self.output}", highlight=False, markup=False, soft_wrap=True)
        _print_info(self.output)


@dataclass(frozen=True)
class MapInfo:
    """What a subsurface database covers and how it was made."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace that file if it exists"""

    def run(self) -> None:
        """Print."""
        from lgprjax.cli.figures import write_figures

        figures = _print_info(self.file)
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)


def _print_info(path: Path) -> dict[str, object]:
    from lgprjax.formats import MapFile

    with MapFile.open(path) as source:
        description, pose = source.description, source.pose
        step = np.hypot(*np.diff(pose[:, :2], axis=0).T)
        along = float(step[np.diff(source.drive) == 0].sum())
        low, high = pose[:, :2].min(axis=0), pose[:, :2].max(axis=0)
        figures: dict[str, object] = {
            "name": description.name,
            "anchor_latitude_deg": description.frame.latitude_deg,
            "anchor_longitude_deg": description.frame.longitude_deg,
            "baselines": int(source.drive.max()) + 1,
            "stations": len(pose),
            "length_m": round(along, 2),
            "east_m": [round(float(low[0]), 2), round(float(high[0]), 2)],
            "north_m": [round(float(low[1]), 2), round(float(high[1]), 2)],
            "channels": description.channels,
            "channel_pitch_m": round(description.channel_pitch_m, 4),
            "station_step_m": round(description.settings.step_m, 4),
            "band_mhz": [description.settings.band_low_hz / 1e6, description.settings.band_high_hz / 1e6],
            "travel_time_ns": round(len(description.gain) * description.settings.sample_interval_ns, 2),
            "track_filter_m": round(description.settings.track_filter_m, 2),
            "tiles": len(source.tile_frame),
            "bytes_per_m": round(path.stat().st_size / max(along, 1e-9)),
            "steps": source.provenance.get("steps"),
        }
    table = Table("quantity", "value", title=f"{path.name}")
    for name, value in figures.items():
        table.add_row(name, ", ".join(map(str, value)) if isinstance(value, list) else str(value))
    console.print(table)
    return figures


MapVerb = Annotated[MapBuild, tyro.conf.subcommand("build")] | Annotated[MapInfo, tyro.conf.subcommand("info")]
