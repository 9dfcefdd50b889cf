"""``lgprjax map info``: what a subsurface database covers, how it was made, and what it takes on disk."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.progress import console

if TYPE_CHECKING:
    from lgprjax.registration import Chance

_RISK = 1e-4
UNSTATED = "sigma not stated (fixes are relative to the map's labels)"


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

        figures = print_info(self.file)
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)


def _labels(sigma_m: tuple[float, ...]) -> str:
    """What the navigation of each baseline said of its positions."""
    if not any(sigma_m):
        return UNSTATED
    told = ", ".join("not stated" if sigma == 0.0 else f"{100.0 * sigma:.1f} cm" for sigma in sigma_m)
    return f"sigma {told}"


def _chance(chance: "Chance | None", wavelength_m: float) -> dict[str, object]:
    """What other ground reaches on this map, and what a match must."""
    from lgprjax.registration import ladder_of, least_z

    if chance is None:
        return {"noise_floor": "not in this file: measured at the first registration", "least_score": None}
    pooled = "pooled over many grounds: this map is too small to tell its own"
    least = [round(float(score), 2) for score in least_z(_RISK, chance)]
    return {
        "noise_floor": f"{'own' if chance.own else pooled}; {chance.pieces} independent pieces",
        "least_score": {
            f"{window_m:g} m": score for window_m, score in zip(ladder_of(wavelength_m), least, strict=True)
        },
    }


def print_info(path: Path) -> dict[str, object]:
    """Print the table of a database; the same figures by name."""
    from lgprjax.archive import map_assumed_in_words
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
            "labels": _labels(description.label_sigma_m),
            **_chance(source.chance, description.settings.wavelength_m),
            "weight": [round(weight, 3) for weight in description.weight],
            "retired": int(np.count_nonzero(source.retired)),
            "precision": source.precision.name,
            "bytes_per_m": round(path.stat().st_size / max(along, 1e-9)),
            **{f"bytes_per_m_{part}": round(size / max(along, 1e-9)) for part, size in source.stored_bytes().items()},
            "steps": source.provenance.get("steps"),
        }
        assumed = map_assumed_in_words(source)
    table = Table("quantity", "value", title=f"{path.name}")
    for name, value in figures.items():
        table.add_row(name, _told(value))
    console.print(table)
    if assumed is not None:
        console.print(f"assumed: {assumed}", highlight=False, markup=False, soft_wrap=True)
    return {**figures, "assumed": assumed}


def _told(value: object) -> str:
    if isinstance(value, dict):
        scores = ", ".join(f"{window} {score:.2f}" for window, score in value.items())
        return f"{scores} noise floors by window (risk {_RISK:g}, one search)"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
