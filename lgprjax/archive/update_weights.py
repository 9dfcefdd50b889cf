"""What a map's baselines are weighed by, measured where it is not known yet: agreement in pairs, and signal."""

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.baseline_strengths import NearPlaces, lay_places, repeats_at, strengths_on
from lgprjax.formats import MapFile
from lgprjax.registration import RegisterOptions, ground_map_for

_SAMPLES = 40
"""Places a pair of baselines is compared at, spread over the stretch that they share."""
_LEAST_SAMPLES = 5


def agreement_with(
    source: MapFile,
    in_force: Bool[np.ndarray, " scan"],
    known: Float[np.ndarray, "known known"],
    strength: Float[np.ndarray, "drive place"],
) -> Float[np.ndarray, "drive_and_new drive_and_new"]:
    """Median strength of the matches of every two baselines; NaN where they share less than a few metres.

    Args:
        source: the map, a new baseline the last one.
        in_force: stations that are compared.
        known: of its first baselines, measured before; it is kept.
        strength: of the new baseline's places on the ground of each of the others.
    """
    drives = len(strength)
    out = np.full((drives + 1, drives + 1), np.nan)
    measured = min(len(known), drives)
    out[:measured, :measured] = known[:measured, :measured]
    for later in range(max(measured, 1), drives):
        places = lay_places(source, later)
        near = NearPlaces(source, places)
        for earlier in range(later):
            kept = in_force & (source.drive == earlier)
            shared = (near.nearest_stations(kept, 0.5 * near.width_m) >= 0) & in_force[places.station]
            chosen = places.station[_spread(np.flatnonzero(shared))]
            out[later, earlier] = out[earlier, later] = _median_of_enough(strengths_on(source, chosen, kept).strength)
    out[drives, :drives] = out[:drives, drives] = [_median_of_enough(row) for row in strength]
    return out


def _median_of_enough(strength: Float[np.ndarray, " place"]) -> float:
    told = strength[np.isfinite(strength)]
    return float(np.median(told)) if len(told) >= _LEAST_SAMPLES else float("nan")


def repeats_of(
    source: MapFile, in_force: Bool[np.ndarray, " scan"], known: Float[np.ndarray, " drive"]
) -> Float[np.ndarray, " drive"]:
    """Median share of each baseline's signal that is ground; measured where it is NaN in ``known``."""
    out = known.copy()
    missing = np.flatnonzero(~np.isfinite(out))
    if len(missing):
        ground = ground_map_for(source, RegisterOptions(search_m=1.5))
        for drive in missing:
            stations = lay_places(source, int(drive)).station
            chosen = stations[_spread(np.flatnonzero(in_force[stations]))]
            if len(chosen):
                out[drive] = float(np.median(repeats_at(source, ground, chosen)))
    return out


def _spread(numbers: Int[np.ndarray, " place"]) -> Int[np.ndarray, " sample"]:
    """At most so many of some numbers, from the first to the last."""
    if len(numbers) <= _SAMPLES:
        return numbers
    return np.asarray(numbers[np.linspace(0, len(numbers) - 1, _SAMPLES).astype(int)])
