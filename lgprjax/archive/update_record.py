"""What updates did to a map: told to the caller, and kept in the map's provenance."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lgprjax.archive.baseline_weights import BaselineWeight


class UpdateStretch(NamedTuple):
    """Ground on which a new drive does not match an old baseline.

    Attributes:
        start_m, stop_m: along the new drive.
        start, stop: latitude_deg and longitude_deg of its ends.
        baseline: the old one.
        strength: of the matches there, and usual: of the new drive's matches.
        agreeing: newer baselines that agree with the drive: the old one's stations there are retired. Without any the
            ground is changed or disturbed, and the old stations stay in force.
    """

    start_m: float
    stop_m: float
    start: tuple[float, float]
    stop: tuple[float, float]
    baseline: int
    strength: float
    usual: float
    agreeing: tuple[int, ...]


class DriveUpdate(NamedTuple):
    """What one drive did to a map.

    Attributes:
        number: of the update, from 1 on.
        name: of the drive.
        baseline: number that the drive has in the map.
        map_sha256: of the map before.
        length_m: of the drive; over_map_m: on the map's ground; located_m: where fixes agree with their neighbours.
        ok_share: of the scans over the map's ground, those whose fix is ok.
        corrected_m: of the drive's way with corrected labels; moved_rms_m, moved_max_m: by how much.
        match_sigma_m: of the corrected labels against the map's ground.
        label_sigma_m: what the map says of the new baseline's labels.
        stations, held_back: of the drive; those that are not in force until a second drive agrees, or not located.
        retired, released: stations of older baselines taken out of force, and brought back.
        changed: stretches that do not match.
    """

    number: int
    name: str
    baseline: int
    map_sha256: str
    length_m: float
    over_map_m: float
    located_m: float
    ok_share: float
    corrected_m: float
    moved_rms_m: float
    moved_max_m: float
    match_sigma_m: float
    label_sigma_m: float
    stations: int
    held_back: int
    retired: int
    released: int
    changed: tuple[UpdateStretch, ...]


class UpdatedMap(NamedTuple):
    """What an update did: drive by drive, and the weights that all baselines have after it, with their files."""

    drives: tuple[DriveUpdate, ...]
    weights: tuple[BaselineWeight, ...]
    files: tuple[str, ...]

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON."""
        weights = [
            {"baseline": number, "file": file, **weight._asdict()}
            for number, (file, weight) in enumerate(zip(self.files, self.weights, strict=True))
        ]
        return {"drives": [plain(drive) for drive in self.drives], "weights": weights}


def plain(value: Any) -> Any:
    """Named tuples as tables, numbers that are not finite as null: what JSON holds."""
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: plain(part) for name, part in value._asdict().items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray):
        return [plain(part) for part in value.tolist()]
    if isinstance(value, float):
        return round(value, 6) if np.isfinite(value) else None
    return value


def file_of(row: dict[str, Any], number: int) -> str:
    """Name of a baseline's file, or its number."""
    return str(row.get("file") or f"baseline {number}").removesuffix(".drive.h5")


def drive_name(path: str | Path) -> str:
    """Name of a drive."""
    return Path(path).name.removesuffix(".drive.h5")
