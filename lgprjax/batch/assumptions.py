"""Assumptions behind a map's labels that no instrument recorded; drives away from a map, and those it was made of."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyproj
from scipy.spatial import KDTree

from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, MapFile, MapHistory, assumed_of

UNSTATED = "sigma not stated (fixes are relative to the map's labels)"
"""Note on labels whose navigation states no errors."""
_NEAR_M = 50.0
"""A drive that never comes this close is not next to the map, but elsewhere."""
_NO_LABELS = ("time", "speed")
_GEOD = pyproj.Geod(ellps="WGS84")


def map_assumed(source: MapFile) -> tuple[dict[str, str], ...]:
    """Assumptions made for each baseline; a map's labels do not depend on clocks and speeds."""
    rows = (assumed_of(row) for row in MapHistory.of(source).inputs)
    return tuple({name: words for name, words in row.items() if name not in _NO_LABELS} for row in rows)


def map_assumed_in_words(source: MapFile) -> str | None:
    """The same as one line; None without assumptions."""
    return assumptions_by_baseline(map_assumed(source))


def assumptions_by_baseline(rows: Sequence[Mapping[str, str]]) -> str | None:
    """Assumptions as one line, with the numbers of the baselines where they do not hold for all."""
    found: dict[tuple[str, str], list[str]] = {}
    for number, row in enumerate(rows):
        for each in row.items():
            found.setdefault(each, []).append(str(number))
    words = [
        f"{name} ({words})" + (f" in baseline {', '.join(numbers)}" if len(numbers) < len(rows) else "")
        for (name, words), numbers in found.items()
    ]
    return ", ".join(words) or None


def distance_to_map_m(source: MapFile, log: DriveLog) -> float:
    """Horizontal distance from the drive's nearest recorded position to the nearest station of the map, m."""
    navigation, pose = log.description.navigation, source.pose
    east_north = (pose[:, 0].astype(np.float64), pose[:, 1].astype(np.float64))
    latitude, longitude, _ = source.description.frame.to_geodetic(*east_north, np.zeros(len(pose)))
    away, station = KDTree(_on_sphere(latitude, longitude)).query(
        _on_sphere(navigation.latitude_deg, navigation.longitude_deg)
    )
    nearest = int(np.argmin(away))
    there = station[nearest]
    here = (float(navigation.longitude_deg[nearest]), float(navigation.latitude_deg[nearest]))
    return float(_GEOD.inv(*here, float(longitude[there]), float(latitude[there]))[2])


def away_in_words(source: MapFile, log: DriveLog) -> str | None:
    """Distance of a drive from the map, in words; None where it comes close."""
    away_m = distance_to_map_m(source, log)
    if away_m <= _NEAR_M + 0.5 * source.description.array_width_m:
        return None
    words = f"{away_m:.0f} m" if away_m < 1e3 else f"{away_m / 1e3:.1f} km"
    return f"the drive is {words} from the map {source.description.name} (nearest point)"


def is_place_assumed(source: MapFile, log: DriveLog) -> bool:
    """Whether the place on the earth of the drive, or of a baseline of the map, is assumed."""
    return any("place on the earth" in each for each in (assumed_of(log.description.provenance), *map_assumed(source)))


def is_baseline(source: MapFile, log: DriveLog) -> bool:
    """Whether the map was made of this very drive."""
    # The hash reads the whole log: it is taken where the rest is alike.
    head = {"t0_utc": log.description.t0_utc, "scans": log.scans}
    alike = [row for row in MapHistory.of(source).inputs if all(row.get(name) == head[name] for name in head)]
    return bool(alike) and file_hash(log.path) in [row.get("sha256") for row in alike]


def _on_sphere(latitude_deg: np.ndarray, longitude_deg: np.ndarray) -> np.ndarray:
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    cos = np.cos(latitude)
    return np.stack([cos * np.cos(longitude), cos * np.sin(longitude), np.sin(latitude)], axis=1)
